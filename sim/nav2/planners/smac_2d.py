"""SmacPlanner2D: A* over the cells of the global costmap, from each to its eight neighbors."""

import heapq
import math
from typing import Any

import numpy as np

from vastflow.sim.kernels.numeric import addressed, inner, njit
from vastflow.sim.nav2.parameters.servers import SmacPlanner2D
from vastflow.sim.nav2.planners.planner import (
    NO_VALID_PATH,
    START_OCCUPIED,
    TIMEOUT,
    Planner,
    PlannerInput,
    PlannerSetting,
)
from vastflow.sim.nav2.planners.search import WHOLE, SearchMemory, collides, search_memory
from vastflow.sim.nav2.planners.smoother import smooth

_FEWEST_SMOOTHED = 6


@addressed
def compute_path(parameters: Any, memory: SearchMemory, given: PlannerInput) -> int:
    """Plan into `given.path`; return the number of poses, or minus an error code."""
    q = memory.search[0]
    columns = given.costs.shape[1]
    start = _cell(q, given.start[0], given.start[1], columns)
    goal = _cell(q, given.goal[0], given.goal[1], columns)
    if start == goal:
        given.path[0, 0], given.path[0, 1], given.path[0, 2] = given.start
        return 1
    last, parents, code = search(q, given.costs, start, goal)
    if code != 0:
        return int(-code)
    n, at = 1, last
    while at != start:
        n, at = n + 1, parents[at]
    if n > given.path.shape[0]:
        return -NO_VALID_PATH
    at = last
    for k in range(n - 1, -1, -1):
        given.path[k, 0] = q.origin_x + (at % columns + 0.5) * q.resolution
        given.path[k, 1] = q.origin_y + (at // columns + 0.5) * q.resolution
        given.path[k, 2] = 0.0
        at = parents[at]
    if q.smooths != 0 and n > _FEWEST_SMOOTHED:
        poses = given.path[:n]
        smooth(q, given.costs, poses, np.empty(0))
        for k in range(n - 1):
            poses[k, 2] = math.atan2(poses[k + 1, 1] - poses[k, 1], poses[k + 1, 0] - poses[k, 0])
    return n


@inner
def _cell(q: Any, x_m: float, y_m: float, columns: int) -> int:
    return int((y_m - q.origin_y) / q.resolution) * columns + int((x_m - q.origin_x) / q.resolution)


@njit
def search(q: Any, costs: Any, start: int, goal: int) -> Any:
    """(last cell, parents, error code): A* from a cell to another, or to the nearest within the tolerance.

    Cells are counted row after row; `parents` is (H·W,) int64. For `q` see `search_of`.
    """
    rows, columns = costs.shape
    cells = costs.ravel()
    known = np.full(cells.shape[0], np.inf, dtype=np.float32)
    parents = np.full(cells.shape[0], -1, dtype=np.int64)
    visited = np.zeros(cells.shape[0], dtype=np.bool_)
    goal_column, goal_row = goal % columns, goal // columns
    known[start] = 0.0
    waiting = [(0.0, start)]
    iterations, on_approach, nearest, nearest_cell = 0, 0, math.inf, start
    while len(waiting) > 0 and iterations < q.max_iterations:
        _, here = heapq.heappop(waiting)
        if visited[here]:
            continue
        iterations += 1
        visited[here] = True
        if here == goal:
            return here, parents, 0
        if nearest < q.tolerance:
            on_approach += 1
            if on_approach >= q.max_on_approach_iterations:
                return nearest_cell, parents, 0
        column, row = here % columns, here // columns
        for dy in range(-1, 2):
            for dx in range(-1, 2):
                x, y = column + dx, row + dy
                if x < 0 or y < 0 or x >= columns or y >= rows:
                    continue
                there = y * columns + x
                if visited[there] or collides(q, cells[there]):
                    continue
                step = 1.0 if dx == 0 or dy == 0 else math.sqrt(2.0)
                value = np.float32(known[here] + step * (1.0 + q.cost_travel_multiplier * cells[there] / WHOLE))
                if value >= known[there]:
                    continue
                known[there], parents[there] = value, here
                left = math.hypot(goal_column - x, goal_row - y)
                if left < nearest:
                    nearest, nearest_cell = left, there
                heapq.heappush(waiting, (float(value) + left, there))
    if nearest < q.tolerance:
        return nearest_cell, parents, 0
    if iterations == 1:
        return start, parents, START_OCCUPIED
    return start, parents, TIMEOUT if iterations >= q.max_iterations else NO_VALID_PATH


class Smac2D(SmacPlanner2D, Planner):
    """The planner."""

    compute_path = compute_path

    def memory(self, setting: PlannerSetting) -> SearchMemory:
        return search_memory(self, setting)
