"""The global plan: legs through the goals that remain, every one searched, or flooded by NavFn, afresh at every replanning.

As in Nav2, a leg of NavFn's is flooded from its start until its goal has a value, and walked back from there. The flood keeps within
bounds: where a path through a cell would cost `MARGIN` more than is to be expected, going by the least that is left to the
goal from there, it does not enter. No better path is lost by that, and along the best one the potential is the whole flood's
but for the order of NavFn's updates.
"""

import math
from typing import Any, Final, TypeAlias

import numpy as np

from vastflow.sim.kernels.numeric import inner
from vastflow.sim.nav2.navigator.state import NAVIGATE_THROUGH_POSES, Grids, Route
from vastflow.sim.nav2.planners.lower_bound import Bounds, bound_below, covers
from vastflow.sim.nav2.planners.navfn import (
    NEUTRAL,
    OBSTACLE,
    UNREACHED,
    descend,
    propagate,
    propagate_astar,
    propagate_within,
)
from vastflow.sim.nav2.planners.planner import compute_path, searches
from vastflow.sim.nav2.planners.search import GOAL_OUTSIDE, NO_VALID_PATH, START_OUTSIDE, PlannerInput

Cell: TypeAlias = tuple[int, int]
"""Column and row, as NavFn counts them."""

PASSED_M: Final = 0.7
"""RemovePassedGoals' radius in the through-poses tree."""

MARGIN: Final = 0.05
MARGIN_COST: Final = 30 * NEUTRAL
"""Paths this much dearer than expected are flooded, too: the walk down the potential reads cells beside the best one."""

WIDER: Final = 1.5
"""By this much more a path may cost where none was found within the first bounds; after that there are none."""

FARTHER: Final = 1.25
"""So much more than is needed at once new lower bounds reach."""


@inner
def plan(p: Any, m: Any, g: Grids, route: Route) -> int:
    """Plan from the estimate through the remaining goals into `path`: 0, or ComputePathToPose's error code.

    A path that there was stays where planning fails.
    """
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
    if searches(route.planner):
        planned = _searched(p, m, g, route, last)
        if planned < 0:
            return -planned
    else:
        planned = _flooded(p, m, g, route, column, row, last)
        if planned == 0:
            return NO_VALID_PATH
    for i in range(planned):
        for k in range(3):
            route.path[i, k] = route.draft[i, k]
    m.path_n, m.path_i = planned, 0
    m.goal_x, m.goal_y, m.goal_yaw = m.end_x, m.end_y, route.goals[last, 2]
    m.latched = 0
    return 0


@inner
def _searched(p: Any, m: Any, g: Grids, route: Route, last: int) -> int:
    """Search the legs into `draft`: the number of points there, or minus an error code."""
    planned, start = 0, (m.x, m.y, m.yaw)
    place = np.array([p.origin_x, p.origin_y, p.resolution])
    for k in range(m.goal, last + 1):
        goal = (route.goals[k, 0], route.goals[k, 1], route.goals[k, 2])
        m.floods += 1
        # Where one leg ends the next begins.
        first = max(planned - 1, 0)
        given = PlannerInput(g.costs, place, m.outline[: m.vertices], start, goal, route.draft[first:])
        n = compute_path(route.planner, given)
        if n < 0:
            return n
        planned, start = first + n, goal
        route.draft[planned - 1, 2] = goal[2]
    m.end_x, m.end_y = route.draft[planned - 1, 0], route.draft[planned - 1, 1]
    return int(planned)


@inner
def _flooded(p: Any, m: Any, g: Grids, route: Route, column: int, row: int, last: int) -> int:
    """NavFn's legs from a cell into `draft`: the number of points there, 0 where a leg has none."""
    planned = 0
    for k in range(m.goal, last + 1):
        if k > m.goal:
            column, row = cell(p, route.goals[k - 1, 0], route.goals[k - 1, 1])
        # Only a path through several goals has several legs.
        leg = k if p.mission == NAVIGATE_THROUGH_POSES else 0
        n = _plan_leg(p, m, g, route, leg, column, row, route.goals[k, 0], route.goals[k, 1])
        if n == 0 or planned + n + 1 > route.draft.shape[0]:
            return 0
        planned = _to_map(p, route.leg, n, (m.end_x, m.end_y, route.goals[k, 2]), route.draft, planned)
    return int(planned)


@inner
def cell(p: Any, x_m: float, y_m: float) -> Cell:
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
def _plan_leg(
    p: Any, m: Any, g: Grids, route: Route, leg: int, column: int, row: int, goal_x_m: float, goal_y_m: float
) -> int:
    """Path from a cell to a goal into `route.leg`, in cell units, its last point first; 0 points when there is none.

    A goal in an obstacle is replaced by the nearest point that can be reached, as `_nearest` has them.
    """
    if not inside(g.travel, column, row):
        return 0
    before = g.travel[row, column]
    g.travel[row, column] = NEUTRAL
    n = 0
    # The nearest free point is the nearest that can be reached, unless the flood says otherwise.
    found, x_m, y_m = _nearest(p, g, goal_x_m, goal_y_m, False)
    # NavFn floods until it meets the goal: where that can't be reached, until there is nothing left.
    start, stop = (column, row), cell(p, goal_x_m, goal_y_m)
    if found and not _flood(p, m, g, route.bounds, leg, start, cell(p, x_m, y_m), stop):
        found, x_m, y_m = _nearest(p, g, goal_x_m, goal_y_m, True)
    if found:
        m.end_x, m.end_y = x_m, y_m
        end_column, end_row = cell(p, x_m, y_m)
        n = descend(g.potential, end_column, end_row, column, row, route.leg)
    g.travel[row, column] = before
    return n


@inner
def _nearest(p: Any, g: Grids, x_m: float, y_m: float, reached: bool) -> Any:
    """(found, x, y): the point itself if its cell is free, or flooded; else the nearest such within NavFn's `tolerance`.

    NavFn tries points a cell apart, from `tolerance` below and left of the goal on: they lie off the cells as that does.
    """
    if _open(p, g, x_m, y_m, reached):
        return True, x_m, y_m
    tolerance, nearest, found, best_x, best_y = p.planner.tolerance, math.inf, False, x_m, y_m
    y = y_m - tolerance
    while y <= y_m + tolerance:
        x = x_m - tolerance
        while x <= x_m + tolerance:
            square = (x - x_m) * (x - x_m) + (y - y_m) * (y - y_m)
            if square < nearest and _open(p, g, x, y, reached):
                nearest, found, best_x, best_y = square, True, x, y
            x += p.resolution
        y += p.resolution
    return found, best_x, best_y


@inner
def _open(p: Any, g: Grids, x_m: float, y_m: float, reached: bool) -> bool:
    column, row = cell(p, x_m, y_m)
    if not inside(g.travel, column, row):
        return False
    return bool(g.potential[row, column] < UNREACHED if reached else g.travel[row, column] < OBSTACLE)


@inner
def _flood(p: Any, m: Any, g: Grids, bounds: Bounds, leg: int, start: Cell, end: Cell, stop: Cell) -> bool:
    """NavFn's potential from a cell until the stop has a value; whether the end has one. If not, all that can be reached is flooded."""
    # A* does not find the best path, and which one it finds hangs on every cell it has been to.
    if p.planner.use_astar != 0:
        m.floods += 1
        propagate_astar(g.travel, start[0], start[1], stop[0], stop[1], g.potential, g.scratch)
        return bool(g.potential[end[1], end[0]] < UNREACHED)
    if _flood_within_bounds(m, g, bounds, leg, start, end, stop):
        return True
    m.floods += 1
    propagate(g.travel, start[0], start[1], stop[0], stop[1], g.potential, g.scratch)
    return bool(g.potential[end[1], end[0]] < UNREACHED)


@inner
def _flood_within_bounds(m: Any, g: Grids, bounds: Bounds, leg: int, start: Cell, end: Cell, stop: Cell) -> bool:
    """The same among paths little dearer than the one to be expected; whether it was among them."""
    b, least, to_goal = bounds.legs[leg], bounds.least, bounds.to_goal[leg]
    (column, row), (end_column, end_row) = start, end
    if least[row, column] >= OBSTACLE:
        return False
    if b.goal_column != end_column or b.goal_row != end_row or to_goal[row, column] == 0.0:
        m.floods += bound_below(b, least, to_goal, column, row, end_column, end_row, 0.0, g.potential, g.scratch)
        b.detour = 1.0
    if to_goal[row, column] == 0.0:
        return False
    expected = b.detour * to_goal[row, column]
    for _ in range(2):
        margin = max(MARGIN * expected, MARGIN_COST)
        bound = expected + margin
        if not covers(b, column, row, bound):
            m.floods += bound_below(
                b, least, to_goal, column, row, end_column, end_row, FARTHER * bound, g.potential, g.scratch
            )
        m.floods += 1
        propagate_within(g.travel, column, row, stop[0], stop[1], to_goal, bound, g.potential, g.scratch)
        if g.potential[end_row, end_column] < UNREACHED:
            expected = g.potential[end_row, end_column]
            # A path that only just fits has been cut at its sides.
            if expected + 0.5 * margin <= bound:
                b.detour = max(expected / to_goal[row, column], 1.0)
                return True
        else:
            expected *= WIDER
    return False


@inner
def _to_map(p: Any, leg: Any, n: int, goal: Any, out: Any, at: int) -> int:
    """Put `leg`, turned round, behind `out[:at]` in meters, ending at the exact goal; the number of poses then there.

    NavFn gives every pose but the goal's the map's own heading.
    """
    resolution, (end_x_m, end_y_m, end_yaw_rad) = p.resolution, goal
    for i in range(n):
        out[at + i, 0] = p.origin_x + leg[n - 1 - i, 0] * resolution
        out[at + i, 1] = p.origin_y + leg[n - 1 - i, 1] * resolution
        out[at + i, 2] = 0.0
    end = at + n
    if n > 1:
        last, before = out[end - 1], out[end - 2]
        if math.hypot(last[0] - before[0], last[1] - before[1]) > math.hypot(end_x_m - before[0], end_y_m - before[1]):
            end -= 1
    out[end, 0], out[end, 1], out[end, 2] = end_x_m, end_y_m, end_yaw_rad
    return end + 1
