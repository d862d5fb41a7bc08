"""Poses and obstacles, as configuration values write them."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from table import each_row

from vastflow.sim.model.obstacle import FRICTION, MASS_KG, Obstacle, Trigger, obstacle_of, obstacles_of
from vastflow.sim.model.pose import Pose, pose_of

NUMBERS = st.floats(-1e3, 1e3)


@given(NUMBERS, NUMBERS, NUMBERS)
def test_pose_is_read_back_from_its_value(x, y, yaw):
    assert pose_of(Pose(x, y, yaw).value()) == Pose(x, y, yaw)


@each_row(
    ("value", "pose"),
    [
        ({"x": 1, "y": 2.5, "yaw": 0.5}, Pose(1.0, 2.5, 0.5)),
        ({"x": 1, "y": 2}, Pose(1.0, 2.0, 0.0)),
        ({"x": "1", "y": "2.5", "yaw": "0"}, Pose(1.0, 2.5, 0.0)),
        ({"position": {"x": 1, "y": 2}}, Pose(1.0, 2.0, 0.0)),
        ({"position": {"x": 1, "y": 2, "z": 3}, "orientation": {"yaw": 1}}, Pose(1.0, 2.0, 1.0)),
        ({"position": {"x": 1, "y": 2}, "orientation": {"roll": 0.1}}, Pose(1.0, 2.0, 0.0)),
    ],
)
def test_pose_may_be_written_long_or_short(value, pose):
    assert pose_of(value) == pose


@each_row(
    "value",
    [
        None,
        "1, 2",
        [1, 2],
        {"x": 1},
        {"x": True, "y": 0},
        {"x": "1 m", "y": 2},
        {"x": "nan", "y": 2},
        {"position": 3},
        {},
    ],
)
def test_what_is_no_pose_is_refused_by_name(value):
    with pytest.raises(ValueError, match=r"goal: found .*; a pose is \{x, y, yaw\} or"):
        pose_of(value, "goal")


def read(model="box", arguments="", **others):
    return obstacle_of({"model": model, "xacro_arguments": arguments, "spawn_pose": {"x": 1, "y": 2}, **others})


@each_row(
    ("arguments", "length_m", "width_m"),
    [
        ("", 0.5, 0.5),
        ("width:=0.8, length:=0.6, height:=1.0", 0.6, 0.8),
        ("width:=0.8 length:=0.6", 0.6, 0.8),
        ("width:=0.3", 0.3, 0.3),
        ("box_width:=0.3,box_length:=0.4,box_height:=2", 0.4, 0.3),
    ],
)
def test_box_has_the_size_of_its_arguments(arguments, length_m, width_m):
    assert read("models/box.sdf.xacro", arguments) == Obstacle("obstacle", "box", Pose(1, 2), length_m, width_m)


@each_row(
    ("arguments", "diameter_m"),
    [("", 0.5), ("diameter:=0.4", 0.4), ("radius:=0.4, height:=1", 0.8), ("width:=0.3", 0.3), ("length:=2.0", 0.5)],
)
def test_cylinder_has_the_diameter_of_its_arguments(arguments, diameter_m):
    found = read("models/Cylinder.sdf.xacro", arguments)
    assert (found.shape, found.length_m, found.width_m) == ("cylinder", diameter_m, diameter_m)


def test_only_the_file_s_name_says_what_a_model_is():
    assert read("cylinders/crate.sdf").shape == "box"


def test_obstacle_without_a_name_is_called_by_its_place():
    entry = {"spawn_pose": {"x": 0, "y": 0}}
    assert [o.name for o in obstacles_of({"crates": [entry, {**entry, "entity_name": "red"}]})] == ["crates[0]", "red"]


def test_obstacles_are_the_entries_with_a_spawn_pose_of_any_list_in_order_of_keys():
    entry = {"spawn_pose": {"x": 0, "y": 0}}
    environment = {"z": [entry], "a": [entry, {"pose": 1}, 3], "map_file": "m", "text": "spawn_pose"}
    assert [o.name for o in obstacles_of(environment)] == ["a[0]", "z[0]"]


@each_row(
    ("model", "arguments", "message"),
    [
        ("box", "w:=3", "obstacle: a box has no argument 'w'; it has width, length, height, box_width"),
        ("box", "radius:=0.3", "a box has no argument 'radius'"),
        ("cylinder", "box_width:=0.3", "a cylinder has no argument 'box_width'; it has diameter, radius"),
        ("box", "width=3", "found argument 'width=3'; a size is written like width:=0.5, greater than 0"),
        ("box", "width:=wide", "got argument 'width:=wide'"),
        ("box", "width:=0", "got argument 'width:=0'"),
        ("box", "width:=-1", "got argument 'width:=-1'"),
        ("box", "width:=nan", "got argument 'width:=nan'"),
        ("box", "width:=inf", "got argument 'width:=inf'"),
    ],
)
def test_size_that_can_not_be_read_is_refused(model, arguments, message):
    with pytest.raises(ValueError, match=message):
        read(model, arguments)


def test_obstacle_in_no_place_is_refused_by_its_place_in_the_list():
    with pytest.raises(ValueError, match=r"crates\[1\]\.spawn_pose: found None"):
        obstacles_of({"crates": [{"spawn_pose": {"x": 0, "y": 0}}, {"spawn_pose": None}]})


@given(NUMBERS, NUMBERS, st.floats(-7, 7), st.floats(0.01, 5), st.floats(0.01, 5))
def test_box_s_footprint_has_its_area_its_center_and_its_direction(x, y, yaw, length, width):
    box = Obstacle("b", "box", Pose(x, y, yaw), length, width)
    footprint = box.footprint()
    assert footprint.area == pytest.approx(length * width, rel=1e-6)
    assert footprint.centroid.coords[0] == pytest.approx((x, y), abs=1e-6)
    corner = (x + math.cos(yaw) * length / 2 - math.sin(yaw) * width / 2,
              y + math.sin(yaw) * length / 2 + math.cos(yaw) * width / 2)  # fmt: skip
    assert min(math.dist(corner, c) for c in footprint.exterior.coords) < 1e-6
    assert box.circumradius_m == pytest.approx(math.dist(corner, (x, y)), rel=1e-6)


def test_cylinder_s_footprint_is_its_circle():
    cylinder = Obstacle("c", "cylinder", Pose(1.0, 2.0), 0.6, 0.6)
    assert cylinder.circumradius_m == 0.3
    assert cylinder.footprint().area == pytest.approx(math.pi * 0.09, rel=2e-3)


def test_obstacles_of_one_shape_and_size_have_one_class():
    assert Obstacle("a", "box", Pose(0, 0), 0.5, 0.25).size_class == "box 0.5 x 0.25 m"
    assert Obstacle("a", "cylinder", Pose(0, 0), 0.5, 0.5).size_class == "cylinder 0.5 m"


def test_mass_and_friction_are_those_of_the_arguments_or_of_a_carton():
    assert (read().mass_kg, read().friction) == (MASS_KG, FRICTION)
    heavy = read("cylinder", "radius:=0.2, mass:=20, friction:=0.7")
    assert (heavy.mass_kg, heavy.friction) == (20.0, 0.7)


@given(st.floats(0.05, 3.0), st.floats(0.05, 3.0))
def test_mean_radius_is_the_mean_distance_of_the_floor_area_s_points_from_its_center(length_m, width_m):
    box = Obstacle("it", "box", Pose(0, 0), length_m, width_m)
    x, y = np.meshgrid((np.arange(200) + 0.5) / 200 - 0.5, (np.arange(200) + 0.5) / 200 - 0.5)
    assert box.mean_radius_m == pytest.approx(np.hypot(x * length_m, y * width_m).mean(), rel=1e-3)


def test_mean_radius_of_a_cylinder_is_two_thirds_of_its_own():
    assert Obstacle("it", "cylinder", Pose(0, 0), 0.6, 0.6).mean_radius_m == pytest.approx(0.2)


ENTRY = {"entity_name": "obstacle_0", "model": "box.sdf.xacro", "spawn_pose": {"position": {"x": 1.5, "y": -2.0}}}
POINT = {"x": 1.5, "y": -2.0, "z": 0}


def test_obstacle_without_a_trigger_stands_from_the_start():
    assert [o.trigger for o in obstacles_of({"static_objects": [ENTRY]})] == [None]


def test_trigger_of_the_usual_keys_is_that_of_the_obstacle_at_its_point():
    (static, triggered) = obstacles_of(
        {
            "static_objects": [{**ENTRY, "spawn_pose": {"x": 0, "y": 0}}],
            "the_dynamic_one": [ENTRY],
            "spawn_trigger_point": POINT,
            "spawn_trigger_threshold": 2.0,
        }
    )
    assert (static.trigger, triggered.trigger) == (None, Trigger(1.5, -2.0, 2.0))


@each_row(
    "spawn_trigger",
    [{"point": {"x": 4, "y": 5}, "threshold": 1}, {"point": "where", "threshold": "near"}],
)
def test_entry_s_own_trigger_is_written_as_values_or_as_keys_of_the_environment(spawn_trigger):
    environment = {"crates": [{**ENTRY, "spawn_trigger": spawn_trigger}], "where": {"x": 4, "y": 5, "z": 0}, "near": 1}
    assert [o.trigger for o in obstacles_of(environment)] == [Trigger(4.0, 5.0, 1.0)]


@each_row("delay", [0.8, "late"])
def test_delay_of_an_entry_s_own_trigger_is_a_value_or_a_key(delay):
    spawn_trigger = {"point": {"x": 4, "y": 5}, "threshold": 1, "delay": delay}
    (obstacle,) = obstacles_of({"crates": [{**ENTRY, "spawn_trigger": spawn_trigger}], "late": 0.8})
    assert obstacle.trigger == Trigger(4.0, 5.0, 1.0, 0.8)


@each_row("delay", [-1, True, "nowhere", float("inf")])
def test_delay_that_is_no_time_is_refused(delay):
    spawn_trigger = {"point": {"x": 4, "y": 5}, "threshold": 1, "delay": delay}
    with pytest.raises(
        ValueError, match=r"crates\[0\]\.spawn_trigger\.delay: expected a time in seconds, 0 or more, got .*"
    ):
        obstacles_of({"crates": [{**ENTRY, "spawn_trigger": spawn_trigger}]})


@each_row(
    ("environment", "message"),
    [
        ({"spawn_trigger_point": POINT}, "spawn_trigger_threshold: expected a distance in meters, 0 or more, got None"),
        (
            {"spawn_trigger_point": POINT, "spawn_trigger_threshold": -1},
            "spawn_trigger_threshold: expected a dist, got -1",
        ),
        (
            {"spawn_trigger_point": [1, 2], "spawn_trigger_threshold": 1},
            r"spawn_trigger_point: expected a pose, got \[1, 2\]",
        ),
        (
            {"spawn_trigger_point": {"x": 1.5, "y": 2.0}, "spawn_trigger_threshold": 1},
            "spawn_trigger_point: expected the position of an obstacle, and none stands there, got .*",
        ),
    ],
)
def test_trigger_that_can_not_be_read_or_is_no_obstacle_s_is_refused(environment, message):
    with pytest.raises(ValueError, match=message):
        obstacles_of({"crates": [ENTRY], **environment})


@each_row(
    ("spawn_trigger", "message"),
    [
        (2.0, r"crates\[0\]\.spawn_trigger: expected \{point: …, threshold: …\}, got 2\.0"),
        ({"point": POINT}, r"crates\[0\]\.spawn_trigger: expected \{point: …, threshold: …\}, got .*"),
        ({"point": "there", "threshold": 1}, r"crates\[0\]\.spawn_trigger\.point: expected a pose, got 'there'"),
        ({"point": POINT, "threshold": True}, r"crates\[0\]\.spawn_trigger\.threshold: expected a distance, got True"),
    ],
)
def test_entry_s_own_trigger_that_can_not_be_read_is_refused_by_its_place(spawn_trigger, message):
    with pytest.raises(ValueError, match=message):
        obstacles_of({"crates": [{**ENTRY, "spawn_trigger": spawn_trigger}]})
