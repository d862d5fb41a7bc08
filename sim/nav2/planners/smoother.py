"""The ends of a smoothed path: Dubins curves that keep the headings the search had there (nav2_smac_planner)."""

import math
from typing import Any, Final

import numpy as np

from vastflow.sim.kernels.numeric import inner
from vastflow.sim.nav2.costmaps.inflation import INSCRIBED, UNKNOWN
from vastflow.sim.nav2.planners.curves import pose_on, shortest
from vastflow.sim.nav2.planners.search import center_cost

_LONGEST: Final = 2.0
"""Times the segment in whose place it comes: a longer curve has a loop in it."""
_SPANS: Final = (1.0, 2.0, math.pi, 2.0 * math.pi)
"""Lengths of a segment that an end may change, in least radii."""


@inner
def keep_ends(q: Any, costs: Any, points: Any, headings: Any) -> None:
    """Lead a smoothed segment from its first to its last heading, in place, by the shortest of `_SPANS`.

    Args:
        q: See `search_of`.
        points: (N, 2) in meters, without a cusp among them.
        headings: (N,) as the search had them (rad); those of the points as they are now after it.
    """
    first, last = headings[0], headings[-1]
    reversing = _align(points, headings)
    for k in range(2):
        _keep_end(q, costs, points, headings, k == 1, last if k == 1 else first, reversing)


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
def _keep_end(
    q: Any, costs: Any, points: Any, headings: Any, at_end: bool, heading_rad: float, reversing: bool
) -> None:
    radius_m, last = q.radius * q.resolution, points.shape[0] - 1
    best, shortest_m, original_m, tried = np.empty((0, 3)), math.inf, 0.0, 0
    for k in range(1, last + 1):
        here, before = (last - k, last - k + 1) if at_end else (k, k - 1)
        original_m += math.hypot(points[here, 0] - points[before, 0], points[here, 1] - points[before, 1])
        if original_m < radius_m * _SPANS[tried]:
            continue
        tried += 1
        near = last if at_end else 0
        near_end, far_end = (
            (points[near, 0], points[near, 1], heading_rad),
            (points[here, 0], points[here, 1], headings[here]),
        )
        begin, end = (near_end, far_end) if at_end == reversing else (far_end, near_end)
        length_m, poses = _curve(q, costs, begin, end, k, _LONGEST * original_m)
        if 0.0 < length_m < shortest_m:
            best, shortest_m = poses, length_m
        if tried == len(_SPANS):
            break
    count = best.shape[0]
    for k in range(count):
        pose, at = best[count - 1 - k if reversing else k], k + (last + 1 - count if at_end else 0)
        points[at, 0], points[at, 1], headings[at] = pose[0], pose[1], pose[2]


@inner
def _curve(q: Any, costs: Any, begin: Any, end: Any, intervals: int, longest_m: float) -> Any:
    """(length in meters, poses) of a curve between two poses; 0 if it is too long or its center collides."""
    radius_m, poses = q.radius * q.resolution, np.empty((intervals + 1, 3))
    dx, dy = (end[0] - begin[0]) / radius_m, (end[1] - begin[1]) / radius_m
    c, s = math.cos(begin[2]), math.sin(begin[2])
    curve = shortest(c * dx + s * dy, c * dy - s * dx, end[2] - begin[2], False)
    if curve[0] * q.radius * q.resolution > longest_m:
        return 0.0, poses
    length_m, x_m, y_m = 0.0, begin[0], begin[1]
    for k in range(intervals + 1):
        ahead, aside, turned, _ = pose_on(curve, k / intervals * curve[0])
        to_x_m = begin[0] + radius_m * (c * ahead - s * aside)
        to_y_m = begin[1] + radius_m * (s * ahead + c * aside)
        poses[k, 0], poses[k, 1], poses[k, 2] = to_x_m, to_y_m, begin[2] + turned
        column, row = (to_x_m - q.origin_x) / q.resolution, (to_y_m - q.origin_y) / q.resolution
        if center_cost(costs, column, row) >= INSCRIBED:
            return 0.0, poses
        length_m += math.hypot(to_x_m - x_m, to_y_m - y_m)
        x_m, y_m = to_x_m, to_y_m
    return length_m, poses


FEWEST_POINTS: Final = 10
"""A segment between two cusps of no more intervals than this stays as it is."""


@inner
def smooth(q: Any, costs: Any, points: Any, headings: Any) -> None:
    """Smooth a path in place between its cusps, and keep the headings at the ends.

    Args:
        points: (N, 2) in meters.
        headings: (N,) in radians; (0,) of a robot that turns on the spot, whose path is one segment whatever its turns are.
    """
    holonomic = headings.shape[0] == 0
    start = 0
    for end in range(1, points.shape[0]):
        if end < points.shape[0] - 1:
            before, after = points[end] - points[end - 1], points[end + 1] - points[end]
            if holonomic or before[0] * after[0] + before[1] * after[1] >= 0.0:
                continue
        if end - start > FEWEST_POINTS:
            segment = points[start : end + 1]
            done = 0
            while done <= q.refinements and _relax(q, costs, segment):
                done += 1
            if done > 0 and not holonomic:
                keep_ends(q, costs, segment, headings[start : end + 1])
        start = end


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
            column, row = (moved[i, 0] - q.origin_x) / q.resolution, (moved[i, 1] - q.origin_y) / q.resolution
            if INSCRIBED <= center_cost(costs, column, row) < UNKNOWN:
                return False
        points[:] = moved
    return True
