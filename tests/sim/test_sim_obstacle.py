"""Obstacles, as configuration values write them."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from table import each_row

from vastflow.sim.model.obstacle import FRICTION, MASS_KG, Obstacle, Trigger, obstacle_of, obstacles_of
from vastflow.sim.model.pose import Pose
from vastflow.sim.model.shape import Box, Disc

NUMBERS = st.floats(-1e3, 1e3)
SIDES_M = st.floats(0.01, 5)
HERE = {"spawn_pose": {"x": 0, "y": 0}}
ENTRY = {"entity_name": "obstacle_0", "model": "box.sdf.xacro", "spawn_pose": {"position": {"x": 1.5, "y": -2.0}}}
POINT = {"x": 1.5, "y": -2.0, "z": 0}
NO_DELAYS = (-1, True, "nowhere", math.inf)
NO_SIZES = ("width=3", "width:=wide", "width:=0", "width:=nan", "width:=inf")


def box(pose, length, width, *more):
    return Obstacle("it", Box(length, width), pose, *more)


def cylinder(pose, diameter):
    return Obstacle("it", Disc(diameter / 2), pose)


def read(model="box", arguments=""):
    return obstacle_of({"model": model, "xacro_arguments": arguments, "spawn_pose": {"x": 1, "y": 2}}, "it")


@each_row(
    ("model", "arguments", "obstacle"),
    [
        ("models/box.sdf.xacro", "", box(Pose(1, 2), 0.5, 0.5)),
        ("cylinders/crate.sdf", "width:=0.8, length:=0.6, height:=1.0", box(Pose(1, 2), 0.6, 0.8)),
        ("box", "width:=0.3", box(Pose(1, 2), 0.3, 0.3)),
        ("box", "box_width:=0.3,box_length:=0.4,box_height:=2", box(Pose(1, 2), 0.4, 0.3)),
        ("models/Cylinder.sdf.xacro", "", cylinder(Pose(1, 2), 0.5)),
        ("cylinder", "diameter:=0.4", cylinder(Pose(1, 2), 0.4)),
        ("cylinder", "radius:=0.4, height:=1", cylinder(Pose(1, 2), 0.8)),
        ("cylinder", "width:=0.3", cylinder(Pose(1, 2), 0.3)),
        ("cylinder", "length:=2.0", cylinder(Pose(1, 2), 0.5)),
        ("box", "mass:=20 friction:=0.7", box(Pose(1, 2), 0.5, 0.5, None, 20.0, 0.7)),
    ],
)
def test_model_has_the_shape_of_its_file_and_the_size_of_its_arguments(model, arguments, obstacle):
    assert read(model, arguments) == obstacle
    assert (box(Pose(1, 2), 0.5, 0.5).mass_kg, read().friction) == (MASS_KG, FRICTION)


def test_obstacles_are_entries_with_a_spawn_pose_in_order_of_keys():
    entries = [HERE, {**HERE, "entity_name": "red"}, {"pose": 1}, 3]
    environment = {"z": [HERE], "a": entries, "map_file": "m", "t": "spawn_pose"}
    assert [(o.name, o.trigger) for o in obstacles_of(environment)] == [("a[0]", None), ("red", None), ("z[0]", None)]


@each_row(
    ("model", "arguments", "message"),
    [
        ("box", "w:=3", "it: a box has no argument 'w'. It has width, length, height, box_width"),
        ("cylinder", "box_width:=0.3", "a cylinder has no argument 'box_width'. It has diameter, radius"),
        *(("box", text, f"size greater than 0, such as width:=0.5, got '{text}'") for text in NO_SIZES),
    ],
)
def test_unreadable_size_is_refused(model, arguments, message):
    with pytest.raises(ValueError, match=message):
        read(model, arguments)


@given(NUMBERS, NUMBERS, st.floats(-7, 7), SIDES_M, SIDES_M)
def test_box_footprint_has_area_center_and_direction(x, y, yaw, length, width):
    crate = box(Pose(x, y, yaw), length, width)
    footprint = crate.footprint()
    assert footprint.area == pytest.approx(length * width, rel=1e-6)
    assert footprint.centroid.coords[0] == pytest.approx((x, y), abs=1e-6)
    corner = (x + math.cos(yaw) * length / 2 - math.sin(yaw) * width / 2,
              y + math.sin(yaw) * length / 2 + math.cos(yaw) * width / 2)  # fmt: skip
    assert min(math.dist(corner, c) for c in footprint.exterior.coords) < 1e-6
    assert crate.shape.circumradius_m == pytest.approx(math.dist(corner, (x, y)), rel=1e-6)
    along, across = np.meshgrid((np.arange(200) + 0.5) / 200 - 0.5, (np.arange(200) + 0.5) / 200 - 0.5)
    assert crate.shape.mean_radius_m == pytest.approx(np.hypot(along * length, across * width).mean(), rel=1e-3)


def test_cylinder_is_a_circle_and_has_the_class_of_its_size():
    barrel = cylinder(Pose(1.0, 2.0), 0.6)
    assert (barrel.shape.circumradius_m, barrel.shape.mean_radius_m) == pytest.approx((0.3, 0.2))
    assert barrel.footprint().area == pytest.approx(math.pi * 0.09, rel=2e-3)
    assert (str(barrel.shape), str(Box(0.5, 0.25))) == ("cylinder 0.6 m", "box 0.5 x 0.25 m")


def test_default_trigger_keys_match_obstacle_trigger():
    usual = {"spawn_trigger_point": POINT, "spawn_trigger_threshold": 2.0}
    static, triggered = obstacles_of({"static_objects": [HERE], "the_dynamic_one": [ENTRY], **usual})
    assert (static.trigger, triggered.trigger) == (None, Trigger(1.5, -2.0, 2.0))


@each_row(
    ("spawn_trigger", "delay_s"),
    [
        ({"point": {"x": 4, "y": 5}, "threshold": 1}, 0.0),
        ({"point": "where", "threshold": "near"}, 0.0),
        ({"point": "where", "threshold": 1, "delay": 0.8}, 0.8),
        ({"point": "where", "threshold": 1, "delay": "late"}, 0.8),
    ],
)
def test_trigger_of_an_entry_has_values_or_keys(spawn_trigger, delay_s):
    keys = {"where": {"x": 4, "y": 5, "z": 0}, "near": 1, "late": 0.8}
    (obstacle,) = obstacles_of({"crates": [{**ENTRY, "spawn_trigger": spawn_trigger}], **keys})
    assert obstacle.trigger == Trigger(4.0, 5.0, 1.0, delay_s)


def own(**spawn_trigger):
    return {"crates": [{**ENTRY, "spawn_trigger": {"point": POINT, "threshold": 1, **spawn_trigger}}]}


def usual(point, threshold=1):
    return {"crates": [ENTRY], "spawn_trigger_point": point, "spawn_trigger_threshold": threshold}


@each_row(
    ("environment", "message"),
    [
        ({"crates": [HERE, {"spawn_pose": None}]}, r"crates\[1\]\.spawn_pose: expected .*, got None"),
        *((own(delay=delay), r"trigger\.delay: expected a time in seconds, 0 or more, got .*") for delay in NO_DELAYS),
        (own(point="there"), r"crates\[0\]\.spawn_trigger\.point: expected .*, got 'there'"),
        (own(threshold=True), r"crates\[0\]\.spawn_trigger\.threshold: expected a distance .*, got True"),
        (own(speed=1), r"spawn_trigger: expected \{point: …, threshold: …\} and perhaps delay: … \(s\), got"),
        ({"crates": [{**ENTRY, "spawn_trigger": 2.0}]}, r"crates\[0\]\.spawn_trigger: expected .*, got 2\.0"),
        (usual(POINT, None), "spawn_trigger_threshold: expected a distance in meters, 0 or more, got None"),
        (usual(POINT, -1), "spawn_trigger_threshold: expected a distance .*, got -1"),
        (usual([1, 2]), r"spawn_trigger_point: expected .*, got \[1, 2\]"),
        (usual({"x": 1.5, "y": 2.0}), "spawn_trigger_point: expected the position of an obstacle, got .*"),
    ],
)
def test_unreadable_place_or_trigger_is_refused_with_its_place(environment, message):
    with pytest.raises(ValueError, match=message):
        obstacles_of(environment)
