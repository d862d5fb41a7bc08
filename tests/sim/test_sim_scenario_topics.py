"""Scenario files that listen to the simulated robot's topics, publish on them, and read its stack's log."""

import math

import numpy as np
from recorded import ends, final

from vastflow.sim.model.recording import si
from vastflow.sim.run import run

ODOMETRY = "topic_name: '/odom', topic_type: 'nav_msgs.msg.Odometry'"


def test_wait_for_data_ends_with_first_message(staged):
    text = """
        do parallel:
            pose: wait_for_data('/amcl_pose', 'geometry_msgs.msg.PoseWithCovarianceStamped')
            scan: wait_for_data('/scan', 'sensor_msgs.msg.LaserScan', qos_preset_profiles!sensor_data)
            map: wait_for_data('/map', 'nav_msgs.msg.OccupancyGrid')
            twist: wait_for_data('/cmd_vel', 'geometry_msgs.msg.Twist')
            plan: wait_for_data('/plan', 'nav_msgs.msg.Path')
            serial:
                wait elapsed(1s)
                robot.init_nav2(start)
                robot.nav_to_pose(near)
    """
    recording = run(staged(text, timeout_s=30.0), 0)
    assert recording.run.outcome == "succeeded"
    assert ends(recording, "map")[0][:2] == (0.1, "SUCCESS")
    assert ends(recording, "scan")[0][0] <= 0.4
    assert 1.1 < ends(recording, "pose")[0][0] < 1.6
    assert ends(recording, "pose")[0][0] < ends(recording, "plan")[0][0] <= ends(recording, "twist")[0][0] < 3.0


def test_member_of_a_message_is_compared_until_the_relation_holds(staged):
    text = f"""
        parallel:
            robot.nav_to_pose(near)
            far: check_data({ODOMETRY}, member_name: 'pose.pose.position.x', expected_value: '1.0', comparison_operator: comparison_operator!gt)
    """
    recording = run(staged(text), 0)
    assert recording.run.outcome == "succeeded"
    ((t_s, status, _),) = ends(recording, "far")
    driven = si(recording.columns["x_mm"])[np.searchsorted(recording.columns["t_ms"], round(t_s * 1000))] - 1.0
    assert status == "SUCCESS" and 0.9 < driven < 1.2


def test_pose_that_was_heard_is_a_goal(staged):
    """The robot goes back to where AMCL took it to be when the scenario began."""
    text = """
        var heard: pose_3d
        do serial:
            topic_monitor('/amcl_pose', 'geometry_msgs.msg.PoseWithCovarianceStamped', heard)
            robot.init_nav2(start)
            wait elapsed(0.5s)
            robot.nav_to_pose(near)
            robot.nav_to_pose(msg_conversion.to_pose_3d(heard))
    """
    recording = run(staged(text), 0)
    assert recording.run.outcome == "succeeded"
    assert math.dist(final(recording), (3.0, 1.0)) < 0.6


def test_published_velocity_moves_robot_until_smoother_timeout(staged):
    text = """
        topic_publish('/cmd_vel', 'geometry_msgs.msg.Twist', "{'linear': {'x': 0.4}}")
        robot.odometry_distance_traveled(0.2m)
        wait elapsed(3s)
    """
    recording = run(staged(text, timeout_s=20.0), 0)
    assert recording.run.outcome == "succeeded"
    assert 1.2 < final(recording)[0] < 1.7
    assert recording.columns["speed_mmps"][-1] == 0


def test_published_initial_pose_completes_init_nav2(staged):
    text = """
        do parallel:
            init: robot.init_nav2(wait_for_initial_pose: true)
            serial:
                wait elapsed(1s)
                topic_publish('/initialpose', 'geometry_msgs.msg.PoseWithCovarianceStamped', "{'pose': {'pose': {'position': {'x': 1.0, 'y': 1.0}}}}")
    """
    recording = run(staged(text, timeout_s=10.0, start_pose={"x": 1.0, "y": 1.0}), 0)
    assert recording.run.outcome == "succeeded"
    assert 1.0 < ends(recording, "init")[0][0] < 1.6


def test_log_of_the_stack_is_read_from_here_on_and_by_node(staged):
    text = """
        parallel:
            begun: log_check('bt_navigator', ['Begin navigating'])
            there: log_check(values: ['Reached the goal!', 'Goal failed'])
            serial:
                wait elapsed(1s)
                robot.nav_to_pose(near)
                emit end
            other: log_check('amcl', ['Begin navigating'])
    """
    recording = run(staged(text), 0)
    assert recording.run.outcome == "succeeded"
    assert ends(recording, "begun")[0][:2] == (1.3, "SUCCESS")
    assert ends(recording, "there")[0][1] == "SUCCESS"
    assert "SUCCESS" not in recording.behaviors["status"][recording.behaviors["name"] == "other"]


def test_assert_tf_moving_fails_for_immobile_robot(staged):
    text = """
        parallel:
            moves: assert_tf_moving('base_link', timeout: 2s)
            serial:
                robot.nav_to_pose(near)
                wait elapsed(5s)
    """
    recording = run(staged(text), 0)
    assert recording.run.outcome == "failed"
    assert recording.run.reason.startswith("base_link has not moved for 2.")
    driven = run(staged(text.replace("wait elapsed(5s)", "emit end")), 0)
    assert driven.run.outcome == "succeeded"


def test_frames_of_truth_and_odometry_follow_the_robot(staged):
    text = """
        parallel:
            robot.nav_to_pose(near)
            true: robot.tf_close_to(0.1m, position_3d(2.0m, 1.0m), robot_frame_id: 'turtlebot4_base_link_gt')
            counted: robot.tf_close_to(0.1m, position_3d(1.0m, 0.0m), parent_frame_id: 'odom')
    """
    recording = run(staged(text), 0)
    assert recording.run.outcome == "succeeded"
    assert abs(ends(recording, "true")[0][0] - ends(recording, "counted")[0][0]) <= 0.3
