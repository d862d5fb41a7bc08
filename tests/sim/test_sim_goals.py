"""A scenario with one goal and a configuration with several: the robot is sent to each in turn."""

import pytest

from vastflow.sim.model.pose import Pose
from vastflow.sim.model.scenario import Scenario
from vastflow.sim.reading.abstract import abstract_content
from vastflow.sim.reading.script import calls_of, script_of
from vastflow.sim.scenario.language.parameters import ParameterMismatch

ONE_GOAL = """\
import osc.gazebo
import osc.helpers
import osc.nav2
import osc.ros

scenario go:
    start_pose: pose_3d
    goal_pose: pose_3d
{parameters}    robot: differential_drive_robot
    do serial:
        robot.init_nav2(start_pose)
        robot.nav_to_pose(goal_pose) with:
            timeout(60s)
        spawn_multiple(boxes)
        log('there')
"""
GOALS = [{"x": 1.0, "y": 0.0}, {"x": 2.0, "y": 1.0}, {"x": 3.0, "y": 0.0, "yaw": 1.0}]
POSES = (Pose(1, 0), Pose(2, 1), Pose(3, 0, 1))


@pytest.fixture
def script(tmp_path):
    def made(task, parameters="    boxes: list of spawn_entity\n"):
        file = tmp_path / "go.osc"
        file.write_text(ONE_GOAL.format(parameters=parameters))
        return script_of(Scenario(abstract_content(file), 60.0, {}, {"start_pose": {"x": 0.0, "y": 0.0}, **task}, {}))

    return made


@pytest.mark.parametrize(
    ("task", "poses"),
    [
        ({"goal_poses": GOALS}, POSES),
        ({"goal_pose10": GOALS[2], "goal_pose2": GOALS[1], "goal_pose1": GOALS[0]}, POSES),
        ({"goal_poses": GOALS[:1]}, POSES[:1]),
        ({"goal_pose": GOALS[1], "goal_poses": GOALS}, POSES[1:2]),
    ],
)
def test_goals_of_a_list_are_sent_in_turn_unless_one_is_given(script, task, poses):
    found = script(task)
    assert found.goals == poses
    assert len([call for call in calls_of(found.definition.root) if call.action.endswith("nav_to_pose")]) == len(poses)
    assert found.values["goal_pose"]["position"]["x"] == poses[-1].x_m
    assert found.values["boxes"] == []  # a list of objects that the configuration leaves out


def test_numbered_goal_parameters_are_kept(script):
    own = "    goal_pose1: pose_3d\n    boxes: list of spawn_entity\n"
    assert script({"goal_pose": GOALS[1], "goal_pose1": GOALS[0]}, own).goals == POSES[1:2]
    with pytest.raises(ParameterMismatch, match="goal_pose of scenario go: expected a mapping, pose_3d, got nothing"):
        script({"goal_pose1": GOALS[0]}, own)


@pytest.mark.parametrize("goals", [[], "@goal"])
def test_goals_of_wrong_kind_are_refused(script, goals):
    with pytest.raises(ValueError, match=r"goal_poses: expected a list of poses, at least one, got .*"):
        script({"goal_poses": goals})
