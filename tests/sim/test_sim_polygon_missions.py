"""Missions of a robot with a polygon for a footprint, in two rooms with a door between them."""

import pytest

from vastflow.sim.run import run
from vastflow.sim.world.occupancy import OccupancyMap

LONG = "[[0.35, 0.25], [0.35, -0.25], [-0.35, -0.25], [-0.35, 0.25]]"


@pytest.fixture
def mission(saved, scenario, two_rooms_map):
    """A mission of the long robot through the two rooms' door, which begins at y 1.8 m."""

    def make(controller, door_m, **system):
        cells = two_rooms_map.cells.copy()
        cells[:, 82:86] = 100
        cells[36 : 36 + round(door_m / 0.05), 82:86] = 0
        footprints = {"local_costmap.footprint": LONG, "global_costmap.footprint": LONG}
        map_file = saved(OccupancyMap(cells, 0.05, (0.0, 0.0)))
        return scenario(controller=controller, map_file=map_file, **footprints, **system)

    return make


@pytest.mark.parametrize("controller", ["mppi", "rpp"])
@pytest.mark.parametrize(("door_m", "outcome"), [(0.8, "succeeded"), (0.45, "aborted")])
def test_robot_passes_a_door_lengthwise_and_no_narrower_one(mission, controller, door_m, outcome):
    recording = run(mission(controller, door_m), 0)
    assert recording.run.outcome == outcome
    assert outcome == "succeeded" or recording.columns["x_mm"].max() < 4100


def test_controller_considers_footprint_when_enabled(mission):
    wide = {"local_costmap.width": 6, "local_costmap.height": 6}
    recording = run(mission("mppi", 0.8, **wide, **{"FollowPath.CostCritic.consider_footprint": True}), 0)
    assert recording.run.outcome == "succeeded"
    assert not [event for event in recording.run.events if event.kind == "contact"]
