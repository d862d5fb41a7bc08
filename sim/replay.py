"""Replays: a recorded run executed again and observed, with snapshots of the robot copied from its stack."""

import itertools
import math
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final, Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from vastflow.sim.model.digest import digest
from vastflow.sim.model.pose import GridFrame, Pose, placed, placed_points, seen_from
from vastflow.sim.model.rates import TICK_S
from vastflow.sim.model.recording import Recording, run_row
from vastflow.sim.model.scenario import Scenario
from vastflow.sim.nav2.controllers.local_plan import cut_plan
from vastflow.sim.nav2.controllers.mppi import Mppi
from vastflow.sim.nav2.costmaps.inflation import INSCRIBED, LETHAL, UNKNOWN
from vastflow.sim.nav2.navigator import state
from vastflow.sim.nav2.navigator.state import Stack, planning_frame
from vastflow.sim.run import run
from vastflow.sim.world.motion import wrapped
from vastflow.sim.world.obstacle_rows import outline_of
from vastflow.sim.world.robot_model import Robot

Activity: TypeAlias = Literal["starting", "following", "spin", "wait", "back up", "pausing", "resting", "ended"]
_ACTIVITIES: Final[Mapping[int, Activity]] = {
    state.STARTING: "starting",
    state.FOLLOWING: "following",
    state.SPINNING: "spin",
    state.WAITING: "wait",
    state.BACKING_UP: "back up",
    state.PAUSING: "pausing",
    state.ENDED: "ended",
}

OVERVIEW_CELLS: Final = 400
"""Greatest number of cells along a side of the overview."""


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
        true, estimate: Its true and its estimated pose.
        speed_mps, yaw_rate_radps: True motion.
        stopped: True while the collision monitor stops it.
        planned: True if there is a plan to follow.
        no_command_s: Time since the controller's last valid command.
        no_progress_s: Time since the progress checker's last progress.
        recoveries: Number so far.
        goal: Index of its goal.
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
        return self.tick * TICK_S

    @property
    def yaw_rate_degps(self) -> float:
        return float(np.degrees(self.yaw_rate_radps))

    @property
    def error_m(self) -> float:
        return float(np.hypot(self.true.x_m - self.estimate.x_m, self.true.y_m - self.estimate.y_m))


State: TypeAlias = Stack
"""State of a system after a tick, as the watch of a run gets it; `moment_of` and `snapshot_of` read it."""


@dataclass(frozen=True, eq=False, slots=True)
class Patch:
    """A rectangle of a costmap, somewhere in the map frame.

    Attributes:
        costs: (R, C) uint8 of Nav2: 253 inscribed, 254 lethal, 255 unknown.
        corner: Pose of the lower left corner.
    """

    costs: NDArray[np.uint8] = field(repr=False)
    corner: Pose
    resolution_m: float

    @property
    def lethal(self) -> NDArray[np.bool_]:
        """Cells of obstacles."""
        return np.asarray(self.costs == LETHAL)

    @property
    def inscribed(self) -> NDArray[np.bool_]:
        """Cells where the robot's center would have it in an obstacle."""
        return np.asarray(self.costs == INSCRIBED)

    @property
    def unknown(self) -> NDArray[np.bool_]:
        return np.asarray(self.costs == UNKNOWN)


@dataclass(frozen=True, eq=False, slots=True)
class TickSnapshot:
    """State of a run at one tick; points are (N, 2) in the map frame.

    Attributes:
        plan_xy_m: Remaining global plan.
        ahead_xy_m: The part of it that the controller follows.
        intended_xy_m: MPPI's optimal trajectory; empty for other controllers.
        scan_xy_m: The newest scan.
        particles: (N, 3) x, y, yaw of AMCL's last update.
        outline_m: (V, 2) padded footprint in the robot's frame.
        obstacles: Outlines (N, 2) of the obstacles that are there.
        goals: Goals in order.
        global_costs: Requested part of the global costmap.
        local_costs: Local costmap; None before its first update.
        overview: The whole global costmap; a cell of a large one has the greatest cost of several.
    """

    moment: Moment
    plan_xy_m: NDArray[np.float64] = field(repr=False)
    ahead_xy_m: NDArray[np.float64] = field(repr=False)
    intended_xy_m: NDArray[np.float64] = field(repr=False)
    scan_xy_m: NDArray[np.float64] = field(repr=False)
    particles: NDArray[np.float64] = field(repr=False)
    robot: Robot
    outline_m: NDArray[np.float64] = field(repr=False)
    obstacles: Sequence[NDArray[np.float64]] = field(repr=False)
    goals: tuple[Pose, ...]
    global_costs: Patch
    local_costs: Patch | None
    overview: Patch


def moment_of(stack: Stack, tick: int) -> Moment:
    """Return the moment after tick `tick`, the stack's last."""
    m, frame = stack.m[0], _frame(stack)
    known = placed(Pose(float(m["x"]), float(m["y"]), float(m["yaw"])), planning_frame(stack))
    following = m["state"] == state.FOLLOWING and m["path_n"] > 0
    return Moment(
        tick=tick,
        activity="resting" if m["status"] == state.RESTING else _ACTIVITIES[int(m["state"])],
        true=frame.pose_to_map(Pose(float(m["true_x"]), float(m["true_y"]), float(m["true_yaw"]))),
        estimate=frame.pose_to_map(known),
        speed_mps=float(m["true_v"]),
        yaw_rate_radps=float(m["true_w"]),
        stopped=bool(m["stopped"]),
        planned=bool(m["path_n"] > 0),
        no_command_s=float(tick - m["valid_tick"]) * TICK_S if following else 0.0,
        no_progress_s=float(tick - m["base_tick"]) * TICK_S if following else 0.0,
        recoveries=int(m["recoveries"]),
        goal=int(m["goal"]),
    )


def snapshot_of(stack: Stack, moment: Moment, box: Box, overview: bool = True) -> TickSnapshot:
    """Copy the state at a moment, and the costs in a part of the map.

    Args:
        overview: False for an empty one, which takes no time.
    """
    m, frame, planning = stack.m[0], _frame(stack), planning_frame(stack)
    odom = _odom(stack)
    plan = stack.route.path[int(m["path_i"]) : int(m["path_n"]), :2].copy()
    x_m, y_m, resolution_m = stack.grids.place.tolist()
    place = x_m, y_m, resolution_m
    particles = stack.cloud.particles[:, : int(m["particles"])].T
    costs = stack.grids.costs
    corners = frame.points_to_grid(np.array([(x, y) for x in (box.x0, box.x1) for y in (box.y0, box.y1)]))
    corners = placed_points(corners, seen_from(Pose(0.0, 0.0), planning))
    local = None
    if m["has_local"]:
        x, y, resolution_m = stack.local.window.place.tolist()
        ((x, y),) = placed_points(np.array([[x, y]]), odom).tolist()
        corner = frame.pose_to_map(Pose(x, y, wrapped(odom.yaw_rad)))
        local = Patch(stack.local.window.costs.copy(), corner, resolution_m)
    return TickSnapshot(
        moment=moment,
        plan_xy_m=frame.points_to_map(placed_points(plan, planning)),
        ahead_xy_m=frame.points_to_map(
            placed_points(_ahead(stack) if moment.activity == "following" else plan[:0], planning)
        ),
        intended_xy_m=_intended(stack, moment),
        scan_xy_m=frame.points_to_map(placed_points(_scan(stack), odom)),
        particles=np.column_stack([frame.points_to_map(particles[:, :2]), particles[:, 2] + frame.yaw_rad]),
        robot=stack.robot,
        outline_m=m["outline"][: m["vertices"]].copy(),
        obstacles=[frame.points_to_map(outline_of(row)) for row in stack.obstacles if math.isfinite(row[0])],
        goals=tuple(frame.pose_to_map(placed(Pose(*goal), planning)) for goal in stack.route.goals.tolist()),
        global_costs=_in_map(
            _cut(costs, place, Box(*corners.min(axis=0).tolist(), *corners.max(axis=0).tolist())), planning, frame
        ),
        local_costs=local,
        overview=_in_map(_coarse(costs if overview else costs[:0, :0], place), planning, frame),
    )


@dataclass(frozen=True, eq=False, slots=True)
class Published:
    """Odometry and scan that the stack has after a tick.

    Attributes:
        odometry: Pose of the robot in the frame `odom`, which is already that of the next tick's time, as its motion is.
        map_odom: Pose of that frame in the map frame.
        speed_mps, lateral_mps, yaw_rate_radps: Motion as odometry reports it.
        scan: Number of the newest scan, from 1; 0 before the first.
        scan_t_s: Its stamp.
        ranges_m: (B,) its readings, a view that the next tick changes; infinite without a return.
        updates: Number of AMCL's updates so far.
    """

    odometry: Pose
    map_odom: Pose
    speed_mps: float
    lateral_mps: float
    yaw_rate_radps: float
    scan: int
    scan_t_s: float
    ranges_m: NDArray[np.float64] = field(repr=False)
    updates: int


def published_by(stack: Stack, tick: int) -> Published:
    """Return the odometry and the scan after tick `tick`, the stack's last."""
    m, p = stack.m[0], stack.p[0]
    scan = int(m["scans_used"]) if p["late"] else tick // int(p["scan_ticks"]) + 1
    began_s = m["late_scans"][(scan - 1) % state.LATE_SCANS][1] * TICK_S / state.SUBSTEPS
    odom = _odom(stack)
    return Published(
        odometry=Pose(float(m["odom_x"]), float(m["odom_y"]), wrapped(float(m["odom_yaw"]))),
        map_odom=_frame(stack).pose_to_map(replace(odom, yaw_rad=wrapped(odom.yaw_rad))),
        speed_mps=float(m["odom_v"]),
        lateral_mps=float(m["odom_vy"]),
        yaw_rate_radps=float(m["odom_w"]),
        scan=scan,
        scan_t_s=float(began_s) if p["late"] else tick // int(p["scan_ticks"]) * int(p["scan_ticks"]) * TICK_S,
        ranges_m=m["ranges"][: m["beams"]],
        updates=int(m["filter_updates"]),
    )


def _frame(stack: Stack) -> GridFrame:
    p = stack.p[0]
    return GridFrame((float(p["origin_x"]), float(p["origin_y"])), float(p["grid_yaw"]))


def _odom(stack: Stack) -> Pose:
    """Return the pose of the frame `odom` in the grid's frame."""
    m = stack.m[0]
    # Before the first pose is set the filter places nothing; odometry then still starts where the robot does.
    place = ("map_odom_x", "map_odom_y", "map_odom_yaw") if m["initialized"] else ("x", "y", "yaw")
    return placed(Pose(*(float(m[name]) for name in place)), planning_frame(stack))


def _in_map(patch: Patch, planning: Pose, frame: GridFrame) -> Patch:
    return replace(patch, corner=frame.pose_to_map(placed(patch.corner, planning)))


def _scan(stack: Stack) -> NDArray[np.float64]:
    m, p = stack.m[0], stack.p[0]
    ranges, directions = m["ranges"][: m["beams"]], m["directions"][: m["beams"]]
    returned = (ranges >= p["range_min"]) & (ranges < p["range_max"])
    points = (p["mount_x"], p["mount_y"]) + ranges[returned, None] * directions[returned]
    return placed_points(points, Pose(float(m["scan_odom_x"]), float(m["scan_odom_y"]), float(m["scan_odom_yaw"])))


def _ahead(stack: Stack) -> NDArray[np.float64]:
    """Return the part of the plan that the controller would get now, in the grid's frame."""
    memory, path = stack.m.copy(), stack.route.path
    n = cut_plan(stack.p, memory, stack.local.window, path, np.empty_like(stack.route.ahead))
    first = int(memory[0]["path_i"])
    ahead: NDArray[np.float64] = path[first : first + n, :2].copy()
    return ahead


def _intended(stack: Stack, moment: Moment) -> NDArray[np.float64]:
    """Return (T + 1, 2) points from the estimate on, by the steps of MPPI's own rollout."""
    if not isinstance(stack.controller.plug_in, Mppi) or moment.activity != "following" or moment.no_command_s > 0.0:
        return np.empty((0, 2))
    v_mps, w_radps = stack.controller.memory.sequence
    dt_s = float(stack.controller.parameters[0]["model_dt"])
    yaw_rad = moment.estimate.yaw_rad + np.r_[0.0, np.cumsum(w_radps)[:-1]] * dt_s
    steps_m = np.column_stack([np.cos(yaw_rad), np.sin(yaw_rad)]) * v_mps[:, None] * dt_s
    start_m = np.array([[moment.estimate.x_m, moment.estimate.y_m]])
    return np.cumsum(np.concatenate([start_m, steps_m]), axis=0)


def _cut(costs: NDArray[np.uint8], place: tuple[float, float, float], box: Box) -> Patch:
    """Return the cells that `box` touches, of costs at a place (x, y, resolution in m)."""
    x_m, y_m, resolution_m = place
    low = np.floor((np.array([box.y0, box.x0]) - (y_m, x_m)) / resolution_m).astype(np.int64)
    high = np.ceil((np.array([box.y1, box.x1]) - (y_m, x_m)) / resolution_m).astype(np.int64)
    (row, column), (rows, columns) = (np.clip(ends, 0, costs.shape).tolist() for ends in (low, high))
    corner = Pose(x_m + column * resolution_m, y_m + row * resolution_m)
    return Patch(costs[row:rows, column:columns].copy(), corner, resolution_m)


def _coarse(costs: NDArray[np.uint8], place: tuple[float, float, float]) -> Patch:
    k = max(1, -(-max(costs.shape) // OVERVIEW_CELLS))
    rows, columns = (-(-n // k) for n in costs.shape)
    framed = np.full((rows * k, columns * k), UNKNOWN, dtype=np.uint8)
    framed[: costs.shape[0], : costs.shape[1]] = costs
    # Unknown is the greatest number, but ranks lowest.
    blocks = (framed + np.uint8(1)).reshape(rows, k, columns, k).max(axis=(1, 3)) - np.uint8(1)
    return Patch(blocks, Pose(*place[:2]), k * place[2])


@dataclass(frozen=True, eq=False, slots=True)
class Replay:
    """A run, executed again.

    Attributes:
        moments: One of each tick.
        snapshots: Snapshots of the requested ticks up to the run's end.
    """

    recording: Recording
    moments: Sequence[Moment] = field(repr=False)
    snapshots: Sequence[TickSnapshot] = field(repr=False)


@dataclass(frozen=True, slots=True)
class Difference:
    """First difference of two recordings of a run.

    Attributes:
        what: Name of the column, or of a value of the run's row.
        row, t_s: Row of the columns and its time; None for a value of the run's row.
        recorded, executed: Values; None where there is none.
    """

    what: str
    row: int | None
    t_s: float | None
    recorded: Any
    executed: Any

    def __str__(self) -> str:
        time = "" if self.t_s is None else f" ({self.t_s:.2f} s)"
        where = f"{self.what} of the run" if self.row is None else f"row {self.row}{time}, {self.what}"
        recorded, executed = (
            "nothing" if value is None else textwrap.shorten(str(value), 100, placeholder=" …")
            for value in (self.recorded, self.executed)
        )
        return f"{where}: recorded {recorded}, executed {executed}"


def replay(scenario: Scenario, run_index: int, seed: int, looks: Mapping[int, Box]) -> Replay:
    """Execute a run as `vastflow.sim.run.run` does, byte for byte, and observe it.

    Args:
        seed: The campaign's `execution.seed`.
        looks: Tick to the part of the map whose costs its snapshot has.
    """
    moments: list[Moment] = []
    snapshots: list[TickSnapshot] = []

    def watch(stack: Stack, tick: int) -> None:
        moments.append(moment_of(stack, tick))
        if tick in looks:
            snapshots.append(snapshot_of(stack, moments[-1], looks[tick]))

    recording = run(scenario, run_index, seed, watch=watch, watch_ticks=range(round(scenario.timeout_s / TICK_S)))
    return Replay(recording, moments, snapshots)


def first_difference(recorded: Recording, executed: Recording) -> Difference | None:
    """Return the first different column of the earliest row, else value of the run's row; None if equal."""
    if recorded.digest == executed.digest:
        return None
    names = dict.fromkeys([*recorded.columns, *executed.columns])
    if found := [d for name in names if (d := _column_difference(name, recorded, executed))]:
        return min(found, key=lambda d: d.row or 0)
    ours, theirs = run_row(executed.run), run_row(recorded.run)
    for key in ours:
        if digest(ours[key]) != digest(theirs[key]):
            return Difference(key, None, None, theirs[key], ours[key])
    changes = (zip(*(column.tolist() for column in r.behaviors.values()), strict=True) for r in (recorded, executed))
    for pair in itertools.zip_longest(*changes):
        if pair[0] != pair[1]:
            return Difference("behaviors", None, None, *pair)
    return Difference("behaviors", None, None, tuple(recorded.behaviors), tuple(executed.behaviors))


def _column_difference(name: str, recorded: Recording, executed: Recording) -> Difference | None:
    a, b = (np.asarray(r.columns.get(name, np.empty(0)), dtype=np.int64) for r in (recorded, executed))
    common = min(len(a), len(b))
    unequal = np.flatnonzero(a[:common] != b[:common])
    if not unequal.size and len(a) == len(b):
        return None
    row = int(unequal[0]) if unequal.size else common
    longer = recorded if len(a) > row else executed
    t_s = float(longer.columns["t_ms"][row]) * 1e-3 if "t_ms" in longer.columns else None
    return Difference(name, row, t_s, *(int(c[row]) if row < len(c) else None for c in (a, b)))
