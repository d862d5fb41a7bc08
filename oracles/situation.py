"""The situation: what observation and oracles know of a scenario beside what happened in it."""

from dataclasses import dataclass

from vastflow.sim.mission import BUILTIN, mission_of
from vastflow.sim.obstacle import Obstacle, obstacles_of
from vastflow.sim.pose import Pose
from vastflow.sim.scenario import Scenario


@dataclass(frozen=True, slots=True)
class Situation:
    """Where a mission begins, where it is to go, and what stands in the way.

    Attributes:
        start: None where the scenario is no navigation mission.
        goals: In the order they are to be reached, repeated by the mission's loops; empty without a goal.
        obstacles: What is not on the robot's map, as the scenario has it: those with a trigger may never appear, and may be pushed
            (`vastflow.oracles.whereabouts`).
    """

    start: Pose | None
    goals: tuple[Pose, ...]
    obstacles: tuple[Obstacle, ...]


def situation_of(scenario: Scenario) -> Situation:
    """Read start, goals and obstacles of `scenario`.

    Raises:
        ValueError: a mission or an obstacle that can't be read.
    """
    obstacles = obstacles_of(scenario.environment)
    if scenario.abstract not in BUILTIN:
        return Situation(None, (), obstacles)
    mission = mission_of(scenario)
    return Situation(mission.start, mission.goals * (1 + mission.loops), obstacles)
