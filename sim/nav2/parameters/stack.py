"""All parameters of the navigation stack, component by component."""

from pydantic import SerializeAsAny

from vastflow.sim.model.parameter import ParameterGroup
from vastflow.sim.nav2.parameters.amcl import AmclParameters
from vastflow.sim.nav2.parameters.costmap import Costmap, global_costmap, local_costmap
from vastflow.sim.nav2.parameters.mppi import MppiParameters
from vastflow.sim.nav2.parameters.servers import (
    BehaviorServer,
    CollisionMonitor,
    ControllerServer,
    GoalChecker,
    NavFn,
    Perturbation,
    PlannerServer,
    ProgressChecker,
    RotationShim,
    VelocitySmoother,
    WaypointFollower,
)
from vastflow.sim.system.robot import Latency, OdometryDrift, RobotParameters
from vastflow.sim.world.noise_registry import GaussianDropoutParameters


class NavParameters(ParameterGroup):
    """Settings of the stack in the loop; Nav2 Jazzy's default file where nothing is given.

    Attributes:
        controller: Parameters of the controller; a plug-in is its own, see
            `vastflow.sim.nav2.parameter_files.plug_ins`. So are `planner` and `lidar_noise`.
        robot: Parameters of the robot, which the stack is not told of; `latency` and `odometry`: those of its sensors and computers.
    """

    robot: RobotParameters = RobotParameters()
    perturbation: Perturbation = Perturbation()
    lidar_noise: SerializeAsAny[ParameterGroup] = GaussianDropoutParameters()
    latency: Latency = Latency()
    odometry: OdometryDrift = OdometryDrift()
    amcl: AmclParameters = AmclParameters()
    local_costmap: Costmap = local_costmap()
    global_costmap: Costmap = global_costmap()
    planner_server: PlannerServer = PlannerServer()
    planner: SerializeAsAny[ParameterGroup] = NavFn()
    controller_server: ControllerServer = ControllerServer()
    progress_checker: ProgressChecker = ProgressChecker()
    goal_checker: GoalChecker = GoalChecker()
    behavior_server: BehaviorServer = BehaviorServer()
    waypoint_follower: WaypointFollower = WaypointFollower()
    velocity_smoother: VelocitySmoother = VelocitySmoother()
    collision_monitor: CollisionMonitor = CollisionMonitor()
    rotation_shim: RotationShim = RotationShim()
    controller: SerializeAsAny[ParameterGroup] = MppiParameters()
