"""MPPI's samples: control sequences drawn round the current one, limited, and followed from where the robot is.

Positions are in cells of the cost frame, so that the cell of a position is its whole part. Working space is in rows of
eight numbers, one for each sample of a group; a group has so and so many rows for a step. See `Space`.
"""

import functools
import math
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vastflow.sim.kernels.numeric import inner
from vastflow.sim.kernels.streams import integer_below
from vastflow.sim.nav.controllers.lanes import either, higher, load, lower, size, splat, store

ROW: Final = 8
"""Samples in a group. Lanes are as many or half of them: what is computed is the same."""
STEP: Final = 2 * ROW
"""A row of the one kind (v, x), and one of the other (ω, y)."""
NOISE_SEED: Final = 20_241
CYCLES_OF_NOISE: Final = 8
GAP_ROWS: Final = 4096


class Space(NamedTuple):
    """Addresses of the working space, all float32 but `cells`; G groups, T steps, a row eight numbers.

    Attributes:
        noise: Standard normal numbers.
        center: T times a row of v, one of ω: the sequence, each number eight times over.
        gains: T times a row for v, one for ω: what 1 m/s and 1 rad/s cost by γ.
        controls, track: T times a row of v, one of ω, or of x and y: of the samples at hand.
        ends: G times a row of x, y, cosine and sine of the heading.
        marks: G times P times a row of x, y and length, for the P points of PathAlignCritic.
        cells: uint16: numbers of cells, or of entries of the table, for the lanes at hand.
        frame: Cost of a cell.
        touched, costs, weights: G rows: costs under the track, costs in all, weights in the mean.
        plan: n times a row of x, one of y, each number eight times over.
        table_x, table_y: Points of the plan by the length along it.
        sums: T times a row for v, one for ω.
    """

    noise: Any
    center: Any
    gains: Any
    controls: Any
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


class Limits(NamedTuple):
    """How much a step may add to v, take from v, and change ω."""

    rise: float
    fall: float
    turn: float


class Prices(NamedTuple):
    """What speeds cost.

    Attributes:
        lowest, highest: Range of ConstraintCritic.
        beyond: Price of 1 m/s outside that range, in a step.
        backwards: Price of 1 m/s backwards.
    """

    lowest: float
    highest: float
    beyond: float
    backwards: float


@functools.lru_cache(maxsize=4)
def noise(cycle: int) -> NDArray[np.float32]:
    """Read-only standard normal numbers, drawn once in a process and shared by all its runs.

    Args:
        cycle: How many of them one control cycle uses.
    """
    length = 1 << math.ceil(math.log2(CYCLES_OF_NOISE * cycle))
    numbers = np.random.default_rng(NOISE_SEED).standard_normal(length, dtype=np.float32)
    numbers.flags.writeable = False
    return numbers


@inner
def next_noise(stream: Any, at: Any, length: int, used: int) -> int:
    """Where in `length` numbers the next cycle begins that uses `used` of them; `at` (1,) is where the last one ended.

    Cycles follow each other through the noise with random gaps, so those that meet the same numbers again are at least
    six cycles apart, and meet them in another place: at another time, for another sample.
    """
    start = at[0] + ROW * integer_below(stream, GAP_ROWS)
    if start > length - used:
        start -= length - used
    at[0] = start + used
    return int(start)


@inner
def rows_of(first: int, rows: int) -> int:
    """Where the lanes that begin with sample `first` begin, if each group has so many rows."""
    return first // ROW * rows * ROW + first % ROW


@inner
def draw(space: Space, first: int, steps: int, noise_at: int, twist: Any, spread: Any, limits: Limits) -> None:
    """Draw the controls of the samples from `first` on: noise round the sequence, within reach of the speed before.

    Args:
        noise_at: Where this cycle's noise begins.
        twist: Measured (v, ω).
        spread: Standard deviations of v and ω.

    The last control moves nothing any more and is not limited, as in Nav2.
    """
    center, numbers, controls = space.center, space.noise, space.controls
    spread_v, spread_w = splat(spread[0]), splat(spread[1])
    rise, fall, turn, none = splat(limits.rise), splat(limits.fall), splat(limits.turn), splat(0.0)
    v, w = splat(twist[0]), splat(twist[1])
    noise_at += rows_of(first, 2 * steps)
    last = (steps - 1) * STEP
    if limits.rise == limits.fall:
        for k in range(0, last, STEP):
            wish_v = load(center, k) + spread_v * load(numbers, noise_at + k)
            wish_w = load(center, k + ROW) + spread_w * load(numbers, noise_at + k + ROW)
            v, w = lower(higher(wish_v, v - rise), v + rise), lower(higher(wish_w, w - turn), w + turn)
            store(controls, k, v)
            store(controls, k + ROW, w)
    else:
        for k in range(0, last, STEP):
            wish_v = load(center, k) + spread_v * load(numbers, noise_at + k)
            wish_w = load(center, k + ROW) + spread_w * load(numbers, noise_at + k + ROW)
            # Backwards, speeding up and slowing down change places.
            slower, faster = either(none, v, fall, rise), either(none, v, rise, fall)
            v, w = lower(higher(wish_v, v - slower), v + faster), lower(higher(wish_w, w - turn), w + turn)
            store(controls, k, v)
            store(controls, k + ROW, w)
    store(controls, last, load(center, last) + spread_v * load(numbers, noise_at + last))
    store(controls, last + ROW, load(center, last + ROW) + spread_w * load(numbers, noise_at + last + ROW))


@inner
def follow(space: Space, first: int, steps: int, start: Any, scale: float, dt_s: float, prices: Prices) -> None:
    """Follow the controls just drawn, and begin the costs of these samples by what their speeds cost.

    Args:
        start: x, y and the heading's cosine and sine after the first step, which goes by the measured speeds.
        scale: Cells that 1 m/s goes in a step.

    A heading is a vector that is turned by δ = ω dt. 1 - δ²/2 stands for cos δ and δ - δ³/6 for sin δ: the vector shrinks
    by δ⁴/24 a step, 2e-4 in all for a robot that turns at 1.9 rad/s all the time.
    """
    gains, controls, track, ends = space.gains, space.controls, space.track, space.ends
    middle, half = splat(0.5 * (prices.highest + prices.lowest)), splat(0.5 * (prices.highest - prices.lowest))
    beyond, backwards = splat(prices.beyond), splat(-prices.backwards)
    linear, cubic, squared = splat(dt_s), splat(dt_s * dt_s * dt_s / 6.0), splat(dt_s * dt_s / 2.0)
    none, one = splat(0.0), splat(1.0)
    x, y = splat(start[0]), splat(start[1])
    c, s = splat(scale * start[2]), splat(scale * start[3])
    cost = none
    store(track, 0, x)
    store(track, ROW, y)
    last = (steps - 1) * STEP
    for k in range(0, last, STEP):
        v, w = load(controls, k), load(controls, k + ROW)
        x, y = x + v * c, y + v * s
        store(track, k + STEP, x)
        store(track, k + STEP + ROW, y)
        square = w * w
        sine, cosine = w * (linear - square * cubic), one - square * squared
        c, s = c * cosine - s * sine, s * cosine + c * sine
        excess = (higher(size(v - middle), half) - half) * beyond
        cost = cost + ((v * load(gains, k) + w * load(gains, k + ROW)) + (excess + lower(v, none) * backwards))
    v, w = load(controls, last), load(controls, last + ROW)
    store(space.costs, first, cost + (v * load(gains, last) + w * load(gains, last + ROW)))
    end = rows_of(first, 4)
    store(ends, end, x)
    store(ends, end + ROW, y)
    store(ends, end + 2 * ROW, c)
    store(ends, end + 3 * ROW, s)
