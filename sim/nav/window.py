"""The local costmap as the controller and the behaviors see it: a window of costs somewhere in the odom frame."""

import math
from typing import Any, NamedTuple

from vastflow.sim.kernels.numeric import inner
from vastflow.sim.nav.inflation import UNKNOWN


class Window(NamedTuple):
    """A rolling window.

    Attributes:
        costs: (R, C) uint8.
        place: (3,) float64: x, y of the lower left corner in the odom frame, and the resolution, in meters.
    """

    costs: Any
    place: Any


@inner
def cost_at(window: Window, x_m: float, y_m: float) -> int:
    """Cost at a point of the odom frame; unknown outside the window."""
    column = math.floor((x_m - window.place[0]) / window.place[2])
    row = math.floor((y_m - window.place[1]) / window.place[2])
    if row < 0 or column < 0 or row >= window.costs.shape[0] or column >= window.costs.shape[1]:
        return UNKNOWN
    return int(window.costs[row, column])
