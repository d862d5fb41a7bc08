"""MPPI's samples: control sequences drawn round the current one, limited, and followed from where the robot is.

Positions are in cells of the cost frame, so that the cell of a position is its whole part. Working space is in rows of
sixteen numbers, one for each sample of a group; a group has so and so many rows for a step. See `Space`.
"""

import functools
import math
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vastflow.sim.kernels.lanes import (
    WIDTH,
    either,
    higher,
    load,
    load_lower,
    load_upper,
    lower,
    root,
    size,
    splat,
    store,
)
from vastflow.sim.kernels.numeric import inner
from vastflow.sim.kernels.streams import integer_below
from vastflow.sim.model.elementary import normals
from vastflow.sim.model.polygon import MOST_VERTICES
from vastflow.sim.nav2.parameters.mppi import MppiParameters

ROW: Final = WIDTH
"""Samples in a group."""
STEP: Final = 2 * ROW
"""A row of the one kind (v, x), and one of the other (ω, y)."""
LINE_BYTES: Final = 64
NOISE_SEED: Final = 20_241
CYCLES_OF_NOISE: Final = 8
GAP_ROWS: Final = 1024


PLAN_POINTS: Final = 1024
SIDE: Final = 256
"""Cells along a side of the cost frame at most: a cell's number has 16 bits."""
BINS: Final = 8
"""Entries of the table of the plan for each of its points."""


class Space(NamedTuple):
    """Working space, or its addresses; all float32 unless noted. G groups, T steps, a row sixteen numbers."""

    noise: Any  # uint32, normal numbers for v and ω, see `noise`.
    center: Any  # T times v and ω of the sequence, and what 1 m/s and 1 rad/s cost by γ.
    turns: Any  # turns, track: T times a row of ω, T times one of x and one of y: of the samples at hand.
    track: Any
    ends: Any  # G times a row of x, y, cosine and sine of the heading.
    marks: Any  # G times P times a row of x, y and length, for the P points of PathAlignCritic.
    cells: Any  # uint16: numbers of cells, or of entries of the table, for the samples at hand.
    values: Any  # (256,) cost by the costmap's cost.
    frame: Any  # Cost of a cell.
    # uint8, by the number of a frame's cell: 0 where no outline that has its center there is looked at, 2 where the
    # cell is lethal, else 1. This and the next are empty where none is looked at.
    near: Any
    # int32, by the number of a frame's cell: lethal cells in its row and below, in its column and left of it.
    lethal: Any
    vertices: Any  # float64, x and y of the outline's vertices in the robot's frame (m).
    yaws: Any  # P times a row: headings of the samples at hand at the points whose outlines are looked at (rad).
    touched: Any  # touched, costs, weights: G rows: costs under the track, costs in all, weights in the mean.
    costs: Any
    weights: Any
    plan: Any  # n times x and y.
    table_x: Any  # table_x, table_y: Points of the plan by the length along it.
    table_y: Any
    sums: Any  # T times a row for v, one for ω.
    # Normal numbers for vy of an omni model, see `lateral_noise`; this and the next two are empty of others.
    lateral_noise: Any
    lateral_center: Any  # T times vy of the sequence, and what 1 m/s costs by γ.
    lateral_sums: Any  # T times a row for vy.
    headings: Any  # G times P times a row, of the marks where their headings count.
    table_yaw: Any  # Headings of the table's points.


class MppiMemory(NamedTuple):
    """State and working space of the controller, of steps T."""

    sequence: Any  # (2, T) float64, the control sequence: v and ω. (3, T) of an omni model: vy as well.
    history: Any  # (2, 4) or (3, 4) float64, the last commands.
    stream: Any  # (1,) uint64.
    next_noise: Any  # (1,) int64, where the next cycle's noise may begin.
    kept_noise: Any  # (1,) int64, where that of the cycle before began; -1 after a reset.
    # lengths, free: (n,) float64 and bool: of the plan's points the length so far, and whether they are free.
    lengths: Any
    free: Any
    line: Any  # (T + 8,) float64, what is smoothed.
    circumscribed_cost: Any  # (1,) float64, see `Setting`.
    min_turning_radius_m: Any  # (1,) float64 of an Ackermann model; 0 of one that turns on the spot.
    goal_tolerance_m: Any  # (1,) float64, the goal checker's `xy_goal_tolerance`.
    unlimited_mps: Any  # (3,) float64, `vx_min`, `vx_max` and `vy_max` without a speed limit.
    space: Space


def new_memory(
    q: MppiParameters, stream: NDArray[np.uint64], circumscribed_cost: float = 0.0, goal_tolerance_m: float = 0.0
) -> MppiMemory:
    """Memory of a controller that draws from `stream` (1,).

    Args:
        circumscribed_cost: See `Setting`; every outline is looked at where it is 0.
        goal_tolerance_m: See `MppiMemory`.
    """
    steps, groups = q.time_steps, math.ceil(q.batch_size / ROW)
    axes, lateral_steps = (3, steps) if q.motion_model == "Omni" else (2, 0)
    frame_cells = SIDE * SIDE if q.CostCritic.consider_footprint else 0
    marks = (steps - 1) // q.PathAlignCritic.trajectory_point_step
    oriented = int(q.PathAlignCritic.use_path_orientations)
    cells = (steps - 1) // (1 if q.ObstaclesCritic.enabled else q.CostCritic.trajectory_point_step) + 1

    def rows(count: int) -> NDArray[np.float32]:
        return aligned(ROW * count, np.float32)

    return MppiMemory(
        sequence=np.zeros((axes, steps)),
        history=np.zeros((axes, 4)),
        stream=stream,
        next_noise=np.zeros(1, dtype=np.int64),
        kept_noise=np.full(1, -1, dtype=np.int64),
        lengths=np.zeros(PLAN_POINTS),
        free=np.zeros(PLAN_POINTS, dtype=np.bool_),
        line=np.zeros(steps + 8),
        circumscribed_cost=np.array([circumscribed_cost]),
        min_turning_radius_m=np.array([q.AckermannConstraints.min_turning_r if q.motion_model == "Ackermann" else 0.0]),
        goal_tolerance_m=np.array([goal_tolerance_m]),
        unlimited_mps=np.array([q.vx_min, q.vx_max, q.vy_max]),
        space=Space(
            noise=noise(ROW * steps * groups, q.vx_std, q.wz_std),
            center=aligned(4 * steps, np.float32),
            turns=rows(steps),
            track=rows(2 * steps),
            ends=rows(4 * groups),
            marks=rows(3 * marks * groups),
            cells=aligned(ROW * max(cells, marks), np.uint16),
            values=np.zeros(256, dtype=np.float32),
            frame=np.zeros(SIDE * SIDE, dtype=np.float32),
            near=np.zeros(frame_cells, dtype=np.uint8),
            lethal=np.zeros(frame_cells, dtype=np.int32),
            vertices=np.zeros(2 * MOST_VERTICES),
            yaws=rows(cells),
            touched=rows(groups),
            costs=rows(groups),
            weights=rows(groups),
            plan=aligned(2 * PLAN_POINTS, np.float32),
            table_x=aligned(BINS * PLAN_POINTS, np.float32),
            table_y=aligned(BINS * PLAN_POINTS, np.float32),
            sums=rows(2 * steps),
            lateral_noise=lateral_noise(ROW * lateral_steps * groups, q.vy_std),
            lateral_center=aligned(2 * lateral_steps, np.float32),
            lateral_sums=rows(lateral_steps),
            headings=rows(oriented * marks * groups),
            table_yaw=aligned(oriented * BINS * PLAN_POINTS, np.float32),
        ),
    )


class Draw(NamedTuple):
    """Parameters for drawing controls, and prices of their speeds."""

    noise_at: int  # Where this cycle's noise begins.
    v_mps: float  # v_mps, w_radps: Measured speeds.
    w_radps: float
    rise: float  # rise, fall, turn: How much a step may add to v, take from v, and change ω.
    fall: float
    turn: float
    vy_mps: float  # vy_mps, lateral_rise, lateral_fall: The same of the speed to an omni model's left.
    lateral_rise: float
    lateral_fall: float
    lowest: float  # lowest, highest: Range of ConstraintCritic.
    highest: float
    beyond: float  # beyond, backwards: Price of 1 m/s outside that range, in a step, and of 1 m/s backwards.
    backwards: float


@functools.lru_cache(maxsize=4)
def noise(cycle: int, spread_v: float, spread_w: float) -> NDArray[np.uint32]:
    """Read-only normal numbers for v and ω, two in a word, shared by all runs of a process.

    A number has 16 bits: sign, exponent and seven bits behind the first of a float32 number, half of whose memory it takes. The
    word is that for v, whose lower half is noise all the same, and ω's is its lower half.

    Args:
        cycle: Number of words that one control cycle uses.
        spread_v, spread_w: Standard deviations.
    """
    length = 1 << (CYCLES_OF_NOISE * cycle - 1).bit_length()
    drawn = normals(np.random.default_rng(NOISE_SEED), (2, length), np.float32)
    drawn *= np.array([[spread_v], [spread_w]], dtype=np.float32)
    # Shared and read-only: numbers drawn anew in each cycle are what Nav2 has a thread of its own for.
    words = aligned(length, np.uint32)
    words[:] = words_of(*drawn)
    words.flags.writeable = False
    return words


@functools.lru_cache(maxsize=4)
def lateral_noise(cycle: int, spread: float) -> NDArray[np.float32]:
    """Read-only normal numbers for vy, one for each word of `noise` and read in the same places."""
    length = 1 << (CYCLES_OF_NOISE * cycle - 1).bit_length() if cycle > 0 else 0
    numbers = aligned(length, np.float32)
    numbers[:] = normals(np.random.default_rng([NOISE_SEED, 1]), (length,), np.float32) * np.float32(spread)
    numbers.flags.writeable = False
    return numbers


def words_of(v: NDArray[np.float32], w: NDArray[np.float32]) -> NDArray[np.uint32]:
    """The words that hold noise for v and ω, as in `noise`."""
    return np.asarray((v.view(np.uint32) & 0xFFFF_0000) | ((w.view(np.uint32) + 0x8000) >> 16))


def aligned(length: int, kind: type[Any]) -> NDArray[Any]:
    """Zeros (length,) aligned to a cache line, because loads across two lines take twice as long."""
    size = np.dtype(kind).itemsize
    room = np.zeros(length * size + LINE_BYTES, dtype=np.uint8)
    begin = -room.ctypes.data % LINE_BYTES
    return room[begin : begin + length * size].view(kind)


@inner
def next_noise(stream: Any, at: Any, length: int, used: int) -> int:
    """Return the place in `length` numbers where the next cycle, of `used`, begins; `at` (1,) ended the last.

    Cycles follow each other through the noise with random gaps, so those that meet the same numbers again are at least
    six cycles apart, and meet them in another place: at another time, for another sample.
    """
    # Whole rows, so that a group's loads stay aligned to a cache line.
    start = at[0] + ROW * integer_below(stream, GAP_ROWS)
    if start > length - used:
        start -= length - used
    at[0] = start + used
    return int(start)


@inner
def rows_of(first: int, rows: int) -> int:
    """Index of a sample in its group's first row, for groups of so many rows."""
    return first // ROW * rows * ROW + first % ROW


@inner
def follow(
    space: Space, lateral: Any, first: int, steps: int, draw: Draw, start: Any, scale: float, dt_s: float
) -> None:
    """Draw a group of samples and follow it, and begin its costs by what its speeds cost.

    Controls are noise round the sequence, within reach of the speed before. The last one moves nothing any more and is not
    limited, as in Nav2.

    Args:
        lateral: `space.lateral_center` of an omni model, whose whole speed ConstraintCritic judges; None of others, for which
            numba leaves its lines out.
        start: x, y and the heading's cosine and sine after the first step, which goes by the measured speeds.
        scale: Cells that 1 m/s goes in a step.

    A heading is a vector that is turned by δ = ω dt. 1 - δ²/2 stands for cos δ and δ - δ³/6 for sin δ: the vector shrinks
    by δ⁴/24 a step, 2e-4 in all for a robot that turns at 1.9 rad/s all the time.
    """
    center, track, ends = space.center, space.track, space.ends
    middle, half = splat(0.5 * (draw.highest + draw.lowest)), splat(0.5 * (draw.highest - draw.lowest))
    linear, cubic, squared = splat(dt_s), splat(dt_s * dt_s * dt_s / 6.0), splat(dt_s * dt_s / 2.0)
    none, one = splat(0.0), splat(1.0)
    v, w, u = splat(draw.v_mps), splat(draw.w_radps), splat(draw.vy_mps)
    x, y = splat(start[0]), splat(start[1])
    c, s = splat(scale * start[2]), splat(scale * start[3])
    # Costs of speeds are summed while the speeds are in registers: they are never stored.
    cost, reached, back = none, none, none
    store(track, 0, x)
    store(track, ROW, y)
    at = draw.noise_at + first * steps
    last = steps - 1
    for t in range(last):
        v, w = _drawn(space, at, splat(center[4 * t]), splat(center[4 * t + 1]), v, w, draw)
        dx, dy, speed = v * c, v * s, v
        price = v * splat(center[4 * t + 2]) + w * splat(center[4 * t + 3])
        if lateral is not None:
            u = _drawn_lateral(space, at, splat(lateral[2 * t]), u, draw)
            dx, dy, speed = dx - u * s, dy + u * c, root(v * v + u * u)
            speed = either(v, none, none - speed, speed)
            price = price + u * splat(lateral[2 * t + 1])
        at += ROW
        x, y, cost = x + dx, y + dy, cost + price
        store(space.turns, t * ROW, w)
        store(track, (t + 1) * STEP, x)
        store(track, (t + 1) * STEP + ROW, y)
        square = w * w
        # The products are those of Taylor's polynomials, see above: sines and cosines would cost as much as the rest of
        # the step.
        sine, cosine = w * (linear - square * cubic), one - square * squared
        c, s = c * cosine - s * sine, s * cosine + c * sine
        # max(|v - middle|, half) less half is the excess over the range: the branch is spared, and `half` is taken off
        # once, below.
        reached = reached + higher(size(speed - middle), half)
        back = back + lower(v, none)
    v = splat(center[4 * last]) + load_upper(space.noise, at)
    w = splat(center[4 * last + 1]) + load_lower(space.noise, at)
    price = v * splat(center[4 * last + 2]) + w * splat(center[4 * last + 3])
    if lateral is not None:
        u = splat(lateral[2 * last]) + load(space.lateral_noise, at)
        price = price + u * splat(lateral[2 * last + 1])
    cost = cost + price
    cost = cost + (reached - splat(float(last)) * half) * splat(draw.beyond)
    store(space.costs, first, cost - back * splat(draw.backwards))
    end = first * 4
    store(ends, end, x)
    store(ends, end + ROW, y)
    store(ends, end + 2 * ROW, c)
    store(ends, end + 3 * ROW, s)


@inner
def add_weighted_lateral(space: Space, first: int, weight: Any, steps: int, draw: Draw) -> None:
    """Draw the vy of a group of samples again, and add it to its sums by the samples' weights."""
    lateral, sums = space.lateral_center, space.lateral_sums
    u = splat(draw.vy_mps)
    at = draw.noise_at + first * steps
    for t in range(steps - 1):
        u = _drawn_lateral(space, at, splat(lateral[2 * t]), u, draw)
        at += ROW
        store(sums, t * ROW, load(sums, t * ROW) + weight * u)
    last = steps - 1
    u = splat(lateral[2 * last]) + load(space.lateral_noise, at)
    store(sums, last * ROW, load(sums, last * ROW) + weight * u)


@inner
def missing_speed(space: Space, first: int, steps: int, draw: Draw, least: Any, is_omni: bool) -> Any:
    """Draw a group of samples again; sum what their speeds, measured first, lack of `least` (v, vy, ω)."""
    center, lateral, none = space.center, space.lateral_center, splat(0.0)
    least_v, least_u, least_w = splat(abs(least[0])), splat(abs(least[1])), splat(abs(least[2]))
    v, w, u = splat(draw.v_mps), splat(draw.w_radps), splat(draw.vy_mps)
    missing = higher(least_v - size(v), none) + higher(least_w - size(w), none)
    if is_omni:
        missing = missing + higher(least_u - size(u), none)
    at = draw.noise_at + first * steps
    for t in range(steps - 1):
        v, w = _drawn(space, at, splat(center[4 * t]), splat(center[4 * t + 1]), v, w, draw)
        missing = missing + higher(least_v - size(v), none) + higher(least_w - size(w), none)
        if is_omni:
            u = _drawn_lateral(space, at, splat(lateral[2 * t]), u, draw)
            missing = missing + higher(least_u - size(u), none)
        at += ROW
    return missing


@inner
def _drawn_lateral(space: Space, at: int, mean: Any, u: Any, draw: Draw) -> Any:
    """The next vy: noise round its mean, within reach of the one before."""
    rise, fall, none = splat(draw.lateral_rise), splat(draw.lateral_fall), splat(0.0)
    wish = mean + load(space.lateral_noise, at)
    return lower(higher(wish, u - either(none, u, fall, rise)), u + either(none, u, rise, fall))


@inner
def add_weighted(space: Space, first: int, weight: Any, second: int, other_weight: Any, steps: int, draw: Draw) -> None:
    """Draw two groups of samples again, and add their controls to the sums by the samples' weights.

    Each step waits for the one before: two groups take hardly longer than one.
    """
    center, sums = space.center, space.sums
    v, w = splat(draw.v_mps), splat(draw.w_radps)
    other_v, other_w = v, w
    at, other_at = draw.noise_at + first * steps, draw.noise_at + second * steps
    last = steps - 1
    for t in range(last):
        mean_v, mean_w = splat(center[4 * t]), splat(center[4 * t + 1])
        v, w = _drawn(space, at, mean_v, mean_w, v, w, draw)
        other_v, other_w = _drawn(space, other_at, mean_v, mean_w, other_v, other_w, draw)
        at += ROW
        other_at += ROW
        store(sums, t * STEP, load(sums, t * STEP) + (weight * v + other_weight * other_v))
        store(sums, t * STEP + ROW, load(sums, t * STEP + ROW) + (weight * w + other_weight * other_w))
    numbers, mean_v, mean_w, k = space.noise, splat(center[4 * last]), splat(center[4 * last + 1]), last * STEP
    v, w = mean_v + load_upper(numbers, at), mean_w + load_lower(numbers, at)
    other_v, other_w = mean_v + load_upper(numbers, other_at), mean_w + load_lower(numbers, other_at)
    store(sums, k, load(sums, k) + (weight * v + other_weight * other_v))
    store(sums, k + ROW, load(sums, k + ROW) + (weight * w + other_weight * other_w))


@inner
def _drawn(space: Space, at: int, mean_v: Any, mean_w: Any, v: Any, w: Any, draw: Draw) -> Any:
    """The next controls (v, w): noise round their mean, within reach of the ones before."""
    wish_v, wish_w = mean_v + load_upper(space.noise, at), mean_w + load_lower(space.noise, at)
    rise, fall, turn, none = splat(draw.rise), splat(draw.fall), splat(draw.turn), splat(0.0)
    # The usual case spares two selections a step; the compiler can't know that the two are equal.
    if draw.rise == draw.fall:
        v = lower(higher(wish_v, v - rise), v + rise)
    else:  # backwards, speeding up and slowing down change places
        v = lower(higher(wish_v, v - either(none, v, fall, rise)), v + either(none, v, rise, fall))
    return v, lower(higher(wish_w, w - turn), w + turn)
