"""Snapshots: what a robot sees, knows and does at one tick, copied from its stack while a run goes on."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Final, Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from vastflow.sim.kernels.numeric import njit
from vastflow.sim.model.pose import GridFrame, Pose
from vastflow.sim.model.rates import TICK_S
from vastflow.sim.nav2.controllers.local_plan import local_plan
from vastflow.sim.nav2.controllers.mppi import Mppi
from vastflow.sim.nav2.costmaps.inflation import UNKNOWN
from vastflow.sim.nav2.costmaps.window import Window
from vastflow.sim.nav2.navigator.state import (
    BACKING_UP,
    ENDED,
    FOLLOWING,
    PAUSING,
    RESTING,
    SPINNING,
    STARTING,
    WAITING,
    Stack,
)
from vastflow.sim.world.motion import wrapped
from vastflow.sim.world.robot_model import Robot

Activity: TypeAlias = Literal["starting", "following", "spin", "wait", "back up", "pausing", "resting", "ended"]
_ACTIVITIES: Final[Mapping[int, Activity]] = {
    STARTING: "starting",
    FOLLOWING: "following",
    SPINNING: "spin",
    WAITING: "wait",
    BACKING_UP: "back up",
    PAUSING: "pausing",
    ENDED: "ended",
}

OVERVIEW_CELLS: Final = 400
"""Cells of the whole map's costs along its longer side at the most."""


class Box(NamedTuple):
    """An upright rectangle of the map frame (m)."""

    x0: float
    y0: float
    x1: float
    y1: float


@dataclass(frozen=True, slots=True)
class Moment:
    """The robot at one tick, in numbers.

    Attributes:
        true, estimate: Where it is, and where it takes itself to be.
        speed_mps, yaw_rate_radps: True motion.
        stopped: Whether the collision monitor lets no motion through.
        planned: Whether there is a plan to follow.
        no_command_s: For how long the controller has found no valid command.
        no_progress_s: For how long the progress checker has seen none.
        recoveries: So far.
        goal: Index of the goal it is heading for.
    """

    tick: int
    activity: Activity
    true: Pose
    estimate: Pose
    speed_mps: float
    yaw_rate_radps: float
    stopped: bool
    planned: bool
    no_command_s: float
    no_progress_s: float
    recoveries: int
    goal: int

    @property
    def t_s(self) -> float:
        """Simulated time."""
        return self.tick * TICK_S

    @property
    def yaw_rate_degps(self) -> float:
        """True rate of turning, in degrees."""
        return float(np.degrees(self.yaw_rate_radps))

    @property
    def error_m(self) -> float:
        """Localization error."""
        return float(np.hypot(self.true.x_m - self.estimate.x_m, self.true.y_m - self.estimate.y_m))


@dataclass(frozen=True, eq=False, slots=True)
class Patch:
    """A rectangle of a costmap, somewhere in the map frame.

    Attributes:
        costs: (R, C) uint8 as Nav2 has them: 253 inscribed, 254 lethal, 255 unknown.
        corner: Lower left corner, and how the patch is turned about it.
    """

    costs: NDArray[np.uint8] = field(repr=False)
    corner: Pose
    resolution_m: float


@dataclass(frozen=True, eq=False, slots=True)
class TickSnapshot:
    """What a run holds at one tick. Points are (N, 2) in the map frame: for what the robot senses and plans in its own
    odometry's frame, where it takes that to be.

    Attributes:
        plan_xy_m: What is left of the global plan.
        ahead_xy_m: The part of it that the controller follows.
        intended_xy_m: Where MPPI's commands would lead from here (Nav2's optimal trajectory); of other controllers nothing.
        scan_xy_m: The newest scan.
        particles: (N, 3) x, y, yaw: AMCL's, at its last update.
        robot: The body that drives.
        outline_m: (V, 2) padded footprint in the robot's frame.
        obstacles: (K, 6) or more columns, rows as `vastflow.sim.world.lidar.scan` reads them.
        goals: In the order they are visited.
        global_costs: Global costmap, as much of it as was asked for.
        local_costs: Local costmap; None before its first update.
        overview: The whole global costmap, coarser where it is large: the greatest cost of the cells that make one.
    """

    moment: Moment
    plan_xy_m: NDArray[np.float64] = field(repr=False)
    ahead_xy_m: NDArray[np.float64] = field(repr=False)
    intended_xy_m: NDArray[np.float64] = field(repr=False)
    scan_xy_m: NDArray[np.float64] = field(repr=False)
    particles: NDArray[np.float64] = field(repr=False)
    robot: Robot
    outline_m: NDArray[np.float64] = field(repr=False)
    obstacles: NDArray[np.float64] = field(repr=False)
    goals: tuple[Pose, ...]
    global_costs: Patch
    local_costs: Patch | None
    overview: Patch


def moment_of(stack: Stack, tick: int) -> Moment:
    """The moment after tick `tick`, which the stack has just done."""
    m, frame = stack.m[0], _frame(stack)
    following = m["state"] == FOLLOWING and m["path_n"] > 0
    return Moment(
        tick=tick,
        activity="resting" if m["status"] == RESTING else _ACTIVITIES[int(m["state"])],
        true=frame.pose_to_map(Pose(float(m["true_x"]), float(m["true_y"]), float(m["true_yaw"]))),
        estimate=frame.pose_to_map(Pose(float(m["x"]), float(m["y"]), float(m["yaw"]))),
        speed_mps=float(m["true_v"]),
        yaw_rate_radps=float(m["true_w"]),
        stopped=bool(m["stopped"]),
        planned=bool(m["path_n"] > 0),
        no_command_s=float(tick - m["valid_tick"]) * TICK_S if following else 0.0,
        no_progress_s=float(tick - m["base_tick"]) * TICK_S if following else 0.0,
        recoveries=int(m["recoveries"]),
        goal=int(m["goal"]),
    )


def snapshot_of(stack: Stack, moment: Moment, box: Box) -> TickSnapshot:
    """Everything else of the same moment, copied.

    Args:
        box: The part of the map whose costs are kept.
    """
    m, p, frame = stack.m[0], stack.p[0], _frame(stack)
    odom = Pose(float(m["map_odom_x"]), float(m["map_odom_y"]), float(m["map_odom_yaw"]))
    plan = stack.route.path[int(m["path_i"]) : int(m["path_n"]), :2].copy()
    costs, resolution_m = stack.grids.costs, float(p["resolution"])
    origin = float(p["origin_x"]), float(p["origin_y"])
    particles = stack.cloud.particles[:, : int(m["particles"])].T
    local = _local(stack, odom) if m["has_local"] else None
    return TickSnapshot(
        moment=moment,
        plan_xy_m=frame.points_to_map(plan),
        ahead_xy_m=frame.points_to_map(_ahead(stack) if moment.activity == "following" else plan[:0]),
        intended_xy_m=_intended(stack, moment),
        scan_xy_m=frame.points_to_map(_placed(_scan(stack), odom)),
        particles=np.column_stack([frame.points_to_map(particles[:, :2]), particles[:, 2] + frame.yaw_rad]),
        robot=stack.robot,
        outline_m=m["outline"][: m["vertices"]].copy(),
        obstacles=_obstacles(stack.obstacles, frame),
        goals=tuple(frame.pose_to_map(Pose(*goal)) for goal in stack.route.goals.tolist()),
        global_costs=_in_map(_cut(costs, origin, resolution_m, _box_in_grid(box, frame)), frame),
        local_costs=local and _in_map(local, frame),
        overview=_in_map(_coarse(costs, origin, resolution_m), frame),
    )


def _frame(stack: Stack) -> GridFrame:
    p = stack.p[0]
    return GridFrame((float(p["origin_x"]), float(p["origin_y"])), float(p["grid_yaw"]))


def _in_map(patch: Patch, frame: GridFrame) -> Patch:
    return replace(patch, corner=frame.pose_to_map(patch.corner))


def _box_in_grid(box: Box, frame: GridFrame) -> Box:
    """What of the grid's frame holds a box of the map's."""
    corners = np.array([(x, y) for x in (box.x0, box.x1) for y in (box.y0, box.y1)])
    turned = frame.points_to_grid(corners)
    return Box(*turned.min(axis=0).tolist(), *turned.max(axis=0).tolist())


def _obstacles(rows: NDArray[np.float64], frame: GridFrame) -> NDArray[np.float64]:
    """Rows of obstacles in the map's frame; those that are nowhere stay there."""
    placed = rows.copy()
    there = np.isfinite(rows[:, :2]).all(axis=1)
    placed[there, :2] = frame.points_to_map(rows[there, :2])
    if frame.yaw_rad != 0.0:
        (c, s), cos, sin = frame.turn, rows[there, 2], rows[there, 3]
        placed[there, 2], placed[there, 3] = c * cos - s * sin, s * cos + c * sin
    return placed


def _placed(xy_m: NDArray[np.float64], frame: Pose) -> NDArray[np.float64]:
    """Points (N, 2) of a frame, in the frame that `frame` is a pose of."""
    c, s = np.cos(frame.yaw_rad), np.sin(frame.yaw_rad)
    placed: NDArray[np.float64] = xy_m @ np.array([[c, s], [-s, c]]) + (frame.x_m, frame.y_m)
    return placed


def _scan(stack: Stack) -> NDArray[np.float64]:
    """End points of the newest scan in the odom frame."""
    m, p = stack.m[0], stack.p[0]
    ranges, directions = m["ranges"][: m["beams"]], m["directions"][: m["beams"]]
    returned = (ranges >= p["range_min"]) & (ranges < p["range_max"])
    points = (p["mount_x"], p["mount_y"]) + ranges[returned, None] * directions[returned]
    return _placed(points, Pose(float(m["scan_odom_x"]), float(m["scan_odom_y"]), float(m["scan_odom_yaw"])))


@njit
def _cut_plan(parameters: Any, memory: Any, window: Window, path: Any, out: Any) -> int:
    n, _ = local_plan(parameters[0], memory[0], window, path, out)
    return int(n)


def _ahead(stack: Stack) -> NDArray[np.float64]:
    """What the controller would get of the plan now, in the grid's frame."""
    memory, path = stack.m.copy(), stack.route.path
    n = _cut_plan(stack.p, memory, stack.local.window, path, np.empty_like(stack.route.ahead))
    first = int(memory[0]["path_i"])
    ahead: NDArray[np.float64] = path[first : first + n, :2].copy()
    return ahead


def _intended(stack: Stack, moment: Moment) -> NDArray[np.float64]:
    """(T + 1, 2), from the estimate on: each step goes where the robot heads before it turns, as in MPPI's own rollout."""
    if not isinstance(stack.controller.plug_in, Mppi) or moment.activity != "following" or moment.no_command_s > 0.0:
        return np.empty((0, 2))
    v_mps, w_radps = stack.controller.memory.sequence
    dt_s = float(stack.controller.parameters[0]["model_dt"])
    yaw_rad = moment.estimate.yaw_rad + np.r_[0.0, np.cumsum(w_radps)[:-1]] * dt_s
    steps_m = np.column_stack([np.cos(yaw_rad), np.sin(yaw_rad)]) * v_mps[:, None] * dt_s
    start_m = np.array([[moment.estimate.x_m, moment.estimate.y_m]])
    return np.cumsum(np.concatenate([start_m, steps_m]), axis=0)


def _local(stack: Stack, odom: Pose) -> Patch:
    window = stack.local.window
    x, y, resolution_m = window.place.tolist()
    ((x, y),) = _placed(np.array([[x, y]]), odom).tolist()
    return Patch(window.costs.copy(), Pose(x, y, wrapped(odom.yaw_rad)), resolution_m)


def _cut(costs: NDArray[np.uint8], origin_xy_m: tuple[float, float], resolution_m: float, box: Box) -> Patch:
    """The cells that `box` touches."""
    columns = np.clip(_cells((box.x0, box.x1), origin_xy_m[0], resolution_m), 0, costs.shape[1]).tolist()
    rows = np.clip(_cells((box.y0, box.y1), origin_xy_m[1], resolution_m), 0, costs.shape[0]).tolist()
    corner = Pose(origin_xy_m[0] + columns[0] * resolution_m, origin_xy_m[1] + rows[0] * resolution_m)
    return Patch(costs[slice(*rows), slice(*columns)].copy(), corner, resolution_m)


def _cells(ends_m: tuple[float, float], origin_m: float, resolution_m: float) -> NDArray[np.int64]:
    low, high = ((end - origin_m) / resolution_m for end in ends_m)
    return np.array([np.floor(low), np.ceil(high)], dtype=np.int64)


def _coarse(costs: NDArray[np.uint8], origin_xy_m: tuple[float, float], resolution_m: float) -> Patch:
    k = -(-max(costs.shape) // OVERVIEW_CELLS)
    rows, columns = (-(-n // k) for n in costs.shape)
    framed = np.full((rows * k, columns * k), UNKNOWN, dtype=np.uint8)
    framed[: costs.shape[0], : costs.shape[1]] = costs
    # Unknown is the greatest number, but the least to be seen.
    blocks = (framed + np.uint8(1)).reshape(rows, k, columns, k).max(axis=(1, 3)) - np.uint8(1)
    return Patch(blocks, Pose(*origin_xy_m), k * resolution_m)
