"""Missions: what the robot is asked to do."""

from dataclasses import dataclass
from typing import Literal, TypeAlias

from vastflow.sim.pose import Pose

MissionKind: TypeAlias = Literal["navigate_to_pose", "navigate_through_poses", "follow_waypoints"]


@dataclass(frozen=True, slots=True)
class Mission:
    """A Nav2 action and its arguments.

    Attributes:
        goals: In the order they are visited; one for `navigate_to_pose`.
        loops: Repetitions of `follow_waypoints` after the first round (Nav2's `number_of_loops`).
    """

    kind: MissionKind
    goals: tuple[Pose, ...]
    loops: int = 0
