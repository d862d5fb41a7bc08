"""Parameters of the DWB controller: defaults of Humble's nav2_bringup file, which the TurtleBot 4's shares."""

from vastflow.sim.model.parameter import ParameterGroup, derived, parameter


class DwbCritic(ParameterGroup):
    """A critic: whether it is in the list `critics`, and its place among them, 0 for the first."""

    enabled: bool = derived(True)
    place: int = derived(0)


class RotateToGoalCritic(DwbCritic):
    """Heading at the goal."""

    scale: float = parameter(32.0, 0.0, 1e6)
    slowing_factor: float = parameter(5.0, 0.0, 1e6)


class OscillationCritic(DwbCritic):
    """No change of direction until the robot has moved (m) or turned (rad); a negative reset value never lifts it."""

    scale: float = parameter(1.0, 0.0, 1e6)
    oscillation_reset_dist: float = parameter(0.05, -1.0, 100.0)
    oscillation_reset_angle: float = parameter(0.2, -1.0, 7.0)
    x_only_threshold: float = parameter(0.05, -1.0, 10.0)


class ObstacleCritic(DwbCritic):
    """Cost at the last pose, or at all of them with `sum_scores`; none of them may collide.

    BaseObstacle's is under the center, ObstacleFootprint's the greatest under the outline.
    """

    scale: float = parameter(0.02, 0.0, 1e6)
    sum_scores: bool = parameter(False)


class AlignCritic(DwbCritic):
    """Distance (m) from a point in front of the robot to the local plan or its extended goal."""

    scale: float = parameter(32.0, 0.0, 1e6)
    forward_point_distance: float = parameter(0.1, -10.0, 10.0)


class DistCritic(DwbCritic):
    """Distance to the local plan, or to its end."""

    scale: float = parameter(32.0, 0.0, 1e6)


class PreferForwardCritic(DwbCritic):
    """A penalty for driving backward (m/s), and for strafing below `strafe_x` and `strafe_theta` (rad/s)."""

    scale: float = parameter(1.0, 0.0, 1e6)
    penalty: float = parameter(1.0, 0.0, 1e6)
    strafe_x: float = parameter(0.1, -10.0, 10.0)
    strafe_theta: float = parameter(0.2, 0.0, 10.0)
    theta_scale: float = parameter(10.0, 0.0, 1e6)


class TwirlingCritic(DwbCritic):
    """Yaw rate."""

    scale: float = parameter(0.0, 0.0, 1e6)


class DwbParameters(ParameterGroup):
    """dwb_core with StandardTrajectoryGenerator: meters, seconds, radians.

    Nav2's code defaults of the kinematic limits are 0: a file that leaves one of them out has a robot that does not
    move that way.
    """

    min_vel_x: float = parameter(0.0, -5.0, 5.0)
    max_vel_x: float = parameter(0.26, -5.0, 5.0)
    min_vel_y: float = parameter(0.0, -5.0, 5.0)
    max_vel_y: float = parameter(0.0, -5.0, 5.0)
    max_vel_theta: float = parameter(1.0, 0.0, 100.0)
    min_speed_xy: float = parameter(0.0, -100.0, 100.0)
    max_speed_xy: float = parameter(0.26, -100.0, 100.0)
    min_speed_theta: float = parameter(0.0, -100.0, 100.0)
    acc_lim_x: float = parameter(2.5, -100.0, 100.0)
    acc_lim_y: float = parameter(0.0, -100.0, 100.0)
    acc_lim_theta: float = parameter(3.2, -100.0, 100.0)
    decel_lim_x: float = parameter(-2.5, -100.0, 100.0)
    decel_lim_y: float = parameter(0.0, -100.0, 100.0)
    decel_lim_theta: float = parameter(-3.2, -100.0, 100.0)
    vx_samples: int = parameter(20, 0, 100)
    vy_samples: int = parameter(5, 0, 100)
    vtheta_samples: int = parameter(20, 0, 100)
    sim_time: float = parameter(1.7, 0.05, 5.0, least=1e-9)
    linear_granularity: float = parameter(0.05, 0.01, 10.0, least=1e-9)
    angular_granularity: float = parameter(0.025, 0.01, 10.0, least=1e-9)
    xy_goal_tolerance: float = parameter(0.25, 0.0, 100.0, mirrored=True)
    trans_stopped_velocity: float = parameter(0.25, 0.0, 10.0)
    prune_distance: float = parameter(2.0, 0.0, 100.0)
    forward_prune_distance: float = parameter(2.0, 0.0, 100.0, below=100.0)
    RotateToGoal: RotateToGoalCritic = RotateToGoalCritic()
    Oscillation: OscillationCritic = OscillationCritic(place=1)
    BaseObstacle: ObstacleCritic = ObstacleCritic(place=2)
    GoalAlign: AlignCritic = AlignCritic(scale=24.0, place=3)
    PathAlign: AlignCritic = AlignCritic(place=4)
    PathDist: DistCritic = DistCritic(place=5)
    GoalDist: DistCritic = DistCritic(scale=24.0, place=6)
    PreferForward: PreferForwardCritic = PreferForwardCritic(enabled=False, place=7)
    Twirling: TwirlingCritic = TwirlingCritic(enabled=False, place=8)
    ObstacleFootprint: ObstacleCritic = ObstacleCritic(scale=1.0, enabled=False, place=9)

    def critics(self) -> tuple[DwbCritic, ...]:
        """The parameter groups of the critics, in the order above."""
        return tuple(value for _, value in self if isinstance(value, DwbCritic))
