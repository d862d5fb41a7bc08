"""The part of the path that a controller follows, in the odom frame: see `PlanCut`."""

import math
from typing import Any

from vastflow.sim.kernels.numeric import inner
from vastflow.sim.nav.window import Window
from vastflow.sim.world.robot import wrapped


@inner
def local_plan(p: Any, m: Any, window: Window, path: Any, out: Any) -> Any:
    """Write the local plan into `out` (A, 2) as `p.plan_cut` says: (number of points, yaw of the last one).

    No point left is Nav2's INVALID_PATH.
    """
    q = p.plan_cut
    m.path_i = _first(q, m, path)
    c, s = math.cos(m.map_odom_yaw), math.sin(m.map_odom_yaw)
    rows, columns = window.costs.shape
    n, along = 0, 0.0
    for i in range(m.path_i, m.path_n):
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
        out[n, 0], out[n, 1] = x, y
        n += 1
    # NavFn gives every pose but the goal's the map's own heading.
    end_yaw_rad = m.goal_yaw if m.path_i + n == m.path_n else 0.0
    return n, wrapped(end_yaw_rad - m.map_odom_yaw)


@inner
def _first(q: Any, m: Any, path: Any) -> int:
    """Index of the point that the local plan begins with."""
    best, nearest, along, end = m.path_i, math.inf, 0.0, m.path_i
    while end < m.path_n:
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
