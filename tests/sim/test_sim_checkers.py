"""Goal and progress checkers, and the velocity smoother with feedback: each in a run that the default would end otherwise."""

import numpy as np
import pytest

from vastflow.sim.nav2.parameter_files.chosen import parameters_of
from vastflow.sim.nav2.parameter_files.document import DocumentError, parse
from vastflow.sim.nav2.parameter_files.findings import findings
from vastflow.sim.nav2.parameter_files.interpretation import interpretation
from vastflow.sim.nav2.parameters.servers import NO_ANGLE_RAD, NO_LIMIT, GoalChecker, ProgressChecker
from vastflow.sim.nav2.parameters.stack import NavParameters


def read(server, text):
    return interpretation(parse(f"{server}: {{ros__parameters: {{{text}}}}}", "n.yaml"))


def checked(text):
    return read("controller_server", text).parameters


def stack(**parts):
    return parameters_of({"controller": "rpp"}).with_values(**parts)


def test_pose_progress_checker_has_nav2_s_angle_and_a_simple_one_none():
    kinds = "progress_checker_plugins: [p], p: {plugin: nav2_controller::%s, required_movement_radius: 0.3}"
    assert checked(kinds % "PoseProgressChecker").progress_checker.required_movement_angle == 0.5
    assert checked(kinds % "SimpleProgressChecker").progress_checker.required_movement_angle == NO_ANGLE_RAD
    assert NavParameters().progress_checker.required_movement_angle == NO_ANGLE_RAD


def test_stopped_goal_checker_has_nav2_s_velocities_and_a_simple_one_no_limit():
    kinds = "goal_checker_plugins: [g], g: {plugin: nav2_controller::%s, trans_stopped_velocity: 0.1}"
    stopped = checked(kinds % "StoppedGoalChecker").goal_checker
    simple = checked(kinds % "SimpleGoalChecker").goal_checker
    assert (stopped.trans_stopped_velocity, stopped.rot_stopped_velocity) == (0.1, 0.25)
    assert (simple.trans_stopped_velocity, simple.rot_stopped_velocity) == (NO_LIMIT, NO_LIMIT)


def test_smoother_with_feedback_is_read_and_one_with_another_word_refused():
    found = read("velocity_smoother", "feedback: CLOSED_LOOP, odom_duration: 0.2")
    assert (found.parameters.velocity_smoother.closed_loop, found.parameters.velocity_smoother.odom_duration) == (
        True,
        0.2,
    )
    assert {finding.status for finding in findings(found)} == {"modeled"}
    with pytest.raises(DocumentError, match="expected one of OPEN_LOOP, CLOSED_LOOP, got 'HALF'"):
        read("velocity_smoother", "feedback: HALF")


def test_stopped_goal_checker_is_content_only_with_a_robot_at_rest(over_a_floor):
    fast = stack(goal_checker=GoalChecker(xy_goal_tolerance=0.6, yaw_goal_tolerance=6.0))
    slow = stack(
        goal_checker=GoalChecker(
            xy_goal_tolerance=0.6, yaw_goal_tolerance=6.0, trans_stopped_velocity=0.1, rot_stopped_velocity=0.1
        )
    )
    moving, resting = over_a_floor(fast), over_a_floor(slow)
    assert moving.run.outcome == resting.run.outcome == "succeeded"
    assert moving.columns["speed_mmps"][-2] > 200
    assert abs(resting.columns["speed_mmps"][-1]) <= 100
    assert resting.run.distance_m > 9.5


def test_robot_that_turns_in_place_makes_progress_only_for_a_pose_progress_checker(over_a_floor):
    # Half a turn at 0.15 rad/s takes 20 s: longer than the checker's 10 s.
    controller = parameters_of({"controller": "rpp"}).controller.with_values(rotate_to_heading_angular_vel=0.15)
    simple = over_a_floor(stack(controller=controller), yaw_rad=3.0)
    posed = over_a_floor(
        stack(controller=controller, progress_checker=ProgressChecker(required_movement_angle=0.5)), yaw_rad=3.0
    )
    assert simple.run.recoveries > 0
    assert (posed.run.outcome, posed.run.recoveries) == ("succeeded", 0)
    assert posed.run.distance_m == pytest.approx(10.0, abs=0.5)


def test_with_feedback_the_robot_speeds_up_from_what_it_does_and_not_from_what_it_was_told(over_a_floor):
    default = stack()
    closed = stack(velocity_smoother=default.velocity_smoother.with_values(closed_loop=True))
    one, other = over_a_floor(default), over_a_floor(closed)
    assert one.run.outcome == other.run.outcome == "succeeded"
    assert other.run.distance_m == pytest.approx(10.0, abs=0.5)
    # The odometry's mean lags behind the command: the same limit gains less speed each cycle.
    half = [int(np.argmax(found.columns["sent_speed_mmps"] > 250)) for found in (one, other)]
    assert half[1] > half[0]
