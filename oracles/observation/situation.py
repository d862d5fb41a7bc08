"""The situation: the facts of a scenario that observation and oracles use."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from vastflow.sim.model.obstacle import Obstacle
from vastflow.sim.model.pose import Pose
from vastflow.sim.model.scenario import Scenario
from vastflow.sim.model.shape import Box, Disc
from vastflow.sim.reading.movers import mover_shapes
from vastflow.sim.reading.script import script_of
from vastflow.sim.system.system import system_of
from vastflow.sim.world.robot_model import TURTLEBOT_4, TURTLEBOT_4_RADIUS_M


@dataclass(frozen=True, slots=True)
class Situation:
    """Start, goals, obstacles, and robot size of a scenario.

    Attributes:
        start: None without a robot.
        goals: Goals of the navigation actions in written order, loops repeated.
        obstacles: Objects that are not on the robot's map; those with a trigger may never appear. Spawned ones are in `Run.entities`.
        inscribed_radius_m: Inscribed radius of the body in the section `robot`, else of the local costmap's footprint.
        circumscribed_radius_m: Circumscribed radius of the robot's body.
        passed: The goals that a mission through poses passes by, in order.
        movers: Shapes of bodies that move by themselves, by their names.
        reference_length_m: Length of the path that a benchmark compares with; None where the campaign gives none.
    """

    start: Pose | None
    goals: tuple[Pose, ...]
    obstacles: tuple[Obstacle, ...]
    inscribed_radius_m: float = TURTLEBOT_4_RADIUS_M
    circumscribed_radius_m: float = TURTLEBOT_4.radius_m
    passed: tuple[Pose, ...] = ()
    movers: Mapping[str, Disc | Box] = field(default_factory=dict)
    reference_length_m: float | None = None


def situation_of(scenario: Scenario) -> Situation:
    """Read start, goals, obstacles, and the robot's size of `scenario`.

    Raises:
        ValueError: a mission, an obstacle, or a robot that cannot be read.
    """
    script = script_of(scenario)
    if script.start is None:
        return Situation(None, script.goals, script.obstacles)
    system = system_of(scenario.system, is_drawn=True)
    radii_m = system.inscribed_radius_m, system.robot.radius_m
    movers = mover_shapes(scenario.environment)
    passed, length_m = script.passed, script.reference_length_m
    return Situation(script.start, script.goals, script.obstacles, *radii_m, passed, movers, length_m)
