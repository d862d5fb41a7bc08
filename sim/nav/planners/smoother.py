"""The smoother of the Smac planners: each point is drawn toward its neighbors, and back to where the search had it."""

import math
from typing import Any, Final

from vastflow.sim.kernels.numeric import inner
from vastflow.sim.nav.inflation import INSCRIBED, UNKNOWN
from vastflow.sim.nav.planners.ends import keep_ends

FEWEST_POINTS: Final = 10
"""A stretch between two cusps of no more intervals than this stays as it is."""


@inner
def smooth(q: Any, costs: Any, points: Any, headings: Any) -> None:
    """Smooth a path in place, stretch by stretch between the points where it reverses, and keep the headings at their ends.

    Args:
        q: `Search`.
        costs: (H, W) global costmap.
        points: (N, 2) in meters.
        headings: (N,) in radians; (0,) of a robot that turns on the spot, whose path is one stretch whatever its turns are.
    """
    holonomic = headings.shape[0] == 0
    start = 0
    for end in range(1, points.shape[0]):
        if end < points.shape[0] - 1 and (holonomic or not _is_cusp(points, end)):
            continue
        if end - start > FEWEST_POINTS:
            stretch = points[start : end + 1]
            if _smooth_stretch(q, costs, stretch) and not holonomic:
                keep_ends(q, costs, stretch, headings[start : end + 1])
        start = end


@inner
def _is_cusp(points: Any, k: int) -> bool:
    before_x, before_y = points[k, 0] - points[k - 1, 0], points[k, 1] - points[k - 1, 1]
    after_x, after_y = points[k + 1, 0] - points[k, 0], points[k + 1, 1] - points[k, 1]
    return bool(before_x * after_x + before_y * after_y < 0.0)


@inner
def _smooth_stretch(q: Any, costs: Any, points: Any) -> bool:
    """Smooth, and then refine as long as that succeeds; whether the first of it did."""
    if not _relax(q, costs, points):
        return False
    for _ in range(q.refinements):
        if not _relax(q, costs, points):
            break
    return True


@inner
def _relax(q: Any, costs: Any, points: Any) -> bool:
    """Move the inner points until they rest; whether they did, and not before one was in an obstacle or the patience at its end."""
    data, moved = points.copy(), points.copy()
    iterations, change = 0, q.smoother_tolerance
    while change >= q.smoother_tolerance:
        iterations += 1
        if iterations >= q.smoother_iterations:
            return False
        change = 0.0
        for i in range(1, points.shape[0] - 1):
            for axis in range(2):
                here = moved[i, axis]
                to = here + q.w_data * (data[i, axis] - here)
                to += q.w_smooth * (moved[i + 1, axis] + moved[i - 1, axis] - 2.0 * here)
                moved[i, axis] = to
                change += abs(to - here)
            cost = _cost_at(q, costs, moved[i, 0], moved[i, 1])
            if INSCRIBED <= cost < UNKNOWN:
                return False
        points[:] = moved
    return True


@inner
def _cost_at(q: Any, costs: Any, x_m: float, y_m: float) -> int:
    column = math.floor((x_m - q.origin_x) / q.resolution)
    row = math.floor((y_m - q.origin_y) / q.resolution)
    if row < 0 or column < 0 or row >= costs.shape[0] or column >= costs.shape[1]:
        return int(UNKNOWN)
    return int(costs[row, column])
