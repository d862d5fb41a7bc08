"""8-connected octile distance on the grid for a robot of given radius, the product's measure of path length.

A step along an axis costs one cell, a diagonal step √2 cells; diagonal steps between two blocked cells are allowed, as in the A* of the
paper's tool.
"""

import itertools
import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from vastflow.sim.kernels.numeric import inner, njit
from vastflow.sim.world.occupancy import OccupancyMap

UNREACHED: Final = np.float32(np.inf)
ROUNDING_CELLS: Final = 1e-9
"""Tolerance of a radius in cells: 1.1 m are 11 cells of 0.1 m."""


def passable(occupancy: OccupancyMap, radius_m: float) -> NDArray[np.bool_]:
    """Return the mask (H, W) of cells where the center of a robot of `radius_m` may be.

    A cell is blocked where its center is at most `radius_m`, rounded up to whole cells, from that of a cell not known to be free; the
    grid's outside counts as not free.
    """
    return inflated_free(occupancy.free, whole_cells(radius_m, occupancy.resolution_m))


def whole_cells(radius_m: float, resolution_m: float) -> int:
    return math.ceil(radius_m / resolution_m - ROUNDING_CELLS)


def inflated_free(free: NDArray[np.bool_], radius_cells: float) -> NDArray[np.bool_]:
    """Return `passable` of a mask (H, W) and a radius in cells."""
    framed = np.pad(free, 1, constant_values=False)
    distance = ndimage.distance_transform_edt(framed)[1:-1, 1:-1]
    return np.asarray(distance > max(radius_cells, 0.0))


def distance_field(
    free: NDArray[np.bool_], row: int, column: int, limit_cells: float = math.inf
) -> NDArray[np.float32]:
    """Return the octile distance (H, W) in cells from one cell to all others; infinite without a path.

    Args:
        free: (H, W) passable cells.
        row, column: Source; nothing is reached if it is not passable.
        limit_cells: Cells farther away are not searched.
    """
    out = np.full(free.shape, UNREACHED, dtype=np.float32)
    if 0 <= row < free.shape[0] and 0 <= column < free.shape[1] and free[row, column]:
        _flood(np.ascontiguousarray(free), row, column, float(limit_cells), out)
    return out


def descend(field: NDArray[np.float32], row: int, column: int) -> NDArray[np.int64]:
    """Return a shortest path (N, 2) of (row, column) from a cell down `field` to its source, both included."""
    if not np.isfinite(field[row, column]):
        raise ValueError(f"cell ({row}, {column}) is not reached by the field")
    out = np.empty((field.size, 2), dtype=np.int64)
    return out[: _descend(field, row, column, out)].copy()


def shortest_path(
    occupancy: OccupancyMap, free: NDArray[np.bool_], stops_xy_m: NDArray[np.float64]
) -> tuple[NDArray[np.float64], float] | None:
    """Return points (M, 2) and length of the shortest path through stops (N >= 2, 2), in meters, or None."""
    legs: list[NDArray[np.int64]] = []
    length_cells = 0.0
    cells = [occupancy.cell_of(float(x), float(y)) for x, y in stops_xy_m]
    if not all(occupancy.contains(*cell) for cell in cells):
        return None
    for (row, column), (to_row, to_column) in itertools.pairwise(cells):
        field = distance_field(free, to_row, to_column)
        if not math.isfinite(field[row, column]):
            return None
        length_cells += float(field[row, column])
        leg = descend(field, row, column)
        legs.append(leg if not legs else leg[1:])
    return occupancy.centers_of(np.concatenate(legs)), length_cells * occupancy.resolution_m


@njit
def _flood(free: Any, row: int, column: int, limit: float, out: Any) -> None:
    """Run Dijkstra with a ring of buckets one cell wide; a step costs at least 1."""
    rows, columns = free.shape
    passable = free.reshape(-1)
    field = out.reshape(-1)
    sqrt2 = math.sqrt(2.0)
    # This bucket and the next two; a step is shorter than 2.
    buckets = np.empty((3, 4096), dtype=np.int32)
    counts = np.zeros(3, dtype=np.int64)
    buckets[0, 0] = row * columns + column
    counts[0] = 1
    field[buckets[0, 0]] = 0.0
    level = 0
    while counts.sum() > 0:
        now, following, after = level % 3, (level + 1) % 3, (level + 2) % 3
        n_following, n_after = counts[following], counts[after]
        if max(n_following, n_after) + 8 * counts[now] > buckets.shape[1]:
            buckets = _widened(buckets, max(n_following, n_after) + 8 * counts[now])
        for k in range(counts[now]):
            cell = buckets[now, k]
            here = field[cell]
            if here < level:
                continue  # was reached on a shorter path since, and is done
            r = cell // columns
            c = cell - r * columns
            for near_r in range(max(r - 1, 0), min(r + 2, rows)):
                for near_c in range(max(c - 1, 0), min(c + 2, columns)):
                    near = near_r * columns + near_c
                    there = np.float32(here + (sqrt2 if near_r != r and near_c != c else 1.0))
                    # Most neighbors were reached before: this comparison first.
                    if there < field[near] and passable[near] and there <= limit:
                        field[near] = there
                        if there < level + 2:
                            buckets[following, n_following] = near
                            n_following += 1
                        else:
                            buckets[after, n_after] = near
                            n_after += 1
        counts[now], counts[following], counts[after] = 0, n_following, n_after
        level += 1


@inner
def _widened(buckets: Any, width: int) -> Any:
    larger = np.empty((3, 2 * width), dtype=buckets.dtype)
    larger[:, : buckets.shape[1]] = buckets
    return larger


@njit
def _descend(field: Any, row: int, column: int, out: Any) -> int:
    rows, columns = field.shape
    sqrt2 = math.sqrt(2.0)
    out[0, 0], out[0, 1] = row, column
    n = 1
    while field[row, column] > 0.0:
        best, best_row, best_column = np.inf, row, column
        for dr in range(-1, 2):
            for dc in range(-1, 2):
                r, c = row + dr, column + dc
                if (dr == 0 and dc == 0) or r < 0 or c < 0 or r >= rows or c >= columns:
                    continue
                step = sqrt2 if dr != 0 and dc != 0 else 1.0
                if field[r, c] < field[row, column] and field[r, c] + step < best - 1e-6:
                    best, best_row, best_column = field[r, c] + step, r, c
        row, column = best_row, best_column
        out[n, 0], out[n, 1] = row, column
        n += 1
    return n
