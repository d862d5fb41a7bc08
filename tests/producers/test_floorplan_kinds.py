"""Plans that do what published ones do are read and built."""

import re
import shutil
from pathlib import Path

import numpy as np
from floor_plans import FLOOR_PLANS
from table import each_row

from vastflow.producers.floorplan.environment import solid_digest
from vastflow.producers.floorplan.files import PlanFile, read_plan_file, read_variation_file
from vastflow.producers.floorplan.grid import grid_of
from vastflow.producers.floorplan.mesh import is_closed, mesh_of
from vastflow.sim.model.digest import digest
from vastflow.sim.world.occupancy import FREE, OCCUPIED

DIGESTS = {
    "corridors": "779bbf7c56e50049106243e73a542534d4bdc8ea0e182320195dba4abd68ec6f",
    "hospital_lobby": "ddd4ff5313d479ce4ecba04e8ab145d316f8e187eab6bca4f9d9c5706b8f1025",
    "nested_rooms": "e81675e3baf8c43a6e78f91e1b69050465d229daab8c5778458201d5f0ede1d7",
    "office_wing": "ed9d73eb4059dc9d752c32ff9e84d048c62aa3e854f6c25b46dc73b02e6149bc",
    "university": "066a977e2b4d6edddbdd7cca5e5cf1c422954e369701dfdc49e5f6e78729477e",
}
"""Digests of the solid and the map together: both enter the scenarios of the paper's campaigns."""

CLINIC = Path(__file__).with_name("test_floorplan_clinic.fpm2")
"""A plan with every kind of part, written as in the draft of the language."""


@each_row("name", sorted(DIGESTS))
def test_shipped_plans_keep_their_digests(name):
    building = read_plan_file(FLOOR_PLANS / f"{name}.fpm").building()
    assert digest(solid_digest(building), grid_of(building).occupancy.digest) == DIGESTS[name]


def test_plan_with_every_kind_of_part_is_built_with_notes():
    building = read_plan_file(CLINIC).building()
    assert len(building.rooms) == 4
    assert [obstacle.name for obstacle in building.obstacles] == ["left", "round", "counter", "buttress", "bench"]
    assert {hole.name for hole in building.holes} == {
        "main", "lobby_ward", "whole_wall", "over_the_corner", "slit", "eye",
    }  # fmt: skip
    noted = [re.sub(r"^.*warning: Entryway (.*): It reaches.*", r"\1", str(note)) for note in building.notes]
    assert noted == ["whole_wall", "whole_wall", "over_the_corner"]


def test_mesh_is_closed_and_doors_are_as_wide_as_their_walls():
    building = read_plan_file(CLINIC).building()
    assert is_closed(mesh_of(building))
    occupancy = grid_of(building).occupancy
    (door,) = [hole for hole in building.holes if hole.name == "whole_wall"]
    for x, cell in ((0.0, FREE), (-0.9, FREE), (0.9, FREE), (-1.2, OCCUPIED), (1.2, OCCUPIED)):
        assert occupancy.cells[occupancy.cell_of(*door.frame.apply((x, 0.25)))] == cell, x


def test_variation_reads_draft_keywords(tmp_path):
    shutil.copy(CLINIC, tmp_path / "clinic.fpm2")
    folder = tmp_path / "variations"
    folder.mkdir()
    (folder / "wards.variation").write_text("""\
// Where the plan is, from here
import "../clinic.fpm2"

aisle : uniform([1.0,1.5,2.0])  // no blanks
lobby_turn : normal(mean=-45.0, std=5)
into_the_room : discrete([
    (0.25, -1.5e-1),
    (.75, 0.3)
])

ward : {
    shape.length: uniform([8.0, 10.0])
    location.pose.translation.x : normal(mean=-0.5, std=0.2)
}
lobby: { wall_thickness : uniform([0.3]) }
lobby.counter: { height : uniform([0.9, 1.1]) }
lobby_ward: { location.translation.x : uniform([-0.2, 0.2]) }
over_the_corner: { pose.translation.x : uniform([-1.9, 1.9]) }
""")
    variation = read_variation_file(folder / "wards.variation").variation()
    samples = [variation.sample(seed) for seed in range(4)]
    assert all(PlanFile("p", sample.text).building().holes for sample in samples)
    rng = np.random.RandomState(2)
    assert samples[2].values["aisle"] == [1.0, 1.5, 2.0][rng.randint(0, 3)]
    assert samples[2].values["lobby_turn"] == np.around(rng.normal(-45.0, 5.0), 2)
    assert len(samples[2].values) == 9
