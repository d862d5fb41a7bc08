"""Our own floor plans: buildings in which a robot can go everywhere, made in the promised time."""

import numpy as np
import pytest
import shapely
from floor_plans import FLOOR_PLANS
from scipy import ndimage
from table import each_row

from vastflow.producers.floorplan.files import PlanFile, read_plan_file, read_variation_file
from vastflow.producers.floorplan.grid import grid_of
from vastflow.producers.floorplan.mesh import mesh_of, stl
from vastflow.sim.world import octile

NAMES = ["corridors", "hospital_lobby", "nested_rooms", "office_wing", "university"]
ROBOT_DIAMETER_M = 0.5


def rooms_without_the_robot(building, diameter_m=ROBOT_DIAMETER_M):
    """Rooms in which no place can be reached from the largest connected part of the map."""
    occupancy = grid_of(building).occupancy
    labels, _ = ndimage.label(octile.passable(occupancy, diameter_m / 2), np.ones((3, 3)))
    largest = labels == 1 + int(np.argmax(np.bincount(labels.ravel())[1:]))
    return [room.name for room in building.rooms if not stands_in(occupancy, largest, shapely.Polygon(room.outline))]


def stands_in(occupancy, reached, floor):
    low_x, low_y, high_x, high_y = floor.bounds
    (row, column), (last_row, last_column) = occupancy.cell_of(low_x, low_y), occupancy.cell_of(high_x, high_y)
    rows, columns = np.nonzero(reached[row : last_row + 1, column : last_column + 1])
    x, y = (origin + (cells + 0.5) * occupancy.resolution_m for origin, cells in ((low_x, columns), (low_y, rows)))
    return bool(shapely.contains_xy(floor, x, y).any())


@each_row("name", NAMES)
def test_plan_has_name_of_its_file_and_rooms_for_a_robot(name):
    building = read_plan_file(FLOOR_PLANS / f"{name}.fpm").building()
    assert (building.name, building.notes, rooms_without_the_robot(building)) == (name, (), [])


@each_row("name", NAMES)
def test_rooms_overlap_only_when_nested(name):
    rooms = [shapely.Polygon(room.outline) for room in read_plan_file(FLOOR_PLANS / f"{name}.fpm").building().rooms]
    first, second = shapely.STRtree(rooms).query(rooms, predicate="overlaps")
    assert all(rooms[i].intersection(rooms[j]).area < 1e-6 for i, j in zip(first, second, strict=True))


@each_row("name", NAMES)
def test_samples_of_variations_can_be_driven_everywhere(name):
    variation = read_variation_file(FLOOR_PLANS / f"{name}.variation").variation()
    for seed in range(1 if name == "university" else 5):
        building = PlanFile(f"{name} {seed}", variation.sample(seed).text).building()
        assert rooms_without_the_robot(building, 0.4) == [], seed


def test_university_is_as_large_as_the_real_one():
    low_x, low_y, high_x, high_y = read_plan_file(FLOOR_PLANS / "university.fpm").building().bounds
    assert (high_x - low_x, high_y - low_y) == (pytest.approx(84, abs=1), pytest.approx(87, abs=1))


@each_row("name", NAMES)
def test_floor_plan_renders_within_time_bound(name, loops):
    plan = read_plan_file(FLOOR_PLANS / f"{name}.fpm")
    plan.building()
    assert loops(lambda: grid_of(plan.building())) < 20
    assert loops(lambda: stl(mesh_of(plan.building()))) < 60
