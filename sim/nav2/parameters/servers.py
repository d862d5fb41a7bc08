"""Parameters of Nav2's servers: planners, checkers, behaviors, smoother, and collision monitor, and of perturbations."""

from typing import Annotated, Final, Literal, TypeAlias

from pydantic import Field

from vastflow.sim.model.parameter import ParameterGroup, choice, derived, parameter
from vastflow.sim.model.polygon import Vertices

Forward: TypeAlias = Annotated[float, Field(ge=0.0, le=100.0)]
Backward: TypeAlias = Annotated[float, Field(ge=-100.0, le=0.0)]
Acceleration: TypeAlias = Annotated[float, Field(ge=0.0, le=1000.0)]
Deceleration: TypeAlias = Annotated[float, Field(ge=-1000.0, le=0.0)]


MOST_ZONES: Final = 8
"""Areas of a collision monitor."""

NO_LIMIT: Final = 1e6
"""A number that nothing reaches."""


class NavFn(ParameterGroup):
    """NavfnPlanner; tolerance in meters."""

    tolerance: float = parameter(0.5, 0.0, 100.0, below=0.0)
    allow_unknown: bool = parameter(True)
    use_astar: bool = parameter(False)


class PlannerServer(ParameterGroup):
    """planner_server: seconds that it waits for the update of a cleared costmap.

    Attributes:
        refusal: Nav2's error code where the file makes each ComputePathToPose fail; 0 for none.
    """

    refusal: int = derived(0)
    costmap_update_timeout: float = parameter(1.0, -1e6, NO_LIMIT, above=NO_LIMIT)


class ControllerServer(ParameterGroup):
    """controller_server: Hz, seconds, and velocities below which odometry is read as standing.

    Attributes:
        refusal: Nav2's error code where the file makes each FollowPath end before its first cycle; 0 for none.
    """

    refusal: int = derived(0)
    controller_frequency: float = parameter(20.0, 0.5, 1000.0, least=1e-9)
    costmap_update_timeout: float = parameter(0.3, -1e6, NO_LIMIT, above=NO_LIMIT)
    failure_tolerance: float = parameter(0.3, 0.0, NO_LIMIT, stands_for={-1.0: NO_LIMIT}, below=0.0, above=NO_LIMIT)
    min_x_velocity_threshold: float = parameter(0.001, 0.0, 10.0, below=0.0)
    min_y_velocity_threshold: float = parameter(0.5, 0.0, 10.0, below=0.0)
    min_theta_velocity_threshold: float = parameter(0.001, 0.0, 10.0, below=0.0)


NO_ANGLE_RAD: Final = 7.0
"""No turn counts as progress: it is more than half a circle."""


class ProgressChecker(ParameterGroup):
    """PoseProgressChecker (m, rad, s); a SimpleProgressChecker has the angle `NO_ANGLE_RAD`."""

    required_movement_radius: float = parameter(0.5, -100.0, 100.0)
    required_movement_angle: float = parameter(NO_ANGLE_RAD, -NO_ANGLE_RAD, NO_ANGLE_RAD, above=NO_ANGLE_RAD)
    movement_time_allowance: float = parameter(10.0, -1e6, NO_LIMIT, above=NO_LIMIT)


class GoalChecker(ParameterGroup):
    """StoppedGoalChecker (m, rad, and per second); a SimpleGoalChecker has velocities of `NO_LIMIT`."""

    xy_goal_tolerance: float = parameter(0.25, -100.0, 100.0)
    yaw_goal_tolerance: float = parameter(0.25, -1000.0, 1000.0)
    stateful: bool = parameter(True)
    trans_stopped_velocity: float = parameter(NO_LIMIT, -NO_LIMIT, NO_LIMIT)
    rot_stopped_velocity: float = parameter(NO_LIMIT, -NO_LIMIT, NO_LIMIT)


class RotationShim(ParameterGroup):
    """RotationShimController round the controller: meters, seconds, radians, and per second.

    Attributes:
        enabled: Whether there is one.
        use_path_orientations: Whether it turns to the path's heading ahead, and not to where the path leads.
    """

    enabled: bool = derived(False)
    angular_dist_threshold: float = parameter(0.785, -1000.0, 1000.0)
    angular_disengage_threshold: float = parameter(0.785, -1000.0, 1000.0)
    forward_sampling_distance: float = parameter(0.5, 0.0, 100.0, below=0.0)
    rotate_to_heading_angular_vel: float = parameter(1.8, -100.0, 100.0)
    max_angular_accel: float = parameter(3.2, 0.0, 100.0)
    simulate_ahead_time: float = parameter(1.0, 0.0, 100.0, below=0.0)
    rotate_to_heading_once: bool = parameter(False)
    use_path_orientations: bool = parameter(False)
    rotate_to_goal_heading: bool = parameter(False)
    closed_loop: bool = parameter(True)


class BehaviorServer(ParameterGroup):
    """behavior_server: seconds, rad/s, rad/s²."""

    simulate_ahead_time: float = parameter(2.0, 0.0, 100.0, below=0.0)
    max_rotational_vel: float = parameter(1.0, 0.01, 100.0)
    min_rotational_vel: float = parameter(0.4, 0.0, 100.0)
    rotational_acc_lim: float = parameter(3.2, 0.01, 100.0)


class WaypointFollower(ParameterGroup):
    """waypoint_follower with its WaitAtWaypoint task; the pause is in milliseconds."""

    stop_on_failure: bool = parameter(False)
    waypoint_pause_duration: int = parameter(200, 0, 10_000_000, below=0, above=10_000_000)


class VelocitySmoother(ParameterGroup):
    """velocity_smoother at 20 Hz: x, y, yaw in m/s and rad/s, and per second; times in seconds.

    Attributes:
        closed_loop: Whether it goes on from the mean of the odometry's last `odom_duration`, and not from its last command.
    """

    closed_loop: bool = choice(False, "feedback", {"OPEN_LOOP": False, "CLOSED_LOOP": True})
    odom_duration: float = parameter(0.1, 0.0, 5.0)

    max_velocity: tuple[Forward, Forward, Forward] = parameter((0.5, 0.0, 2.0))
    min_velocity: tuple[Backward, Backward, Backward] = parameter((-0.5, 0.0, -2.0))
    max_accel: tuple[Acceleration, Acceleration, Acceleration] = parameter((2.5, 0.0, 3.2))
    max_decel: tuple[Deceleration, Deceleration, Deceleration] = parameter((-2.5, 0.0, -3.2))
    velocity_timeout: float = parameter(1.0, -1e6, NO_LIMIT, above=NO_LIMIT)


class MonitorZone(ParameterGroup):
    """An area of collision_monitor that the file draws: m/s, rad/s, seconds, and a number of points.

    Attributes:
        vertices: (x, y) of a polygon in the robot's frame (m); none for a circle of `radius`.
    """

    action: Literal["stop", "slowdown", "limit", "approach"] = derived("stop")
    vertices: Vertices = derived(())
    radius: float = parameter(0.0, 0.0, 100.0)
    min_points: int = parameter(4, 0, 100_000, below=0)
    slowdown_ratio: float = parameter(0.5, 0.0, 1.0, above=1.0)
    linear_limit: float = parameter(0.5, 0.0, 100.0, below=0.0, above=100.0)
    angular_limit: float = parameter(0.5, 0.0, 100.0, below=0.0, above=100.0)
    time_before_collision: float = parameter(2.0, 0.0, 100.0, below=0.0)
    simulation_time_step: float = parameter(0.1, 0.001, 10.0, least=1e-9)


class CollisionMonitor(ParameterGroup):
    """collision_monitor with a polygon of type approach round the published footprint, and areas of its file; seconds.

    Humble's stack has none: there the file names no such node, and `enabled` is false.

    Attributes:
        enabled: Whether there is the one round the footprint.
    """

    enabled: bool = parameter(True)
    time_before_collision: float = parameter(1.2, 0.0, 100.0, below=0.0)
    simulation_time_step: float = parameter(0.1, 0.001, 10.0, least=1e-9)
    min_points: int = parameter(6, 0, 100_000, below=0)
    zones: tuple[MonitorZone, ...] = derived(())


class Perturbation(ParameterGroup):
    """Noise of the odometry and of the initial pose.

    Attributes:
        odometry_noise_std_deviation: Standard deviation of each step's distance and turn, as a share of them.
        initial_pose_covariance_xx, initial_pose_covariance_yy, initial_pose_covariance_yaw: Variances of the initial pose (m², rad²).
    """

    odometry_noise_std_deviation: float = parameter(0.0, 0.0, 10.0)
    initial_pose_covariance_xx: float = parameter(0.0, 0.0, 100.0)
    initial_pose_covariance_yy: float = parameter(0.0, 0.0, 100.0)
    initial_pose_covariance_yaw: float = parameter(0.0, 0.0, 40.0)


class SmootherParameters(ParameterGroup):
    """The smoother of a Smac planner: meters a pass, passes, and weights.

    Attributes:
        w_data, w_smooth: Weights of a point's move in a pass: toward where it was, and toward the middle of its neighbors.
    """

    tolerance: float = parameter(1e-10, 0.0, 1.0, below=0.0)
    max_iterations: int = parameter(1000, 0, 1_000_000, below=0)
    w_data: float = parameter(0.2, -10.0, 10.0)
    w_smooth: float = parameter(0.3, -10.0, 10.0)
    do_refinement: bool = parameter(True)
    refinement_num: int = parameter(2, 0, 100, below=0)


class SmacPlanner2D(ParameterGroup):
    """SmacPlanner2D: the tolerance in meters; iterations of 0 and less are without end, as in Nav2."""

    tolerance: float = parameter(0.125, 0.0, 100.0, below=0.0)
    allow_unknown: bool = parameter(True)
    max_iterations: int = parameter(1_000_000, -1, 1_000_000_000, below=-1)
    max_on_approach_iterations: int = parameter(1000, -1, 1_000_000_000, below=-1)
    cost_travel_multiplier: float = parameter(1.0, 0.0, 1000.0)
    smoother: SmootherParameters = SmootherParameters()


class SmacPlannerHybrid(ParameterGroup):
    """SmacPlannerHybrid: meters; penalties are factors, `change_penalty` is added to one.

    Attributes:
        lookup_table_size: Edge of the window round the goal in which the distance heuristic counts.
    """

    tolerance: float = parameter(0.25, 0.0, 100.0, below=0.0)
    allow_unknown: bool = parameter(True)
    max_iterations: int = parameter(1_000_000, -1, 1_000_000_000, below=-1)
    max_on_approach_iterations: int = parameter(1000, -1, 1_000_000_000, below=-1)
    smooth_path: bool = parameter(True)
    motion_model_for_search: Literal["DUBIN", "REEDS_SHEPP"] = parameter("DUBIN")
    angle_quantization_bins: int = parameter(72, 4, 720)
    minimum_turning_radius: float = parameter(0.4, 0.0, 100.0, below=0.0)
    allow_primitive_interpolation: bool = parameter(False)
    reverse_penalty: float = parameter(2.0, 0.0, 1000.0)
    change_penalty: float = parameter(0.0, -1000.0, 1000.0)
    non_straight_penalty: float = parameter(1.2, 0.0, 1000.0)
    cost_penalty: float = parameter(2.0, 0.0, 1000.0)
    retrospective_penalty: float = parameter(0.015, -10.0, 1.0)
    analytic_expansion_ratio: float = parameter(3.5, 0.1, 1000.0)
    analytic_expansion_max_length: float = parameter(3.0, 0.0, 1000.0, below=0.0)
    analytic_expansion_max_cost: float = parameter(200.0, -1.0, 255.0, below=-1.0, above=255.0)
    analytic_expansion_max_cost_override: bool = parameter(False)
    use_quadratic_cost_penalty: bool = parameter(False)
    downsample_obstacle_heuristic: bool = parameter(True)
    lookup_table_size: float = parameter(20.0, 0.1, 30.0)
    smoother: SmootherParameters = SmootherParameters()
