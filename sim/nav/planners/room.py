"""Where a robot has room on the global costmap: a disc by its center's cost, a polygon by its outline as well."""

from typing import Any

from vastflow.sim.kernels.numeric import inner
from vastflow.sim.nav.footprint import outline_hits
from vastflow.sim.nav.inflation import UNKNOWN
from vastflow.sim.nav.planners.search import collides
from vastflow.sim.nav.window import Window


@inner
def has_room(q: Any, given: Any, x: float, y: float, heading_rad: float) -> bool:
    """Whether the robot fits at a pose in cells.

    Args:
        q: `Search`.
        given: `PlannerInput`.
    """
    if x < 0.0 or y < 0.0 or x >= given.costs.shape[1] or y >= given.costs.shape[0]:
        return False
    cost = int(given.costs[int(y), int(x)])
    if collides(q, cost):
        return False
    if q.polygon == 0 or (cost < q.circumscribed_cost and q.circumscribed_cost > 0.0):
        return True
    x_m, y_m = q.origin_x + x * q.resolution, q.origin_y + y * q.resolution
    return not outline_hits(Window(given.costs, given.place), given.outline, x_m, y_m, heading_rad)


@inner
def center_cost(costs: Any, x: float, y: float) -> int:
    """Cost of the cell at a point in cells; unknown off the map."""
    if x < 0.0 or y < 0.0 or x >= costs.shape[1] or y >= costs.shape[0]:
        return int(UNKNOWN)
    return int(costs[int(y), int(x)])
