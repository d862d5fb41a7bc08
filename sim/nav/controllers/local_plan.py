"""The part of the plan that a controller follows: pruned behind the robot, cut ahead, in the odom frame."""

import math
from typing import Any

from vastflow.sim.kernels.numeric import inner
from vastflow.sim.nav.window import Window
from vastflow.sim.world.robot import wrapped


@inner
def local_plan(p: Any, m: Any, window: Window, path: Any, out: Any) -> Any:
    """Write the local plan into `out` (A, 2): (number of points, yaw of the last one).

    The point nearest to the robot is sought on the first stretch of what is left of the path, half the local costmap's edge
    long, and what lies before it is forgotten. The plan goes on from there for the controller's prune distance, at the most
    to the first point outside the local costmap. No point left is Nav2's INVALID_PATH.
    """
    resolution = window.place[2]
    rows, columns = window.costs.shape
    search_m = 0.5 * resolution * max(rows, columns)
    nearest, best, along = math.inf, m.path_i, 0.0
    for i in range(m.path_i, m.path_n):
        if i > m.path_i:
            along += math.hypot(path[i, 0] - path[i - 1, 0], path[i, 1] - path[i - 1, 1])
            if along > search_m:
                break
        away = math.hypot(path[i, 0] - m.x, path[i, 1] - m.y)
        if away < nearest:
            nearest, best = away, i
    m.path_i = best
    c, s = math.cos(m.map_odom_yaw), math.sin(m.map_odom_yaw)
    n, along, last = 0, 0.0, best
    for i in range(best, m.path_n):
        if i > best:
            along += math.hypot(path[i, 0] - path[i - 1, 0], path[i, 1] - path[i - 1, 1])
        if along > p.plan_ahead or n == out.shape[0]:
            break
        dx, dy = path[i, 0] - m.map_odom_x, path[i, 1] - m.map_odom_y
        x, y = c * dx + s * dy, c * dy - s * dx
        column, row = (x - window.place[0]) / resolution, (y - window.place[1]) / resolution
        if row < 0.0 or column < 0.0 or row >= rows or column >= columns:
            break
        out[n, 0], out[n, 1] = x, y
        n += 1
        last = i
    # NavFn gives every pose but the goal's the map's own heading.
    end_yaw_rad = m.goal_yaw if last == m.path_n - 1 else 0.0
    return n, wrapped(end_yaw_rad - m.map_odom_yaw)
