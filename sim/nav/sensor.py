"""AMCL's sensor model: what a scan says of each particle's pose by the likelihood field (`likelihood_field`)."""

from typing import Any, Final

import numpy as np

from vastflow.sim.kernels.numeric import inner
from vastflow.sim.kernels.sincos import sincos
from vastflow.sim.nav.likelihood import FRAME
from vastflow.sim.nav.particles import LANES, Cloud

OFF_MAP: Final = 1e7


@inner
def weigh(p: Any, n: int, ranges_m: Any, directions: Any, cubed: Any, cloud: Cloud) -> None:
    """Multiply the weights of `n` particles by 1 + Σ pz³ over the beams that AMCL uses.

    The cell of an end point is found by rounding: AMCL takes the map's origin as the center of cell 0.

    Args:
        ranges_m, directions: (B,) readings and (B, 2) unit vectors of their beams in the robot's frame.
        cubed: Table from `vastflow.sim.nav.likelihood.likelihood_cubed`.
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
    step = max(1, (ranges_m.shape[0] - 1) // (q.max_beams - 1))
    n = 0
    for b in range(0, ranges_m.shape[0], step):
        reading = ranges_m[b]
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
    """Where particles are in the table, and how they are turned."""
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
        found[k] = 1.0 - (filled - beams) * flat[0]
    room = _room(frames, n, cubed)
    for first in range(0, filled, LANES):
        for b in range(LANES):
            _locate(frames, n, points[0, first + b], points[1, first + b], room, cubed, indices[b])
        for k in range(n):
            found[k] += (flat[one[k]] + flat[two[k]]) + (flat[three[k]] + flat[four[k]])


@inner
def _room(frames: Any, n: int, cubed: Any) -> float:
    """How many cells the table goes on round all particles."""
    last_x, last_y = cubed.shape[1] - 1.0, cubed.shape[0] - 1.0
    room = last_x
    for k in range(n):
        x, y = frames[0, k], frames[1, k]
        room = min(room, min(min(x, last_x - x), min(y, last_y - y)))
    # A cell less, against rounding.
    return float(max(room - 1.0, 0.0))


@inner
def _locate(frames: Any, n: int, px: Any, py: Any, room: float, cubed: Any, indices: Any) -> None:
    """Where in the table the beam to a point ends, for each of `n` particles."""
    x, y, c, s = frames[0, :n], frames[1, :n], frames[2, :n], frames[3, :n]
    number = cubed.dtype.type
    # The width is a multiple of 64, so that its product with a row is exact in four bytes up to 2³⁰; a product of whole
    # numbers would take longer, for want of an instruction in SSE2.
    width = number(cubed.shape[1])
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
