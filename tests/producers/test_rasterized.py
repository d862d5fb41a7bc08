"""Paths between the points of a raster."""

import itertools
import math

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from table import each_row
from walks import is_walked, walks

from vastflow.producers.catalog.rasterized_path import PathVariationRasterized, raster_points
from vastflow.producers.model.configuration import Fragment, Rejection
from vastflow.producers.model.conformance import check_producer
from vastflow.producers.model.producer import evaluate
from vastflow.producers.places.ground import ground_of
from vastflow.sim.model.pose import Pose, pose_of
from vastflow.sim.world.map_file import load_map


def rasterized(**parameters):
    return PathVariationRasterized(PathVariationRasterized.Parameters.model_validate(parameters))


@pytest.fixture(scope="module")
def hall(drawn_map):
    """6 m x 4 m, free throughout; its lower left corner is (-1, -2)."""
    return drawn_map(*["." * 12] * 8, cells=10)


def stops(item):
    goals = item.values.get("goal_poses") or [item.values["goal_pose"]]
    return [pose_of(pose) for pose in (item.values["start_pose"], *goals)]


def places(item):
    return [(round(pose.x_m, 6), round(pose.y_m, 6)) for pose in stops(item)]


def split(items):
    return [i for i in items if isinstance(i, Fragment)], [i for i in items if isinstance(i, Rejection)]


@given(
    walls=arrays(bool, st.tuples(st.integers(3, 9), st.integers(3, 9)), elements=st.sampled_from([False, False, True])),
    lengths=st.lists(st.floats(0.5, 5.0), min_size=1, max_size=2, unique=True),
    tolerance=st.floats(0.0, 0.8),
    size=st.sampled_from([0.5, 1.0, 1.5]),
    offset=st.floats(-2.0, 2.0),
    robot_diameter=st.sampled_from([0.3, 0.9]),
)
@settings(max_examples=50, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_pairs_of_requested_length_are_complete_and_ordered(
    grid_map, walls, lengths, tolerance, size, offset, robot_diameter
):
    content = grid_map(walls)
    occupancy = load_map(content.path)
    passable, cells, distance_m = walks(content, robot_diameter)
    points = raster_points(ground_of(content, robot_diameter), size, offset, 0.0).tolist()
    number = {cell: i for i, cell in enumerate(map(tuple, cells.tolist()))}
    expected = {
        length: [
            (tuple(start), tuple(goal), meters)
            for start, goal in itertools.permutations(points, 2)
            if abs((meters := distance_m[number[tuple(start)], number[tuple(goal)]]) - length) <= tolerance + 1e-9
        ]
        for length in lengths
    }
    asked = {"path_length_tolerance": tolerance, "raster_size": size, "raster_offset_x": offset}
    producer = rasterized(path_length=lengths, robot_diameter=robot_diameter, **asked)
    paths, rejections = split(evaluate(producer, {"map_file": content}))
    wanted = [pair for length in lengths for pair in expected[length]]
    ends = [tuple(tuple(occupancy.cell_of(pose.x_m, pose.y_m)) for pose in stops(item)) for item in paths]
    assert ends == [(start, goal) for start, goal, _ in wanted]
    for item, (_, _, meters) in zip(paths, wanted, strict=True):
        path = item.values["_path"]
        assert [tuple(path[0]), tuple(path[-1])] == places(item)
        assert item.values["_path_length"] == pytest.approx(meters)
        assert sum(math.dist(one, other) for one, other in itertools.pairwise(path)) == pytest.approx(meters)
        assert is_walked(path, passable, occupancy)
    n_pairs = len(points) * (len(points) - 1)
    if n_pairs:
        missing = [n_pairs - len(expected[length]) for length in lengths]
        assert [int(r.reason.split()[0]) for r in rejections] == [n for n in missing if n]
    else:
        assert [r.reason.rpartition(", ")[2] for r in rejections] == ["too few for a path"] * len(lengths)


def test_points_go_by_rows_from_below_at_the_offset(hall, drawn_map):
    points = raster_points(ground_of(hall, 0.35), 2.0, 5.0, -1.0)  # 1 m and 1 m
    assert points.tolist() == [[20, 20], [20, 60], [20, 100], [60, 20], [60, 60], [60, 100]]
    # A raster finer than the map has every cell once.
    points = raster_points(ground_of(drawn_map(*["....."] * 4), 0.01), 1e-9, 0.0, 0.0)
    assert points.tolist() == [[1, 1], [1, 2], [1, 3], [2, 1], [2, 2], [2, 3]]


def test_stops_are_cell_centers_facing_x(hall):
    asked = {"raster_size": 2, "raster_offset_x": 1, "raster_offset_y": 1}
    items, _ = split(evaluate(rasterized(path_length=4, path_length_tolerance=0.1, **asked), {"map_file": hall}))
    left, right = Pose(0.025, -0.975), Pose(4.025, -0.975)
    assert [stops(item) for item in items[:2]] == [[left, right], [right, left]]
    assert {key for key in items[0].values if not key.startswith("_")} == {"start_pose", "goal_pose"}


def test_way_back_is_the_same_way(hall):
    items, _ = split(evaluate(rasterized(path_length=3, raster_size=1), {"map_file": hall}))
    ways = {tuple(places(item)): item.values["_path"] for item in items}
    assert all(ways[ends[::-1]] == way[::-1] for ends, way in ways.items())


def test_several_goals_give_one_path_from_each_start(hall):
    producer = rasterized(path_length=6, num_goal_poses=3, raster_size=2, raster_offset_x=1, raster_offset_y=1)
    items, rejections = split(evaluate(producer, {"map_file": hall}))
    assert [places(item)[0] for item in items] == [(x, y) for y in (-0.975, 1.025) for x in (0.025, 2.025, 4.025)]
    assert all(len(set(places(item))) == 4 for item in items[:1])
    assert places(items[0]) == [(0.025, -0.975), (2.025, -0.975), (4.025, -0.975), (4.025, 1.025)]
    assert all(item.values["_path_length"] == pytest.approx(6.0) for item in items)
    assert rejections == []


def test_rejection_counts_pairs_and_names_the_longest(drawn_map):
    rooms = drawn_map(*["......#......"] * 4, cells=10)
    items = evaluate(rasterized(path_length=[2, 50], raster_size=1, raster_offset_x=0.5), {"map_file": rooms})
    _, rejections = split(items)
    assert [r.requested for r in rejections] == [{"path_length": m, "num_goal_poses": 1} for m in (2.0, 50.0)]
    assert "pairs on the raster have no path of 2 m ± 0.5 m for a robot 0.35 m across" in rejections[0].reason
    assert "longest" not in rejections[0].reason
    points = 5  # three and two columns at y 1 m, for the row at 0 is too near the edge
    assert rejections[1].reason == (
        f"{points * (points - 1)} of {points * (points - 1)} pairs on the raster have no path of 50 m ± 0.5 m for a robot "
        "0.35 m across. 12 of 20 pairs are not connected. The longest shortest path between two of its points is 2.00 m"
    )


def test_given_start_is_kept_or_written_and_is_the_only_one(hall):
    start = {"x": 0.6, "y": -1.0, "yaw": 1.0}
    items, (rejection,) = split(
        evaluate(rasterized(path_length=3, raster_size=1), {"map_file": hall, "start_pose": start})
    )
    assert all("start_pose" not in item.values for item in items)
    assert all(math.dist(item.values["_path"][0], (0.6, -1.0)) < 0.05 for item in items)
    assert len(items) + int(rejection.reason.split()[0]) == 15
    producer = rasterized(path_length=4, num_goal_poses=2, raster_size=1, start_pose={"x": 0.6, "y": -1.0})
    (item,), _ = split(evaluate(producer, {"map_file": hall}))
    assert stops(item)[0] == Pose(0.6, -1.0)
    assert len(item.values["goal_poses"]) == 2


@each_row(
    ("parameters", "inputs", "reason"),
    [
        ({}, {"map_file": "m.yaml"}, "map_file is 'm.yaml', not a map file"),
        ({}, {"start_pose": "here"}, "start_pose: "),
        ({}, {"start_pose": {"x": 90, "y": 0}}, "the given start (90, 0) is no place for a robot 0.35 m across"),
        ({"raster_size": 90}, {}, "a raster of 90 m has 0 points for a robot 0.35 m across on this map, too few"),
        ({"raster_size": 0.05}, {}, "has 8064 points for a robot 0.35 m across on this map, at most 5000"),
    ],
)
def test_impossible_raster_is_rejected_for_each_length(hall, parameters, inputs, reason):
    producer = rasterized(**{"path_length": [3, 4], "raster_size": 1, **parameters})
    items = evaluate(producer, {"map_file": hall, **inputs})
    assert [type(item) for item in items] == [Rejection, Rejection]
    assert reason in items[0].reason


def test_raster_producers_keep_the_contract(hall, drawn_map):
    producer = rasterized(path_length=[3, 200], raster_size=1, num_goal_poses=2)
    check_producer(producer, [{"map_file": hall, "noise": 0.1}, {"map_file": drawn_map("..", cells=10)}])
