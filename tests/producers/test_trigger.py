"""Obstacles that appear when the robot comes near."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from shapely.geometry import LineString, Point
from table import each_row
from walks import leaves_a_path

from vastflow.producers.catalog.obstacle import ObstacleVariation
from vastflow.producers.catalog.path import PathVariationRandom
from vastflow.producers.catalog.triggered_obstacle import ObstacleVariationWithDistanceTrigger, beyond
from vastflow.producers.model.configuration import Fragment, Rejection
from vastflow.producers.model.conformance import check_producer
from vastflow.producers.model.producer import evaluate
from vastflow.sim.model.obstacle import Trigger, obstacles_of

KEYS = {"spawn_trigger_point": "@spawn_trigger_point", "spawn_trigger_threshold": "@spawn_trigger_threshold"}
BOX = {"amount": 1, "max_distance": 0.6, "args": "width:=0.4"}


def triggered(*configs, **parameters):
    given_parameters = {"obstacle_configs": list(configs or [BOX]), "trigger_distance": 1.0, **KEYS, **parameters}
    return ObstacleVariationWithDistanceTrigger(
        ObstacleVariationWithDistanceTrigger.Parameters.model_validate(given_parameters)
    )


@pytest.fixture(scope="module")
def site(drawn_map):
    """A drawn path of 9 m through two goals in a hall with a pillar."""
    rows = ["#" * 26, *["#" + "." * 24 + "#"] * 5, "#" + "." * 11 + "##" + "." * 11 + "#", *["#" + "." * 24 + "#"] * 5]
    content = drawn_map(*rows, "#" * 26, cells=10)
    asked = PathVariationRandom.Parameters(path_length=9, num_goal_poses=2, seed=5)
    (item,) = evaluate(PathVariationRandom(asked), {"map_file": content})
    return {"map_file": content, **item.values}


def environment(item, before=()):
    """The simulator's values, without notes for other producers."""
    return {key: value for key, value in {**dict(before), **item.values}.items() if not key.startswith("_")}


@given(
    distance=st.floats(0.6, 4.0),
    max_distance=st.floats(0.0, 1.5),
    model=st.sampled_from(["box", "cylinder"]),
    amount_static=st.integers(0, 4),
    seed=st.integers(0, 99),
)
@settings(max_examples=12, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_triggered_obstacle_keeps_its_distances_and_leaves_a_path(
    site, distance, max_distance, model, amount_static, seed
):
    boxes = {"amount": amount_static, "max_distance": 1.5, "args": "width:=0.3"}
    static = ObstacleVariation(ObstacleVariation.Parameters(obstacle_configs=[boxes], seed=seed))
    (first,) = evaluate(static, site)
    if isinstance(first, Rejection):
        return
    config = {"amount": 1, "max_distance": max_distance, "model": model, "args": "width:=0.4"}
    producer = triggered(config, trigger_distance=distance, seed=seed, name="late")
    (item,) = evaluate(producer, {**site, **first.values})
    if isinstance(item, Rejection):
        assert "of 1 obstacles fit" in item.reason
        return
    obstacles = obstacles_of(environment(item, {"static_objects": first.values["static_objects"]}))
    (late,) = [obstacle for obstacle in obstacles if obstacle.trigger]
    assert late.trigger == Trigger(late.pose.x_m, late.pose.y_m, distance)
    footprints = [obstacle.footprint() for obstacle in obstacles]
    assert len(footprints) == amount_static + 1
    assert all(one.distance(other) >= 0.05 for one, other in itertools.combinations(footprints, 2))
    stops = [(p["position"]["x"], p["position"]["y"]) for p in (site["start_pose"], *site["goal_poses"])]
    center = (late.pose.x_m, late.pose.y_m)
    assert all(late.footprint().distance(Point(stop)) >= 0.35 / 2 + 0.05 for stop in stops)
    assert math.dist(center, stops[0]) >= distance
    path = LineString(site["_path"])
    rest = path.segmentize(0.01).coords[int(distance / 0.01) :] if distance < path.length else []
    assert LineString(rest).distance(Point(center)) <= max_distance + 0.02
    assert leaves_a_path(site["map_file"], footprints, stops, 0.35)


def test_usual_keys_are_written_as_the_scenario_reads_them(site):
    (item,) = evaluate(triggered(), site)
    (taken,) = evaluate(triggered(), {**site, **item.values})
    assert taken.reason.startswith("spawn_trigger_point is written already, for another trigger")
    (entry,) = item.values["static_objects"]
    assert not [key for key in item.values if "delay" in key or key == "goal_poses"]
    position = entry["spawn_pose"]["position"]
    assert item.values["spawn_trigger_point"] == {"x": position["x"], "y": position["y"], "z": 0.0}
    assert item.values["spawn_trigger_threshold"] == 1.0
    assert triggered().writes == dict.fromkeys(
        ("static_objects", "spawn_trigger_point", "spawn_trigger_threshold"), "environment"
    )


def test_placement_has_every_delay(site):
    soon, late, *_ = found = evaluate(triggered(count=2, spawn_delay_s=[0.0, 0.8]), site)
    assert len(found) == 4 == triggered(count=2, spawn_delay_s=[0.0, 0.8]).most_choices
    places = [item.values["static_objects"][0]["spawn_pose"] for item in found]
    assert places[0] == places[1] != places[2] == places[3]
    assert [item.values["static_objects_delay_s"] for item in (soon, late)] == [0.0, 0.8]
    assert [o.trigger.delay_s for item in (soon, late) for o in obstacles_of(environment(item))] == [0.0, 0.8]


def test_triggers_with_own_keys_are_separate(site):
    (one,) = evaluate(triggered(trigger_distance=1.0, name="first"), site)
    second = triggered(
        trigger_distance=2.0, name="second", spawn_trigger_point="point_2", spawn_trigger_threshold="threshold_2"
    )
    (two,) = evaluate(second, {**site, **one.values})
    found = {o.name: o for o in obstacles_of(environment(two, environment(one)))}
    assert [o.trigger.distance_m for o in found.values()] == [1.0, 2.0]
    assert all((o.trigger.x_m, o.trigger.y_m) == (o.pose.x_m, o.pose.y_m) for o in found.values())


def test_distances_are_outermost_and_each_is_placed_count_times(site):
    producer = triggered({**BOX, "max_distance": [0.3, 0.9]}, trigger_distance=[1.0, 2.0], count=3)
    items = evaluate(producer, site)
    assert [item.values["spawn_trigger_threshold"] for item in items] == [1.0] * 6 + [2.0] * 6
    assert len({str(item.values) for item in items}) == 12


@each_row(
    ("parameters", "reason"),
    [
        ({"trigger_distance": 12.0}, "ends before 12 m, where the trigger could be set off"),
        ({"trigger_distance": 0.3}, "appear where the robot is. Expected a trigger_distance of 0.46 m"),
        ({"obstacle_configs": [{"amount_per_m": 0.4, "max_distance": 0.5}]}, "3 obstacles were asked for on a path"),
        ({"obstacle_configs": [{**BOX, "args": "width:=0.2, length:=9"}], "trigger_distance": 5}, "of 1 obstacles fit"),
    ],
)
def test_impossible_trigger_is_rejected(site, parameters, reason):
    (item,) = evaluate(triggered(**parameters), site)
    assert isinstance(item, Rejection)
    assert reason in item.reason
    assert item.requested["trigger_distance"] == parameters.get("trigger_distance", 1.0)


def test_given_poses_are_path_ends(drawn_map):
    ends = {"start_pose": {"x": 0.0, "y": -1.28}, "goal_pose": {"x": 10.0, "y": -1.28}}
    inputs = {"map_file": drawn_map(*["." * 30] * 3, cells=10)}
    (item,) = evaluate(triggered({"amount": 1, "max_distance": 0, "args": "width:=0.2"}, **ends), inputs)
    (obstacle,) = obstacles_of(environment(item))
    assert obstacle.pose.y_m == pytest.approx(-1.275)
    assert 1.0 <= obstacle.pose.x_m <= 10.0


@given(st.floats(0.0, 8.0))
def test_remaining_path_length_excludes_cut_part(distance):
    path = np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 5.0]])
    rest = beyond(path, distance)
    assert np.hypot(*np.diff(rest, axis=0).T).sum() == pytest.approx(8.0 - distance)
    np.testing.assert_array_equal(rest[-1], path[-1])
    assert beyond(path, 8.1).shape == (0, 2)


def test_trigger_producers_keep_the_contract(site):
    (before,) = evaluate(ObstacleVariation(ObstacleVariation.Parameters(obstacle_configs=[BOX], name="others")), site)
    assert isinstance(before, Fragment)
    check_producer(triggered(trigger_distance=[0.1, 1.0]), [{**site, **before.values, "noise": 1}, site, {"noise": 1}])
