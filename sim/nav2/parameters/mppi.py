"""Parameters of the MPPI controller (nav2_mppi_controller, Jazzy)."""

from typing import Final, Literal, TypeAlias

from vastflow.sim.model.parameter import ParameterGroup, parameter

MotionModel: TypeAlias = Literal["DiffDrive", "Ackermann", "Omni"]


class AckermannParameters(ParameterGroup):
    """Parameters of the motion model Ackermann alone; meters."""

    min_turning_r: float = parameter(0.2, 0.001, 100.0)


class MppiCritic(ParameterGroup):
    """A critic: whether it is in the list `critics`, and on."""

    enabled: bool = parameter(True)


class ConstraintParameters(MppiCritic):
    """Speed beyond the limits."""

    cost_weight: float = parameter(4.0, -1e6, 1e6)


class CostParameters(MppiCritic):
    """The local costmap under every `trajectory_point_step`-th point; distances in meters.

    With `consider_footprint` a point collides where the robot's outline does, and not where its center is inscribed.
    """

    cost_weight: float = parameter(3.81, -1e6, 1e6)
    near_collision_cost: int = parameter(253, 0, 255)
    critical_cost: float = parameter(300.0, -1e6, 1e6)
    collision_cost: float = parameter(1_000_000.0, -1e12, 1e12)
    near_goal_distance: float = parameter(1.0, 0.0, 1e3, mirrored=True, above=1e3)
    trajectory_point_step: int = parameter(2, 1, 1000, least=1)
    consider_footprint: bool = parameter(False)


class ObstaclesParameters(MppiCritic):
    """Distance to the nearest obstacle, as the local costmap's inflation says it, under every point; distances in meters.

    Humble's critic in place of CostCritic. The inflation's two parameters are the critic's own there, and since then the layer's.
    """

    repulsion_weight: float = parameter(1.5, -1e6, 1e6)
    critical_weight: float = parameter(20.0, -1e6, 1e6)
    collision_cost: float = parameter(100_000.0, -1e12, 1e12)
    collision_margin_distance: float = parameter(0.1, 0.0, 1e3)
    near_goal_distance: float = parameter(0.5, 0.0, 1e3, mirrored=True, above=1e3)
    inflation_radius: float = parameter(0.55, 0.0, 100.0)
    cost_scaling_factor: float = parameter(10.0, 0.0, 1e3)


class ThresholdParameters(MppiCritic):
    """A critic within a distance of the goal (m), or PreferForwardCritic beyond it.

    GoalCritic judges the distance of all points to the goal, GoalAngleCritic their heading against the goal's, and PreferForwardCritic
    driving backwards.
    """

    cost_weight: float = parameter(5.0, -1e6, 1e6)
    threshold_to_consider: float = parameter(0.5, 0.0, 1e3, mirrored=True, above=1e3)


class PathAlignParameters(MppiCritic):
    """Distance of every `trajectory_point_step`-th point to the plan's point as far along; offsets count its points.

    With `use_path_orientations` 1 rad between their headings counts as 1 m.
    """

    cost_weight: float = parameter(14.0, -1e6, 1e6)
    max_path_occupancy_ratio: float = parameter(0.05, -1e6, 1e6)
    trajectory_point_step: int = parameter(4, 1, 1000, least=1)
    threshold_to_consider: float = parameter(0.5, 0.0, 1e3, mirrored=True, above=1e3)
    offset_from_furthest: int = parameter(20, 0, 1000)
    use_path_orientations: bool = parameter(False)


class PathFollowParameters(MppiCritic):
    """Distance of the last point to the plan's point just beyond the reach of all trajectories."""

    cost_weight: float = parameter(5.0, -1e6, 1e6)
    offset_from_furthest: int = parameter(5, 0, 1000)
    threshold_to_consider: float = parameter(1.4, 0.0, 1e3, mirrored=True, above=1e3)


class PathAngleParameters(MppiCritic):
    """Last heading against the bearing of such a point, when the robot faces elsewhere (rad).

    `mode` 0 wants the front towards the point, 1 front or back, and 2 whichever the plan's heading there says.
    """

    cost_weight: float = parameter(2.0, -1e6, 1e6)
    offset_from_furthest: int = parameter(4, 0, 1000)
    threshold_to_consider: float = parameter(0.5, 0.0, 1e3, mirrored=True, above=1e3)
    max_angle_to_furthest: float = parameter(1.0, -4.0, 4.0, below=-4.0, above=4.0)
    mode: int = parameter(0, 0, 2, least=0, most=2)


class TwirlingParameters(MppiCritic):
    """Turning, as long as the robot is farther from the goal than the goal checker allows."""

    cost_power: int = parameter(1, 1, 10)
    cost_weight: float = parameter(10.0, -1e6, 1e6)


class VelocityDeadbandParameters(TwirlingParameters):
    """Speeds short of these: forward and to the left (m/s), and turning (rad/s)."""

    cost_weight: float = parameter(35.0, -1e6, 1e6)
    deadband_velocities: tuple[float, float, float] = parameter((0.0, 0.0, 0.0))


_OMNI: Final = ("motion_model", "Omni", "the motion model is not Omni")
_INVERSIONS: Final = ("enforce_path_inversion", True, "enforce_path_inversion is not set")


class MppiParameters(ParameterGroup):
    """Parameters of the optimizer: meters, seconds, radians.

    Without the model Omni `vy_max` serves ConstraintCritic alone, as in Jazzy; `ay_max`, `ay_min` and `vy_std` have no effect.

    `retry_scores` is not Nav2's: whether the critics judge the samples of a retry after a batch in which all collide. As
    Nav2 is released they don't, and a retry never gives a command.
    """

    motion_model: MotionModel = parameter("DiffDrive")
    time_steps: int = parameter(56, 2, 1000, least=1)
    model_dt: float = parameter(0.05, 0.05, 1.0, least=1e-9)
    batch_size: int = parameter(2000, 1, 100_000, least=1)
    temperature: float = parameter(0.3, 1e-3, 1e6, least=1e-9)
    gamma: float = parameter(0.015, -1e3, 1e3)
    vx_max: float = parameter(0.5, 0.0, 10.0)
    vx_min: float = parameter(-0.35, -10.0, 10.0)
    vy_max: float = parameter(0.5, 0.0, 10.0)
    wz_max: float = parameter(1.9, 0.0, 10.0)
    ax_max: float = parameter(3.0, 0.0, 100.0, mirrored=True)
    ax_min: float = parameter(-3.0, -100.0, 0.0, mirrored=True)
    ay_max: float = parameter(3.0, 0.0, 100.0, needs=_OMNI)
    ay_min: float = parameter(-3.0, -100.0, 0.0, mirrored=True, needs=_OMNI)
    az_max: float = parameter(3.5, 0.0, 100.0)
    vx_std: float = parameter(0.2, 1e-3, 10.0, least=1e-9)
    vy_std: float = parameter(0.2, 1e-3, 10.0, least=1e-9, needs=_OMNI)
    wz_std: float = parameter(0.4, 1e-3, 10.0, least=1e-9)
    prune_distance: float = parameter(1.7, 0.0, 100.0)
    enforce_path_inversion: bool = parameter(False)
    inversion_xy_tolerance: float = parameter(0.2, 0.0, 100.0, needs=_INVERSIONS)
    inversion_yaw_tolerance: float = parameter(0.4, 0.0, 7.0, needs=_INVERSIONS)
    retry_attempt_limit: int = parameter(1, 0, 1000)
    regenerate_noises: bool = parameter(True)
    retry_scores: bool = parameter(False)
    AckermannConstraints: AckermannParameters = AckermannParameters()
    ConstraintCritic: ConstraintParameters = ConstraintParameters()
    CostCritic: CostParameters = CostParameters()
    ObstaclesCritic: ObstaclesParameters = ObstaclesParameters(enabled=False)
    GoalCritic: ThresholdParameters = ThresholdParameters(threshold_to_consider=1.4)
    GoalAngleCritic: ThresholdParameters = ThresholdParameters(cost_weight=3.0)
    PathAlignCritic: PathAlignParameters = PathAlignParameters()
    PathFollowCritic: PathFollowParameters = PathFollowParameters()
    PathAngleCritic: PathAngleParameters = PathAngleParameters()
    PreferForwardCritic: ThresholdParameters = ThresholdParameters()
    TwirlingCritic: TwirlingParameters = TwirlingParameters(enabled=False)
    VelocityDeadbandCritic: VelocityDeadbandParameters = VelocityDeadbandParameters(enabled=False)
