"""The situation: what observation and oracles know of a scenario beside what happened in it."""

from dataclasses import dataclass

from vastflow.sim.model.obstacle import Obstacle
from vastflow.sim.model.pose import Pose
from vastflow.sim.model.scenario import Scenario
from vastflow.sim.nav2.costmaps.outline import inscribed_radius_of
from vastflow.sim.nav2.parameter_files.chosen import parameters_of
from vastflow.sim.reading.robot import TURTLEBOT_4, TURTLEBOT_4_RADIUS_M, robot_of
from vastflow.sim.reading.script import script_of


@dataclass(frozen=True, slots=True)
class Situation:
    """Start, goals, obstacles, and robot size of a scenario.

    Attributes:
        start: None where the scenario has no robot.
        goals: Of the scenario's navigation actions in the order they are written, repeated by their loops; empty without one.
        obstacles: What is not on the robot's map, as the scenario has it: those with a trigger may never appear, and may be pushed
            (`vastflow.oracles.observation.obstacle_tracks`). What a scenario file spawns itself is in a run's `entities`.
        inscribed_radius_m: Of the body that the section `robot` gives, else of the local costmap's footprint.
        circumscribed_radius_m: Of the robot's body.
    """

    start: Pose | None
    goals: tuple[Pose, ...]
    obstacles: tuple[Obstacle, ...]
    inscribed_radius_m: float = TURTLEBOT_4_RADIUS_M
    circumscribed_radius_m: float = TURTLEBOT_4.radius_m


def situation_of(scenario: Scenario) -> Situation:
    """Read start, goals, obstacles, and the robot's size of `scenario`.

    Raises:
        ValueError: a mission, an obstacle, or a robot that can't be read.
    """
    script = script_of(scenario)
    if script.start is None:
        return Situation(None, script.goals, script.obstacles)
    parameters = parameters_of(scenario.system)
    radii_m = inscribed_radius_of(parameters), robot_of(parameters).radius_m
    return Situation(script.start, script.goals, script.obstacles, *radii_m)
