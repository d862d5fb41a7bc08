"""NavFn, Nav2's global planner: a potential by wavefront buffers and a path down its gradient.

The buffers (current, next, overflow, each of at most 10,000 cells) are imitated, not replaced by an exact
queue, because their early stop leaves values that a heap would not.
"""

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vastflow.sim.kernels.arrays import zero_pages
from vastflow.sim.kernels.numeric import inner, njit
from vastflow.sim.nav2.costmaps.inflation import INSCRIBED, UNKNOWN

UNREACHED: Final = np.float32(1e10)
NEUTRAL: Final = 50
OBSTACLE: Final = 254
BUFFER_CELLS: Final = 10_000
PATH_STEP_CELLS: Final = 0.5


def travel_costs(costmap_u8: NDArray[np.uint8], allow_unknown: bool = True) -> NDArray[np.uint8]:
    """NavFn's cost (H, W): 50 + 0.8 c for traversable cells, 254 for others, unknown 253 or 254."""
    out = np.empty(costmap_u8.shape, dtype=np.uint8)
    fill_travel_costs(costmap_u8, allow_unknown, 0, costmap_u8.shape[0], 0, costmap_u8.shape[1], out)
    out[0], out[-1], out[:, 0], out[:, -1] = OBSTACLE, OBSTACLE, OBSTACLE, OBSTACLE
    return out


def new_potential(shape: tuple[int, ...]) -> NDArray[np.float32]:
    """A potential (H, W) in which nothing is reached yet."""
    return np.full(shape, UNREACHED, dtype=np.float32)


def new_scratch(shape: tuple[int, ...]) -> tuple[NDArray[np.int64], NDArray[np.uint8], NDArray[np.int64]]:
    """Scratch of `propagate`: buffers (3, 10000) int64, pending flags (H, W) uint8, extent (4,) int64 of the last flood.

    The extent, rows and columns from and to, spares the clearing of a large map at every flood.
    """
    return np.zeros((3, BUFFER_CELLS), dtype=np.int64), zero_pages(shape, np.uint8), np.zeros(4, dtype=np.int64)


@njit
def fill_travel_costs(costmap: Any, allow_unknown: bool, row0: int, row1: int, col0: int, col1: int, out: Any) -> None:
    """Travel costs of rows row0..row1 and columns col0..col1 of `costmap` (H, W) into `out` (H, W)."""
    travel = np.full(256, OBSTACLE, dtype=np.uint8)
    for cost in range(INSCRIBED):
        travel[cost] = min(INSCRIBED, int(NEUTRAL + 0.8 * cost))
    if allow_unknown:
        travel[UNKNOWN] = INSCRIBED
    for row in range(row0, row1):
        for column in range(col0, col1):
            out[row, column] = travel[costmap[row, column]]


@njit
def propagate(
    travel: Any,
    root_x: int,
    root_y: int,
    stop_x: int,
    stop_y: int,
    astar: bool,
    lower: Any,
    bound: float,
    out: Any,
    scratch: Any,
) -> bool:
    """Fill `out` (H, W) float32 from the root until the stop cell has a value; return whether it has one.

    Where no path of at most `bound` comes near what is left out, the potential is that of the whole flood.

    Args:
        travel: (H, W) uint8 travel costs; the outermost cells are obstacles, so that none has a neighbor missing.
        astar: Whether cells nearer to the stop cell come first, as with NavFn's `use_astar`.
        lower: (H, W) float32, no greater than what any path on from a cell costs, the cell's own cost included.
        bound: Only cells are entered that a path from the root of at most this cost can lead through; `math.inf` for all.
        out: From `new_potential`, and written by this function alone.
        scratch: From `new_scratch`, always the same for one `out`.
    """
    rows, columns = travel.shape
    buffers, pending_flags, extent = scratch
    for row in range(extent[0], extent[1]):
        for column in range(extent[2], extent[3]):
            out[row, column] = UNREACHED
    # Flat views: one index for a cell in place of two, in the innermost loop of a flood over millions of cells.
    cost_of, potential_of, pending, lower_of = travel.ravel(), out.ravel(), pending_flags.ravel(), lower.ravel()
    beside = np.array([-1, 1, -columns, columns])
    root, stop = root_y * columns + root_x, stop_y * columns + stop_x
    low, high = root, root
    low_x, high_x = root_x, root_x
    potential_of[root] = 0.0
    current, following, overflow = 0, 1, 2
    n_current, n_following, n_overflow = 0, 0, 0
    for step in (1, -1, -columns, columns):
        cell = root + step
        if 0 <= cell < cost_of.shape[0] and cost_of[cell] < OBSTACLE:
            pending[cell] = 1
            buffers[current, n_current] = cell
            n_current += 1
    # NavFn's priority steps: cells whose value is above the threshold wait in the overflow for the next round.
    threshold = np.float32(OBSTACLE)
    if astar:
        threshold += np.float32(NEUTRAL * math.hypot(root_x - stop_x, root_y - stop_y))
    reached = False
    for _ in range(max(rows * columns // 20, rows + columns)):
        if n_current == 0:
            break
        for k in range(n_current):
            pending[buffers[current, k]] = 0
        for k in range(n_current):
            cell = buffers[current, k]
            across = min(potential_of[cell - 1], potential_of[cell + 1])
            along = min(potential_of[cell - columns], potential_of[cell + columns])
            cost = np.float32(cost_of[cell])
            base, difference = min(across, along), abs(across - along)
            if difference >= cost:
                value = base + cost
            else:
                # NavFn's constants have 64 bits, its numbers 32: what rounding decides may lead round another corner.
                d = np.float64(difference / cost)
                value = base + cost * np.float32(-0.2301 * d * d + 0.5307 * d + 0.7040)
            if value >= potential_of[cell]:
                continue
            potential_of[cell] = value
            low, high = min(low, cell), max(high, cell)
            x = cell % columns
            low_x, high_x = min(low_x, x), max(high_x, x)
            # NavFn's A* takes what is left for a part of the value, even where it asks whether a neighbor gains.
            rank = value
            if astar:
                rank += np.float32(NEUTRAL * math.hypot(x - stop_x, cell // columns - stop_y))
            for side in range(4):
                there = cell + beside[side]
                price = cost_of[there]
                if price >= OBSTACLE or pending[there] != 0:
                    continue
                if not potential_of[there] > rank + np.float32(0.707106781 * price):
                    continue
                if value + lower_of[there] > bound:
                    continue
                if rank < threshold:
                    # NavFn drops cells that find no room: on wide floors its potential has holes, and so has this one.
                    if n_following < BUFFER_CELLS:
                        buffers[following, n_following] = there
                        n_following += 1
                        pending[there] = 1
                elif n_overflow < BUFFER_CELLS:
                    buffers[overflow, n_overflow] = there
                    n_overflow += 1
                    pending[there] = 1
        current, following = following, current
        n_current, n_following = n_following, 0
        if n_current == 0:
            threshold += np.float32(2 * NEUTRAL)
            current, overflow = overflow, current
            n_current, n_overflow = n_overflow, 0
        if stop_x >= 0 and potential_of[stop] < UNREACHED:
            reached = True
            break
    for k in range(n_current):
        pending[buffers[current, k]] = 0
    for k in range(n_overflow):
        pending[buffers[overflow, k]] = 0
    extent[0], extent[1], extent[2], extent[3] = low // columns, high // columns + 1, low_x, high_x + 1
    return reached


@njit
def descend(values: Any, from_x: int, from_y: int, root_x: int, root_y: int, out: Any) -> int:
    """Walk down the gradient of `values` (H, W) to the root in half-cell steps of 32-bit numbers.

    Writes (x, y) in cell units into `out` (M, 2), the root cell last, and returns their number;
    0 where the walk fails (no gradient, or `out` is full: NavFn's cap on a path's length is M = 4 max(H, W)).
    """
    rows, columns = values.shape
    cells = values.ravel()
    at, size = from_y * columns + from_x, rows * columns
    dx, dy, one, none = np.float32(0.0), np.float32(0.0), np.float32(1.0), np.float32(0.0)
    for n in range(out.shape[0]):
        # NavFn asks whether the cell that the point rounds to is the start's, by its value: no other lies below the
        # neutral cost.
        near = min(max(at + _rounded(dx) + columns * _rounded(dy), 0), size - 1)
        if cells[near] < NEUTRAL:
            out[n, 0], out[n, 1] = root_x, root_y
            return n + 1
        if at < columns or at >= size - columns:
            return 0
        out[n, 0], out[n, 1] = np.float32(at % columns) + dx, np.float32(at // columns) + dy
        # Two steps that end where they began are an oscillation: NavFn takes the grid's lowest neighbor then.
        rough = n > 1 and out[n, 0] == out[n - 2, 0] and out[n, 1] == out[n - 2, 1]
        for row in range(at - columns, at + columns + 1, columns):
            for cell in range(row - 1, row + 2):
                rough = rough or cells[cell] >= UNREACHED
        if rough:
            if cells[at] >= UNREACHED:
                return 0
            # NavFn holds the least in a whole number.
            best, least = at, int(cells[at])
            for row in range(at - columns, at + columns + 1, columns):
                for cell in range(row - 1, row + 2):
                    if cell != at and cells[cell] < least:
                        best, least = cell, int(cells[cell])
            at, dx, dy = best, none, none
            continue
        gx00, gy00 = _gradient(cells, at, columns)
        gx10, gy10 = _gradient(cells, at + 1, columns)
        gx01, gy01 = _gradient(cells, at + columns, columns)
        gx11, gy11 = _gradient(cells, at + columns + 1, columns)
        gx = _between(dy, _between(dx, gx00, gx10), _between(dx, gx01, gx11))
        gy = _between(dy, _between(dx, gy00, gy10), _between(dx, gy01, gy11))
        if gx == none and gy == none:
            return 0
        step = np.float32(PATH_STEP_CELLS) / _hypot(gx, gy)
        dx += gx * step
        dy += gy * step
        if dx > one:
            at, dx = at + 1, dx - one
        if dx < -one:
            at, dx = at - 1, dx + one
        if dy > one:
            at, dy = at + columns, dy - one
        if dy < -one:
            at, dy = at - columns, dy + one
    return 0


@inner
def _rounded(offset: Any) -> int:
    """The nearest whole number, of two the one farther from 0."""
    whole = int(abs(offset) + 0.5)
    return whole if offset >= 0.0 else -whole


@inner
def _between(part: Any, low: Any, high: Any) -> Any:
    return np.float32((1.0 - part) * low + part * high)


@inner
def _hypot(x: Any, y: Any) -> Any:
    wide_x, wide_y = np.float64(x), np.float64(y)
    return np.float32(math.sqrt(wide_x * wide_x + wide_y * wide_y))


@inner
def _gradient(cells: Any, at: int, columns: int) -> Any:
    """Unit vector down the potential at a cell that has a value, zero in the outermost rows."""
    gx, gy = np.float32(0.0), np.float32(0.0)
    if at < columns or at >= cells.shape[0] - columns:
        return gx, gy
    here = cells[at]
    left, right, down, up = cells[at - 1], cells[at + 1], cells[at - columns], cells[at + columns]
    if left < UNREACHED:
        gx += left - here
    if right < UNREACHED:
        gx += here - right
    if down < UNREACHED:
        gy += down - here
    if up < UNREACHED:
        gy += here - up
    norm = _hypot(gx, gy)
    if norm > np.float32(0.0):
        norm = np.float32(1.0 / norm)
    return norm * gx, norm * gy


@inner
def cell(place: Any, x_m: float, y_m: float) -> Any:
    """NavFn's (column, row) of a point, rounded: its paths are half a cell off the costmap's cells."""
    return math.floor((x_m - place[0]) / place[2] + 0.5), math.floor((y_m - place[1]) / place[2] + 0.5)


@inner
def on_map(costs: Any, column: int, row: int) -> bool:
    """Whether a cell is one of the map's."""
    return column >= 0 and row >= 0 and column < costs.shape[1] and row < costs.shape[0]
