"""The ends of a smoothed path: Dubins curves that keep the headings the search had there (nav2_smac_planner)."""

import math
from typing import Any, Final

from vastflow.sim.kernels.numeric import inner
from vastflow.sim.nav2.costmaps.inflation import INSCRIBED, UNKNOWN
from vastflow.sim.nav2.planners.curves import pose_on, shortest
from vastflow.sim.nav2.planners.search import center_cost

_LONGEST: Final = 2.0
"""Times the segment in whose place it comes: a longer curve has a loop in it."""
_SPANS: Final = (1.0, 2.0, math.pi, 2.0 * math.pi)
"""How many least radii an end reaches into a segment."""


@inner
def keep_ends(q: Any, costs: Any, points: Any, headings: Any) -> None:
    """Lead a smoothed segment from its first heading and to its last one, in place.

    Each end reaches one of `_SPANS` into the segment, wherever the curve is the shortest.

    Args:
        q: See `search_of`.
        points: (N, 2) in meters, without a cusp among them.
        headings: (N,) as the search had them (rad); those of the points as they are now after it.
    """
    first, last = headings[0], headings[-1]
    reversing = _align(points, headings)
    for at_end in range(2):
        far = _far_end(q, costs, points, headings, at_end == 1, last if at_end == 1 else first, reversing)
        if far > 0:
            _lay(q, points, headings, at_end == 1, last if at_end == 1 else first, reversing, far)


@inner
def _align(points: Any, headings: Any) -> bool:
    """Point each heading but the last along the path, or against it where the robot reverses; whether it does."""
    along = math.atan2(points[2, 1] - points[1, 1], points[2, 0] - points[1, 0])
    reversing = math.cos(along - headings[1]) < 0.0
    for k in range(points.shape[0] - 1):
        dx, dy = points[k + 1, 0] - points[k, 0], points[k + 1, 1] - points[k, 1]
        if abs(dx) >= 1e-4 or abs(dy) >= 1e-4:
            headings[k] = math.atan2(-dy, -dx) if reversing else math.atan2(dy, dx)
    return bool(reversing)


@inner
def _far_end(q: Any, costs: Any, points: Any, headings: Any, at_end: bool, heading_rad: float, reversing: bool) -> int:
    """Return the number of points that the best curve at an end spans; 0 if none is free."""
    radius_m, last = q.radius * q.resolution, points.shape[0] - 1
    best, shortest_m, original_m, tried = 0, math.inf, 0.0, 0
    for k in range(1, last + 1):
        here, before = (last - k, last - k + 1) if at_end else (k, k - 1)
        original_m += math.hypot(points[here, 0] - points[before, 0], points[here, 1] - points[before, 1])
        if original_m < radius_m * _SPANS[tried]:
            continue
        tried += 1
        length_m = _free_length(q, costs, points, headings, at_end, heading_rad, reversing, k, original_m)
        if 0.0 < length_m < shortest_m:
            best, shortest_m = k, length_m
        if tried == len(_SPANS):
            break
    return best


@inner
def _ends(points: Any, headings: Any, at_end: bool, heading_rad: float, reversing: bool, far: int) -> Any:
    """((x, y, heading) where a curve begins, the same where it ends) as a robot drives it forward."""
    near_at, far_at = (points.shape[0] - 1, points.shape[0] - 1 - far) if at_end else (0, far)
    near_end = (points[near_at, 0], points[near_at, 1], heading_rad)
    far_end = (points[far_at, 0], points[far_at, 1], headings[far_at])
    return (near_end, far_end) if at_end == reversing else (far_end, near_end)


@inner
def _curve(q: Any, begin: Any, end: Any) -> Any:
    radius_m = q.radius * q.resolution
    dx, dy = (end[0] - begin[0]) / radius_m, (end[1] - begin[1]) / radius_m
    c, s = math.cos(begin[2]), math.sin(begin[2])
    return shortest(c * dx + s * dy, c * dy - s * dx, end[2] - begin[2], False)


@inner
def _point_on(q: Any, begin: Any, curve: Any, share: float) -> Any:
    """(x, y, heading) at a share of a curve's length."""
    radius_m = q.radius * q.resolution
    ahead, aside, turned, _ = pose_on(curve, share * curve[0])
    c, s = math.cos(begin[2]), math.sin(begin[2])
    return (
        begin[0] + radius_m * (c * ahead - s * aside),
        begin[1] + radius_m * (s * ahead + c * aside),
        begin[2] + turned,
    )


@inner
def _free_length(
    q: Any,
    costs: Any,
    points: Any,
    headings: Any,
    at_end: bool,
    heading_rad: float,
    reversing: bool,
    far: int,
    original_m: float,
) -> float:
    """Length of a drawn curve (m); 0 if it has a loop or its center collides."""
    begin, end = _ends(points, headings, at_end, heading_rad, reversing, far)
    curve = _curve(q, begin, end)
    if curve[0] * q.radius * q.resolution > _LONGEST * original_m:
        return 0.0
    length_m, x_m, y_m = 0.0, begin[0], begin[1]
    for k in range(far + 1):
        to_x_m, to_y_m, _ = _point_on(q, begin, curve, k / far)
        column, row = (to_x_m - q.origin_x) / q.resolution, (to_y_m - q.origin_y) / q.resolution
        if center_cost(costs, column, row) >= INSCRIBED:
            return 0.0
        length_m += math.hypot(to_x_m - x_m, to_y_m - y_m)
        x_m, y_m = to_x_m, to_y_m
    return length_m


@inner
def _lay(q: Any, points: Any, headings: Any, at_end: bool, heading_rad: float, reversing: bool, far: int) -> None:
    begin, end = _ends(points, headings, at_end, heading_rad, reversing, far)
    curve = _curve(q, begin, end)
    first = points.shape[0] - 1 - far if at_end else 0
    for k in range(far + 1):
        share = (far - k) / far if reversing else k / far
        points[first + k, 0], points[first + k, 1], headings[first + k] = _point_on(q, begin, curve, share)


FEWEST_POINTS: Final = 10
"""A segment between two cusps of no more intervals than this stays as it is."""


@inner
def smooth(q: Any, costs: Any, points: Any, headings: Any) -> None:
    """Smooth a path in place between its cusps, and keep the headings at the ends.

    Args:
        q: See `search_of`.
        costs: (H, W) global costmap.
        points: (N, 2) in meters.
        headings: (N,) in radians; (0,) of a robot that turns on the spot, whose path is one segment whatever its turns are.
    """
    holonomic = headings.shape[0] == 0
    start = 0
    for end in range(1, points.shape[0]):
        if end < points.shape[0] - 1 and (holonomic or not _is_cusp(points, end)):
            continue
        if end - start > FEWEST_POINTS:
            segment = points[start : end + 1]
            if _smooth_segment(q, costs, segment) and not holonomic:
                keep_ends(q, costs, segment, headings[start : end + 1])
        start = end


@inner
def _is_cusp(points: Any, k: int) -> bool:
    before_x, before_y = points[k, 0] - points[k - 1, 0], points[k, 1] - points[k - 1, 1]
    after_x, after_y = points[k + 1, 0] - points[k, 0], points[k + 1, 1] - points[k, 1]
    return bool(before_x * after_x + before_y * after_y < 0.0)


@inner
def _smooth_segment(q: Any, costs: Any, points: Any) -> bool:
    """Smooth, and then refine as long as that succeeds; whether the first of it did."""
    if not _relax(q, costs, points):
        return False
    for _ in range(q.refinements):
        if not _relax(q, costs, points):
            break
    return True


@inner
def _relax(q: Any, costs: Any, points: Any) -> bool:
    """Relax the inner points; true if they come to rest before a collision or the last iteration."""
    data, moved = points.copy(), points.copy()
    iterations, change = 0, q.smoother.tolerance
    while change >= q.smoother.tolerance:
        iterations += 1
        if iterations >= q.smoother.max_iterations:
            return False
        change = 0.0
        for i in range(1, points.shape[0] - 1):
            for axis in range(2):
                here = moved[i, axis]
                to = here + q.smoother.w_data * (data[i, axis] - here)
                to += q.smoother.w_smooth * (moved[i + 1, axis] + moved[i - 1, axis] - 2.0 * here)
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
