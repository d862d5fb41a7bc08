"""The navigation stack's whole state: preallocated arrays and two records, owned by one run."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vastflow.sim.kernels.arrays import zero_pages
from vastflow.sim.kernels.binding import Bound, Running
from vastflow.sim.kernels.streams import CONTROLLER, LIDAR, SUBSYSTEMS
from vastflow.sim.model.elementary import cos_sin
from vastflow.sim.model.polygon import MOST_VERTICES, circumscribed_radius_m
from vastflow.sim.model.pose import Pose, seen_from
from vastflow.sim.model.rates import TICK_S, ticks_of
from vastflow.sim.model.scenario import Mission
from vastflow.sim.nav2.amcl.particles import Cloud, new_cloud
from vastflow.sim.nav2.controllers.binding import RunningController, running
from vastflow.sim.nav2.controllers.controller import Controller, Setting
from vastflow.sim.nav2.controllers.speed_zones import SpeedZones, speed_zones
from vastflow.sim.nav2.costmaps.filters import Mask
from vastflow.sim.nav2.costmaps.inflation import LETHAL, cost_at_distance
from vastflow.sim.nav2.costmaps.outline import inscribed_radius_m, outline_of
from vastflow.sim.nav2.costmaps.window import Window
from vastflow.sim.nav2.navigator.kernels import with_kernels
from vastflow.sim.nav2.navigator.parameter_record import parameter_record
from vastflow.sim.nav2.navigator.prepared import PreparedMap
from vastflow.sim.nav2.parameters.costmap import NEVER_HZ, Costmap, SpeedFilter
from vastflow.sim.nav2.parameters.stack import NavParameters
from vastflow.sim.nav2.planners.binding import RunningPlanner
from vastflow.sim.nav2.planners.binding import running as running_planner
from vastflow.sim.nav2.planners.planner import PlannerSetting
from vastflow.sim.world.lidar import running_noise
from vastflow.sim.world.noise import LidarNoise
from vastflow.sim.world.robot_model import MOST_BEAMS, Lidar, Robot

SUBSTEPS: Final = 5
"""Physics and actuator steps a tick: 100 Hz."""

ROW_TICKS: Final = 2
"""A recording has a row every second tick: 10 Hz."""

LEG_LENGTHS: Final = 32
"""Points of a leg of a path, in longer edges of the map: a way through a maze is many times as long as the map."""

MAX_EVENTS: Final = 4096
LATE_SCANS: Final = 16
"""Scans on their way to the stack: the oldest by `OLDEST_S` at 20 Hz, waiting for its odometry, and one that is being taken."""

ODOMETRY_STEPS: Final = 80
"""Physics steps of odometry that are kept: the oldest sample at 5 Hz on its way, and its twist."""

MOST_TWISTS: Final = 101
"""Ticks of odometry that a velocity smoother with feedback can look back."""
AHEAD_POINTS: Final = 1024

NAVIGATE_TO_POSE, NAVIGATE_THROUGH_POSES, FOLLOW_WAYPOINTS = 0, 1, 2
MISSION_KINDS: Final = {
    "navigate_to_pose": NAVIGATE_TO_POSE,
    "navigate_through_poses": NAVIGATE_THROUGH_POSES,
    "follow_waypoints": FOLLOW_WAYPOINTS,
}

STARTING, FOLLOWING, SPINNING, WAITING, BACKING_UP, PAUSING, ENDED = 0, 1, 2, 3, 4, 5, 6
RUNNING, SUCCEEDED, ABORTED, RESTING = 0, 1, 2, 3
"""State of the mission; RESTING without one, or after its cancellation."""

EVENT_KINDS: Final = ("recovery", "goal_reached", "goal_missed", "plan_failed", "control_failed", "stopped_by_monitor")
EVENT_RECOVERY, EVENT_GOAL_REACHED, EVENT_GOAL_MISSED, EVENT_PLAN_FAILED, EVENT_CONTROL_FAILED, EVENT_STOPPED = range(6)

CLEAR_LOCAL, CLEAR_GLOBAL, CLEAR_BOTH, SPIN, WAIT, BACK_UP = range(6)
RECOVERIES: Final = ("clear local costmap", "clear global costmap", "clear both costmaps", "spin", "wait", "back up")

COLUMNS: Final = (
    *("t_ms", "x_mm", "y_mm", "yaw_mrad"),
    *("estimated_x_mm", "estimated_y_mm", "estimated_yaw_mrad"),
    *("speed_mmps", "yaw_rate_mradps"),
    *("command_speed_mmps", "command_yaw_rate_mradps", "sent_speed_mmps", "sent_yaw_rate_mradps"),
    *("localized", "covariance_xx_mm2", "covariance_xy_mm2", "covariance_yy_mm2", "covariance_yaw_mrad2"),
)

OMNI_COLUMNS: Final = ("lateral_speed_mmps", "command_lateral_speed_mmps", "sent_lateral_speed_mmps")
"""Additional columns of an omni robot's recording: its speeds to the left."""

_REAL: Final = (
    # True pose, true motion of the last tick, true path driven.
    *("true_x", "true_y", "true_yaw", "true_v", "true_w", "true_vy", "distance"),
    # Odometry: pose in the odom frame and twist as the stack has them, limited wheel command of the last step.
    *("odom_x", "odom_y", "odom_yaw", "odom_v", "odom_w", "odom_vy", "wheel_v", "wheel_w", "wheel_vy"),
    # Odometry as the wheels count it, and when within its period it is sampled (steps).
    *("counted_x", "counted_y", "counted_yaw", "odometry_phase"),
    # Command that the controller computes; when the newest scan arrives; pose to which the scanner has swept.
    *("pending_v", "pending_w", "pending_vy", "scan_arrives", "swept_x", "swept_y", "swept_yaw"),
    # Odometry at the last scan and at the last filter update; transform map -> odom; estimate in the map.
    *("scan_odom_x", "scan_odom_y", "scan_odom_yaw", "filter_odom_x", "filter_odom_y", "filter_odom_yaw"),
    *("map_odom_x", "map_odom_y", "map_odom_yaw", "x", "y", "yaw"),
    # Pose of the frame in which the stack plans, see `planning_frame`.
    *("planning_x", "planning_y", "planning_yaw"),
    # Covariance that AMCL published last.
    *("pose_xx", "pose_xy", "pose_yy", "pose_aa"),
    # Commands: of controller or behavior, after the smoother, after the collision monitor.
    *("command_v", "command_w", "command_vy", "smooth_v", "smooth_w", "smooth_vy", "sent_v", "sent_w", "sent_vy"),
    # End of the leg just planned, goal of the path, progress baseline (odom frame), what a behavior has done so far.
    *("end_x", "end_y", "goal_x", "goal_y", "goal_yaw", "base_x", "base_y", "base_yaw"),
    *("done", "last_yaw", "last_x", "last_y"),
    # Yaw rate that the Rotation Shim or the controller in it ordered last; end of the path that the shim had last.
    *("shim_w", "shim_end_x", "shim_end_y", "shim_end_yaw"),
)
_WHOLE: Final = (
    *("tick", "status", "events", "rows", "vertices", "beams"),
    *("initialized", "localized", "first_scan", "particles", "bins", "filter_updates"),
    *("phase_local", "phase_publish", "phase_global", "local_column", "local_row", "has_local", "has_global"),
    *("odometry_step", "scans_taken", "scans_used", "swept", "smoother_step", "pending_step", "busy_step", "cycle_due"),
    *("clear_local", "clear_global", "local_current", "global_current", "overridden", "near", "stopped"),
    *("path_n", "path_i", "path_end"),
    *("changed_row0", "changed_row1", "changed_column0", "changed_column1"),
    *("state", "until", "goal", "loop", "replan_in", "latched", "base_tick", "valid_tick", "command_tick"),
    *("plan_tick", "follow_tick"),
    *("heading_due", "shim_turns", "shim_at_goal", "shim_planned"),
    *("attempts", "round_robin", "tried", "follow_retries", "plan_retries"),
    *("planner_code", "controller_code", "error_code", "recoveries", "missed"),
)
MEMORY: Final = np.dtype(
    [(name, np.float64) for name in _REAL]
    + [(name, np.int64) for name in _WHOLE]
    + [
        ("streams", np.uint64, (SUBSYSTEMS, 1)),
        ("velocities", np.float64, (SUBSTEPS, 3)),
        ("twists", np.float64, (MOST_TWISTS, 3)),
        ("odometry", np.float64, (ODOMETRY_STEPS, 6)),
        ("late_scans", np.float64, (LATE_SCANS, 5)),
        ("late_ranges", np.float64, (LATE_SCANS, MOST_BEAMS)),
        ("ranges", np.float64, (MOST_BEAMS,)),
        ("directions", np.float64, (MOST_BEAMS, 2)),
        ("near_points", np.float64, (2, MOST_BEAMS)),
        ("outline", np.float64, (MOST_VERTICES, 2)),
        ("event_rows", np.float64, (MAX_EVENTS, 6)),
    ],
    align=True,
)
"""Memory of a run in one record: kernels get it as one pointer, which keeps them small and quick to compile.

`velocities` (speed, yaw rate, speed to the left) is the tick's result for physics, `twists` what odometry reported in the last ticks, in a
ring; an event row is t, kind, x, y, what, value; rows of `odometry`, in a ring of physics steps, are x, y, yaw, v, ω and vy as the wheels count;
rows of `late_scans` are when a scan arrives (s), the step of its stamp, and odometry's x, y and yaw there; of `outline` the first `vertices` count, of `ranges` and `directions` the first `beams`.
"""


class Grids(NamedTuple):
    """The map, its tables, and the global costmap: all (H, W), but for stamp, place, and scratch.

    Attributes:
        place: (3,) x and y of the global costmap's lower left corner, and its resolution.
        scratch: That of a window that rolls; (1, 1) without one.
        static, static_costs: Static layer, and the inflation of its lethal cells.
        quiet, lethal: The global obstacle layer after the Denoise layer, and its scratch; (1, 1) without one.
        layer: Global obstacle layer; `costs` the master costmap.
        keepout: The mask of the keepout filter; (0, 0) without one.
        zones: Zones of the speed filter.
    """

    skips: Any
    cubed: Any
    static: Any
    static_costs: Any
    stamp: Any
    layer: Any
    quiet: Any
    lethal: Any
    costs: Any
    keepout: Any
    place: Any
    scratch: Any
    zones: SpeedZones


class Local(NamedTuple):
    """The local costmap, all (R, C) uint8: obstacle layer, inflation kernel, scratch, and result.

    Attributes:
        window: The master costmap, which the controller reads.
        published: Master costmap as last published, which behaviors read.
        keepout: The mask of its keepout filter.
    """

    layer: Any
    stamp: Any
    scratch: Any
    lethal: Any
    window: Window
    published: Window
    keepout: Mask


class Route(NamedTuple):
    """Poses x, y, yaw: goals (G, 3), the path and the one being planned (M, 3).

    Attributes:
        ahead: (A, 3) the part of the path that the controller follows: poses in the odom frame.
    """

    goals: Any
    path: Any
    draft: Any
    ahead: Any
    planner: Bound


@dataclass(frozen=True, eq=False)
class Stack:
    """State of a run that its ticks read and write.

    Poses and positions are in the frame of the map's grid, those of estimate and plans in `planning_frame`; rows are in the map's.

    Attributes:
        p, m: (1,) records of parameters and `MEMORY`.
        controller: The controller in use.
        planner: That of the mission.
        planning: The setting for which the planner was prepared.
        noise: The lidar's.
        robot: The body and actuators that it drives.
        obstacles: (K, 6) as in `vastflow.sim.world.lidar.scan`.
        rows: (R, C) int32 of `columns_of` the robot.
    """

    p: NDArray[np.void]
    m: NDArray[np.void]
    grids: Grids
    local: Local
    cloud: Cloud
    route: Route
    controller: RunningController
    planner: RunningPlanner
    planning: PlannerSetting
    noise: Running[LidarNoise]
    robot: Robot
    obstacles: NDArray[np.float64]
    rows: NDArray[np.int32]


def new_stack(
    prepared: PreparedMap,
    parameters: NavParameters,
    lidar: Lidar,
    robot: Robot,
    start: Pose,
    obstacles: NDArray[np.float64],
    streams: NDArray[np.uint64],
    timeout_s: float,
) -> Stack:
    """Return the stack of an unlocalized robot at rest without a mission, see `set_pose` and `give`."""
    shape, everywhere = prepared.static.shape, parameters.global_costmap
    denoised_shape = shape if everywhere.denoise_layer.enabled else (1, 1)
    memory = np.zeros(1, dtype=MEMORY)
    m = memory[0]
    m["true_x"], m["true_y"], m["true_yaw"] = start.x_m, start.y_m, start.yaw_rad
    m["x"], m["y"], m["yaw"] = start.x_m, start.y_m, start.yaw_rad
    m["first_scan"], m["local_current"], m["global_current"] = 1, 1, 1
    m["state"], m["status"], m["pending_step"] = ENDED, RESTING, -1
    m["has_global"] = everywhere.sized_by_map  # Nav2's costmaps update before anything is planned
    m["streams"], m["ranges"], m["beams"] = streams, np.inf, lidar.beams
    m["directions"][: lidar.beams] = lidar.directions()
    outline = outline_of(parameters.local_costmap)
    m["vertices"] = len(outline)
    m["outline"][: len(outline)] = outline
    local = _local(parameters.local_costmap, prepared.local_stamp, prepared.local_keepout)
    setting = _setting(parameters, local.window, streams[CONTROLLER].copy())
    controller: Controller = with_kernels(parameters.controller)
    in_use = running(controller, setting)
    planner = running_planner(with_kernels(parameters.planner), prepared.planning)
    costmaps = parameters.global_costmap, parameters.local_costmap
    speed_filter = next((each.speed_filter for each in costmaps if each.speed_filter.enabled), SpeedFilter())
    return Stack(
        p=parameter_record(
            parameters, lidar, robot, prepared, controller.plan_cut(setting), int(planner.plug_in.overlaps)
        ),
        m=memory,
        grids=Grids(
            *(prepared.skips, prepared.cubed, prepared.static, prepared.static_costs, prepared.stamp),
            layer=zero_pages(shape, np.uint8),
            quiet=np.zeros(denoised_shape, dtype=np.uint8),
            lethal=np.zeros(denoised_shape, dtype=np.uint8),
            costs=prepared.planning.costs.copy(),
            keepout=prepared.keepout,
            place=np.array([*prepared.planning.origin_xy_m, prepared.planning.resolution_m]),
            scratch=np.zeros(shape if everywhere.rolling_window else (1, 1), dtype=np.uint8),
            zones=speed_zones(prepared.speed_mask, prepared.occupancy, speed_filter, in_use),
        ),
        local=local,
        cloud=new_cloud(parameters.amcl.max_particles, lidar.beams),
        route=_route(shape, (), 0, planner.bound),
        controller=in_use,
        planner=planner,
        planning=prepared.planning,
        noise=running_noise(with_kernels(parameters.lidar_noise), streams[LIDAR].copy(), lidar.beams),
        robot=robot,
        obstacles=obstacles,
        rows=np.zeros((int(timeout_s / (TICK_S * ROW_TICKS)) + 8, len(columns_of(robot))), dtype=np.int32),
    )


def columns_of(robot: Robot) -> tuple[str, ...]:
    return (*COLUMNS, *OMNI_COLUMNS) if robot.drive == "omni" else COLUMNS


def set_pose(stack: Stack, pose: Pose) -> None:
    """Set the robot's initial pose; AMCL and the rest of the stack begin there at the next scan.

    Without a map the pose is nobody's. The stack begins at once, and plans in the frame of odometry, which began where the robot stood.
    """
    m = stack.m[0]
    if stack.p[0]["without_map"]:
        if not m["initialized"]:
            m["planning_x"], m["planning_y"], m["planning_yaw"] = m["x"], m["y"], m["yaw"]
            m["x"], m["y"], m["yaw"] = m["odom_x"], m["odom_y"], m["odom_yaw"]
            m["initialized"], m["first_scan"] = 1, 0
        return
    m["x"], m["y"], m["yaw"] = pose.x_m, pose.y_m, pose.yaw_rad
    m["map_odom_yaw"] = pose.yaw_rad - m["odom_yaw"]
    c, s = cos_sin(float(m["map_odom_yaw"]))
    m["map_odom_x"] = pose.x_m - (c * m["odom_x"] - s * m["odom_y"])
    m["map_odom_y"] = pose.y_m - (s * m["odom_x"] + c * m["odom_y"])
    m["initialized"], m["first_scan"] = 1, 1


def planning_frame(stack: Stack) -> Pose:
    """Return the pose of the frame that estimate, goals, plans, and global costmap are in.

    It is the grid's own, or odometry's without a map.
    """
    return Pose(*(float(stack.m[0][f"planning_{axis}"]) for axis in ("x", "y", "yaw")))


def give(stack: Stack, mission: Mission) -> Stack:
    """Return the stack with another mission, in the frame of the map's grid; it begins after AMCL's first pose."""
    p, m = stack.p[0], stack.m[0]
    p["mission"], p["loops"] = MISSION_KINDS[mission.kind], mission.loops
    m["state"], m["status"], m["error_code"] = STARTING, RUNNING, 0
    m["goal"], m["loop"], m["path_n"] = 0, 0, 0
    legs = len(mission.goals) if mission.kind == "navigate_through_poses" else 1
    planner, (rows, columns) = stack.planner, stack.grids.costs.shape
    if stack.route.goals.size:  # The memory before has seen changes that `changed` no longer tells of.
        m["changed_row0"], m["changed_row1"], m["changed_column0"], m["changed_column1"] = 0, rows, 0, columns
    if stack.route.goals.size or legs != stack.planning.legs:  # else no mission has used the memory yet
        planner = running_planner(planner.plug_in, replace(stack.planning, legs=legs))
    goals = [seen_from(goal, planning_frame(stack)) for goal in mission.goals]
    return replace(stack, planner=planner, route=_route((rows, columns), goals, legs, planner.bound))


def _route(shape: tuple[int, ...], goals: Sequence[Pose], legs: int, planner: Bound) -> Route:
    """Room for the goals and for a path of so many legs on a map of this shape."""
    points = (LEG_LENGTHS * max(shape) + 1) * legs
    poses = np.array([[goal.x_m, goal.y_m, goal.yaw_rad] for goal in goals]).reshape(-1, 3)
    path, draft = zero_pages((points, 3), np.float64), zero_pages((points, 3), np.float64)
    return Route(poses, path, draft, np.zeros((AHEAD_POINTS, 3)), planner)


def _local(q: Costmap, stamp: NDArray[np.uint8], keepout: Mask) -> Local:
    shape = int(q.height / q.resolution), int(q.width / q.resolution)  # whole cells, as in Nav2
    layer, scratch, lethal, costs = (np.zeros(shape, dtype=np.uint8) for _ in range(4))
    # Behaviors that get no costmap take everything for a collision.
    published = np.full(shape, LETHAL if q.publish_frequency <= NEVER_HZ else 0, dtype=np.uint8)
    corner = (0.0, 0.0) if q.rolling_window else (q.origin_x, q.origin_y)
    place = np.array([*corner, q.resolution])
    return Local(layer, stamp, scratch, lethal, Window(costs, place), Window(published, place.copy()), keepout)


def _setting(parameters: NavParameters, window: Window, stream: NDArray[np.uint64]) -> Setting:
    goal, costmap, cost = parameters.goal_checker, parameters.local_costmap, 0.0
    layer, outline = costmap.inflation_layer, outline_of(costmap)
    if layer.enabled:
        cost = cost_at_distance(circumscribed_radius_m(outline), inscribed_radius_m(outline), layer.cost_scaling_factor)
    tolerances = goal.xy_goal_tolerance, goal.yaw_goal_tolerance
    period_s = ticks_of(parameters.controller_server.controller_frequency) * TICK_S
    rows, columns = window.costs.shape
    return Setting(rows, columns, costmap.resolution, *tolerances, stream, period_s, cost)
