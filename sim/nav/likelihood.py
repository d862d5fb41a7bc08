"""AMCL's likelihood field: how well a beam that ends in a cell agrees with the map."""

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vastflow.sim.kernels.numeric import inner, njit
from vastflow.sim.nav.parameters.amcl import AmclParameters

UNREACHED: Final = -1
FRAME: Final = 64
"""So wide, because beams need no test for the table's border while they are shorter than the distance to it."""

WIDTH: Final = 64


def usable_range_m(q: AmclParameters, range_min_m: float, range_max_m: float) -> tuple[float, float]:
    """Least and greatest range AMCL uses of a scanner's, after `laser_min_range` and `laser_max_range`."""
    return (
        max(range_min_m, q.laser_min_range) if q.laser_min_range > 0.0 else range_min_m,
        min(range_max_m, q.laser_max_range) if q.laser_max_range > 0.0 else range_max_m,
    )


def likelihood_cubed(
    occupied: NDArray[np.bool_],
    resolution_m: float,
    *,
    range_max_m: float,
    z_hit: float,
    z_rand: float,
    sigma_hit_m: float,
    likelihood_max_dist_m: float,
    dtype: type[np.floating[Any]] = np.float32,
) -> NDArray[Any]:
    """pz³ of a beam that ends in each cell, with a frame of `FRAME` cells at least for beams that end off the map.

    The table's width is an odd multiple of `WIDTH`, so that its rows do not all begin in one part of the cache.

    pz = z_hit exp(-d² / 2σ²) + z_rand / range_max, d the distance to the wall the wavefront found for the cell; the cap
    off the map and where it found none.

    Args:
        range_max_m: Greatest usable range, see `usable_range_m`.
        dtype: float32 in the loop, float64 where the eighth digit counts.
    """
    squares = squared_distances(occupied, int(likelihood_max_dist_m / resolution_m))
    distances_m = np.append(np.sqrt(np.arange(squares.max() + 1)) * resolution_m, likelihood_max_dist_m)
    pz = z_hit * np.exp(-(distances_m**2) / (2 * sigma_hit_m**2)) + z_rand / range_max_m
    east = FRAME - (squares.shape[1] + 2 * FRAME + WIDTH) % -(2 * WIDTH)
    framed = np.pad(squares, ((FRAME, FRAME), (FRAME, east)), constant_values=UNREACHED)
    # UNREACHED, which is -1, finds the last entry.
    cubed: NDArray[Any] = (pz**3).astype(dtype)[framed]
    return cubed


def squared_distances(occupied: NDArray[np.bool_], radius_cells: int) -> NDArray[np.int32]:
    """Squared distance in cells (H, W) to a near wall, UNREACHED beyond `radius_cells`, as AMCL finds it.

    A wavefront of edge neighbors takes each wall's cells along, nearest first, and a cell keeps the wall of the
    neighbor that touches it first. That is not always the nearest one: on maps with ragged walls up to half of the
    cells within 0.6 m of a wall get a distance that is too large, by 0.03 m in the mean and up to 0.17 m (measured).
    Which neighbor is first among equals follows from the order of walls in the queue (column by column) and from the
    binary heap of C++'s standard library, so the heap here moves its entries as that one does.
    """
    squares = np.full(occupied.shape, UNREACHED, dtype=np.int32)
    walls = np.flatnonzero(occupied.T)
    # From column by column to the cells' numbers, which are row by row.
    cells = walls % occupied.shape[0] * occupied.shape[1] + walls // occupied.shape[0]
    squares.ravel()[cells] = 0
    owners = np.zeros(occupied.shape, dtype=np.int32)
    owners.ravel()[cells] = cells
    heap = np.empty(occupied.size, dtype=np.int64)
    heap[: len(cells)] = cells
    _flood(squares, owners, heap, len(cells), radius_cells)
    return squares


@njit
def _flood(squares: Any, walls: Any, heap: Any, size: int, radius_cells: int) -> None:
    """Let walls take cells along.

    Args:
        walls: (H, W) int32 number of the wall a cell belongs to.
        heap: (H * W,) int64, its first `size` entries the walls: squared distance (upper 32 bits) and cell (lower 32).
    """
    rows, columns = squares.shape
    while size > 0:
        cell = heap[0] & 0xFFFFFFFF
        row, column = cell // columns, cell % columns
        wall = walls[row, column]
        for k in range(4):
            r, c = (row, column + k - 1) if k % 2 == 0 else (row + k - 2, column)
            if r < 0 or c < 0 or r >= rows or c >= columns or squares[r, c] != UNREACHED:
                continue
            dr, dc = r - wall // columns, c - wall % columns
            square = dr * dr + dc * dc
            if square > radius_cells * radius_cells:
                continue
            squares[r, c], walls[r, c] = square, wall
            _rise(heap, size, square << 32 | r * columns + c)
            size += 1
        # The first leaves: its hole sinks to the bottom, and the last entry rises from there.
        size -= 1
        _rise(heap, _sunk(heap, size), heap[size])


@inner
def _rise(heap: Any, hole: int, entry: int) -> None:
    while hole > 0 and heap[(hole - 1) // 2] >> 32 > entry >> 32:
        heap[hole] = heap[(hole - 1) // 2]
        hole = (hole - 1) // 2
    heap[hole] = entry


@inner
def _sunk(heap: Any, size: int) -> int:
    """Where the hole at the top of `size` entries and one more ends."""
    hole = 0
    while 2 * hole + 2 < size:
        child = 2 * hole + 2
        if heap[child] >> 32 > heap[child - 1] >> 32:
            child -= 1
        heap[hole] = heap[child]
        hole = child
    if 2 * hole + 2 == size:
        heap[hole] = heap[size - 1]
        hole = size - 1
    return hole
