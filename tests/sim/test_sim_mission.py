"""Missions, as a scenario's task describes them."""

import pytest

from vastflow.sim.mission import Mission, MissionError, mission_of
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
