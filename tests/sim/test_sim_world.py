"""Physics: walls, obstacles, contacts, and obstacles that appear and can be pushed."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely.affinity import rotate, translate
from shapely.geometry import Point, Polygon
from table import each_row

from vastflow.sim.model.obstacle import Obstacle, Trigger
from vastflow.sim.model.pose import Pose
from vastflow.sim.model.shape import Box, Disc
from vastflow.sim.world.motion import FREE, MOVING, TOUCHING, arc
from vastflow.sim.world.occupancy import OccupancyMap
from vastflow.sim.world.physics import GRAVITY_MPS2, TRACTION, Physics, WallIndex
from vastflow.sim.world.robot_model import Robot

DT_S = 0.01
TICK_S = 0.05
ROBOT = Robot()
STEP_M = 0.006
"""Greatest depth of a body in a wall: its travel in one step at 0.5 m/s, and the engine's slop."""
HERE = Trigger(0.0, 0.0, 1.0)
RECTANGLE = Robot(
    vertices=((0.35, 0.25), (0.35, -0.25), (-0.35, -0.25), (-0.35, 0.25)), radius_m=math.hypot(0.35, 0.25)
)
NOTCHED = Robot(vertices=((0.4, 0.3), (0.4, -0.3), (-0.4, -0.3), (-0.4, 0.3), (0.1, 0.1)), radius_m=0.5)
ROBOTS = [ROBOT, RECTANGLE, NOTCHED]


def hall(length_m=6.0, width_m=4.0):
    """A hall with walls 0.1 m thick, its free space from 0 to `length_m` and from 0 to `width_m`."""
    cells = np.zeros((round(width_m / 0.05) + 4, round(length_m / 0.05) + 4), dtype=np.int8)
    cells[:2], cells[-2:], cells[:, :2], cells[:, -2:] = 100, 100, 100, 100
    return WallIndex(OccupancyMap(cells, 0.05, (-0.1, -0.1)))


class Driven:
    """A robot in a world, driven by the engine alone."""

    def __init__(self, start, obstacles=(), walls=None, robot=ROBOT):
        self.robot = robot
        self.world = Physics(robot, walls or hall(), obstacles, np.zeros((1, 0, 3)))
        self.pose = np.array([start.x_m, start.y_m, start.yaw_rad])
        self.t_s = 0.0

    def drive(self, v_mps, w_radps, seconds):
        for _ in range(round(seconds / TICK_S)):
            self.world.drive(self.pose, [(v_mps, w_radps, 0.0)] * 5, DT_S, self.t_s)
            self.t_s += TICK_S

    def appear(self, index=0):
        self.world.appear(index, self.t_s)

    @property
    def contacts(self):
        return [event for event in self.world.events if event.kind == "contact"]

    @property
    def depth_m(self):
        """Distance by which the body reaches out of the hall."""
        body = Polygon(self.robot.vertices) if self.robot.vertices else Point(0.0, 0.0).buffer(self.robot.radius_m)
        turned = rotate(body, self.pose[2], (0.0, 0.0), use_radians=True)
        x0, y0, x1, y1 = translate(turned, *self.pose[:2]).bounds
        return max(-x0, -y0, x1 - 6.0, y1 - 4.0)


@given(st.sampled_from(ROBOTS), st.floats(-4, 4), st.floats(-0.5, 0.5), st.floats(-2, 2))
@settings(max_examples=100, deadline=None)
def test_free_motion_is_the_exact_arc(robot, yaw, v, w):
    driven = Driven(Pose(3.0, 2.0, yaw), robot=robot)
    driven.drive(v, w, 1.0)
    assert driven.pose == pytest.approx(arc(3.0, 2.0, yaw, v, w, 1.0), abs=1e-9)
    assert (driven.world.events, driven.world.hold) == ([], FREE)


def test_robot_stops_at_a_wall_with_a_contact():
    driven = Driven(Pose(4.0, 2.0))
    driven.drive(0.5, 0.0, 8.0)
    assert driven.pose[0] == pytest.approx(6.0 - ROBOT.radius_m, abs=STEP_M)
    assert driven.pose[1:] == pytest.approx((2.0, 0.0))
    assert driven.world.hold != FREE
    (contact,) = driven.contacts
    assert (contact.what, contact.value) == ("wall", pytest.approx(0.5))
    assert contact.t_s == pytest.approx((2.0 - ROBOT.radius_m) / 0.5, abs=0.03)
    assert (contact.x_m, contact.y_m) == pytest.approx((6.0 - ROBOT.radius_m, 2.0), abs=0.01)


@each_row(
    ("robot", "yaw", "v", "obstacle", "stops_m", "what"),
    [
        (RECTANGLE, 0.0, 0.5, None, 6.0 - 0.35, "wall"),
        (RECTANGLE, math.pi, -0.5, None, 6.0 - 0.35, "wall"),
        (ROBOT, 0.0, 0.5, Obstacle("crate", Box(0.4, 1.0), Pose(5.0, 2.0)), 4.8 - ROBOT.radius_m, "crate"),
        (ROBOT, 0.0, 0.5, Obstacle("drum", Disc(0.3), Pose(5.0, 2.0)), 4.7 - ROBOT.radius_m, "drum"),
    ],
)
def test_robot_stops_with_its_front_or_back_at_a_wall_or_an_obstacle(robot, yaw, v, obstacle, stops_m, what):
    driven = Driven(Pose(4.0, 2.0, yaw), [obstacle] if obstacle else [], robot=robot)
    driven.drive(v, 0.0, 6.0)
    assert driven.pose[0] == pytest.approx(stops_m, abs=STEP_M)
    assert {event.what for event in driven.contacts} == {what}


@given(robot=st.sampled_from(ROBOTS), yaw=st.floats(-3, 3), v=st.floats(-0.5, 0.5), w=st.floats(-2, 2))
@settings(max_examples=90, deadline=None)
def test_body_stays_out_of_walls_and_reports_contacts(robot, yaw, v, w):
    driven = Driven(Pose(5.4, 3.4, yaw), robot=robot)
    for _ in range(40):
        driven.drive(v, w, 0.05)
        assert driven.depth_m < (3 if robot.vertices else 1) * STEP_M
        if driven.depth_m > 2e-3:
            assert driven.world.events


def test_contact_of_a_notched_body_is_counted_once():
    contacts = []
    for robot in (NOTCHED, Robot(vertices=NOTCHED.vertices[:4], radius_m=0.5)):
        driven = Driven(Pose(4.5, 2.0), robot=robot)
        driven.drive(0.5, 0.0, 5.0)
        contacts.append(len(driven.world.events))
    assert contacts[0] == contacts[1] > 0


def test_robot_slides_along_a_wall_that_blocks_one_part_of_its_motion():
    yaw = math.radians(30)
    driven = Driven(Pose(1.0, 3.5, yaw))
    driven.drive(0.5, 0.0, 4.0)
    assert driven.pose[1] == pytest.approx(4.0 - ROBOT.radius_m, abs=STEP_M)
    assert driven.pose[0] == pytest.approx(1.0 + 4.0 * 0.5 * math.cos(yaw), abs=0.02)
    assert driven.contacts[0].value == pytest.approx(0.5 * math.sin(yaw))


def test_robot_rests_at_a_wall_and_touches_it_again_when_it_returns():
    driven = Driven(Pose(5.5, 2.0))
    driven.drive(0.5, 0.0, 1.0)
    driven.drive(0.0, 0.0, 0.1)
    stands = tuple(driven.pose)
    driven.drive(0.0, 0.0, 5.0)
    assert (driven.world.hold, tuple(driven.pose), len(driven.contacts)) == (TOUCHING, stands, 1)
    driven.drive(-0.5, 0.0, 1.0)
    assert driven.world.hold == FREE
    driven.drive(0.5, 0.0, 1.0)
    assert driven.world.hold != FREE
    assert [contact.what for contact in driven.contacts] == ["wall", "wall"]


def test_robot_slides_off_the_corner_of_an_obstacle_and_never_enters_it():
    obstacle = Obstacle("crate", Box(0.4, 0.4), Pose(3.0, 2.0, 0.7))
    driven = Driven(Pose(1.0, 2.0), [obstacle])
    for _ in range(40):
        driven.drive(0.5, 0.0, 0.2)
        assert obstacle.footprint().distance(Point(*driven.pose[:2])) >= ROBOT.radius_m - STEP_M
    assert driven.pose[0] > 3.5


CUBE = Box(0.5, 0.5)


def carton(x_m=3.0, y_m=2.0, yaw_rad=0.0, mass_kg=5.0, friction=0.4, shape=CUBE):
    return Obstacle("carton", shape, Pose(x_m, y_m, yaw_rad), HERE, mass_kg, friction)


def test_triggered_obstacle_stays_where_it_appears():
    driven = Driven(Pose(1.0, 2.0), [carton(yaw_rad=0.3)])
    driven.drive(0.5, 0.0, 5.0)
    assert (driven.pose[0], driven.world.events) == (pytest.approx(3.5), [])
    driven.drive(-0.5, 0.0, 5.0)
    driven.appear()
    driven.drive(0.0, 0.5, 2.0)
    (event,) = driven.world.events
    assert (event.kind, event.what, event.t_s) == ("spawned", "carton", 10.0)
    assert (event.x_m, event.y_m, event.value) == driven.world.pose_of(0) == (3.0, 2.0, 0.3)
    assert driven.world.hold == FREE


@each_row("shape", [CUBE, Disc(0.25)])
def test_robot_pushes_a_light_box_before_it(shape):
    driven = Driven(Pose(1.0, 2.0), [carton(shape=shape)])
    driven.appear()
    driven.drive(0.5, 0.0, 6.0)
    x, y, _ = driven.world.pose_of(0)
    assert x > 3.5
    assert y == pytest.approx(2.0, abs=0.01)
    assert driven.pose[0] == pytest.approx(x - 0.25 - ROBOT.radius_m, abs=STEP_M)
    assert driven.world.hold != FREE


def test_box_with_high_friction_is_struck_and_not_pushed():
    heavy = carton(mass_kg=30.0, friction=0.5)
    assert heavy.mass_kg * heavy.friction > ROBOT.mass_kg * TRACTION
    driven = Driven(Pose(1.0, 2.0), [heavy])
    driven.appear()
    driven.drive(0.5, 0.0, 4.0)
    struck_at = driven.world.pose_of(0)
    assert struck_at[0] == pytest.approx(3.0, abs=0.002)
    driven.drive(0.5, 0.0, 20.0)
    assert driven.world.pose_of(0) == pytest.approx(struck_at, abs=1e-6)
    assert driven.pose[0] == pytest.approx(struck_at[0] - 0.25 - ROBOT.radius_m, abs=STEP_M)


def test_struck_box_slides_by_friction():
    """Inelastic: both go on at one speed, and the box slides v² / 2μg where the robot stops at once."""
    driven = Driven(Pose(2.5, 2.0), [carton(mass_kg=1.0, friction=0.2)])
    driven.appear()
    while not driven.contacts:
        driven.drive(0.5, 0.0, TICK_S)
    body = driven.world._appeared[0]
    at, speed = body.position.x, body.velocity.x
    assert 0.3 < speed < 0.5
    driven.drive(0.0, 0.0, TICK_S)
    assert driven.world.hold == MOVING
    driven.drive(0.0, 0.0, 2.0)
    assert driven.world.pose_of(0)[0] - at == pytest.approx(speed**2 / (2 * 0.2 * GRAVITY_MPS2), abs=0.004)
    assert driven.world.hold == FREE


def test_box_struck_off_center_turns():
    driven = Driven(Pose(1.0, 2.15), [carton()])
    driven.appear()
    driven.drive(0.5, 0.0, 5.0)
    assert driven.world.pose_of(0)[2] < -0.05


def test_moving_box_makes_events_and_resting_box_none():
    driven = Driven(Pose(2.3, 2.0), [carton()])
    driven.appear()
    for _ in range(20):
        driven.drive(0.5, 0.0, 0.1)
        driven.world.note_moves(driven.t_s)
    moves = [event for event in driven.world.events if event.kind == "obstacle_moved"]
    assert (moves[-1].x_m, moves[-1].y_m, moves[-1].value) == pytest.approx(driven.world.pose_of(0), abs=1e-4)
    assert np.all(np.diff([event.x_m for event in moves]) > 0.0)
    driven.drive(-0.5, 0.0, 0.5)
    driven.world.note_moves(driven.t_s)
    events = len(driven.world.events)
    driven.world.note_moves(driven.t_s + 0.1)
    assert len(driven.world.events) == events


def test_box_that_appears_on_the_robot_pushes_it_out():
    driven = Driven(Pose(3.1, 2.0), [carton()])
    driven.appear()
    driven.drive(0.0, 0.0, 1.0)
    assert [event.kind for event in driven.world.events] == ["spawned", "contact"]
    assert driven.contacts[0].value == 0.0
    assert driven.world.pose_of(0) == (3.0, 2.0, 0.0)
    assert carton().footprint().distance(Point(*driven.pose[:2])) == pytest.approx(ROBOT.radius_m, abs=STEP_M)
