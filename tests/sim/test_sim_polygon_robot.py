"""Robots with a polygon for a footprint: what is read, and what their costmaps hold."""

import math

import numpy as np
import pytest
import shapely
import shapely.affinity
from hypothesis import given
from hypothesis import strategies as st
from table import each_row

from vastflow.sim.kernels.numeric import njit
from vastflow.sim.model.polygon import circumscribed_radius_m, vertices_of
from vastflow.sim.nav2.costmaps.outline import inscribed_radius_m, outline_of
from vastflow.sim.nav2.navigator.collision_monitor import _in_outline
from vastflow.sim.nav2.parameters.costmap import Costmap
from vastflow.sim.nav2.parameters.servers import VelocitySmoother
from vastflow.sim.nav2.parameters.stack import NavParameters
from vastflow.sim.nav2.system.robot import robot_of

RECTANGLE = "[[0.35, 0.25], [0.35, -0.25], [-0.35, -0.25], [-0.35, 0.25]]"
NOTCHED = "[[0.4, 0.3], [0.4, -0.3], [-0.4, -0.3], [-0.4, 0.3], [0.1, 0.1]]"


def of_polygon(text, **values):
    return NavParameters(local_costmap=Costmap(footprint=text, **values))


def test_polygon_counts_in_place_of_the_radius():
    outline = outline_of(Costmap(footprint=RECTANGLE, robot_radius=0.1))
    assert outline.tolist() == [[0.36, 0.26], [0.36, -0.26], [-0.36, -0.26], [-0.36, 0.26]]
    assert inscribed_radius_m(outline) == pytest.approx(0.26)
    assert circumscribed_radius_m(outline) == pytest.approx(math.hypot(0.36, 0.26))


@each_row("text", ["", "[]", " [] "])
def test_robot_without_a_polygon_is_a_disc(text):
    assert np.array_equal(outline_of(Costmap(footprint=text)), outline_of(Costmap()))


@each_row(
    ("text", "right"),
    [
        ("[[0.2, 0.2]]", "three or more vertices"),
        ("[[0.2, 0.2], [0.1, 0.1, 0.1], [0.0, 0.3]]", "three or more vertices"),
        ("[[a, b], [0.1, 0.1], [0.0, 0.3]]", "three or more vertices"),
        (f"[[{10**400}, 0], [0.1, 0.1], [0.0, 0.3]]", "vertices within 10 m"),
        ("[[10.1, 0.0], [-0.1, 0.1], [0.0, -0.3]]", "vertices within 10 m"),
        ("[" * 300, "three or more vertices"),
        ("[[0.1, 0.1], [0.2, 0.2], [0.3, 0.3]]", "a polygon with an area"),
        ("[[0.3, 0.3], [-0.3, -0.2], [0.3, -0.3], [-0.3, 0.3]]", "do not cross"),
        ("[[0.3, 0.1], [0.5, 0.1], [0.5, 0.3]]", r"round the robot's origin \(0, 0\)"),
        (str([[math.cos(k), math.sin(k)] for k in np.linspace(0, 6, 40)]), "32 vertices at most, and not of 40"),
    ],
)
def test_polygon_that_no_robot_has_is_refused(text, right):
    with pytest.raises(ValueError, match=right):
        vertices_of(text)


def test_radii_of_notched_outline_follow_edges():
    vertices = np.array(vertices_of(NOTCHED))
    ring = shapely.Polygon(vertices).exterior
    assert inscribed_radius_m(vertices) == pytest.approx(ring.distance(shapely.Point(0.0, 0.0)))


@njit
def inside(outline, x, y):
    return _in_outline(outline, outline.shape[0], x, y)


@given(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), st.sampled_from([RECTANGLE, NOTCHED]), st.booleans())
def test_inside_test_works_for_any_outline(x, y, text, turned):
    vertices, point = np.array(vertices_of(text)), shapely.Point(x, y)
    polygon = shapely.Polygon(vertices)
    outline = np.ascontiguousarray(vertices[::-1] if turned else vertices)
    if polygon.exterior.distance(point) > 1e-9:
        assert inside(outline, x, y) == polygon.contains(point)


def test_body_is_the_polygon_without_its_padding_or_a_disc_of_the_radius():
    robot = robot_of(of_polygon(RECTANGLE))
    assert robot.vertices == ((0.35, 0.25), (0.35, -0.25), (-0.35, -0.25), (-0.35, 0.25))
    assert robot.radius_m == pytest.approx(math.hypot(0.35, 0.25))
    assert robot_of(NavParameters(local_costmap=Costmap(robot_radius=0.4))).radius_m == 0.4
    assert robot_of(NavParameters()).radius_m == 0.17  # a TurtleBot 4


def test_actuators_reach_smoother_limits_or_turtlebot_4():
    def smoothed(**limits):
        return robot_of(NavParameters(velocity_smoother=VelocitySmoother(**limits)))

    fast = smoothed(max_velocity=(1.5, 0.0, 2.5), max_accel=(4.0, 0.0, 3.2))
    assert (fast.max_speed_mps, fast.max_acceleration_mps2, fast.max_yaw_rate_radps) == (1.5, 4.0, 2.5)
    assert fast.max_yaw_acceleration_radps2 == 3.0
    slow = smoothed(max_velocity=(0.2, 0.0, 1.0), min_velocity=(-0.2, 0.0, -1.0))
    assert (slow.max_speed_mps, slow.max_acceleration_mps2) == (0.5, 2.0)
