"""Missions and parameters, as a scenario gives them."""

from dataclasses import asdict

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vastflow.sim.mission import Mission, MissionError, mission_of
from vastflow.sim.nav.parameters import RANGES, NavParameters, ParameterError, parameters_of, unread
from vastflow.sim.pose import Pose
from vastflow.sim.scenario import Scenario

HERE, THERE = {"x": 1.0, "y": 2.0}, {"x": 3.0, "y": 4.0, "yaw": 1.0}


def a_mission(kind, **task):
    return mission_of(Scenario(f"builtin:{kind}", 60.0, {}, {"start_pose": HERE, **task}, {}))


def test_to_a_pose_there_is_one_goal():
    assert a_mission("navigate_to_pose", goal_pose=THERE) == Mission("navigate_to_pose", Pose(1, 2), (Pose(3, 4, 1),))


@pytest.mark.parametrize("kind", ["navigate_through_poses", "follow_waypoints"])
def test_through_poses_and_waypoints_take_a_list_or_one_goal(kind):
    assert a_mission(kind, goal_poses=[THERE, HERE]).goals == (Pose(3, 4, 1), Pose(1, 2))
    assert a_mission(kind, goal_pose=THERE).goals == (Pose(3, 4, 1),)


def test_waypoints_are_repeated_as_often_as_asked_and_through_poses_never():
    assert a_mission("follow_waypoints", goal_poses=[THERE], number_of_loops=2).loops == 2
    assert a_mission("navigate_through_poses", goal_poses=[THERE], number_of_loops=2).loops == 0


@pytest.mark.parametrize(
    ("kind", "task", "message"),
    [
        ("fly", {}, "scenario: found 'builtin:fly'; one of builtin:navigate_to_pose, "),
        ("navigate_to_pose", {}, "goal_pose: nothing in the task; this mission needs a pose"),
        ("navigate_to_pose", {"goal_pose": THERE, "start_pose": "here"}, "start_pose: found 'here'; a pose is"),
        ("follow_waypoints", {}, "goal_poses: found None; a list of one pose or more"),
        ("follow_waypoints", {"goal_poses": []}, r"goal_poses: found \[\]; a list of one pose or more"),
        ("follow_waypoints", {"goal_poses": "@x"}, "goal_poses: found '@x'"),
        ("navigate_through_poses", {"goal_poses": [THERE, 3]}, r"goal_poses\[1\]: found 3; a pose is"),
        ("follow_waypoints", {"goal_poses": [THERE], "number_of_loops": -1}, "number_of_loops: found -1; a whole"),
        ("follow_waypoints", {"goal_poses": [THERE], "number_of_loops": True}, "number_of_loops: found True"),
        ("follow_waypoints", {"goal_poses": [THERE], "number_of_loops": 1.5}, "number_of_loops: found 1.5"),
    ],
)
def test_a_task_that_is_no_mission_is_refused(kind, task, message):
    with pytest.raises(MissionError, match=message):
        a_mission(kind, **task)


def test_defaults_are_those_of_nav2_jazzy():
    given_by_nav2 = {
        "robot_radius": 0.22,
        "footprint_padding": 0.01,
        "inflation_radius": 0.70,
        "cost_scaling_factor": 3.0,
        "obstacle_max_range": 2.5,
        "raytrace_max_range": 3.0,
        "xy_goal_tolerance": 0.25,
        "yaw_goal_tolerance": 0.25,
        "required_movement_radius": 0.5,
        "movement_time_allowance": 10.0,
        "failure_tolerance": 0.3,
        "tolerance": 0.5,
        "min_particles": 500,
        "max_particles": 2000,
        "pf_err": 0.05,
        "pf_z": 0.99,
        "alpha1": 0.2,
        "max_beams": 60,
        "sigma_hit": 0.2,
        "laser_likelihood_max_dist": 2.0,
        "update_min_d": 0.25,
        "update_min_a": 0.2,
        "desired_linear_vel": 0.5,
        "lookahead_dist": 0.6,
    }
    assert given_by_nav2.items() <= asdict(NavParameters()).items()


def test_parameters_are_read_by_their_own_name_and_sensing_by_the_launch_argument_s():
    found = parameters_of({"robot_radius": 0.3, "laserscan_gaussian_noise_std_deviation": 0.1, "max_beams": 30.0})
    assert (found.robot_radius, found.gaussian_noise_std_deviation, found.max_beams) == (0.3, 0.1, 30)


def test_numbers_may_be_text():
    found = parameters_of({"laserscan_random_drop_percentage": "0.1", "min_particles": "100"})
    assert (found.random_drop_percentage, found.min_particles) == (0.1, 100)


def test_keys_that_nothing_reads_are_named():
    system = {"robot_radius": 0.3, "vx_max": 0.5, "laserscan_gaussian_noise_std_deviation": 0.1, "amcl": 1}
    assert unread(system) == ("amcl", "vx_max")


@pytest.mark.parametrize(
    ("system", "message"),
    [
        ({"robot_radius": -0.1}, r"robot_radius must lie in \[0.01, 10\], got -0.1"),
        ({"random_drop_percentage": 20}, r"random_drop_percentage must lie in \[0, 1\], got 20.0"),
        ({"robot_radius": "wide"}, "robot_radius must be a number, got 'wide'"),
        ({"robot_radius": True}, "robot_radius must be a number, got True"),
        ({"robot_radius": float("inf")}, "robot_radius must be a number, got inf"),
        ({"robot_radius": [0.2]}, r"robot_radius must be a number, got \[0.2\]"),
        ({"max_beams": 2.5}, "max_beams must be a whole number, got 2.5"),
        ({"allow_unknown": 1}, "allow_unknown must be true or false, got 1"),
        ({"min_particles": 3000}, "min_particles 3000 must be <= max_particles 2000"),
    ],
)
def test_a_parameter_of_the_wrong_type_or_out_of_range_is_refused(system, message):
    with pytest.raises(ParameterError, match=message):
        parameters_of(system)


@given(st.sampled_from(RANGES), st.booleans())
def test_both_ends_of_a_range_are_in_it(limits, high):
    name, low, top = limits
    others = {"max_particles": 100_000} if name == "min_particles" else {"min_particles": 1}
    value = top if high else low
    assert getattr(NavParameters(**{**others, name: value}), name) == value
