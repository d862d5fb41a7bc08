"""Obstacles along a path."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from shapely.geometry import LineString, Point, box
from table import each_row
from walks import leaves_a_path

from vastflow.producers.catalog.obstacle import ObstacleVariation
from vastflow.producers.catalog.path import PathVariationRandom
from vastflow.producers.model.configuration import Rejection
from vastflow.producers.model.conformance import check_producer
from vastflow.producers.model.producer import evaluate
from vastflow.producers.places.ground import ground_of
from vastflow.producers.places.placement import Line, covered_cells, outline_of, without
from vastflow.sim.model.obstacle import Obstacle, obstacle_of, obstacles_of
from vastflow.sim.model.pose import Pose
from vastflow.sim.model.shape import Box, Disc
from vastflow.sim.world import octile

PILLARS = [
    "????????????????????????",
    "?......................?",
    "?......................?",
    "?....##..........##....?",
    "?....##..........##....?",
    "?......................?",
    "?.........##...........?",
    "?.........##...........?",
    "?......................?",
    "????????????????????????",
]


def obstacle_variation(*configs, **parameters):
    return ObstacleVariation(
        ObstacleVariation.Parameters.model_validate({"obstacle_configs": list(configs), **parameters})
    )


@pytest.fixture(scope="module")
def site(drawn_map):
    """A drawn path of 9 m between pillars, for the larger robot: the map and what the path producer wrote."""
    content = drawn_map(*PILLARS, cells=10)
    asked = PathVariationRandom.Parameters(path_length=9, num_goal_poses=2, seed=5, robot_diameter=0.5)
    (item,) = evaluate(PathVariationRandom(asked), {"map_file": content})
    return {"map_file": content, **item.values}


@pytest.fixture(scope="module")
def ground(drawn_map):
    return ground_of(drawn_map(*["." * 35] * 35, resolution_m=0.1), 0.35)


def corridor(drawn_map, half_meters_wide, y):
    """The inputs of a way of 10 m along a corridor."""
    ends = {key: {"x": x, "y": y} for key, x in (("start_pose", 0.0), ("goal_pose", 10.0))}
    return {"map_file": drawn_map(*["." * 30] * half_meters_wide, cells=10), **ends}


def placed(item, key="static_objects"):
    return obstacles_of({key: item.values[key]})


@given(
    amount=st.integers(0, 7),
    max_distance=st.floats(0.0, 1.5),
    size=st.sampled_from(["width:=0.2, length:=0.6", "width:=0.5", "width:=0.8 length:=0.8"]),
    model=st.sampled_from(["box", "models/cylinder.sdf.xacro"]),
    robot_diameter=st.sampled_from([0.35, 0.5]),
    seed=st.integers(0, 99),
)
@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_obstacles_stand_free_near_the_path_and_leave_a_path(
    site, amount, max_distance, size, model, robot_diameter, seed
):
    config = {"amount": amount, "max_distance": max_distance, "model": model, "xacro_arguments": size}
    (item,) = evaluate(obstacle_variation(config, seed=seed, robot_diameter=robot_diameter), site)
    if isinstance(item, Rejection):
        assert f"of {amount} obstacles fit" in item.reason
        return
    obstacles = placed(item)
    footprints = [obstacle.footprint() for obstacle in obstacles]
    assert len(obstacles) == amount
    path = LineString(site["_path"])
    assert all(path.distance(Point(o.pose.x_m, o.pose.y_m)) <= max_distance + 1e-5 for o in obstacles)
    assert all(one.distance(other) >= 0.05 for one, other in itertools.combinations(footprints, 2))
    stops = [pose["position"] for pose in (site["start_pose"], *site["goal_poses"])]
    gaps = [footprint.distance(Point(stop["x"], stop["y"])) for stop in stops for footprint in footprints]
    assert all(gap >= robot_diameter / 2 + 0.05 for gap in gaps)
    assert all(
        covered_cells(ground_of(site["map_file"], robot_diameter), footprint) is not None for footprint in footprints
    )
    assert leaves_a_path(site["map_file"], footprints, [(stop["x"], stop["y"]) for stop in stops], robot_diameter)


@given(
    x=st.floats(0.0, 1.5),
    y=st.floats(-1.0, 0.5),
    yaw=st.floats(-4, 4),
    length=st.floats(0.02, 1.0),
    width=st.floats(0.02, 1.0),
)
@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_covered_cells_intersect_footprint(ground, x, y, yaw, length, width):
    entry = {"spawn_pose": {"x": x, "y": y, "yaw": yaw}, "xacro_arguments": f"length:={length} width:={width}"}
    footprint = obstacle_of(entry).footprint()
    found = {tuple(cell) for cell in covered_cells(ground, footprint).tolist()}
    for row, column in np.ndindex(ground.occupancy.shape):
        x0, y0 = ground.occupancy.center_of(row, column)
        square = box(x0 - 0.05, y0 - 0.05, x0 + 0.05, y0 + 0.05)
        if footprint.distance(square) > 1e-9:
            assert (row, column) not in found
        elif footprint.intersection(square).area > 1e-9:
            assert (row, column) in found


@given(st.lists(st.tuples(st.integers(0, 19), st.integers(0, 19)), min_size=1, max_size=6), st.integers(0, 6))
@settings(max_examples=60, deadline=None)
def test_taking_cells_away_later_is_inflating_without_them(cells, radius_cells):
    free = np.random.default_rng(1).random((20, 20)) > 0.1
    covered = np.array(cells)
    less = free.copy()
    less[covered[:, 0], covered[:, 1]] = False
    found = without(octile.inflated_free(free, radius_cells), covered, radius_cells)
    np.testing.assert_array_equal(found, octile.inflated_free(less, radius_cells))


@given(st.floats(0.0, 2.0), st.integers(0, 1000))
def test_poses_are_drawn_within_max_distance_of_the_path(max_distance, seed):
    path = np.array([[0.0, 0.0], [3.0, 0.0], [4.0, 1.0], [4.0, 5.0]])
    pose = Line.along(path).draw(max_distance, np.random.default_rng(seed))
    assert LineString(path).distance(Point(pose.x_m, pose.y_m)) <= max_distance + 1e-5
    assert -math.pi <= pose.yaw_rad <= math.pi + 1e-6


def test_path_of_a_single_point_has_obstacles_round_it():
    pose = Line.along(np.array([[1.0, 2.0]])).draw(0.5, np.random.default_rng(0))
    assert math.dist((pose.x_m, pose.y_m), (1.0, 2.0)) <= 0.5 + 1e-5


def test_listed_amounts_and_distances_are_combined_and_each_placed_count_times(site):
    producer = obstacle_variation(
        {"amount_per_m": [0, 0.2], "max_distance": [0.5, 1.0]}, {"amount": 1, "max_distance": [0.8, 1.2]}, count=2
    )
    items = evaluate(producer, site)
    assert len(items) == 2 * 2 * 2 * 2
    per_m = math.floor(0.2 * site["_path_length"])
    assert [len(placed(item)) for item in items] == [1] * 8 + [1 + per_m] * 8


def test_shortest_path_counts_without_a_drawn_one(drawn_map):
    inputs = corridor(drawn_map, 3, -1.28)
    (item,) = evaluate(obstacle_variation({"amount_per_m": 0.2, "max_distance": 0, "args": "width:=0.2"}), inputs)
    assert len(placed(item)) == 2
    assert all(abs(obstacle.pose.y_m + 1.275) < 1e-6 for obstacle in placed(item))


def test_obstacles_that_would_close_a_corridor_are_rejected_with_the_reason(drawn_map):
    producer = obstacle_variation({"amount": 1, "max_distance": 0, "args": "width:=0.6"})
    (item,) = evaluate(producer, corridor(drawn_map, 2, -1.5))
    assert isinstance(item, Rejection)
    assert item.reason.startswith("at most 0 of 1 obstacles fit in 10 attempts of 100 tries each")
    assert "left no path to the goals" in item.reason
    assert item.requested["obstacle_configs"][0]["max_distance"] == 0.0


@each_row(
    ("without_keys", "extra", "reason"),
    [
        (("_path", "start_pose"), {}, "there is no path to place obstacles at: no start_pose with goal_pose"),
        (("_path",), {"start_pose": {"x": -0.9, "y": -1.9}}, "there is no path from the start to the goals"),
        ((), {"start_pose": 3}, "start_pose: "),
        ((), {"goal_poses": [{"x": 99.0, "y": 0.0}]}, "the start or a goal, (99, 0), lies beyond the map"),
        ((), {"static_objects": 7}, "static_objects: expected a list of obstacles, got 7"),
        ((), {"static_objects": [{"spawn_pose": 3}]}, "static_objects[0].spawn_pose: "),
        (("map_file",), {}, "map_file is None, not a map file"),
    ],
)
def test_unsuitable_configuration_is_rejected_with_the_reason(site, without_keys, extra, reason):
    inputs = {key: value for key, value in {**site, **extra}.items() if key not in without_keys}
    items = evaluate(obstacle_variation({"amount": 1, "max_distance": 0}, count=2), inputs)
    assert [type(item) for item in items] == [Rejection, Rejection]
    assert reason in items[0].reason


def test_second_producer_leaves_the_obstacles_of_the_first_their_place(site):
    first, second = (
        obstacle_variation({"amount": 3, "max_distance": 1.0, "args": "width:=0.4"}, name=name, seed=8)
        for name in ("boxes", "more_boxes")
    )
    (one,) = evaluate(first, site)
    values = {**site, **one.values}
    assert "boxes" not in second.reads  # but what the first noted of it
    (two,) = evaluate(second, {key: values[key] for key in second.reads if key in values})
    assert "boxes" not in two.values
    footprints = [o.footprint() for o in (*placed(one, "boxes"), *placed(two, "more_boxes"))]
    assert all(one.distance(other) >= 0.05 for one, other in itertools.combinations(footprints, 2))
    names = [entry["entity_name"] for entry in (*one.values["boxes"], *two.values["more_boxes"])]
    assert names == [f"obstacle_{i}" for i in range(6)]


def test_listed_obstacles_stay(site):
    given_box = {"entity_name": "obstacle_1", "spawn_pose": {"x": 1.0, "y": 0.0}}
    (item,) = evaluate(obstacle_variation({"amount": 2, "max_distance": 1}), {**site, "static_objects": [given_box]})
    assert item.values["static_objects"][0] == given_box
    assert [o.name for o in placed(item)] == ["obstacle_1", "obstacle_2", "obstacle_3"]


def test_obstacles_blocking_only_path_are_the_reason(drawn_map):
    there = {"static_objects": [{"spawn_pose": {"x": 5.0, "y": -1.5}, "xacro_arguments": "width:=2.0"}]}
    producer = obstacle_variation({"amount": 1, "max_distance": 0, "args": "width:=0.2"})
    (item,) = evaluate(producer, {**corridor(drawn_map, 2, -1.5), **there})
    assert item.reason == "the obstacles that are there already leave no path to the goals"


def test_obstacle_producers_keep_the_contract(site):
    producer = obstacle_variation(
        {"amount_per_m": [0.2, 0.5], "max_distance": 0.5}, {"amount": 1, "max_distance": 0, "args": "width:=4"}
    )
    check_producer(producer, [{**site, "noise": 0.1}, {"noise": 1}])


near = st.floats(-1.5, 1.5).map(lambda value: round(value, 6))
sizes = st.sampled_from([0.1, 0.3, 0.5, 0.8])
poses = st.builds(Pose, near, near, st.floats(-math.pi, math.pi).map(lambda value: round(value, 6)))
boxes = st.builds(lambda pose, length, width: Obstacle("o", Box(length, width), pose), poses, sizes, sizes)
cylinders = st.builds(lambda pose, diameter: Obstacle("o", Disc(diameter / 2), pose), poses, sizes)
obstacles = boxes | cylinders
distances = st.sampled_from([0.05, 0.225, 0.4])


@given(obstacles, obstacles, distances)
def test_outlines_are_as_near_as_their_polygons(one, other, distance):
    nearer = one.footprint().distance(other.footprint()) < distance
    assert outline_of(one).nearer_than(distance, outline_of(other)) == nearer
