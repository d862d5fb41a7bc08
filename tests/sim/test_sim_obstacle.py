"""Poses and obstacles, as configuration values write them."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vastflow.sim.obstacle import Obstacle, obstacle_of, obstacles_of
from vastflow.sim.pose import Pose, pose_of

NUMBERS = st.floats(-1e3, 1e3)


@given(NUMBERS, NUMBERS, NUMBERS)
def test_a_pose_is_read_back_from_its_value(x, y, yaw):
    assert pose_of(Pose(x, y, yaw).value()) == Pose(x, y, yaw)


@pytest.mark.parametrize(
    ("value", "pose"),
    [
        ({"x": 1, "y": 2.5, "yaw": 0.5}, Pose(1.0, 2.5, 0.5)),
        ({"x": 1, "y": 2}, Pose(1.0, 2.0, 0.0)),
        ({"position": {"x": 1, "y": 2}}, Pose(1.0, 2.0, 0.0)),
        ({"position": {"x": 1, "y": 2, "z": 3}, "orientation": {"yaw": 1}}, Pose(1.0, 2.0, 1.0)),
        ({"position": {"x": 1, "y": 2}, "orientation": {"roll": 0.1}}, Pose(1.0, 2.0, 0.0)),
    ],
)
def test_a_pose_may_be_written_long_or_short(value, pose):
    assert pose_of(value) == pose


@pytest.mark.parametrize(
    "value", [None, "1, 2", [1, 2], {"x": 1}, {"x": True, "y": 0}, {"x": "1", "y": 2}, {"position": 3}, {}]
)
def test_what_is_no_pose_is_refused_by_name(value):
    with pytest.raises(ValueError, match=r"goal: found .*; a pose is \{x, y, yaw\} or"):
        pose_of(value, "goal")


def read(model="box", arguments="", **others):
    return obstacle_of({"model": model, "xacro_arguments": arguments, "spawn_pose": {"x": 1, "y": 2}, **others})


@pytest.mark.parametrize(
    ("arguments", "length_m", "width_m"),
    [
        ("", 0.5, 0.5),
        ("width:=0.8, length:=0.6, height:=1.0", 0.6, 0.8),
        ("width:=0.8 length:=0.6", 0.6, 0.8),
        ("width:=0.3", 0.3, 0.3),
        ("box_width:=0.3,box_length:=0.4,box_height:=2", 0.4, 0.3),
    ],
)
def test_a_box_has_the_size_of_its_arguments(arguments, length_m, width_m):
    assert read("models/box.sdf.xacro", arguments) == Obstacle("obstacle", "box", Pose(1, 2), length_m, width_m)


@pytest.mark.parametrize(
    ("arguments", "diameter_m"),
    [("", 0.5), ("diameter:=0.4", 0.4), ("radius:=0.4, height:=1", 0.8), ("width:=0.3", 0.3), ("length:=2.0", 0.5)],
)
def test_a_cylinder_has_the_diameter_of_its_arguments(arguments, diameter_m):
    found = read("models/Cylinder.sdf.xacro", arguments)
    assert (found.shape, found.length_m, found.width_m) == ("cylinder", diameter_m, diameter_m)


def test_only_the_file_s_name_says_what_a_model_is():
    assert read("cylinders/crate.sdf").shape == "box"


def test_an_obstacle_without_a_name_is_called_by_its_place():
    entry = {"spawn_pose": {"x": 0, "y": 0}}
    assert [o.name for o in obstacles_of({"crates": [entry, {**entry, "entity_name": "red"}]})] == ["crates[0]", "red"]


def test_obstacles_are_the_entries_with_a_spawn_pose_of_any_list_in_order_of_keys():
    entry = {"spawn_pose": {"x": 0, "y": 0}}
    environment = {"z": [entry], "a": [entry, {"pose": 1}, 3], "map_file": "m", "text": "spawn_pose"}
    assert [o.name for o in obstacles_of(environment)] == ["a[0]", "z[0]"]


@pytest.mark.parametrize(
    ("model", "arguments", "message"),
    [
        ("box", "w:=3", "obstacle: a box has no argument 'w'; it has width, length, height, box_width"),
        ("box", "radius:=0.3", "a box has no argument 'radius'"),
        ("cylinder", "box_width:=0.3", "a cylinder has no argument 'box_width'; it has diameter, radius"),
        ("box", "width=3", "found argument 'width=3'; a size is written like width:=0.5, greater than 0 m"),
        ("box", "width:=wide", "found argument 'width:=wide'"),
        ("box", "width:=0", "found argument 'width:=0'"),
        ("box", "width:=-1", "found argument 'width:=-1'"),
        ("box", "width:=nan", "found argument 'width:=nan'"),
        ("box", "width:=inf", "found argument 'width:=inf'"),
    ],
)
def test_a_size_that_can_not_be_read_is_refused(model, arguments, message):
    with pytest.raises(ValueError, match=message):
        read(model, arguments)


def test_an_obstacle_in_no_place_is_refused_by_its_place_in_the_list():
    with pytest.raises(ValueError, match=r"crates\[1\]\.spawn_pose: found None"):
        obstacles_of({"crates": [{"spawn_pose": {"x": 0, "y": 0}}, {"spawn_pose": None}]})


@given(NUMBERS, NUMBERS, st.floats(-7, 7), st.floats(0.01, 5), st.floats(0.01, 5))
def test_a_box_s_footprint_has_its_area_its_centre_and_its_direction(x, y, yaw, length, width):
    box = Obstacle("b", "box", Pose(x, y, yaw), length, width)
    footprint = box.footprint()
    assert footprint.area == pytest.approx(length * width, rel=1e-6)
    assert footprint.centroid.coords[0] == pytest.approx((x, y), abs=1e-6)
    corner = (x + math.cos(yaw) * length / 2 - math.sin(yaw) * width / 2,
              y + math.sin(yaw) * length / 2 + math.cos(yaw) * width / 2)  # fmt: skip
    assert min(math.dist(corner, c) for c in footprint.exterior.coords) < 1e-6
    assert box.circumradius_m == pytest.approx(math.dist(corner, (x, y)), rel=1e-6)


def test_a_cylinder_s_footprint_is_its_circle():
    cylinder = Obstacle("c", "cylinder", Pose(1.0, 2.0), 0.6, 0.6)
    assert cylinder.circumradius_m == 0.3
    assert cylinder.footprint().area == pytest.approx(math.pi * 0.09, rel=2e-3)


def test_obstacles_of_one_shape_and_size_have_one_class():
    assert Obstacle("a", "box", Pose(0, 0), 0.5, 0.25).size_class == "box 0.5 x 0.25 m"
    assert Obstacle("a", "cylinder", Pose(0, 0), 0.5, 0.5).size_class == "cylinder 0.5 m"
