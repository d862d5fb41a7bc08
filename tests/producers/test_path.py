"""Paths of promised length."""

import itertools
import math
import re

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from table import each_row
from walks import is_walked, walks

from vastflow.producers.catalog.path import PathVariationRandom
from vastflow.producers.model.configuration import Fragment, Rejection
from vastflow.producers.model.conformance import check_producer
from vastflow.producers.model.producer import evaluate
from vastflow.sim.model.pose import pose_of
from vastflow.sim.world.map_file import load_map

HALL = ["#" * 32, *["#" + "." * 30 + "#"] * 30, "#" * 32]
"""A square hall; with 10 cells of 0.05 m a letter it is 15 m wide inside."""


def path_variation(**parameters):
    return PathVariationRandom(PathVariationRandom.Parameters.model_validate(parameters))


@pytest.fixture(scope="module")
def hall(drawn_map):
    return drawn_map(*HALL, cells=10)


def lengths(path):
    return [math.dist(one, other) for one, other in itertools.pairwise(path)]


@given(
    walls=arrays(bool, st.tuples(st.integers(3, 9), st.integers(3, 9)), elements=st.sampled_from([False, False, True])),
    length=st.floats(0.5, 6.0),
    tolerance=st.floats(0.0, 0.8),
    min_distance=st.floats(0.0, 3.0),
    robot_diameter=st.sampled_from([0.3, 0.9, 1.2]),
    seed=st.integers(0, 9),
)
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_path_is_as_promised_or_no_such_path_exists(
    grid_map, walls, length, tolerance, min_distance, robot_diameter, seed
):
    content = grid_map(walls)
    passable, cells, distance_m = walks(content, robot_diameter)
    asked = {"path_length_tolerance": tolerance, "min_distance": min_distance, "robot_diameter": robot_diameter}
    (item,) = evaluate(path_variation(path_length=length, seed=seed, **asked), {"map_file": content})
    if isinstance(item, Rejection):
        assume("nor proved impossible" not in item.reason)
        straight_m = np.hypot(*(cells[:, None, :] - cells[None, :, :]).transpose(2, 0, 1)) * 0.5
        met = (np.abs(distance_m - length) <= tolerance) & (straight_m >= min_distance)
        assert not met.any()
        return
    path, occupancy = np.array(item.values["_path"]), load_map(content.path)
    start, goal = pose_of(item.values["start_pose"]), pose_of(item.values["goal_poses"][0])
    assert [start.x_m, start.y_m] == pytest.approx(path[0])
    assert [goal.x_m, goal.y_m] == pytest.approx(path[-1])
    assert is_walked(path, passable, occupancy)
    ends = [cells.tolist().index(list(occupancy.cell_of(*path[i]))) for i in (0, -1)]
    assert sum(lengths(path)) == pytest.approx(distance_m[ends[0], ends[1]])
    assert item.values["_path_length"] == pytest.approx(sum(lengths(path)))
    assert abs(item.values["_path_length"] - length) <= tolerance + 1e-6
    assert math.dist(path[0], path[-1]) >= min_distance - 1e-6


@given(n_goals=st.integers(1, 6), length=st.floats(6.0, 40.0), seed=st.integers(0, 99))
@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_several_goals_share_the_length_equally(hall, n_goals, length, seed):
    producer = path_variation(path_length=length, num_goal_poses=n_goals, seed=seed, path_length_tolerance=0.6)
    (item,) = evaluate(producer, {"map_file": hall})
    assume(isinstance(item, Fragment))
    stops = [pose_of(pose) for pose in (item.values["start_pose"], *item.values["goal_poses"])]
    assert len(stops) == n_goals + 1
    for one, other in itertools.pairwise(stops):
        dx, dy = abs(one.x_m - other.x_m), abs(one.y_m - other.y_m)
        assert math.hypot(dx, dy) >= 1.0 - 1e-6
        assert max(dx, dy) + (math.sqrt(2.0) - 1.0) * min(dx, dy) <= (length + 0.6) / n_goals + 1e-6
    assert sum(lengths(item.values["_path"])) == pytest.approx(item.values["_path_length"])
    assert abs(item.values["_path_length"] - length) <= 0.6 + 1e-6


def test_impossible_path_is_rejected_with_the_longest(hall):
    items = evaluate(path_variation(path_length=200, num_paths=2), {"map_file": hall})
    # From corner to corner along the diagonal, less the inflation: 291 cells of 0.05 m.
    why = "this map has no path of 200 m ± 0.5 m and >= 1 m in a straight line for a robot 0.35 m across"
    requested = {"path_length": 200.0, "num_goal_poses": 1}
    reason = f"{why}. The longest shortest path found is 20.58 m"
    assert items == [Rejection(reason, {**requested, "path": path}) for path in (1, 2)]
    (item,) = evaluate(path_variation(path_length=5, min_distance=6), {"map_file": hall})
    assert item.reason == "a path of 5 m ± 0.5 m can't lead 6 m away in a straight line"


def test_search_without_confirmation_is_reported(drawn_map):
    # No sum of steps of 0.05 m and 0.0707 m is 3.01 m to the nanometer, but many come close.
    producer = path_variation(path_length=3.01, path_length_tolerance=0, num_paths=2)
    items = evaluate(producer, {"map_file": drawn_map(".", cells=100)})
    assert [item.reason for item in items] == [items[0].reason] * 2
    assert "from 200 starts, nor proved impossible" in items[0].reason


def test_unknown_space_is_no_place_to_be(drawn_map):
    content = drawn_map("????", "?..?", "?..?", "????", cells=40)
    occupancy = load_map(content.path)
    for item in evaluate(path_variation(path_length=2, num_paths=20), {"map_file": content}):
        assert all(occupancy.free[occupancy.cell_of(x, y)] for x, y in item.values["_path"])


def test_starts_are_spread_over_the_whole_map(hall):
    items = evaluate(path_variation(path_length=3, num_paths=200), {"map_file": hall})
    starts = np.array([(pose.x_m, pose.y_m) for pose in (pose_of(item.values["start_pose"]) for item in items)])
    quarters = {(bool(x), bool(y)): 0 for x, y in itertools.product((0, 1), repeat=2)}
    for x, y in starts > np.array([7.0, 6.0]):  # the hall's center
        quarters[bool(x), bool(y)] += 1
    assert all(30 <= n <= 70 for n in quarters.values())


def test_references_name_the_keys_that_are_written(hall):
    producer = path_variation(path_length=5, start_pose="@from", goal_poses="@to")
    (item,) = evaluate(producer, {"map_file": hall})
    assert {key for key in item.values if not key.startswith("_")} == {"from", "to"}
    assert producer.writes == {"from": "task", "to": "task"}


def test_goals_yaw_is_the_direction_of_arrival(drawn_map):
    corridor = drawn_map("#" * 40, "." * 40, "#" * 40, cells=10)
    (item,) = evaluate(path_variation(path_length=10, goal_poses="@goal_pose"), {"map_file": corridor})
    start, goal = pose_of(item.values["start_pose"]), pose_of(item.values["goal_pose"])
    assert math.cos(goal.yaw_rad) == pytest.approx(math.copysign(1.0, goal.x_m - start.x_m), abs=0.2)


def test_goals_per_meter_are_rounded_and_at_least_one(hall):
    producer = path_variation(path_length=[4, 12], num_goal_poses_per_m=[0.1, 0.3])
    counts = [len(item.values["goal_poses"]) for item in evaluate(producer, {"map_file": hall})]
    assert counts == [1, 1, 1, 4]


def test_paths_are_independent_of_other_lengths(hall):
    few = evaluate(path_variation(path_length=[5, 10], num_paths=2, seed=3), {"map_file": hall})
    more = evaluate(path_variation(path_length=[300, 8, 5, 10], num_paths=3, seed=3), {"map_file": hall})
    assert [item.values for item in few] == [more[i].values for i in (6, 7, 9, 10)]


def test_given_start_is_kept_and_the_goal_drawn_from_there(hall):
    given_start = {"x": 3.0, "y": 3.0, "yaw": 1.0}
    items = evaluate(path_variation(path_length=6, num_paths=5), {"map_file": hall, "start_pose": given_start})
    assert all("start_pose" not in item.values for item in items)
    assert all(math.dist(item.values["_path"][0], (3.0, 3.0)) < 0.05 for item in items)
    assert len({str(item.values["goal_poses"]) for item in items}) == 5


def test_given_goals_are_kept_and_the_start_drawn_to_them(hall):
    goals = [{"x": 3.0, "y": 3.0}, {"x": 5.0, "y": 3.0}]
    (item,) = evaluate(path_variation(path_length=6), {"map_file": hall, "goal_poses": goals})
    assert "goal_poses" not in item.values
    assert math.dist(item.values["_path"][-1], (5.0, 3.0)) < 0.05
    assert abs(item.values["_path_length"] - 6.0) <= 0.5


def test_poses_in_the_parameters_are_written(hall):
    producer = path_variation(path_length=2, start_pose={"x": 3, "y": 3}, goal_poses=[{"x": 5, "y": 3}])
    (item,) = evaluate(producer, {"map_file": hall})
    assert pose_of(item.values["start_pose"]) == pose_of({"x": 3.0, "y": 3.0})
    assert [pose_of(pose) for pose in item.values["goal_poses"]] == [pose_of({"x": 5.0, "y": 3.0})]


@each_row(("goal_x", "fits"), [(6.525, True), (6.475, False), (7.525, True), (7.575, False)])
def test_given_poses_must_match_length_within_tolerance(hall, goal_x, fits):
    given_poses = {"start_pose": {"x": 3.025, "y": 3.025}, "goal_poses": [{"x": goal_x, "y": 3.025}]}
    (item,) = evaluate(path_variation(path_length=4, path_length_tolerance=0.5), {"map_file": hall, **given_poses})
    assert isinstance(item, Rejection) is not fits


@each_row(
    ("inputs", "reason"),
    [
        ({"start_pose": {"x": 90, "y": 0}}, r"the given start \(90, 0\) is no place for a robot 0.35 m across"),
        ({"start_pose": "here"}, "start_pose: .*'here'"),
        ({"goal_poses": []}, r"goal_poses: expected a list of poses, got \[\]"),
        ({"start_pose": {"x": 3, "y": 3}, "goal_poses": [{"x": 9, "y": 3}]}, "given poses are 6.00 m apart, not 4 m"),
        ({"goal_poses": [{"x": 3, "y": 3}, {"x": 9, "y": 3}]}, "given goals alone are 6.00 m apart"),
        ({"map_file": "m.yaml"}, "map_file is 'm.yaml', not a map file"),
        ({"start_pose": {"x": 0, "y": -1}, "goal_poses": [{"x": 4, "y": -1}]}, "no path"),
    ],
)
def test_unsuitable_given_values_are_rejected(hall, drawn_map, inputs, reason):
    rooms = drawn_map(".#.", cells=40)
    (item,) = evaluate(path_variation(path_length=4), {"map_file": rooms if "no path" in reason else hall, **inputs})
    assert isinstance(item, Rejection)
    assert re.search(reason, item.reason)


def test_producer_map_becomes_configuration_map(hall):
    producer = path_variation(path_length=5, map_file=hall.path)
    (item,) = evaluate(producer, {})
    assert item.values["map_file"] == hall
    assert producer.needs == ()
    assert producer.writes["map_file"] == "environment"


def test_path_producers_keep_the_contract(hall, drawn_map):
    small = drawn_map("....", "....", cells=10)
    producer = path_variation(path_length=[3, 200], num_paths=2)
    check_producer(producer, [{"map_file": hall, "noise": 0.1}, {"map_file": small}])


def test_path_of_20_m_in_large_building_is_drawn_quickly(shared_map, loops):
    inputs = {"map_file": shared_map("university")}
    evaluate(path_variation(path_length=20), inputs)  # the map is read and inflated once
    items = []
    assert loops(lambda: items.extend(evaluate(path_variation(path_length=20, num_paths=10, seed=1), inputs))) / 10 < 8
    assert all(isinstance(item, Fragment) for item in items)
