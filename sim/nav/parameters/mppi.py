"""Parameters of the MPPI controller (nav2_mppi_controller, Jazzy, DiffDrive)."""

from dataclasses import dataclass

from vastflow.sim.nav.parameters.parameter import group, parameter


@dataclass(frozen=True, slots=True)
class ConstraintCritic:
    """Speed beyond the limits. `enabled` also says whether the critic is in the list `critics`, as in all groups below."""

    enabled: bool = parameter(True)
    cost_weight: float = parameter(4.0, 0.0, 1e6)


@dataclass(frozen=True, slots=True)
class CostCritic:
    """The local costmap under every `trajectory_point_step`-th point; distances in metres."""

    enabled: bool = parameter(True)
    cost_weight: float = parameter(3.81, 0.0, 1e6)
    near_collision_cost: int = parameter(253, 0, 255)
    critical_cost: float = parameter(300.0, 0.0, 1e6)
    collision_cost: float = parameter(1_000_000.0, 0.0, 1e12)
    near_goal_distance: float = parameter(1.0, 0.0, 1e3, code=0.5)
    trajectory_point_step: int = parameter(2, 1, 1000)


@dataclass(frozen=True, slots=True)
class GoalCritic:
    """Distance of all points to the goal, within a distance of it (m)."""

    enabled: bool = parameter(True)
    cost_weight: float = parameter(5.0, 0.0, 1e6)
    threshold_to_consider: float = parameter(1.4, 0.0, 1e3)


@dataclass(frozen=True, slots=True)
class GoalAngleCritic:
    """Heading of all points against the goal's, within a distance of it (m)."""

    enabled: bool = parameter(True)
    cost_weight: float = parameter(3.0, 0.0, 1e6)
    threshold_to_consider: float = parameter(0.5, 0.0, 1e3)


@dataclass(frozen=True, slots=True)
class PathAlignCritic:
    """Distance of every `trajectory_point_step`-th point to the plan's point as far along; offsets count its points."""

    enabled: bool = parameter(True)
    cost_weight: float = parameter(14.0, 0.0, 1e6, code=10.0)
    max_path_occupancy_ratio: float = parameter(0.05, 0.0, 1.0, code=0.07)
    trajectory_point_step: int = parameter(4, 1, 1000)
    threshold_to_consider: float = parameter(0.5, 0.0, 1e3)
    offset_from_furthest: int = parameter(20, 0, 1000)


@dataclass(frozen=True, slots=True)
class PathFollowCritic:
    """Distance of the last point to a point of the plan just beyond what any trajectory reaches."""

    enabled: bool = parameter(True)
    cost_weight: float = parameter(5.0, 0.0, 1e6)
    offset_from_furthest: int = parameter(5, 0, 1000, code=6)
    threshold_to_consider: float = parameter(1.4, 0.0, 1e3)


@dataclass(frozen=True, slots=True)
class PathAngleCritic:
    """Last heading against the bearing of such a point, when the robot faces elsewhere (rad).

    `mode` 0 wants the front towards the point, 1 front or back; 2, by the plan's orientations, is not modelled.
    """

    enabled: bool = parameter(True)
    cost_weight: float = parameter(2.0, 0.0, 1e6, code=2.2)
    offset_from_furthest: int = parameter(4, 0, 1000)
    threshold_to_consider: float = parameter(0.5, 0.0, 1e3)
    max_angle_to_furthest: float = parameter(1.0, 0.0, 4.0, code=0.785398)
    mode: int = parameter(0, 0, 1)


@dataclass(frozen=True, slots=True)
class PreferForwardCritic:
    """Driving backwards, farther than a distance from the goal (m)."""

    enabled: bool = parameter(True)
    cost_weight: float = parameter(5.0, 0.0, 1e6)
    threshold_to_consider: float = parameter(0.5, 0.0, 1e3)


@dataclass(frozen=True, slots=True)
class MppiParameters:
    """The optimiser's parameters: metres, seconds, radians. `vy_max` serves ConstraintCritic alone, as in Jazzy."""

    time_steps: int = parameter(56, 2, 1000)
    model_dt: float = parameter(0.05, 0.05, 1.0)
    batch_size: int = parameter(2000, 1, 100_000, code=1000)
    temperature: float = parameter(0.3, 1e-3, 1e6)
    gamma: float = parameter(0.015, 0.0, 1e3)
    vx_max: float = parameter(0.5, 0.0, 10.0)
    vx_min: float = parameter(-0.35, -10.0, 10.0)
    vy_max: float = parameter(0.5, 0.0, 10.0)
    wz_max: float = parameter(1.9, 0.0, 10.0)
    ax_max: float = parameter(3.0, 0.0, 100.0)
    ax_min: float = parameter(-3.0, -100.0, 0.0)
    az_max: float = parameter(3.5, 0.0, 100.0)
    vx_std: float = parameter(0.2, 1e-3, 10.0)
    wz_std: float = parameter(0.4, 1e-3, 10.0)
    prune_distance: float = parameter(1.7, 0.0, 100.0, code=1.5)
    retry_attempt_limit: int = parameter(1, 0, 10)
    ConstraintCritic: ConstraintCritic = group(ConstraintCritic)
    CostCritic: CostCritic = group(CostCritic)
    GoalCritic: GoalCritic = group(GoalCritic)
    GoalAngleCritic: GoalAngleCritic = group(GoalAngleCritic)
    PathAlignCritic: PathAlignCritic = group(PathAlignCritic)
    PathFollowCritic: PathFollowCritic = group(PathFollowCritic)
    PathAngleCritic: PathAngleCritic = group(PathAngleCritic)
    PreferForwardCritic: PreferForwardCritic = group(PreferForwardCritic)
