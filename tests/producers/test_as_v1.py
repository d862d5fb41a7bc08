"""Obstacles placed as version 1 of RoboVAST places them, against its rule read plainly."""

import itertools
import math

import numpy as np
import pytest
from families import made
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from shapely import contains_xy
from shapely.geometry import LineString, Point

from vastflow.producers.campaign import load_campaign
from vastflow.producers.model.configuration import Fragment, Rejection
from vastflow.producers.model.producer import evaluate
from vastflow.sim.model.obstacle import obstacles_of
from vastflow.sim.world import octile
from vastflow.sim.world.map_file import load_map

DIAMETER_M = 0.35
CORRIDOR = ["?" * 16, "?" + "." * 14 + "?", "?" + "." * 14 + "?", "?" * 16]
"""14 m long and 2 m wide, with cells of 1 m."""
NARROW = ["?" * 16, "?" + "." * 14 + "?", "?" * 16]


def obstacles(name="ObstacleVariation", **parameters):
    return made(name, {"placement": "as_v1", "robot_diameter": DIAMETER_M, **parameters})


def boxes(amount, max_distance=0.3, side=0.8):
    return [{"amount": amount, "max_distance": max_distance, "xacro_arguments": f"width:={side}, length:={side}"}]


def with_path(content, length):
    asked = {"path_length": length, "goal_poses": "@goal_pose", "robot_diameter": DIAMETER_M}
    (item,) = evaluate(made("PathVariationRandom", asked), {"map_file": content})
    return {"map_file": content, **item.values}


@pytest.fixture(scope="module")
def wide(drawn_map):
    return with_path(drawn_map(*CORRIDOR, cells=20), 10)


@pytest.fixture(scope="module")
def narrow(drawn_map):
    return with_path(drawn_map(*NARROW, cells=20), 10)


@given(
    amount=st.integers(0, 6),
    max_distance=st.floats(0.0, 1.2),
    side=st.sampled_from([0.2, 0.5, 0.8]),
    shape=st.sampled_from(["box", "cylinder"]),
    seed=st.integers(0, 99),
)
@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_centers_keep_their_distances_and_leave_a_path(wide, amount, max_distance, side, shape, seed):
    size = f"width:={side}, length:={side}" if shape == "box" else f"radius:={side / 2}"
    config = {"amount": amount, "max_distance": max_distance, "model": shape, "xacro_arguments": size}
    (item,) = evaluate(obstacles(obstacle_configs=[config], seed=seed), wide)
    if isinstance(item, Rejection):
        assert item.reason.startswith("as version 1 places them")
        return
    placed = obstacles_of({"static_objects": item.values["static_objects"]})
    centers = [(each.pose.x_m, each.pose.y_m) for each in placed]
    assert len(placed) == amount
    path = LineString(wide["_path"])
    assert all(path.distance(Point(center)) <= max_distance + 1e-5 for center in centers)
    assert all(math.dist(one, other) >= 1.5 * DIAMETER_M for one, other in itertools.combinations(centers, 2))
    stops = [tuple(wide[key]["position"].values()) for key in ("start_pose", "goal_pose")]
    assert all(math.dist(center, stop) >= 2 * DIAMETER_M for center in centers for stop in stops)
    occupancy = load_map(wide["map_file"].path)
    passable = octile.inflated_free(occupancy.free, math.ceil(DIAMETER_M / 2 / occupancy.resolution_m))
    # A box grown by the radius has the corners of a box: cap and join are square.
    grown = [each.footprint().buffer(DIAMETER_M / 2, join_style="mitre") for each in placed]
    centers_m = occupancy.centers_of(np.argwhere(np.ones(occupancy.shape)))
    for each in grown:
        passable &= ~contains_xy(each.buffer(-1e-6), *centers_m.T).reshape(occupancy.shape)
    assert octile.shortest_path(occupancy, passable, np.array(stops)) is not None


def test_version_1_places_box_in_wall_without_room(narrow):
    """A box of 0.8 m in a corridor 1 m wide leaves a path only inside the wall."""
    asked = {"obstacle_configs": boxes(1, max_distance=0.5), "seed": 1}
    (constructive,) = evaluate(obstacles(placement="constructive", **asked), narrow)
    (item,) = evaluate(obstacles(**asked), narrow)
    assert isinstance(constructive, Rejection) and "obstacles fit in" in constructive.reason
    occupancy = load_map(narrow["map_file"].path)
    placed = obstacles_of({"static_objects": item.values["static_objects"]})
    corners = [corner for each in placed for corner in each.footprint().exterior.coords[:-1]]
    assert not all(occupancy.free[occupancy.cell_of(*corner)] for corner in corners)


def test_set_without_room_or_path_is_drawn_ten_times_and_then_rejected(narrow, wide):
    (item,) = evaluate(obstacles(obstacle_configs=boxes(1, max_distance=0.0)), narrow)
    assert item.reason == "as version 1 places them, 10 of 10 sets of 1 obstacles left no path to the goals"
    (item,) = evaluate(obstacles(obstacle_configs=boxes(60, max_distance=0.0, side=0.05)), wide)
    assert item.reason.startswith("as version 1 places them, at most ")
    assert item.reason.endswith(" of 60 obstacles fit in 10 attempts")


def test_obstacle_may_appear_where_the_robot_is(wide):
    asked = {"obstacle_configs": boxes(1, max_distance=0.0, side=0.5), "trigger_distance": 0.1}
    asked |= {"spawn_trigger_point": "point", "spawn_trigger_threshold": "threshold"}
    name = "ObstacleVariationWithDistanceTrigger"
    assert isinstance(evaluate(obstacles(name, **asked), wide)[0], Fragment)
    (constructive,) = evaluate(obstacles(name, placement="constructive", **asked), wide)
    assert "would appear where the robot is" in constructive.reason


FILE = """\
version: 1
configuration:
- name: a
  parameters:
  - map_file: MAP
  variations:
  - PathVariationRandom: {path_length: 10.0, goal_poses: "@goal_pose"}
  - OneOfVariation:
      variations:
      - ObstacleVariation: {obstacle_configs: [{amount: 1, max_distance: 0.5, args: "width:=0.8, length:=0.8"}], seed: 1}
"""


@pytest.fixture
def file(narrow, tmp_path):
    path = tmp_path / "narrow.vast"
    path.write_text(FILE.replace("MAP", narrow["map_file"].path))
    return path


def test_placement_note_is_present_unless_chosen_or_unneeded(file):
    (note,) = load_campaign(file).notes
    assert str(note).endswith(
        "Obstacles keep clear of walls and of each other. Version 1 of RoboVAST places them otherwise, as does "
        "placement: as_v1."
    )
    text = file.read_text()
    for changed in ("seed: 1, placement: as_v1", "seed: 1, placement: constructive", "amount_per_m: 0"):
        file.write_text(text.replace("seed: 1" if "seed" in changed else "amount: 1", changed))
        assert load_campaign(file).notes == ()
