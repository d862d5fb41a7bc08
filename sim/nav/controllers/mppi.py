"""Model Predictive Path Integral control (nav2_mppi_controller, Jazzy)."""

import math
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vastflow.sim.kernels.numeric import addressed, inner
from vastflow.sim.nav.controllers.controller import Controller, ControllerInput, Setting
from vastflow.sim.nav.controllers.lanes import data_of, either, load, lower, splat, store
from vastflow.sim.nav.controllers.mppi_critics import (
    BINS,
    COLLISION,
    SIDE,
    Frame,
    followed_point,
    furthest_point,
    judge_alignment,
    judge_bearing,
    judge_cells,
    judge_following,
    judge_goal,
    judge_goal_angle,
    judge_turns,
    lay_frame,
    lay_plan,
    lay_table,
    mark,
)
from vastflow.sim.nav.controllers.mppi_outlines import judge_outlines
from vastflow.sim.nav.controllers.mppi_samples import (
    ROW,
    STEP,
    Draw,
    Prices,
    Space,
    add_weighted,
    aligned,
    follow,
    next_noise,
    noise,
)
from vastflow.sim.nav.parameters.mppi import MppiParameters
from vastflow.sim.nav.window import Window
from vastflow.sim.world.robot import steered, wrapped

PLAN_POINTS: Final = 1024
UNSMOOTHED: Final = 20
"""A sequence of no more steps than this is left as it is."""
NEGLIGIBLE: Final = 1e-9
"""A group of samples of smaller weights than this times the best one's is left out of the mean: 2e-6 of it in all."""


class MppiMemory(NamedTuple):
    """State and working space of the controller, of steps T.

    Attributes:
        sequence: (2, T) float64, the control sequence: v and ω.
        history: (2, 4) float64, the last commands.
        stream: (1,) uint64.
        next_noise: (1,) int64, where the next cycle's noise may begin.
        noise: (N,) uint32, read-only and shared.
        values: (256,) float32, cost by the costmap's cost.
        lengths, free: (n,) float64 and bool: of the plan's points the length so far, and whether they are free.
        line: (T + 8,) float64, what is smoothed.
        circumscribed_cost: (1,) float64, see `Setting`.
        min_turning_radius_m: (1,) float64 of an Ackermann model; 0 of one that turns on the spot.

    The others are `mppi_samples.Space`.
    """

    sequence: Any
    history: Any
    stream: Any
    next_noise: Any
    noise: Any
    values: Any
    lengths: Any
    free: Any
    line: Any
    circumscribed_cost: Any
    min_turning_radius_m: Any
    center: Any
    turns: Any
    track: Any
    ends: Any
    marks: Any
    cells: Any
    frame: Any
    touched: Any
    costs: Any
    weights: Any
    plan: Any
    table_x: Any
    table_y: Any
    sums: Any


def new_memory(parameters: MppiParameters, stream: NDArray[np.uint64], circumscribed_cost: float = 0.0) -> MppiMemory:
    """Memory of a controller that draws from `stream` (1,).

    Args:
        circumscribed_cost: See `Setting`; every outline is looked at where it is 0.
    """
    steps, groups = parameters.time_steps, math.ceil(parameters.batch_size / ROW)
    is_ackermann = parameters.motion_model == "Ackermann"
    min_turning_radius_m = parameters.AckermannConstraints.min_turning_r if is_ackermann else 0.0
    marks = (steps - 1) // parameters.PathAlignCritic.trajectory_point_step
    cells = (steps - 1) // parameters.CostCritic.trajectory_point_step + 1

    def rows(count: int) -> NDArray[np.float32]:
        return aligned(ROW * count, np.float32)

    return MppiMemory(
        sequence=np.zeros((2, steps)),
        history=np.zeros((2, 4)),
        stream=stream,
        next_noise=np.zeros(1, dtype=np.int64),
        noise=noise(ROW * steps * groups, parameters.vx_std, parameters.wz_std),
        values=np.zeros(256, dtype=np.float32),
        lengths=np.zeros(PLAN_POINTS),
        free=np.zeros(PLAN_POINTS, dtype=np.bool_),
        line=np.zeros(steps + 8),
        circumscribed_cost=np.array([circumscribed_cost]),
        min_turning_radius_m=np.array([min_turning_radius_m]),
        center=aligned(4 * steps, np.float32),
        turns=rows(steps),
        track=rows(2 * steps),
        ends=rows(4 * groups),
        marks=rows(3 * marks * groups),
        cells=aligned(ROW * max(cells, marks), np.uint16),
        frame=np.zeros(SIDE * SIDE, dtype=np.float32),
        touched=rows(groups),
        costs=rows(groups),
        weights=rows(groups),
        plan=aligned(2 * PLAN_POINTS, np.float32),
        table_x=aligned(BINS * PLAN_POINTS, np.float32),
        table_y=aligned(BINS * PLAN_POINTS, np.float32),
        sums=rows(2 * steps),
    )


@addressed
def reset(memory: MppiMemory) -> None:
    """Forget the sequence and the commands, as at the end of a FollowPath action."""
    for axis in range(2):
        for t in range(memory.sequence.shape[1]):
            memory.sequence[axis, t] = 0.0
        for i in range(4):
            memory.history[axis, i] = 0.0


@addressed
def compute_velocity(q: Any, memory: MppiMemory, given: ControllerInput) -> Any:
    """Command (valid, v, ω) from the mean of the samples; not valid when all of them collide.

    As Nav2 releases it, MPPI tries again then and never takes back the flag that stops the critics, so no further try can
    be valid. With `retry_scores` one is.
    """
    window, pose, twist, plan, goal = given.window, given.pose, given.twist, given.plan, given.goal
    n = plan.shape[0]
    sequence, history, free, lengths = memory.sequence, memory.history, memory.free, memory.lengths
    space = Space(
        data_of(memory.noise),
        data_of(memory.center),
        data_of(memory.turns),
        data_of(memory.track),
        data_of(memory.ends),
        data_of(memory.marks),
        data_of(memory.cells),
        data_of(memory.frame),
        data_of(memory.touched),
        data_of(memory.costs),
        data_of(memory.weights),
        data_of(memory.plan),
        data_of(memory.table_x),
        data_of(memory.table_y),
        data_of(memory.sums),
    )
    goal_m = math.hypot(goal[0] - pose[0], goal[1] - pose[1])
    near_goal = goal_m < q.CostCritic.near_goal_distance
    frame = lay_frame(q.CostCritic, space.frame, data_of(memory.values), window, pose, near_goal)
    used = sequence.shape[1] * memory.costs.shape[0]
    rise, fall, turn = q.model_dt * q.ax_max, -q.model_dt * q.ax_min, q.model_dt * q.az_max
    radius_m = memory.min_turning_radius_m[0]
    for _ in range(1 + (q.retry_attempt_limit if q.retry_scores != 0 else 0)):
        noise_at = next_noise(memory.stream, memory.next_noise, memory.noise.shape[0], used)
        draw = Draw(noise_at, twist[0], twist[1], rise, fall, turn)
        if _sample(q, space, sequence, frame, draw, given, memory.circumscribed_cost[0], radius_m, goal_m):
            _judge_plan(q, space, sequence.shape[1], frame, window, pose, plan, n, goal_m, free, lengths)
            _weigh(space, q.batch_size, q.temperature)
            _average(space, sequence, q.batch_size, draw)
            _limit(q, sequence)
            if radius_m > 0.0:
                _steer(sequence, radius_m)
            shift = 1 if abs(q.model_dt - given.dt_s) < 1e-6 else 0
            _smooth(sequence, history, memory.line, shift)
            v_mps, w_radps = sequence[0, shift], sequence[1, shift]
            if shift == 1:
                for t in range(1, sequence.shape[1]):
                    sequence[0, t - 1], sequence[1, t - 1] = sequence[0, t], sequence[1, t]
            return True, v_mps, w_radps
        reset(memory)
    return False, 0.0, 0.0


@inner
def _sample(
    q: Any,
    space: Space,
    sequence: Any,
    frame: Frame,
    draw: Draw,
    given: ControllerInput,
    circumscribed_cost: float,
    min_turning_radius_m: float,
    goal_m: float,
) -> bool:
    """Draw and follow all samples, and judge them by everything but the plan: False when every one collides."""
    pose, twist, goal = given.pose, given.twist, given.goal
    steps, dt_s = sequence.shape[1], q.model_dt
    _center(q, space, sequence)
    x_m, y_m = (
        pose[0] + twist[0] * math.cos(pose[2]) * dt_s,
        pose[1] + twist[0] * math.sin(pose[2]) * dt_s,
    )
    yaw_rad = pose[2] + twist[1] * dt_s
    start = (
        (x_m - frame.left_m) / frame.resolution_m,
        (y_m - frame.bottom_m) / frame.resolution_m,
        math.cos(yaw_rad),
        math.sin(yaw_rad),
    )
    scale = dt_s / frame.resolution_m
    lowest = math.copysign(math.hypot(q.vx_min, q.vy_max), q.vx_min)
    beyond = q.ConstraintCritic.cost_weight * dt_s if q.ConstraintCritic.enabled != 0 else 0.0
    forward = q.PreferForwardCritic.enabled != 0 and goal_m >= q.PreferForwardCritic.threshold_to_consider
    backwards = q.PreferForwardCritic.cost_weight * dt_s if forward else 0.0
    prices = Prices(lowest, math.hypot(q.vx_max, q.vy_max), beyond, backwards)
    priced, cell_stride = q.CostCritic.enabled != 0, q.CostCritic.trajectory_point_step
    outlined, motion, near = q.CostCritic.consider_footprint != 0, (yaw_rad, dt_s), circumscribed_cost
    cells = (steps - 1) // cell_stride + 1
    cell_weight = q.CostCritic.cost_weight / 254.0 / cells
    crash = cell_weight * q.CostCritic.collision_cost
    at_goal = q.GoalCritic.enabled != 0 and goal_m < q.GoalCritic.threshold_to_consider
    goal_cell = (goal[0] - frame.left_m) / frame.resolution_m, (goal[1] - frame.bottom_m) / frame.resolution_m
    goal_weight = q.GoalCritic.cost_weight * frame.resolution_m / steps
    turning = q.GoalAngleCritic.enabled != 0 and goal_m < q.GoalAngleCritic.threshold_to_consider
    off_rad, turn_weight = wrapped(yaw_rad - given.plan_end_yaw_rad), q.GoalAngleCritic.cost_weight / steps
    aligned = q.PathAlignCritic.enabled != 0 and goal_m >= q.PathAlignCritic.threshold_to_consider
    mark_stride = q.PathAlignCritic.trajectory_point_step
    marks = (steps - 1) // mark_stride
    for first in range(0, q.batch_size, ROW):
        follow(space, first, steps, draw, start, scale, dt_s, prices)
        if min_turning_radius_m > 0.0:
            judge_turns(space, first, steps, scale, min_turning_radius_m, beyond)
        if priced:
            judge_cells(space, first, cells, cell_stride, frame, cell_weight, crash)
            if outlined:
                judge_outlines(space, first, cells, cell_stride, frame, given, motion, near, cell_weight, crash)
        if at_goal:
            judge_goal(space, first, steps, goal_cell, goal_weight)
        if turning:
            judge_goal_angle(space, first, steps, dt_s, off_rad, turn_weight)
        if aligned:
            mark(space, first, marks, mark_stride)
    if priced:
        for sample in range(q.batch_size):
            if space.touched[sample] < COLLISION:
                return True
        return False
    return True


@inner
def _judge_plan(
    q: Any,
    space: Space,
    steps: int,
    frame: Frame,
    window: Window,
    pose: Any,
    plan: Any,
    n: int,
    goal_m: float,
    free: Any,
    lengths: Any,
) -> None:
    """Judge the samples by the local plan."""
    aligned = q.PathAlignCritic.enabled != 0 and goal_m >= q.PathAlignCritic.threshold_to_consider
    followed = q.PathFollowCritic.enabled != 0 and goal_m >= q.PathFollowCritic.threshold_to_consider and n > 1
    faced = q.PathAngleCritic.enabled != 0 and goal_m >= q.PathAngleCritic.threshold_to_consider
    if not (aligned or followed or faced):
        return
    lay_plan(space.plan, free, window, frame, plan, n)
    furthest = furthest_point(space, q.batch_size, n)
    scale = lay_table(q.PathAlignCritic, space, free, lengths, furthest) if aligned else 0.0
    point = followed_point(q.PathFollowCritic, free, furthest, n)
    ahead = min(furthest + q.PathAngleCritic.offset_from_furthest, n - 1)
    mode = q.PathAngleCritic.mode
    if faced:
        bearing = abs(wrapped(math.atan2(plan[ahead, 1] - pose[1], plan[ahead, 0] - pose[0]) - pose[2]))
        if mode == 1:
            bearing = min(bearing, math.pi - bearing)
        faced = bearing >= q.PathAngleCritic.max_angle_to_furthest
    marks = (steps - 1) // q.PathAlignCritic.trajectory_point_step
    align_weight = q.PathAlignCritic.cost_weight * frame.resolution_m
    follow_weight = q.PathFollowCritic.cost_weight * frame.resolution_m
    angle_weight = q.PathAngleCritic.cost_weight
    for first in range(0, q.batch_size, ROW):
        if scale > 0.0:
            judge_alignment(space, first, marks, furthest, scale, align_weight)
        if followed:
            judge_following(space, first, point, follow_weight)
        if faced:
            judge_bearing(space, first, ahead, mode, angle_weight)


@inner
def _center(q: Any, space: Space, sequence: Any) -> None:
    """Write the sequence and the gains of γ."""
    gain_v, gain_w = q.gamma / (q.vx_std * q.vx_std), q.gamma / (q.wz_std * q.wz_std)
    center = space.center
    for t in range(sequence.shape[1]):
        v, w = sequence[0, t], sequence[1, t]
        center[4 * t], center[4 * t + 1] = v, w
        center[4 * t + 2], center[4 * t + 3] = gain_v * v, gain_w * w


@inner
def _weigh(space: Space, samples: int, temperature: float) -> None:
    """Weights exp(-(S - min S) / temperature) of the samples; those that only fill the last group get none."""
    costs, weights = space.costs, space.weights
    least = costs[0]
    for sample in range(samples):
        least = min(least, costs[sample])
    # exp(-z) is the 64th power of exp(-z / 64), Taylor's polynomial; past 40 nothing is left of it.
    best, scale, most = splat(least), splat(1.0 / (64.0 * temperature)), splat(40.0 / 64.0)
    one, none = splat(1.0), splat(0.0)
    for k in range(0, samples, ROW):
        z = (load(costs, k) - best) * scale
        x = lower(z, most)
        e = one - x * splat(1.0 / 6.0)
        e = one - x * splat(1.0 / 5.0) * e
        e = one - x * splat(1.0 / 4.0) * e
        e = one - x * splat(1.0 / 3.0) * e
        e = one - x * splat(1.0 / 2.0) * e
        e = one - x * e
        for _ in range(6):
            e = e * e
        store(weights, k, either(z, most, e, none))
    for sample in range(samples, (samples + ROW - 1) // ROW * ROW):
        weights[sample] = 0.0


@inner
def _average(space: Space, sequence: Any, samples: int, draw: Draw) -> None:
    """The sequence becomes the weighted mean of the samples, which are drawn again: they would not fit in the cache."""
    weights, sums = space.weights, space.sums
    steps = sequence.shape[1]
    for k in range(steps * STEP):
        sums[k] = 0.0
    total = 0.0
    waiting = -1
    for first in range(0, samples, ROW):
        share = 0.0
        for sample in range(first, first + ROW):
            share += weights[sample]
        if share < NEGLIGIBLE:
            continue
        total += share
        if waiting < 0:
            waiting = first
        else:
            add_weighted(space, waiting, load(weights, waiting), first, load(weights, first), steps, draw)
            waiting = -1
    if waiting >= 0:
        add_weighted(space, waiting, load(weights, waiting), waiting, splat(0.0), steps, draw)
    for t in range(steps):
        for axis in range(2):
            mean = 0.0
            for k in range(t * STEP + axis * ROW, t * STEP + (axis + 1) * ROW):
                mean += sums[k]
            sequence[axis, t] = mean / total


@inner
def _limit(q: Any, sequence: Any) -> None:
    """Limit the speeds of the sequence, and their changes from step to step."""
    rise, fall, turn = q.model_dt * q.ax_max, -q.model_dt * q.ax_min, q.model_dt * q.az_max
    last_v, last_w = 0.0, 0.0
    for t in range(sequence.shape[1]):
        v = min(max(sequence[0, t], q.vx_min), q.vx_max)
        w = min(max(sequence[1, t], -q.wz_max), q.wz_max)
        if t > 0:
            slower, faster = (fall, rise) if last_v > 0.0 else (rise, fall)
            v = min(max(v, last_v - slower), last_v + faster)
            w = min(max(w, last_w - turn), last_w + turn)
        sequence[0, t], sequence[1, t] = v, w
        last_v, last_w = v, w


@inner
def _steer(sequence: Any, min_turning_radius_m: float) -> None:
    """AckermannMotionModel: no step of the sequence turns tighter than the least radius."""
    for t in range(sequence.shape[1]):
        sequence[1, t] = steered(sequence[0, t], sequence[1, t], min_turning_radius_m)


@inner
def _smooth(sequence: Any, history: Any, line: Any, shift: int) -> None:
    """Savitzky-Golay (9 points, quadratic) over all steps but the last, and the command that comes of it into `history`.

    On their left stand the last four commands, on their right the last step as often as needed.
    """
    count = sequence.shape[1] - 1
    if count < UNSMOOTHED:
        return
    for axis in range(2):
        for i in range(4):
            line[i] = history[axis, i]
        for t in range(count + 4):
            line[t + 4] = sequence[axis, min(t, count)]
        for t in range(count):
            total = 59.0 * line[t + 4] + 54.0 * (line[t + 3] + line[t + 5]) + 39.0 * (line[t + 2] + line[t + 6])
            total += 14.0 * (line[t + 1] + line[t + 7]) - 21.0 * (line[t] + line[t + 8])
            sequence[axis, t] = total / 231.0
        for i in range(3):
            history[axis, i] = history[axis, i + 1]
        history[axis, 3] = sequence[axis, shift]


@addressed
def set_plan(memory: MppiMemory) -> None:
    """A new path changes nothing: the sequence goes on."""


class Mppi(MppiParameters, Controller):
    """The MPPI controller. With the controller server's period for `model_dt` the sequence is shifted between commands."""

    compute_velocity = compute_velocity
    reset = reset
    set_plan = set_plan

    def memory(self, setting: Setting) -> MppiMemory:
        """See `new_memory`."""
        return new_memory(self, setting.stream, setting.circumscribed_cost)

    @property
    def plan_ahead_m(self) -> float:
        """`prune_distance`."""
        return self.prune_distance
