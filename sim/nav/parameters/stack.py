"""All parameters of the navigation stack, component by component."""

from dataclasses import dataclass
from typing import TypeAlias

from vastflow.sim.nav.parameters.amcl import AmclParameters
from vastflow.sim.nav.parameters.costmap import Costmap, global_costmap, local_costmap
from vastflow.sim.nav.parameters.dwb import DwbParameters
from vastflow.sim.nav.parameters.mppi import MppiParameters
from vastflow.sim.nav.parameters.parameter import ParameterError, check, group
from vastflow.sim.nav.parameters.rpp import RppParameters
from vastflow.sim.nav.parameters.servers import (
    BehaviorServer,
    CollisionMonitor,
    ControllerServer,
    GoalChecker,
    NavFn,
    Perturbation,
    ProgressChecker,
    VelocitySmoother,
    WaypointFollower,
)

ControllerParameters: TypeAlias = MppiParameters | DwbParameters | RppParameters


@dataclass(frozen=True, slots=True)
class NavParameters:
    """What the stack in the loop is set to; the values of Nav2 Jazzy's default file where nothing is given.

    Raises:
        ParameterError: a value of the wrong type or out of range; says which.
    """

    perturbation: Perturbation = group(Perturbation)
    amcl: AmclParameters = group(AmclParameters)
    local_costmap: Costmap = group(local_costmap)
    global_costmap: Costmap = group(global_costmap)
    planner: NavFn = group(NavFn)
    controller_server: ControllerServer = group(ControllerServer)
    progress_checker: ProgressChecker = group(ProgressChecker)
    goal_checker: GoalChecker = group(GoalChecker)
    behavior_server: BehaviorServer = group(BehaviorServer)
    waypoint_follower: WaypointFollower = group(WaypointFollower)
    velocity_smoother: VelocitySmoother = group(VelocitySmoother)
    collision_monitor: CollisionMonitor = group(CollisionMonitor)
    controller: ControllerParameters = group(MppiParameters)

    def __post_init__(self) -> None:
        check(self)
        if self.amcl.min_particles > self.amcl.max_particles:
            raise ParameterError(
                f"amcl.min_particles {self.amcl.min_particles} must be <= max_particles {self.amcl.max_particles}"
            )
