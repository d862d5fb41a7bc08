"""The global plan: NavFn legs through the goals that remain, replanned at 1 Hz.

The potential is rooted at the next goal and kept from one replanning to the next: then only the path is drawn anew,
from where the robot is. The flood is repeated when the costs along the path rose, when the robot left what
was flooded, when the goal changed, and after 5 s if an obstacle between robot and goal went. Costs that rose elsewhere
can't make another path better than this one.
"""

import math
from typing import Any, Final

from vastflow.sim.nav.navfn import NEUTRAL, OBSTACLE, UNREACHED, descend, propagate
from vastflow.sim.nav.state import NAVIGATE_THROUGH_POSES, TICK_S, Grids, Route
from vastflow.sim.numeric import inner

START_OUTSIDE, GOAL_OUTSIDE, NO_VALID_PATH = 203, 204, 208
"""Nav2's error codes of ComputePathToPose; those of ComputePathThroughPoses are 100 greater."""

PASSED_M: Final = 0.7
"""RemovePassedGoals' radius in the through-poses tree."""

REFRESH_TICKS: Final = round(5.0 / TICK_S)

CHANGE_TOLERANCE: Final = 0.05
"""Share by which the summed cost along the path may rise before the flood is repeated."""


@inner
def plan(p: Any, m: Any, g: Grids, route: Route) -> int:
    """Plan from the estimate through the remaining goals into `path`: 0, or ComputePathToPose's error code."""
    last = m.goal
    if p.mission == NAVIGATE_THROUGH_POSES:
        last = route.goals.shape[0] - 1
        while m.goal < last and math.hypot(route.goals[m.goal, 0] - m.x, route.goals[m.goal, 1] - m.y) <= PASSED_M:
            m.goal += 1
    column, row = cell(p, m.x, m.y)
    if not on_map(g.travel, column, row):
        return START_OUTSIDE
    for k in range(m.goal, last + 1):
        goal_column, goal_row = cell(p, route.goals[k, 0], route.goals[k, 1])
        if not on_map(g.travel, goal_column, goal_row):
            return GOAL_OUTSIDE
    if not inside(g.travel, column, row):
        return NO_VALID_PATH
    n = 0
    if m.planned_goal == m.goal and not _stale(p, m, g, route.path, column, row):
        n = descend(g.potential, g.travel, float(column), float(row), m.root_column, m.root_row, route.leg)
    if n == 0:
        m.planned_goal = -1
        # Legs beyond the next goal do not depend on the robot; they are flooded first, so that the
        # potential which stays is the next goal's.
        if not _plan_tail(p, m, g, route, last):
            return NO_VALID_PATH
        n = _flood_leg(p, m, g, route.leg, column, row, route.goals[m.goal, 0], route.goals[m.goal, 1])
        if n == 0:
            return NO_VALID_PATH
        m.planned_goal = m.goal
        m.flooded_tick = m.tick
        m.dirty = 0
        for r in range(g.travel.shape[0]):
            for c in range(g.travel.shape[1]):
                g.flooded[r, c] = g.travel[r, c]
    m.path_n = _to_map(p, route.leg, n, m.end_x, m.end_y, route.path, 0)
    if m.tail_n == 0:
        m.goal_x, m.goal_y = m.end_x, m.end_y
    for i in range(m.tail_n):
        route.path[m.path_n, 0], route.path[m.path_n, 1] = route.tail[i, 0], route.tail[i, 1]
        m.path_n += 1
    m.goal_yaw = route.goals[last, 2]
    m.path_i = 0
    m.latched = 0
    return 0


@inner
def _plan_tail(p: Any, m: Any, g: Grids, route: Route, last: int) -> bool:
    m.tail_n = 0
    for k in range(m.goal + 1, last + 1):
        column, row = cell(p, route.goals[k - 1, 0], route.goals[k - 1, 1])
        n = (
            _flood_leg(p, m, g, route.leg, column, row, route.goals[k, 0], route.goals[k, 1])
            if inside(g.travel, column, row)
            else 0
        )
        if n == 0 or m.tail_n + n + 1 + route.leg.shape[0] > route.path.shape[0]:
            return False
        m.tail_n = _to_map(p, route.leg, n, m.end_x, m.end_y, route.tail, m.tail_n)
        m.goal_x, m.goal_y = m.end_x, m.end_y
    return True


@inner
def cell(p: Any, x_m: float, y_m: float) -> Any:
    """NavFn's (column, row) of a point: rounded, so its paths lie half a cell off the costmap's cells."""
    resolution = p.resolution
    return (
        math.floor((x_m - p.origin_x) / resolution + 0.5),
        math.floor((y_m - p.origin_y) / resolution + 0.5),
    )


@inner
def on_map(travel: Any, column: int, row: int) -> bool:
    """Whether a cell is one of the map's."""
    return column >= 0 and row >= 0 and column < travel.shape[1] and row < travel.shape[0]


@inner
def inside(travel: Any, column: int, row: int) -> bool:
    """Whether a cell lies within the map's outermost cells, which NavFn never enters."""
    return column > 0 and row > 0 and column < travel.shape[1] - 1 and row < travel.shape[0] - 1


@inner
def _flood_leg(p: Any, m: Any, g: Grids, leg: Any, column: int, row: int, goal_x_m: float, goal_y_m: float) -> int:
    """Path from a cell to a goal into `leg`, in cell units; 0 points when there is none.

    A goal in an obstacle is replaced by the reachable cell nearest to it within NavFn's `tolerance`.
    """
    goal_column, goal_row = cell(p, goal_x_m, goal_y_m)
    m.end_x, m.end_y = goal_x_m, goal_y_m
    before = g.travel[row, column]
    g.travel[row, column] = NEUTRAL
    found = inside(g.travel, goal_column, goal_row) and g.travel[goal_row, goal_column] < OBSTACLE
    if not found:
        propagate(g.travel, column, row, -1, -1, g.potential, g.scratch)
        reach = int(p.planner.tolerance / p.resolution)
        nearest = math.inf
        best_column, best_row = goal_column, goal_row
        for r in range(goal_row - reach, goal_row + reach + 1):
            for c in range(goal_column - reach, goal_column + reach + 1):
                away = math.hypot(c - goal_column, r - goal_row)
                if inside(g.travel, c, r) and g.potential[r, c] < UNREACHED and away < nearest:
                    nearest, best_column, best_row, found = away, c, r, True
        goal_column, goal_row = best_column, best_row
        m.end_x = p.origin_x + goal_column * p.resolution
        m.end_y = p.origin_y + goal_row * p.resolution
    n = 0
    if found and propagate(g.travel, goal_column, goal_row, column, row, g.potential, g.scratch):
        m.root_column, m.root_row = goal_column, goal_row
        n = descend(g.potential, g.travel, float(column), float(row), goal_column, goal_row, leg)
    g.travel[row, column] = before
    return n


@inner
def _to_map(p: Any, leg: Any, n: int, end_x_m: float, end_y_m: float, out: Any, at: int) -> int:
    """Put `leg` behind `out[:at]` in metres, ending at the exact goal; the number of points then there."""
    resolution = p.resolution
    for i in range(n):
        out[at + i, 0] = p.origin_x + leg[i, 0] * resolution
        out[at + i, 1] = p.origin_y + leg[i, 1] * resolution
    end = at + n
    if n > 1:
        last, before = out[end - 1], out[end - 2]
        if math.hypot(last[0] - before[0], last[1] - before[1]) > math.hypot(end_x_m - before[0], end_y_m - before[1]):
            end -= 1
    if end < out.shape[0]:
        out[end, 0], out[end, 1] = end_x_m, end_y_m
        end += 1
    return end


@inner
def _stale(p: Any, m: Any, g: Grids, path: Any, column: int, row: int) -> bool:
    """Whether the kept potential no longer gives the path a fresh flood would."""
    if g.potential[row, column] >= UNREACHED:
        return True
    if m.dirty == 1 and m.tick - m.flooded_tick >= REFRESH_TICKS:
        return True
    rise, total = 0.0, 1.0
    for i in range(m.path_i, m.path_n):
        c, r = cell(p, path[i, 0], path[i, 1])
        if not inside(g.travel, c, r):
            continue
        now, then = int(g.travel[r, c]), int(g.flooded[r, c])
        if now >= OBSTACLE and then < OBSTACLE:
            return True
        total += then
        rise += max(now - then, 0)
    return rise > CHANGE_TOLERANCE * total
