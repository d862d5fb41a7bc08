"""Parameters of the DWB controller: defaults of Humble's nav2_bringup file, which the TurtleBot 4's shares."""

from vastflow.sim.nav.parameters.parameter import ParameterGroup, parameter


class RotateToGoalCritic(ParameterGroup):
    """Heading at the goal. `enabled` says whether the critic is in the list `critics`, here and in the groups below."""

    enabled: bool = parameter(True)
    scale: float = parameter(32.0, 0.0, 1e6, code=1.0)
    slowing_factor: float = parameter(5.0, 0.0, 1e6)


class OscillationCritic(ParameterGroup):
    """No change of direction until the robot has moved (m) or turned (rad); a negative reset value never lifts it."""

    enabled: bool = parameter(True)
    scale: float = parameter(1.0, 0.0, 1e6)
    oscillation_reset_dist: float = parameter(0.05, -1.0, 100.0)
    oscillation_reset_angle: float = parameter(0.2, -1.0, 7.0)
    x_only_threshold: float = parameter(0.05, -1.0, 10.0)


class BaseObstacleCritic(ParameterGroup):
    """Cost of the last pose; no pose may be in collision."""

    enabled: bool = parameter(True)
    scale: float = parameter(0.02, 0.0, 1e6, code=1.0)


class GoalAlignCritic(ParameterGroup):
    """Distance of a point ahead of the robot (m) to one ahead of the local goal."""

    enabled: bool = parameter(True)
    scale: float = parameter(24.0, 0.0, 1e6, code=1.0)
    forward_point_distance: float = parameter(0.1, 0.0, 10.0, code=0.325)


class PathAlignCritic(ParameterGroup):
    """Distance of a point ahead of the robot (m) to the local plan."""

    enabled: bool = parameter(True)
    scale: float = parameter(32.0, 0.0, 1e6, code=1.0)
    forward_point_distance: float = parameter(0.1, 0.0, 10.0, code=0.325)


class PathDistCritic(ParameterGroup):
    """Distance to the local plan."""

    enabled: bool = parameter(True)
    scale: float = parameter(32.0, 0.0, 1e6, code=1.0)


class GoalDistCritic(ParameterGroup):
    """Distance to the end of the local plan."""

    enabled: bool = parameter(True)
    scale: float = parameter(24.0, 0.0, 1e6, code=1.0)


class DwbParameters(ParameterGroup):
    """dwb_core with StandardTrajectoryGenerator on a differential drive: meters, seconds, radians.

    Nav2's code defaults of the kinematic limits are 0: a file that leaves one of them out has a robot that does not
    move that way.
    """

    min_vel_x: float = parameter(0.0, -5.0, 5.0)
    max_vel_x: float = parameter(0.26, -5.0, 5.0, code=0.0)
    max_vel_theta: float = parameter(1.0, 0.0, 10.0, code=0.0)
    min_speed_xy: float = parameter(0.0, -5.0, 5.0)
    max_speed_xy: float = parameter(0.26, -5.0, 5.0, code=0.0)
    min_speed_theta: float = parameter(0.0, -10.0, 10.0)
    acc_lim_x: float = parameter(2.5, 0.0, 100.0, code=0.0)
    acc_lim_theta: float = parameter(3.2, 0.0, 100.0, code=0.0)
    decel_lim_x: float = parameter(-2.5, -100.0, 0.0, code=0.0)
    decel_lim_theta: float = parameter(-3.2, -100.0, 0.0, code=0.0)
    vx_samples: int = parameter(20, 1, 100)
    vtheta_samples: int = parameter(20, 1, 100)
    sim_time: float = parameter(1.7, 0.05, 5.0)
    linear_granularity: float = parameter(0.05, 0.01, 10.0, code=0.5)
    angular_granularity: float = parameter(0.025, 0.01, 10.0)
    xy_goal_tolerance: float = parameter(0.25, 0.0, 100.0)
    trans_stopped_velocity: float = parameter(0.25, 0.0, 10.0)
    forward_prune_distance: float = parameter(2.0, 0.0, 100.0)
    RotateToGoal: RotateToGoalCritic = RotateToGoalCritic()
    Oscillation: OscillationCritic = OscillationCritic()
    BaseObstacle: BaseObstacleCritic = BaseObstacleCritic()
    GoalAlign: GoalAlignCritic = GoalAlignCritic()
    PathAlign: PathAlignCritic = PathAlignCritic()
    PathDist: PathDistCritic = PathDistCritic()
    GoalDist: GoalDistCritic = GoalDistCritic()
