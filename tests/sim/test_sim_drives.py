"""Robots that are no differential drive: how they are read from what a user says, and how they drive."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vastflow.sim.loop.drive import drive
from vastflow.sim.loop.prepared import prepare
from vastflow.sim.maps.occupancy import OccupancyMap
from vastflow.sim.nav.mission import Mission
from vastflow.sim.nav.parameters.chosen import parameters_of
from vastflow.sim.nav.parameters.document import DocumentError
from vastflow.sim.nav.parameters.interpretation import interpretation
from vastflow.sim.nav.parameters.written import document_of
from vastflow.sim.nav.state import SUBSTEPS
from vastflow.sim.pose import Pose
from vastflow.sim.reading.robot import robot_facts, robot_of, robot_words
from vastflow.sim.world.lidar_model import Lidar

ACKERMANN = {"FollowPath.motion_model": "Ackermann", "FollowPath.AckermannConstraints.min_turning_r": 0.5}
DT_S = 0.05


START, GOAL = Pose(1.0, 2.0, 0.7), Pose(11.0, 2.0)


def driven(system, start=START, goal=GOAL, timeout_s=90.0):
    """A run over an empty floor of 14 m × 6 m, and of each tick the yaw (rad), the distance so far (m), and the velocities of its steps."""
    floor = np.zeros((120, 280), dtype=np.int8)
    floor[[0, -1]], floor[:, [0, -1]] = 100, 100
    parameters = parameters_of(system)
    prepared = prepare(OccupancyMap(floor, 0.05, (0.0, -1.0)), Lidar(), parameters)
    rows = []

    def look(stack, tick):
        m = stack.m[0]
        rows.append((m["true_yaw"], m["distance"], *m["velocities"].ravel()))

    mission = Mission("navigate_to_pose", (goal,))
    recording = drive(
        prepared, parameters, Lidar(), robot_of(parameters), start, mission, (), (1, 2, 3), timeout_s, look, range(1800)
    )
    return recording, np.array(rows)


def tightest(rows):
    """The greatest curvature (1/m) of the commands that the wheels followed, by physics step."""
    velocities = rows[:, 2:].reshape(SUBSTEPS * len(rows), -1)
    moving = velocities[np.any(velocities != 0.0, axis=1)]
    with np.errstate(divide="ignore"):
        return np.abs(moving[:, 1] / moving[:, 0]).max()


# Ackermann.


def test_an_ackermann_robot_drives_ten_meters_and_never_turns_tighter_than_its_radius():
    recording, rows = driven(ACKERMANN)
    assert (recording.run.outcome, recording.run.recoveries) == ("succeeded", 0)
    assert tightest(rows) <= 2.0 + 1e-9


def test_the_same_path_by_a_differential_drive_has_turns_that_no_ackermann_robot_makes():
    recording, rows = driven({})
    assert recording.run.outcome == "succeeded"
    assert tightest(rows) > 4.0


@settings(max_examples=8, deadline=None)
@given(
    radius_m=st.floats(0.2, 1.2),
    yaw_rad=st.floats(-math.pi, math.pi),
    goal_yaw_rad=st.floats(-math.pi, math.pi),
    controller=st.sampled_from(["mppi", "rpp", "dwb"]),
)
def test_the_driven_curvature_never_exceeds_that_of_the_least_radius(radius_m, yaw_rad, goal_yaw_rad, controller):
    """Whatever commands: the robot's true pose turns by no more than what it has driven divided by the radius."""
    robot = {"robot.drive": "ackermann", "robot.min_turning_radius": radius_m, "controller": controller}
    _, rows = driven(robot, Pose(2.0, 2.0, yaw_rad), Pose(7.0, 2.5, goal_yaw_rad), timeout_s=30.0)
    turned_rad = np.abs(np.remainder(np.diff(rows[:, 0]) + math.pi, 2.0 * math.pi) - math.pi)
    driven_m = np.diff(rows[:, 1])
    velocities = np.abs(rows[:-1, 2:].reshape(len(rows) - 1, SUBSTEPS, -1))
    # Where it reverses within a tick, what is driven is more than the distance between the tick's poses.
    arcs_m = np.maximum(driven_m, velocities[:, :, 0].sum(axis=1) * DT_S / SUBSTEPS)
    assert (turned_rad <= arcs_m / radius_m + 1e-9).all()


def test_an_ackermann_robot_does_not_spin():
    """Behind the goal of a path that it can't turn into it stands until the behavior's allowance of 10 s is over."""
    robot = {"robot.drive": "ackermann", "robot.min_turning_radius": 1.0, "controller": "rpp"}
    recording, rows = driven(robot, Pose(5.0, 2.0, math.pi), Pose(9.0, 2.0), timeout_s=40.0)
    assert recording.run.outcome == "timed_out"
    assert np.ptp(np.unwrap(rows[:, 0])) < 0.01


# What a user says.


def test_the_robot_of_a_motion_model_ackermann_is_an_ackermann_robot_with_its_radius():
    parameters = parameters_of(ACKERMANN)
    robot = robot_of(parameters)
    assert (robot.drive, robot.min_turning_radius_m) == ("ackermann", 0.5)
    told = next(line for line in robot_words(robot_facts(parameters)) if "Nav2 parameters" in line)
    assert told == "the robot, from the Nav2 parameters: drive ackermann, turning radius at least 0.5 m"
    assert interpretation(document_of(parameters)).parameters == parameters


def test_a_robot_s_own_radius_counts_before_the_one_that_mppi_reckons_with():
    robot = robot_of(parameters_of({**ACKERMANN, "robot.min_turning_radius": 0.7}))
    assert (robot.drive, robot.min_turning_radius_m) == ("ackermann", 0.7)


def test_a_robot_may_be_another_than_mppi_reckons_with():
    assert robot_of(parameters_of({**ACKERMANN, "robot.drive": "differential"})).drive == "differential"


@pytest.mark.parametrize(
    ("system", "fault"),
    [
        ({"FollowPath.motion_model": "Tracked"}, r"motion_model.*'Tracked'.*'DiffDrive'"),
        ({"robot.drive": "tracked"}, r"robot.drive: found 'tracked'.*'differential'"),
        ({"robot.drive": "ackermann"}, "robot.drive: found ackermann, and neither .* min_turning_radius beside it"),
        (
            {"robot.drive": "differential", "robot.min_turning_radius": 1.0},
            "min_turning_radius is an ackermann drive's",
        ),
        (
            {**ACKERMANN, "FollowPath.AckermannConstraints.min_turning_r": 0.0},
            r"min_turning_r must lie in \[0.001, 100\]",
        ),
    ],
)
def test_a_drive_that_means_nothing_is_refused_with_its_place(system, fault):
    with pytest.raises(DocumentError, match=fault):
        parameters_of(system)
