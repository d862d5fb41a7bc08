"""Physics: free motion, walls, obstacles and contacts."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely.geometry import Point

from vastflow.sim.maps import OccupancyMap
from vastflow.sim.obstacle import Obstacle
from vastflow.sim.pose import Pose
from vastflow.sim.robot import Robot, arc
from vastflow.sim.walls import WallIndex
from vastflow.sim.world import World

DT_S = 0.01
ROBOT = Robot()
STEP_M = 0.006
"""How far a body may stand in a wall: what it drives in one step at 0.5 m/s, and the engine's slop."""


def hall(length_m=6.0, width_m=4.0):
    """A hall with walls 0.1 m thick, its free space from 0 to `length_m` and from 0 to `width_m`."""
    cells = np.zeros((round(width_m / 0.05) + 4, round(length_m / 0.05) + 4), dtype=np.int8)
    cells[:2], cells[-2:], cells[:, :2], cells[:, -2:] = 100, 100, 100, 100
    return WallIndex(OccupancyMap(cells, 0.05, (-0.1, -0.1)))


def drive(world, v_mps, w_radps, seconds):
    for _ in range(round(seconds / (5 * DT_S))):
        world.drive([(v_mps, w_radps)] * 5, DT_S)


def pose(world):
    return (*world.robot.position, world.robot.angle)


@given(st.floats(-4, 4), st.floats(-0.5, 0.5), st.floats(-2, 2))
@settings(max_examples=50, deadline=None)
def test_free_motion_is_the_exact_arc(yaw, v, w):
    world = World(ROBOT, Pose(3.0, 2.0, yaw), hall(), ())
    drive(world, v, w, 1.0)
    assert pose(world) == pytest.approx(arc(3.0, 2.0, yaw, v, w, 1.0), abs=1e-9)
    assert world.contacts == []


def test_a_robot_that_drives_against_a_wall_stops_with_its_body_at_the_wall():
    world = World(ROBOT, Pose(4.0, 2.0), hall(), ())
    drive(world, 0.5, 0.0, 8.0)
    x, y, yaw = pose(world)
    assert x == pytest.approx(6.0 - ROBOT.radius_m, abs=STEP_M)
    assert (y, yaw) == pytest.approx((2.0, 0.0))


def test_a_contact_says_when_where_with_what_and_how_fast():
    world = World(ROBOT, Pose(4.0, 2.0), hall(), ())
    drive(world, 0.5, 0.0, 8.0)
    (contact,) = world.contacts
    assert (contact.kind, contact.what) == ("contact", "wall")
    assert contact.value == pytest.approx(0.5)
    assert contact.t_s == pytest.approx((2.0 - ROBOT.radius_m) / 0.5, abs=0.03)
    assert (contact.x_m, contact.y_m) == pytest.approx((6.0 - ROBOT.radius_m, 2.0), abs=0.01)


def test_a_glancing_contact_closes_with_the_part_of_the_speed_towards_the_wall():
    yaw = math.radians(30)
    world = World(ROBOT, Pose(1.0, 3.0, yaw), hall(), ())
    drive(world, 0.5, 0.0, 4.0)
    assert world.contacts[0].value == pytest.approx(0.5 * math.sin(yaw))


def test_a_robot_slides_along_a_wall_that_blocks_one_part_of_its_motion():
    yaw = math.radians(30)
    world = World(ROBOT, Pose(1.0, 3.5, yaw), hall(), ())
    drive(world, 0.5, 0.0, 4.0)
    x, y, _ = pose(world)
    assert y == pytest.approx(4.0 - ROBOT.radius_m, abs=STEP_M)
    assert x == pytest.approx(1.0 + 4.0 * 0.5 * math.cos(yaw), abs=0.02)


def test_a_robot_that_leaves_a_wall_and_comes_back_touches_it_twice():
    world = World(ROBOT, Pose(5.5, 2.0), hall(), ())
    for v in (0.5, -0.5, 0.5):
        drive(world, v, 0.0, 1.0)
    assert [contact.what for contact in world.contacts] == ["wall", "wall"]


@pytest.mark.parametrize(
    ("shape", "length_m", "width_m", "face_m"), [("box", 0.4, 1.0, 0.2), ("cylinder", 0.6, 0.6, 0.3)]
)
def test_an_obstacle_stops_the_robot_and_is_named_in_the_contact(shape, length_m, width_m, face_m):
    obstacle = Obstacle("crate", shape, Pose(3.0, 2.0), length_m, width_m)
    world = World(ROBOT, Pose(1.0, 2.0), hall(), (obstacle,))
    drive(world, 0.5, 0.0, 5.0)
    assert pose(world)[0] == pytest.approx(3.0 - face_m - ROBOT.radius_m, abs=STEP_M)
    assert {contact.what for contact in world.contacts} == {"crate"}


def test_a_robot_slides_off_the_corner_of_an_obstacle_and_never_enters_it():
    obstacle = Obstacle("crate", "box", Pose(3.0, 2.0, 0.7), 0.4, 0.4)
    world = World(ROBOT, Pose(1.0, 2.0), hall(), (obstacle,))
    for _ in range(40):
        drive(world, 0.5, 0.0, 0.2)
        assert obstacle.footprint().distance(Point(*world.robot.position)) >= ROBOT.radius_m - STEP_M
    assert pose(world)[0] > 3.5


def test_walls_join_as_the_robot_comes_near_them_and_stop_it_all_the_same():
    world = World(ROBOT, Pose(1.0, 2.0), hall(length_m=24.0), ())
    near_the_start = set(world._present)
    assert len(near_the_start) < len(world._walls.rectangles)
    drive(world, 0.5, 0.0, 50.0)
    assert near_the_start < world._present
    assert pose(world)[0] == pytest.approx(24.0 - ROBOT.radius_m, abs=STEP_M)


@given(st.floats(0.5, 5.5), st.floats(0.5, 3.5), st.floats(-4, 4), st.floats(-1, 1))
@settings(max_examples=30, deadline=None)
def test_the_body_never_enters_a_wall(x, y, yaw, w):
    world = World(ROBOT, Pose(x, y, yaw), hall(), ())
    for _ in range(10):
        drive(world, 0.5, w, 1.0)
        x, y, _ = pose(world)
        reach = ROBOT.radius_m - STEP_M
        assert reach <= x <= 6.0 - reach
        assert reach <= y <= 4.0 - reach
