"""Robots with a polygon for a footprint: what is read, what their costmaps hold, and what their bodies meet."""

import math

import numpy as np
import pytest
import shapely
import shapely.affinity
from hypothesis import given
from hypothesis import strategies as st
from table import each_row

from vastflow.sim.kernels.numeric import njit
from vastflow.sim.model.polygon import vertices_of
from vastflow.sim.model.pose import Pose
from vastflow.sim.nav2.costmaps.outline import circumscribed_radius_m, inscribed_radius_m, outline_of
from vastflow.sim.nav2.navigator.collision_monitor import _in_outline
from vastflow.sim.nav2.parameters.costmap import Costmap
from vastflow.sim.nav2.parameters.servers import VelocitySmoother
from vastflow.sim.nav2.parameters.stack import NavParameters
from vastflow.sim.reading.robot import robot_of
from vastflow.sim.world.motion import arc
from vastflow.sim.world.occupancy import OccupancyMap
from vastflow.sim.world.physics import World
from vastflow.sim.world.walls import WallIndex

RECTANGLE = "[[0.35, 0.25], [0.35, -0.25], [-0.35, -0.25], [-0.35, 0.25]]"
NOTCHED = "[[0.4, 0.3], [0.4, -0.3], [-0.4, -0.3], [-0.4, 0.3], [0.1, 0.1]]"
STEP_M = 0.006
"""How far a body may stand in a wall: what it drives in one step at 0.5 m/s, and the engine's slop."""


def of_polygon(text, **values):
    return NavParameters(local_costmap=Costmap(footprint=text, **values))


def test_polygon_counts_in_place_of_the_radius():
    outline = outline_of(Costmap(footprint=RECTANGLE, robot_radius=0.1))
    assert outline.tolist() == [[0.36, 0.26], [0.36, -0.26], [-0.36, -0.26], [-0.36, 0.26]]
    assert inscribed_radius_m(outline) == pytest.approx(0.26)
    assert circumscribed_radius_m(outline) == pytest.approx(math.hypot(0.36, 0.26))


@each_row("text", ["", "[]", " [] "])
def test_without_a_polygon_the_robot_is_the_disc_of_its_radius(text):
    assert np.array_equal(outline_of(Costmap(footprint=text)), outline_of(Costmap()))


@each_row(
    ("text", "right"),
    [
        ("[[0.2, 0.2]]", "three or more vertices"),
        ("[[0.2, 0.2], [0.1, 0.1, 0.1], [0.0, 0.3]]", "three or more vertices"),
        ("[[a, b], [0.1, 0.1], [0.0, 0.3]]", "three or more vertices"),
        ("[[1e999, 0.0], [0.1, 0.1], [0.0, 0.3]]", "three or more vertices"),
        (f"[[{10**400}, 0], [0.1, 0.1], [0.0, 0.3]]", "vertices within 10 m"),
        ("[[10.1, 0.0], [-0.1, 0.1], [0.0, -0.3]]", "vertices within 10 m"),
        ("[" * 300, "three or more vertices"),
        ("[[0.1, 0.1], [0.2, 0.2], [0.3, 0.3]]", "a polygon with an area"),
        ("[[0.3, 0.3], [-0.3, -0.2], [0.3, -0.3], [-0.3, 0.3]]", "do not cross"),
        ("[[0.3, 0.1], [0.5, 0.1], [0.5, 0.3]]", r"round the robot's origin \(0, 0\)"),
        (
            str([[0.3 * math.cos(k), 0.3 * math.sin(k)] for k in np.linspace(0, 6, 40)]),
            "32 vertices at most, and not of 40",
        ),
    ],
)
def test_polygon_that_no_robot_has_is_refused(text, right):
    with pytest.raises(ValueError, match=right):
        vertices_of(text)


def test_radii_of_a_notched_outline_are_those_of_its_edges_and_not_of_their_lines():
    vertices = np.array(vertices_of(NOTCHED))
    ring = shapely.Polygon(vertices).exterior
    assert inscribed_radius_m(vertices) == pytest.approx(ring.distance(shapely.Point(0.0, 0.0)))


@njit
def inside(outline, x, y):
    return _in_outline(outline, outline.shape[0], x, y)


@given(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), st.sampled_from([RECTANGLE, NOTCHED]), st.booleans())
def test_point_is_inside_whatever_form_and_direction_the_outline_has(x, y, text, turned):
    vertices = np.array(vertices_of(text))
    polygon = shapely.Polygon(vertices)
    if polygon.exterior.distance(shapely.Point(x, y)) > 1e-9:
        assert inside(np.ascontiguousarray(vertices[::-1] if turned else vertices), x, y) == polygon.contains(
            shapely.Point(x, y)
        )


def test_body_is_the_polygon_without_its_padding():
    robot = robot_of(of_polygon(RECTANGLE))
    assert robot.vertices == ((0.35, 0.25), (0.35, -0.25), (-0.35, -0.25), (-0.35, 0.25))
    assert robot.radius_m == pytest.approx(math.hypot(0.35, 0.25))


def test_body_is_a_disc_of_the_radius_and_that_of_nav2s_default_file_is_the_turtlebot_4():
    assert robot_of(NavParameters(local_costmap=Costmap(robot_radius=0.4))).radius_m == 0.4
    assert robot_of(NavParameters()).radius_m == 0.17


def test_actuators_reach_what_the_smoother_allows_and_never_less_than_a_turtlebot_4():
    fast = robot_of(
        NavParameters(velocity_smoother=VelocitySmoother(max_velocity=(1.5, 0.0, 2.5), max_accel=(4.0, 0.0, 3.2)))
    )
    assert (fast.max_speed_mps, fast.max_acceleration_mps2, fast.max_yaw_rate_radps) == (1.5, 4.0, 2.5)
    assert fast.max_yaw_acceleration_radps2 == 3.0
    slow = robot_of(
        NavParameters(velocity_smoother=VelocitySmoother(max_velocity=(0.2, 0.0, 1.0), min_velocity=(-0.2, 0.0, -1.0)))
    )
    assert (slow.max_speed_mps, slow.max_acceleration_mps2) == (0.5, 2.0)


def hall(length_m=6.0, width_m=4.0):
    """A hall with walls 0.1 m thick, its free space from 0 to `length_m` and from 0 to `width_m`."""
    cells = np.zeros((round(width_m / 0.05) + 4, round(length_m / 0.05) + 4), dtype=np.int8)
    cells[:2], cells[-2:], cells[:, :2], cells[:, -2:] = 100, 100, 100, 100
    return WallIndex(OccupancyMap(cells, 0.05, (-0.1, -0.1)))


class Driven:
    """A polygon in a hall, driven by the engine alone."""

    def __init__(self, start, text=RECTANGLE):
        self.robot = robot_of(of_polygon(text))
        self.world = World(self.robot, hall(), ())
        self.pose = np.array([start.x_m, start.y_m, start.yaw_rad])
        self.t_s = 0.0

    def drive(self, v_mps, w_radps, seconds):
        for _ in range(round(seconds / 0.05)):
            self.world.drive(self.pose, [(v_mps, w_radps, 0.0)] * 5, 0.01, self.t_s)
            self.t_s += 0.05

    @property
    def body(self):
        polygon = shapely.affinity.rotate(
            shapely.Polygon(self.robot.vertices), self.pose[2], (0.0, 0.0), use_radians=True
        )
        return shapely.affinity.translate(polygon, *self.pose[:2])

    @property
    def depth_m(self):
        """How far the body reaches out of the hall."""
        return max(-self.body.bounds[0], -self.body.bounds[1], self.body.bounds[2] - 6.0, self.body.bounds[3] - 4.0)


@pytest.mark.parametrize("text", [RECTANGLE, NOTCHED])
@given(yaw=st.floats(-4, 4), v=st.floats(-0.5, 0.5), w=st.floats(-2, 2))
def test_free_motion_is_the_exact_arc(text, yaw, v, w):
    driven = Driven(Pose(3.0, 2.0, yaw), text)
    driven.drive(v, w, 1.0)
    assert driven.pose == pytest.approx(arc(3.0, 2.0, yaw, v, w, 1.0), abs=1e-9)
    assert driven.world.events == []


@each_row(("yaw", "reach_m"), [(0.0, 0.35), (math.pi, 0.35)])
def test_it_stops_with_its_front_or_its_back_at_the_wall(yaw, reach_m):
    driven = Driven(Pose(4.5, 2.0, yaw))
    driven.drive(0.5 if yaw == 0.0 else -0.5, 0.0, 5.0)
    assert driven.pose[0] == pytest.approx(6.0 - reach_m, abs=STEP_M)
    assert {event.what for event in driven.world.events} == {"wall"}


@pytest.mark.parametrize("text", [RECTANGLE, NOTCHED])
@given(yaw=st.floats(-3, 3), v=st.floats(-0.5, 0.5), w=st.floats(-2, 2))
def test_no_wall_is_entered_however_it_drives_and_turns_and_no_wall_is_met_without_a_contact(text, yaw, v, w):
    driven = Driven(Pose(5.4, 3.4, yaw), text)
    for _ in range(40):
        driven.drive(v, w, 0.05)
        assert driven.depth_m < 3 * STEP_M
        if driven.depth_m > 2e-3:
            assert driven.world.events


def test_contact_of_a_notched_body_is_one_however_many_convex_parts_it_is_made_of():
    driven = Driven(Pose(4.5, 2.0), NOTCHED)
    driven.drive(0.5, 0.0, 5.0)
    partners = [(event.x_m, event.y_m, event.t_s) for event in driven.world.events]
    whole = Driven(Pose(4.5, 2.0), "[[0.4, 0.3], [0.4, -0.3], [-0.4, -0.3], [-0.4, 0.3]]")
    whole.drive(0.5, 0.0, 5.0)
    assert len(partners) == len(whole.world.events)


def test_turn_beside_a_wall_is_blocked_or_pushes_the_body_away_and_is_a_contact():
    driven = Driven(Pose(3.0, 0.27))
    driven.drive(0.0, 1.0, 1.5)
    assert driven.world.events
    assert driven.depth_m < STEP_M
