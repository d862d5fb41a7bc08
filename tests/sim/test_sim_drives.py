"""Robots that are no differential drive: how they are read from what a user says, and how they drive."""

import math

import numpy as np
import pytest
from amcl_filter import Filter
from driving import drive
from hypothesis import given, settings
from hypothesis import strategies as st
from table import each_row

from vastflow.sim.model.pose import Pose
from vastflow.sim.model.scenario import Mission
from vastflow.sim.nav2.navigator.prepared import prepare
from vastflow.sim.nav2.navigator.state import OMNI_COLUMNS, SUBSTEPS
from vastflow.sim.nav2.parameter_files.chosen import parameters_of
from vastflow.sim.nav2.parameter_files.interpretation import document_of, interpretation
from vastflow.sim.nav2.system.robot import robot_facts, robot_of
from vastflow.sim.run import run
from vastflow.sim.system.facts import robot_words
from vastflow.sim.world.motion import arc, moved
from vastflow.sim.world.occupancy import OccupancyMap
from vastflow.sim.world.physics import Physics, WallIndex
from vastflow.sim.world.robot_model import Lidar, Robot
from vastflow.sim.world.world import World

ACKERMANN = {"FollowPath.motion_model": "Ackermann", "FollowPath.AckermannConstraints.min_turning_r": 0.5}
OMNI = {
    "FollowPath.motion_model": "Omni",
    "robot_model_type": "nav2_amcl::OmniMotionModel",
    "min_y_velocity_threshold": 0.001,
    "max_velocity": [0.5, 0.5, 2.0],
    "min_velocity": [-0.5, -0.5, -2.0],
    "max_accel": [2.5, 2.5, 3.2],
    "max_decel": [-2.5, -2.5, -3.2],
}
LEFT_RAD = 0.5 * math.pi
DT_S = 0.05


START, GOAL = Pose(1.0, 2.0, 0.7), Pose(11.0, 2.0)


def driven(system, start=START, goal=GOAL, timeout_s=90.0):
    """A run over an empty floor, and yaw (rad), distance (m), and velocities of each tick."""
    floor = np.zeros((120, 280), dtype=np.int8)
    floor[[0, -1]], floor[:, [0, -1]] = 100, 100
    parameters = parameters_of(system)
    prepared = prepare(World(OccupancyMap(floor, 0.05, (0.0, -1.0))), Lidar(), parameters)
    rows = []

    def look(stack, tick):
        m = stack.m[0]
        rows.append((m["true_yaw"], m["distance"], *m["velocities"].ravel()))

    mission = Mission("navigate_to_pose", (goal,))
    recording = drive(
        prepared, parameters, Lidar(), robot_of(parameters), start, mission, (), (1, 2, 3), timeout_s, look, range(1800)
    )
    return recording, np.array(rows)


@settings(max_examples=8, deadline=None)
@given(
    radius_m=st.floats(0.2, 1.2),
    yaw_rad=st.floats(-math.pi, math.pi),
    goal_yaw_rad=st.floats(-math.pi, math.pi),
    controller=st.sampled_from(["mppi", "rpp", "dwb"]),
)
def test_driven_curvature_never_exceeds_that_of_the_least_radius(radius_m, yaw_rad, goal_yaw_rad, controller):
    """The true heading turns by at most the driven distance divided by the radius, whatever the commands."""
    robot = {"robot.drive": "ackermann", "robot.min_turning_radius": radius_m, "controller": controller}
    _, rows = driven(robot, Pose(2.0, 2.0, yaw_rad), Pose(7.0, 2.5, goal_yaw_rad), timeout_s=30.0)
    turned_rad = np.abs(np.remainder(np.diff(rows[:, 0]) + math.pi, 2.0 * math.pi) - math.pi)
    # Where it reverses within a tick, what is driven is more than the distance between the tick's poses.
    arcs_m = np.maximum(np.diff(rows[:, 1]), np.abs(rows[:-1, 2::3]).sum(axis=1) * DT_S / SUBSTEPS)
    assert (turned_rad <= arcs_m / radius_m + 1e-9).all()


def test_ackermann_robot_does_not_spin():
    """The goal is behind it: it stands until the behavior's allowance of 10 s is over."""
    robot = {"robot.drive": "ackermann", "robot.min_turning_radius": 1.0, "controller": "rpp"}
    recording, rows = driven(robot, Pose(5.0, 2.0, math.pi), Pose(9.0, 2.0), timeout_s=40.0)
    assert recording.run.outcome == "timed_out"
    assert np.ptp(np.unwrap(rows[:, 0])) < 0.01


@each_row(
    ("system", "drive", "radius_m"),
    [
        (ACKERMANN, "ackermann", 0.5),
        ({**ACKERMANN, "robot.min_turning_radius": 0.7}, "ackermann", 0.7),
        ({**ACKERMANN, "robot.drive": "differential"}, "differential", 0.0),
        (OMNI, "omni", 0.0),
    ],
)
def test_drive_follows_the_motion_model_unless_it_is_given(system, drive, radius_m):
    parameters = parameters_of(system)
    robot = robot_of(parameters)
    assert (robot.drive, robot.min_turning_radius_m if drive == "ackermann" else 0.0) == (drive, radius_m)
    if not any(key.startswith("robot.") for key in system):
        assert interpretation(document_of(parameters)).parameters == parameters
    if system is ACKERMANN:
        told = [line for line in robot_words(robot_facts(parameters)) if "Nav2 parameters" in line]
        assert told == ["the robot, from the Nav2 parameters: drive ackermann, turning radius at least 0.5 m"]


def test_omni_robot_drives_ten_meters_and_to_its_side():
    """With the goal's heading across the path it ends as it begins, facing left, and goes sideways between."""
    recording, rows = driven(OMNI, Pose(1.0, 2.0, LEFT_RAD), Pose(11.0, 2.0, LEFT_RAD))
    assert (recording.run.outcome, recording.run.recoveries) == ("succeeded", 0)
    assert tuple(recording.columns)[-3:] == OMNI_COLUMNS
    assert np.abs(recording.columns["lateral_speed_mmps"]).max() > 300
    assert np.abs(rows[:, 4::3]).max() <= 0.5
    # Its recorded speeds ahead and to the left, in its frame, add up to its path.
    columns = {name: column * 1e-3 for name, column in recording.columns.items()}
    yaw_rad = columns["yaw_mrad"]
    ahead, left = columns["speed_mmps"], columns["lateral_speed_mmps"]
    x_m = 1.0 + 0.1 * np.cumsum(np.cos(yaw_rad) * ahead - np.sin(yaw_rad) * left)
    y_m = 2.0 + 0.1 * np.cumsum(np.sin(yaw_rad) * ahead + np.cos(yaw_rad) * left)
    assert np.hypot(x_m - columns["x_mm"], y_m - columns["y_mm"]).max() < 0.06


@each_row(
    "system",
    [{}, {**OMNI, "robot.drive": "differential"}, {**OMNI, "max_velocity.1": 0.0, "min_velocity.1": 0.0}],
)
def test_sideways_motion_needs_an_omni_drive_and_its_smoother(system):
    recording, rows = driven(system, Pose(1.0, 2.0, LEFT_RAD), timeout_s=5.0)
    assert not rows[:, 4::3].any()
    assert set(OMNI_COLUMNS) <= set(recording.columns) or robot_of(parameters_of(system)).drive != "omni"


def test_scenario_s_velocity_moves_an_omni_robot_to_its_side(staged):
    text = """\
        serial:
            topic_publish('/cmd_vel', 'geometry_msgs.msg.Twist', "{'linear': {'y': 0.3}}")
            wait elapsed(1s)
    """
    omni = {"robot.drive": "omni", "max_velocity.1": 0.5, "max_accel.1": 2.5, "max_decel.1": -2.5}
    recording = run(staged(text, **omni), 0)
    assert recording.columns["lateral_speed_mmps"].max() == pytest.approx(300, abs=2)
    assert not recording.columns["speed_mmps"].any()


def test_motion_to_the_side_is_an_arc_as_motion_ahead_is():
    ahead = moved(1.0, 2.0, 0.3, 0.0, 0.8, 0.5, 2.0)
    assert ahead[:2] == pytest.approx(arc(1.0, 2.0, 0.3 + LEFT_RAD, 0.5, 0.8, 2.0)[:2], abs=1e-12)
    assert ahead[2] == pytest.approx(0.3 + 1.6)
    assert moved(1.0, 2.0, 0.3, 0.4, 0.8, 0.0, 0.05) == arc(1.0, 2.0, 0.3, 0.4, 0.8, 0.05)


def test_engine_moves_an_omni_robot_as_it_moves_freely():
    """Something that stands nearby makes the engine do the steps; they are the same ones."""
    steps = [(0.3, 0.5, -0.4)] * SUBSTEPS
    pose, expected = np.array([1.0, 1.0, 0.2]), (1.0, 1.0, 0.2)
    empty = OccupancyMap(np.zeros((40, 40), dtype=np.int8), 0.05, (0.0, 0.0))
    Physics(Robot(drive="omni"), WallIndex(empty), (), np.zeros((1, 0, 3))).drive(pose, steps, 0.01, 0.0)
    for v_mps, w_radps, vy_mps in steps:
        expected = moved(*expected, v_mps, w_radps, vy_mps, 0.01)
    assert pose == pytest.approx(expected, abs=1e-9)


def particles_after(steps, **given):
    """AMCL's particles after odometry's poses, by a motion model without noise but for `given`."""
    alphas = dict.fromkeys(("alpha1", "alpha2", "alpha3", "alpha4", "alpha5"), 0.0)
    place = {"resolution_m": 0.05, "origin_xy_m": (0.0, 0.0), "laser_xyt": (0.0, 0.0, 0.0), "seed": 1}
    found = Filter(occupied=np.zeros((80, 80), dtype=bool), **place, **{**alphas, **given})
    found.set_pose((1.0, 2.0, steps[0][2]), (0.0, 0.0, 0.0))
    for step in steps:
        found.update(step, np.full(60, np.inf), 0.0, 0.1, 0.1, 10.0)
    return found.particles


def test_omni_particles_follow_the_bearing_of_a_step():
    left = -0.4 * math.sin(0.1), 0.4 * math.cos(0.1)
    particles = particles_after([(0.0, 0.0, 0.1), (*left, 0.1)], omni=True)
    assert particles == pytest.approx(np.broadcast_to((1.0 + left[0], 2.0 + left[1], 0.1), particles.shape), abs=1e-5)


@each_row(
    ("noisy", "along_m", "across_m", "turn_rad"),
    [("alpha3", 0.2, 0.0, 0.0), ("alpha5", 0.0, 0.2, 0.0), ("alpha2", 0.0, 0.0, 0.2)],
)
def test_omni_motion_noise_matches_nav2(noisy, along_m, across_m, turn_rad):
    """A step of 1 m along x; variances are alpha times its square."""
    particles = particles_after([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)], omni=True, min_particles=2000, **{noisy: 0.04})
    assert particles.std(axis=0) == pytest.approx([along_m, across_m, turn_rad], rel=0.1, abs=1e-6)
