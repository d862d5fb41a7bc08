"""The situation: what observation and oracles know of a scenario beside what happened in it."""

from dataclasses import dataclass

from vastflow.sim.pose import Pose
from vastflow.sim.reading.script import script_of
from vastflow.sim.scenario import Scenario
from vastflow.sim.world.obstacle import Obstacle


@dataclass(frozen=True, slots=True)
class Situation:
    """Where a mission begins, where it is to go, and what stands between.

    Attributes:
        start: None where the scenario has no robot.
        goals: Of the scenario's navigation actions in the order they are written, repeated by their loops; empty without one.
        obstacles: What is not on the robot's map, as the scenario has it: those with a trigger may never appear, and may be pushed
            (`vastflow.oracles.obstacle_tracks`). What a scenario file spawns itself is in a run's `entities`.
    """

    start: Pose | None
    goals: tuple[Pose, ...]
    obstacles: tuple[Obstacle, ...]


def situation_of(scenario: Scenario) -> Situation:
    """Read start, goals and obstacles of `scenario`.

    Raises:
        ValueError: a mission or an obstacle that can't be read.
    """
    script = script_of(scenario)
    return Situation(script.start, script.goals, script.obstacles)
