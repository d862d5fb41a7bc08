"""The part of the path that a controller follows, in the odom frame: see `PlanCut`."""

import math
from typing import Any

from vastflow.sim.kernels.numeric import inner, njit
from vastflow.sim.nav2.costmaps.window import Window
from vastflow.sim.world.motion import wrapped


@inner
def renew(p: Any, m: Any, path: Any) -> None:
    """A new path: it counts to its end, or to where it reverses first."""
    m.path_end = _inversion(path, 0, m.path_n) if p.plan_cut.to_inversion != 0 else m.path_n


@inner
def local_plan(p: Any, m: Any, window: Window, path: Any, out: Any) -> Any:
    """Write the local plan into `out` (A, 3), in the odom frame; return (points, yaw of the last).

    It is cut as `p.plan_cut` says; no point left is Nav2's INVALID_PATH. The first `m.path_n` rows of `path` (N, 3) are x, y, and yaw in the map's frame.
    """
    q = p.plan_cut
    m.path_i = _first(q, m, path)
    c, s = math.cos(m.map_odom_yaw), math.sin(m.map_odom_yaw)
    rows, columns = window.costs.shape
    n, along = 0, 0.0
    for i in range(m.path_i, m.path_end):
        if i > m.path_i:
            along += math.hypot(path[i, 0] - path[i - 1, 0], path[i, 1] - path[i - 1, 1])
        away = math.hypot(path[i, 0] - m.x, path[i, 1] - m.y)
        if along > q.ahead_m or away > q.around_m or n == out.shape[0]:
            break
        dx, dy = path[i, 0] - m.map_odom_x, path[i, 1] - m.map_odom_y
        x, y = c * dx + s * dy, c * dy - s * dx
        column, row = (x - window.place[0]) / window.place[2], (y - window.place[1]) / window.place[2]
        if q.in_window != 0 and (row < 0.0 or column < 0.0 or row >= rows or column >= columns):
            break
        out[n, 0], out[n, 1], out[n, 2] = x, y, wrapped(path[i, 2] - m.map_odom_yaw)
        n += 1
    end_yaw_rad = path[m.path_i + n - 1, 2] if n > 0 else 0.0
    # Nav2 goes on behind a reversal only after the plan up to it is cut once more.
    if m.path_end < m.path_n:
        x, y, yaw = path[m.path_end - 1, 0], path[m.path_end - 1, 1], path[m.path_end - 1, 2]
        if math.hypot(x - m.x, y - m.y) <= q.inversion_xy_m and abs(wrapped(yaw - m.yaw)) <= q.inversion_yaw_rad:
            m.path_i = m.path_end
            m.path_end = _inversion(path, m.path_i, m.path_n)
    return n, wrapped(end_yaw_rad - m.map_odom_yaw)


@njit
def cut_plan(parameters: Any, memory: Any, window: Window, path: Any, out: Any) -> int:
    """Return the number of poses of the local plan of a stack's first robot."""
    n, _ = local_plan(parameters[0], memory[0], window, path, out)
    return int(n)


@inner
def _inversion(path: Any, first: int, end: int) -> int:
    """Index after the first point where the path reverses, counted from `first`; `end` where it does not."""
    for i in range(first + 1, end - 1):
        before_x, before_y = path[i, 0] - path[i - 1, 0], path[i, 1] - path[i - 1, 1]
        after_x, after_y = path[i + 1, 0] - path[i, 0], path[i + 1, 1] - path[i, 1]
        if before_x * after_x + before_y * after_y < 0.0:
            return int(i + 1)
    return int(end)


@inner
def _first(q: Any, m: Any, path: Any) -> int:
    best, nearest, along, end = m.path_i, math.inf, 0.0, m.path_i
    while end < m.path_end:
        if end > m.path_i:
            along += math.hypot(path[end, 0] - path[end - 1, 0], path[end, 1] - path[end - 1, 1])
            if along > q.search_m:
                break
        away = math.hypot(path[end, 0] - m.x, path[end, 1] - m.y)
        if away < q.within_m:
            return int(end)
        # Nav2 takes the last of several that are equally near.
        if away <= nearest:
            nearest, best = away, end
        end += 1
    if q.within_m > 0.0:
        return int(end)
    return int(best - 1 if q.two_points != 0 and best == end - 1 and best > m.path_i else best)
