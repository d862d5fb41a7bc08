"""The global plan: legs through the goals that remain, every one planned afresh at every replanning."""

import math
from typing import Any, Final

import numpy as np

from vastflow.sim.kernels.numeric import inner
from vastflow.sim.nav2.navigator.state import NAVIGATE_THROUGH_POSES, Grids, Route
from vastflow.sim.nav2.planners.binding import compute_path
from vastflow.sim.nav2.planners.navfn import cell, on_map
from vastflow.sim.nav2.planners.planner import GOAL_OUTSIDE, START_OUTSIDE, PlannerInput

PASSED_M: Final = 0.7
"""RemovePassedGoals' radius in the through-poses tree."""


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
    place = np.array([p.origin_x, p.origin_y, p.resolution])
    column, row = cell(place, m.x, m.y)
    if not on_map(g.costs, column, row):
        return START_OUTSIDE
    for k in range(m.goal, last + 1):
        goal_column, goal_row = cell(place, route.goals[k, 0], route.goals[k, 1])
        if not on_map(g.costs, goal_column, goal_row):
            return GOAL_OUTSIDE
    planned, start = 0, (m.x, m.y, m.yaw)
    changed = (m.changed_row0, m.changed_row1, m.changed_column0, m.changed_column1)
    m.changed_row1 = 0
    for k in range(m.goal, last + 1):
        goal = (route.goals[k, 0], route.goals[k, 1], route.goals[k, 2])
        first = max(planned - int(p.leg_overlap), 0)
        # Only a path through several goals has several legs.
        leg = k if p.mission == NAVIGATE_THROUGH_POSES else 0
        given = PlannerInput(g.costs, place, m.outline[: m.vertices], start, goal, route.draft[first:], leg, changed)
        n = compute_path(route.planner, given)
        if n < 0:
            return -n
        planned, start = first + n, goal
        route.draft[planned - 1, 2] = goal[2]
    m.end_x, m.end_y = route.draft[planned - 1, 0], route.draft[planned - 1, 1]
    for i in range(planned):
        for k in range(3):
            route.path[i, k] = route.draft[i, k]
    m.path_n, m.path_i = planned, 0
    m.goal_x, m.goal_y, m.goal_yaw = m.end_x, m.end_y, route.goals[last, 2]
    m.latched = 0
    return 0
