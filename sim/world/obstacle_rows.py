"""Obstacles as rows of numbers, which kernels read.

A row (7,) has x, y, cosine and sine of the yaw, half length, half width (m), and its shape: a `DISC` has its radius as half length
and a half width of 0. An absent obstacle is at `NOT_THERE`.
"""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vastflow.sim.model.elementary import cos_sin
from vastflow.sim.model.obstacle import Obstacle
from vastflow.sim.model.rates import TICK_S
from vastflow.sim.model.shape import Box, Disc

SHAPE: Final = 6
"""Column of the shape."""
DISC, BOX = 0.0, 1.0
NOT_THERE: Final = math.inf
"""Position of an obstacle that has not appeared yet."""


def obstacle_rows(obstacles: Sequence[Obstacle]) -> NDArray[np.float64]:
    """Return rows (K, 7); obstacles still to appear are at `NOT_THERE`."""
    rows = []
    for o in obstacles:
        x_m, y_m = (o.pose.x_m, o.pose.y_m) if o.trigger is None else (NOT_THERE, NOT_THERE)
        match o.shape:
            case Disc(radius_m):
                shape = radius_m, 0.0, DISC
            case Box(length_m, width_m):
                shape = length_m / 2, width_m / 2, BOX
        rows.append((x_m, y_m, *cos_sin(o.pose.yaw_rad), *shape))
    return np.array(rows, dtype=np.float64).reshape(-1, 7)


def outline_of(row: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the outline (N, 2) of a row's obstacle where it stands."""
    x_m, y_m, c, s, a, b, kind = row.tolist()
    shape = Disc(a) if kind == DISC else Box(2 * a, 2 * b)
    return np.array([(x_m + c * x - s * y, y_m + s * x + c * y) for x, y in shape.vertices_m])


def trigger_rows(obstacles: Sequence[Obstacle]) -> NDArray[np.float64]:
    """Return rows (K, 5) for `vastflow.sim.world.motion.Body`."""
    rows = [
        (0.0, 0.0, -1.0, 0.0, math.inf)
        if (t := o.trigger) is None
        else (t.x_m, t.y_m, t.distance_m, round(t.delay_s / TICK_S), math.inf)
        for o in obstacles
    ]
    return np.array(rows, dtype=np.float64).reshape(-1, 5)
