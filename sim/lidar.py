"""The laser scanner: exact ranges to the map's walls and to obstacles, then the perturbations of a study.

A beam leaps over the empty disc round its point (from the map's distance transform) and walks cell by cell
only near walls, so a range is exact to floating point whatever the map (measured ~40 µs for 360 beams).
"""

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from vastflow.sim.numeric import inner, njit
from vastflow.sim.streams import integer_below, normal_pair

BEAMS: Final = 360
WALL: Final = 255
MAX_LEAP: Final = 254


@dataclass(frozen=True, slots=True)
class Lidar:
    """The scanner of the minimal TurtleBot 4 model (Nav2's simulation, RPLIDAR).

    Attributes:
        mount_xyt: Pose on the robot (m, m, rad).
        range_min_m, range_max_m: Readings lie in [min, max); beyond there is no return (inf).
    """

    beams: int = BEAMS
    angle_min_rad: float = 0.0
    angle_increment_rad: float = 6.28 / 359
    range_min_m: float = 0.164
    range_max_m: float = 20.0
    rate_hz: float = 10.0
    mount_xyt: tuple[float, float, float] = (-0.04, 0.0, math.pi / 2)

    def directions(self) -> NDArray[np.float64]:
        """(beams, 2) unit vectors of the beams in the robot's frame."""
        bearings_rad = self.mount_xyt[2] + self.angle_min_rad + self.angle_increment_rad * np.arange(self.beams)
        return np.column_stack([np.cos(bearings_rad), np.sin(bearings_rad)])


def leap_table(occupied: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Whole cells (H, W) that a beam may leap from anywhere in a cell without passing a wall; WALL where one is.

    The least distance between points of two cells is that of the one's centre to the nearest centre among the other and
    its eight neighbours. One byte a cell, since the table is read all over the map and has to stay in the cache.
    """
    if not occupied.any():
        return np.full(occupied.shape, MAX_LEAP, dtype=np.uint8)
    near = ndimage.binary_dilation(occupied, structure=np.ones((3, 3)))
    leap: NDArray[np.uint8] = np.clip(np.floor(ndimage.distance_transform_edt(~near)), 0, MAX_LEAP).astype(np.uint8)
    leap[occupied] = WALL
    return leap


@njit
def range_to_wall(leap: Any, x_cells: float, y_cells: float, dx: float, dy: float, start: float, end: float) -> float:
    """Distance in cells along a beam to the first occupied cell, `inf` when there is none before `end`.

    Args:
        leap: (H, W) uint8 from `leap_table`.
        x_cells, y_cells: Origin in cell units from the map's lower left corner.
        dx, dy: Unit direction.
        start: Nearer than this nothing is seen.
    """
    rows, columns = leap.shape
    inverse_x = 1.0 / dx if dx != 0.0 else np.inf
    inverse_y = 1.0 / dy if dy != 0.0 else np.inf
    t = start
    while t < end:
        x, y = x_cells + t * dx, y_cells + t * dy
        column, row = math.floor(x), math.floor(y)
        if row < 0 or column < 0 or row >= rows or column >= columns:
            # Outside the grid nothing is known to stand; go to where the beam enters it, if it still does.
            enter = _entry(x_cells, y_cells, inverse_x, inverse_y, dx, dy, rows, columns)
            if enter < t:
                return np.inf
            t = enter + 1e-9
            continue
        here = leap[row, column]
        if here == WALL:
            return t
        if here > 0:
            t += here
            continue
        next_x = (column + (1 if dx > 0.0 else 0) - x_cells) * inverse_x if dx != 0.0 else np.inf
        next_y = (row + (1 if dy > 0.0 else 0) - y_cells) * inverse_y if dy != 0.0 else np.inf
        step_column, step_row = (1 if dx > 0.0 else -1), (1 if dy > 0.0 else -1)
        # A beam along a border may be looked up on the side it has left: the crossing then lies behind, and t never goes back.
        while True:
            if next_x < next_y:
                t = max(t, next_x)
                next_x += abs(inverse_x)
                column += step_column
            else:
                t = max(t, next_y)
                next_y += abs(inverse_y)
                row += step_row
            # Who leaves the grid never comes back; looking the point up again might round it inside for ever.
            if t >= end or row < 0 or column < 0 or row >= rows or column >= columns:
                return np.inf
            here = leap[row, column]
            if here == WALL:
                return t
            if here > 0:
                t += here
                break
    return np.inf


@inner
def _entry(
    x: float, y: float, inverse_x: float, inverse_y: float, dx: float, dy: float, rows: int, columns: int
) -> float:
    near, far = -np.inf, np.inf
    if dx != 0.0:
        a, b = -x * inverse_x, (columns - x) * inverse_x
        near, far = max(near, min(a, b)), min(far, max(a, b))
    elif x < 0.0 or x >= columns:
        return np.inf
    if dy != 0.0:
        a, b = -y * inverse_y, (rows - y) * inverse_y
        near, far = max(near, min(a, b)), min(far, max(a, b))
    elif y < 0.0 or y >= rows:
        return np.inf
    return near if near < far else -np.inf


@njit
def scan(
    leap: Any,
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
    """One noiseless scan into `out_m` (B,); `inf` where a beam meets nothing.

    Args:
        obstacles: (K, 6) float64 rows x, y, cos yaw, sin yaw, half length, half width in metres; a half width
            of 0 makes a cylinder of radius half length.
        sensor_xyt: (3,) sensor position in the map and the robot's yaw.
        directions: (B, 2) beams in the robot's frame.
    """
    c, s = math.cos(sensor_xyt[2]), math.sin(sensor_xyt[2])
    x_m, y_m = sensor_xyt[0], sensor_xyt[1]
    x_cells, y_cells = (x_m - origin_x_m) / resolution_m, (y_m - origin_y_m) / resolution_m
    for b in range(directions.shape[0]):
        dx = c * directions[b, 0] - s * directions[b, 1]
        dy = s * directions[b, 0] + c * directions[b, 1]
        nearest = resolution_m * range_to_wall(
            leap, x_cells, y_cells, dx, dy, range_min_m / resolution_m, range_max_m / resolution_m
        )
        for k in range(obstacles.shape[0]):
            hit = range_to_obstacle(obstacles[k], x_m, y_m, dx, dy, range_min_m)
            nearest = min(nearest, hit)
        out_m[b] = nearest if nearest < range_max_m else np.inf


@njit
def range_to_obstacle(obstacle: Any, x_m: float, y_m: float, dx: float, dy: float, start_m: float) -> float:
    """Distance along a beam to a box or cylinder (row as in `scan`), `inf` when it is missed or nearer than `start_m`."""
    ox, oy = obstacle[0] - x_m, obstacle[1] - y_m
    along, across = ox * dx + oy * dy, ox * dy - oy * dx
    reach = math.sqrt(obstacle[4] * obstacle[4] + obstacle[5] * obstacle[5])
    if abs(across) > reach or along < -reach:
        return np.inf
    if obstacle[5] == 0.0:
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


@njit
def perturb(ranges_m: Any, stream: Any, dropout: float, noise_m: float, order: Any) -> None:
    """Dropout, then noise, in place, as the paper's relay between simulator and Nav2 does.

    Exactly `int(B * dropout)` distinct beams, chosen anew each scan, become `inf`; then every beam gets
    independent Gaussian noise of standard deviation `noise_m`, not clipped to the sensor's limits.

    Args:
        order: (B,) int64 scratch.
    """
    beams = ranges_m.shape[0]
    dropped = int(beams * dropout)
    if dropped > 0:
        for b in range(beams):
            order[b] = b
        for k in range(dropped):
            other = k + integer_below(stream, beams - k)
            order[k], order[other] = order[other], order[k]
            ranges_m[order[k]] = np.inf
    if noise_m > 0.0:
        for b in range(0, beams, 2):
            first, second = normal_pair(stream)
            ranges_m[b] += noise_m * first
            if b + 1 < beams:
                ranges_m[b + 1] += noise_m * second
