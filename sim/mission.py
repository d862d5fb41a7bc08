"""Missions: what the robot is asked to do."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal, TypeAlias

from vastflow.sim.digest import Value
from vastflow.sim.pose import Pose, pose_of
from vastflow.sim.scenario import Scenario

Kind: TypeAlias = Literal["navigate_to_pose", "navigate_through_poses", "follow_waypoints"]

BUILTIN: Final[Mapping[str, Kind]] = {
    "builtin:navigate_to_pose": "navigate_to_pose",
    "builtin:navigate_through_poses": "navigate_through_poses",
    "builtin:follow_waypoints": "follow_waypoints",
}


class MissionError(ValueError):
    """A task that describes no mission; says which key, what was found and what would be right."""


@dataclass(frozen=True, slots=True)
class Mission:
    """A Nav2 action and its arguments.

    Attributes:
        goals: In the order they are visited; one for `navigate_to_pose`.
        loops: Repetitions of `follow_waypoints` after the first round (Nav2's `number_of_loops`).
    """

    kind: Kind
    start: Pose
    goals: tuple[Pose, ...]
    loops: int = 0


def mission_of(scenario: Scenario) -> Mission:
    """The mission a scenario's task describes.

    Raises:
        MissionError: an unknown abstract scenario, no start, no goal, a malformed pose or number of loops.
    """
    kind = BUILTIN.get(scenario.abstract)
    if kind is None:
        raise MissionError(f"scenario: found {scenario.abstract!r}; one of {', '.join(BUILTIN)}")
    start = _pose(scenario.task, "start_pose")
    loops = scenario.task.get("number_of_loops", 0)
    if isinstance(loops, bool) or not isinstance(loops, int) or loops < 0:
        raise MissionError(f"number_of_loops: found {loops!r}; a whole number >= 0")
    if kind == "navigate_to_pose":
        return Mission(kind, start, (_pose(scenario.task, "goal_pose"),))
    return Mission(kind, start, _poses(scenario.task), loops if kind == "follow_waypoints" else 0)


def _poses(task: Mapping[str, Value]) -> tuple[Pose, ...]:
    goals = task.get("goal_poses", [task["goal_pose"]] if "goal_pose" in task else None)
    if not isinstance(goals, Sequence) or isinstance(goals, str) or not goals:
        raise MissionError(f"goal_poses: found {goals!r}; a list of one pose or more")
    try:
        return tuple(pose_of(goal, f"goal_poses[{i}]") for i, goal in enumerate(goals))
    except ValueError as error:
        raise MissionError(str(error)) from None


def _pose(task: Mapping[str, Value], key: str) -> Pose:
    if key not in task:
        raise MissionError(f"{key}: nothing in the task; this mission needs a pose")
    try:
        return pose_of(task[key], key)
    except ValueError as error:
        raise MissionError(str(error)) from None
