"""Goal and progress checkers, and the velocity smoother with feedback: each in a run that the default would end otherwise."""

import numpy as np
import pytest

from vastflow.sim.nav2.parameter_files.chosen import parameters_of
from vastflow.sim.nav2.parameters.servers import GoalChecker, ProgressChecker


def stack(**parts):
    return parameters_of({"controller": "rpp"}).with_values(**parts)


def test_stopped_goal_checker_is_content_only_with_a_robot_at_rest(over_a_floor):
    wide = GoalChecker(xy_goal_tolerance=0.6, yaw_goal_tolerance=6.0)
    stopped = wide.with_values(trans_stopped_velocity=0.1, rot_stopped_velocity=0.1)
    moving, resting = (over_a_floor(stack(goal_checker=checker)) for checker in (wide, stopped))
    assert moving.run.outcome == resting.run.outcome == "succeeded"
    assert moving.columns["speed_mmps"][-2] > 200
    assert abs(resting.columns["speed_mmps"][-1]) <= 100
    assert resting.run.distance_m > 9.5


def test_robot_that_turns_in_place_makes_progress_only_for_a_pose_progress_checker(over_a_floor):
    # Half a turn at 0.15 rad/s takes 20 s: longer than the checker's 10 s.
    controller = parameters_of({"controller": "rpp"}).controller.with_values(rotate_to_heading_angular_vel=0.15)
    checkers = ProgressChecker(), ProgressChecker(required_movement_angle=0.5)
    simple, posed = (over_a_floor(stack(controller=controller, progress_checker=c), yaw_rad=3.0) for c in checkers)
    assert simple.run.recoveries > 0
    assert (posed.run.outcome, posed.run.recoveries) == ("succeeded", 0)
    assert posed.run.distance_m == pytest.approx(10.0, abs=0.5)


def test_robot_speeds_up_from_its_measured_speed_with_feedback(over_a_floor):
    default = stack()
    closed = stack(velocity_smoother=default.velocity_smoother.with_values(closed_loop=True))
    one, other = over_a_floor(default), over_a_floor(closed)
    assert one.run.outcome == other.run.outcome == "succeeded"
    assert other.run.distance_m == pytest.approx(10.0, abs=0.5)
    # The odometry's mean lags behind the command: the same limit gains less speed each cycle.
    half = [int(np.argmax(found.columns["sent_speed_mmps"] > 250)) for found in (one, other)]
    assert half[1] > half[0]
