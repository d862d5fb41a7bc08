"""The laser scanner: exact ranges to the map's walls and to obstacles, and the seam to its noise."""

import math
from typing import Any, Final

import numba
import numpy as np
from numba import types
from numpy.typing import NDArray

from vastflow.sim.kernels.binding import Bound, Running, Seam, calling, forwarding
from vastflow.sim.kernels.numeric import inner, njit
from vastflow.sim.world.bodies import DISC as DISC_PART
from vastflow.sim.world.noise import LidarNoise, Scan
from vastflow.sim.world.obstacle_rows import DISC, SHAPE
from vastflow.sim.world.skip_table import SkipTable, range_to_part, ranges_to_walls


@njit
def scan(
    skips: SkipTable,
    resolution_m: float,
    origin_x_m: float,
    origin_y_m: float,
    obstacles: Any,
    sensor_xyt: Any,
    directions: Any,
    range_min_m: float,
    range_max_m: float,
    out_m: Any,
) -> None:
    """Write a noiseless scan into `out_m` (B,); `inf` where a beam meets nothing.

    Args:
        skips: Skip table of the map's walls.
        obstacles: (K, 7) float64, see `vastflow.sim.world.obstacle_rows`.
        sensor_xyt: (3,) sensor position in the map and the robot's yaw.
        directions: (B, 2) beams in the robot's frame, evenly spaced counter-clockwise over one turn at the most.
    """
    c, s = math.cos(sensor_xyt[2]), math.sin(sensor_xyt[2])
    x_m, y_m = sensor_xyt[0], sensor_xyt[1]
    x_cells, y_cells = (x_m - origin_x_m) / resolution_m, (y_m - origin_y_m) / resolution_m
    turned = np.empty_like(directions)
    for b in range(directions.shape[0]):
        turned[b, 0] = c * directions[b, 0] - s * directions[b, 1]
        turned[b, 1] = s * directions[b, 0] + c * directions[b, 1]
    start, end = range_min_m / resolution_m, range_max_m / resolution_m
    spacing = _spacing(turned)
    if not _see_discs(skips, x_cells, y_cells, turned, spacing, start, end, out_m):
        ranges_to_walls(skips, x_cells, y_cells, turned, start, end, out_m)
    for b in range(directions.shape[0]):
        out_m[b] *= resolution_m
    for k in range(obstacles.shape[0]):
        _see_obstacle(obstacles[k], x_m, y_m, turned, spacing, range_min_m, range_max_m, out_m)


@inner
def _see_discs(
    skips: SkipTable, x: float, y: float, directions: Any, spacing: float, start: float, end: float, out: Any
) -> bool:
    """Write the ranges to discs, where nothing else stands, as `ranges_to_walls` has them: by the beams toward each.

    Returns:
        False where nothing is written: others stand there, or a beam might begin in a disc.
    """
    parts = skips.parts
    out[:] = math.inf
    for k in range(skips.discs):
        ox, oy, radius = parts[k, 1] - x, parts[k, 2] - y, parts[k, 3]
        if math.sqrt(ox * ox + oy * oy) <= radius + start + 1.0:
            return False
        for turn in range(2):
            first, last = _toward(directions, spacing, ox, oy, radius, turn)
            for b in range(first, last + 1):
                dx, dy = directions[b, 0], directions[b, 1]
                hit = range_to_part(DISC_PART, ox, oy, radius, 0.0, x, y, dx, dy, start)
                if hit < end:
                    out[b] = min(out[b], hit)
    return skips.discs > 0


@inner
def _see_obstacle(
    obstacle: Any,
    x_m: float,
    y_m: float,
    directions: Any,
    spacing: float,
    range_min_m: float,
    range_max_m: float,
    out_m: Any,
) -> None:
    """Shorten the beams that meet an obstacle; only beams toward its circumcircle are tested."""
    ox, oy = obstacle[0] - x_m, obstacle[1] - y_m
    reach = math.sqrt(obstacle[4] * obstacle[4] + obstacle[5] * obstacle[5])
    if not math.sqrt(ox * ox + oy * oy) - reach < range_max_m:
        return
    for turn in range(2):
        first, last = _toward(directions, spacing, ox, oy, reach, turn)
        for b in range(first, last + 1):
            hit = range_to_obstacle(obstacle, x_m, y_m, directions[b, 0], directions[b, 1], range_min_m)
            if hit < range_max_m:
                out_m[b] = min(out_m[b], hit)


@inner
def _spacing(directions: Any) -> float:
    """Return the angle from one beam to the next."""
    if directions.shape[0] < 2:
        return 2.0 * math.pi
    fx, fy, sx, sy = directions[0, 0], directions[0, 1], directions[1, 0], directions[1, 1]
    return math.atan2(fx * sy - fy * sx, fx * sx + fy * sy)


@inner
def _toward(directions: Any, spacing: float, ox: float, oy: float, reach: float, turn: int) -> Any:
    """Return the first and last beam that may come within `reach` of a place.

    Beams lie from 0 to a turn behind the first one, bearings within half a turn of it.

    Args:
        turn: 0 or 1; both are to be asked for.
    """
    away = math.sqrt(ox * ox + oy * oy)
    bearing, half = 0.0, 2.0 * math.pi
    if directions.shape[0] > 1 and away > reach:
        fx, fy = directions[0, 0], directions[0, 1]
        bearing = math.atan2(fx * oy - fy * ox, fx * ox + fy * oy) + turn * 2.0 * math.pi
        half = math.asin(reach / away) + spacing
    first, last = (bearing - half) / spacing, (bearing + half) / spacing
    return max(0, math.floor(first)), min(directions.shape[0] - 1, math.ceil(last))


@njit
def range_to_obstacle(obstacle: Any, x_m: float, y_m: float, dx: float, dy: float, start_m: float) -> float:
    """Return the distance along a beam to an obstacle (row as in `scan`) from `start_m` on, or `inf`."""
    ox, oy = obstacle[0] - x_m, obstacle[1] - y_m
    along, across = ox * dx + oy * dy, ox * dy - oy * dx
    reach = math.sqrt(obstacle[4] * obstacle[4] + obstacle[5] * obstacle[5])
    if abs(across) > reach or along < -reach:
        return np.inf
    if obstacle[SHAPE] == DISC:
        half = math.sqrt(max(obstacle[4] * obstacle[4] - across * across, 0.0))
        near, far = along - half, along + half
    else:
        c, s = obstacle[2], obstacle[3]
        px, py = -(ox * c + oy * s), -(oy * c - ox * s)
        ux, uy = dx * c + dy * s, dy * c - dx * s
        near, far = -np.inf, np.inf
        for axis in range(2):
            p, u, half = (px, ux, obstacle[4]) if axis == 0 else (py, uy, obstacle[5])
            if u == 0.0:
                if abs(p) > half:
                    return np.inf
            else:
                a, b = (-half - p) / u, (half - p) / u
                near, far = max(near, min(a, b)), min(far, max(a, b))
        if near > far:
            return np.inf
    if far < start_m:
        return np.inf
    return float(max(near, start_m))


_GIVEN: Final = numba.typeof(Scan(np.zeros(1), np.zeros((1, 2)), 0.0, 0.0))
_call: Final = calling(types.none, _GIVEN)
_forward: Final = forwarding(0, types.none, _GIVEN)


def _perturb_entry(layout: Any, given: Any) -> None:
    _forward(layout, given)


_NOISE: Final = Seam("perturb", _GIVEN, lambda found: bool(found == types.none), "nothing", perturb=_perturb_entry)


def running_noise(noise: LidarNoise, stream: NDArray[np.uint64], beams: int) -> Running[LidarNoise]:
    """Return noise with the memory of one run; raises `ContractError` as `Seam.running` does."""
    return _NOISE.running(noise, noise.memory(stream, beams))


@inner
def perturb(noise: Bound, given: Scan) -> None:
    """Change the ranges of a scan by the noise; the loop calls it."""
    _call(noise.entries[0], noise.table, given)
