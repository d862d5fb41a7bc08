"""AMCL's sensor model: the likelihood field of a map, and the weights of particles given a scan."""

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vastflow.sim.kernels.arrays import exps
from vastflow.sim.kernels.numeric import inner, njit
from vastflow.sim.kernels.sincos import sincos
from vastflow.sim.nav2.amcl.particles import LANES, Cloud
from vastflow.sim.nav2.parameters.amcl import AmclParameters

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
    """Return the table of pz³ by the cell where a beam ends; off the map it has `FRAME` cells.

    The table's width is an odd multiple of `WIDTH`, so that its rows do not all begin in one part of the cache.

    pz = z_hit exp(-d² / 2σ²) + z_rand / range_max, d the distance to the wall the wavefront found for the cell; the cap
    off the map and where it found none.

    Args:
        range_max_m: Greatest usable range, see `usable_range_m`.
        dtype: float32 in the loop, float64 where the eighth digit counts.
    """
    squares = squared_distances(occupied, int(likelihood_max_dist_m / resolution_m))
    # A squared distance in cells is a whole number: the exponential is taken once for each number, not for each cell.
    distances_m = np.append(np.sqrt(np.arange(squares.max() + 1)) * resolution_m, likelihood_max_dist_m)
    pz = z_hit * exps(-(distances_m * distances_m) / (2 * sigma_hit_m * sigma_hit_m)) + z_rand / range_max_m
    east = FRAME - (squares.shape[1] + 2 * FRAME + WIDTH) % -(2 * WIDTH)
    framed = np.pad(squares, ((FRAME, FRAME), (FRAME, east)), constant_values=UNREACHED)
    # UNREACHED, which is -1, finds the last entry.
    # AMCL sums the cubes of the beams' probabilities in place of multiplying them, by its authors' ad hoc choice.
    cubed: NDArray[Any] = (pz * pz * pz).astype(dtype)[framed]
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
    """Sink the hole at the top of `size` entries and one more; return its place."""
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


OFF_MAP: Final = 1e7


@inner
def weigh(p: Any, n: int, ranges_m: Any, directions: Any, cubed: Any, cloud: Cloud) -> None:
    """Multiply the weights of `n` particles by 1 + Σ pz³ over the beams that AMCL uses.

    The cell of an end point is found by rounding: AMCL takes the map's origin as the center of cell 0.

    Args:
        ranges_m, directions: (B,) readings and (B, 2) unit vectors of their beams in the robot's frame.
        cubed: Table from `vastflow.sim.nav2.amcl.sensor.likelihood_cubed`.
    """
    weights, likelihoods = cloud.weights, cloud.likelihoods
    beams = _beam_points(p, ranges_m, directions, cloud.points)
    _frame(cloud.particles, cloud.headings, cloud.frames, n, 1.0 / p.resolution, p.origin_x, p.origin_y)
    _look_up(cloud.frames, n, cloud.points, beams, cubed, cloud.indices, cloud.unsigned, likelihoods)
    for k in range(n):
        weights[k] *= likelihoods[k]


@inner
def normalize(weights: Any, n: int) -> None:
    """Scale the first `n` weights to a sum of 1."""
    total = 0.0
    for k in range(n):
        total += weights[k]
    for k in range(n):
        weights[k] /= total


@inner
def _beam_points(p: Any, ranges_m: Any, directions: Any, out: Any) -> int:
    """End points (2, M) in the robot's frame, in cells, of the beams that AMCL uses; their number.

    Every ((B - 1) div (max_beams - 1))-th beam; a reading at or below the minimum counts as the maximum, and one at
    or above the maximum (or NaN) is skipped.
    """
    q = p.amcl
    range_min_m = max(p.range_min, q.laser_min_range) if q.laser_min_range > 0.0 else p.range_min
    range_max_m = min(p.range_max, q.laser_max_range) if q.laser_max_range > 0.0 else p.range_max
    # AMCL's integer division: with 360 beams and 60 asked for, every sixth, and the last ones are never used.
    step = max(1, (ranges_m.shape[0] - 1) // (q.max_beams - 1))
    n = 0
    for b in range(0, ranges_m.shape[0], step):
        reading = ranges_m[b]
        # AMCL takes a reading that is too short for one that met nothing, and skips those that met nothing.
        if reading <= range_min_m:
            reading = range_max_m
        if reading < range_max_m:
            out[0, n] = (p.mount_x + reading * directions[b, 0]) / p.resolution
            out[1, n] = (p.mount_y + reading * directions[b, 1]) / p.resolution
            n += 1
    return n


@inner
def _frame(
    particles: Any, headings: Any, frames: Any, n: int, per_cell: float, origin_x_m: float, origin_y_m: float
) -> None:
    for k in range(n):
        sine, cosine = sincos(particles[2, k])
        headings[0, k], headings[1, k] = cosine, sine
        # Half a cell for rounding.
        frames[0, k] = (particles[0, k] - origin_x_m) * per_cell + (FRAME + 0.5)
        frames[1, k] = (particles[1, k] - origin_y_m) * per_cell + (FRAME + 0.5)
        frames[2, k], frames[3, k] = cosine, sine


@inner
def _look_up(frames: Any, n: int, points: Any, beams: int, cubed: Any, indices: Any, unsigned: Any, found: Any) -> None:
    """Likelihoods of `n` particles, four beams at a time: where in the table they end, then what stands there.

    Beams are the outer loop, since all particles look a beam up in one part of the table.
    """
    flat, one, two, three, four = cubed.ravel(), unsigned[0], unsigned[1], unsigned[2], unsigned[3]
    # The last four are filled up with beams that end off the map for every particle.
    filled = (beams + LANES - 1) // LANES * LANES
    for b in range(beams, filled):
        points[0, b], points[1, b] = OFF_MAP, OFF_MAP
    for k in range(n):
        # The beams that fill up the last four are taken off again: each adds the cap off the map.
        found[k] = 1.0 - (filled - beams) * flat[0]
    room = _room(frames, n, cubed)
    for first in range(0, filled, LANES):
        for b in range(LANES):
            _locate(frames, n, points[0, first + b], points[1, first + b], room, cubed, indices[b])
        for k in range(n):
            found[k] += (flat[one[k]] + flat[two[k]]) + (flat[three[k]] + flat[four[k]])


@inner
def _room(frames: Any, n: int, cubed: Any) -> float:
    last_x, last_y = cubed.shape[1] - 1.0, cubed.shape[0] - 1.0
    room = last_x
    for k in range(n):
        x, y = frames[0, k], frames[1, k]
        room = min(room, min(min(x, last_x - x), min(y, last_y - y)))
    # A cell less, against rounding.
    return float(max(room - 1.0, 0.0))


@inner
def _locate(frames: Any, n: int, px: Any, py: Any, room: float, cubed: Any, indices: Any) -> None:
    """Write the table index of a beam's end point for each of `n` particles."""
    x, y, c, s = frames[0, :n], frames[1, :n], frames[2, :n], frames[3, :n]
    number = cubed.dtype.type
    # The width is a multiple of 64, so that its product with a row is exact in four bytes up to 2³⁰; a product of whole
    # numbers would take longer, for want of an instruction in SSE2.
    width = number(cubed.shape[1])
    # Where no particle's beam can leave the table its edges need not be tested, which is the usual case.
    if px * px + py * py < room * room:
        for k in range(n):
            column, row = x[k] + c[k] * px - s[k] * py, y[k] + s[k] * px + c[k] * py
            indices[k] = np.int32(number(np.int32(row)) * width) + np.int32(column)
    else:
        zero, last_x, last_y = number(0), number(cubed.shape[1] - 1), number(cubed.shape[0] - 1)
        for k in range(n):
            column = min(max(x[k] + c[k] * px - s[k] * py, zero), last_x)
            row = min(max(y[k] + s[k] * px + c[k] * py, zero), last_y)
            indices[k] = np.int32(number(np.int32(row)) * width) + np.int32(column)
