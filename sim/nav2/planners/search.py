"""Shared by Smac searches: parameters, collision checks, and heuristics."""

import functools
import heapq
import math
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vastflow.sim.kernels.numeric import inner
from vastflow.sim.kernels.record import record_of
from vastflow.sim.model.polygon import circumscribed_radius_m, vertices_of
from vastflow.sim.nav2.costmaps.inflation import INSCRIBED, UNKNOWN, cost_at_distance
from vastflow.sim.nav2.costmaps.outline import inscribed_radius_m, outline_of
from vastflow.sim.nav2.costmaps.window import Window, outline_hits
from vastflow.sim.nav2.parameters.costmap import Costmap
from vastflow.sim.nav2.parameters.servers import SmacPlanner2D, SmacPlannerHybrid
from vastflow.sim.nav2.planners.curves import shortest
from vastflow.sim.nav2.planners.planner import PlannerSetting

_ENDLESS: Final = 1 << 40

WHOLE: Final = 252.0
"""The greatest cost of a cell that is free."""


@inner
def collides(q: Any, cost: int) -> bool:
    """Whether the center of a robot can't be in a cell of this cost."""
    return bool(cost >= INSCRIBED and not (cost == UNKNOWN and q.allow_unknown != 0))


@inner
def has_room(q: Any, given: Any, x: float, y: float, heading_rad: float) -> bool:
    """Whether the robot fits at a pose in cells."""
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


_BORDER = 3
_TINY = 1e-5


class Ground(NamedTuple):
    """The costs from the goal, computed on demand."""

    values: Any  # (h, w) float32: 0 unknown yet, negative in the open set, positive once they are final.
    goal: Any  # (3,) float64 x, y in cells and the bin of its heading.
    part: int  # Cells along the edge of one of `values`.


@inner
def new_ground(q: Any, costs: Any, goal: Any) -> Any:
    """Return the ground with only the goal's cell known, and the open set of `over_ground` with that alone."""
    part = 2 if q.downsample_obstacle_heuristic != 0 else 1
    rows, columns = (costs.shape[0] + part - 1) // part, (costs.shape[1] + part - 1) // part
    values = np.zeros((rows, columns), dtype=np.float32)
    row, column = int(goal[1]) // part, int(goal[0]) // part
    values[row, column] = -_TINY
    return Ground(values, goal, part), [(0.0, row * columns + column)]


@inner
def over_ground(q: Any, ground: Ground, waiting: Any, costs: Any, x: int, y: int) -> float:
    """The cost of the best path over cells from one to the goal; 0 without a path.

    As in Nav2 it costs no turn, and cells near the map's border, or in an inscribed radius, are not entered. Where the heuristic
    is downsampled, four cells count as one, of the least cost among them.

    Args:
        waiting: Open set, (expected cost, cell).
    """
    values, part = ground.values, ground.part
    column, row = x // part, y // part
    if values[row, column] > 0.0:
        return float(part * values[row, column])
    rows, columns = values.shape
    cells = values.ravel()
    asked = row * columns + column
    for k in range(len(waiting)):
        cell = waiting[k][1]
        waiting[k] = (-cells[cell] + math.hypot(cell % columns - column, cell // columns - row), cell)
    heapq.heapify(waiting)
    while len(waiting) > 0:
        _, here = heapq.heappop(waiting)
        if cells[here] > 0.0:
            continue
        cells[here] = -cells[here]
        at_x, at_y = here % columns, here // columns
        for dy in range(-1, 2):
            for dx in range(-1, 2):
                to_x, to_y = at_x + dx, at_y + dy
                if to_x <= _BORDER or to_y <= _BORDER or to_x >= columns - _BORDER or to_y >= rows - _BORDER:
                    continue
                there = to_y * columns + to_x
                if cells[there] > 0.0:
                    continue
                cost = _least(costs, to_x * part, to_y * part, part)
                if cost >= INSCRIBED:
                    continue
                step = 1.0 if dx == 0 or dy == 0 else math.sqrt(2.0)
                value = np.float32(cells[here] + step * (1.0 + q.cost_penalty * cost_share(q, cost)))
                if cells[there] == 0.0 or -cells[there] > value:
                    cells[there] = -value
                    heapq.heappush(waiting, (value + math.hypot(to_x - column, to_y - row), there))
        if here == asked:
            break
    return float(part * max(values[row, column], np.float32(0.0)))


@inner
def _least(costs: Any, x: int, y: int, part: int) -> int:
    found = int(costs[y, x])
    for row in range(y, min(y + part, costs.shape[0])):
        for column in range(x, min(x + part, costs.shape[1])):
            found = min(found, int(costs[row, column]))
    return found


@inner
def cost_share(q: Any, cost: float) -> float:
    """The share of `WHOLE` that a cell's cost counts as."""
    share = cost / WHOLE
    return share * share if q.use_quadratic_cost_penalty != 0 else share


@inner
def along_curve(q: Any, distances: Any, goal: Any, x: int, y: int, turn: int, over: float) -> float:
    """Length in cells of the shortest curve to the goal; 0 outside the window round it."""
    angle = -2.0 * math.pi * goal[2] / q.bins
    c, s = math.cos(angle), math.sin(angle)
    dx, dy = x - goal[0], y - goal[1]
    half = q.table // 2
    column, row = round(dx * c - dy * s), round(dx * s + dy * c)
    turn = (turn - int(goal[2])) % q.bins
    if row < 0:
        row, turn = -row, (q.bins - turn) % q.bins
    if abs(column) >= half or row >= half:
        if over > 0.0:
            return 0.0
        return _length(q, float(column), float(row), 2.0 * math.pi * turn / q.bins)
    at = ((column + half) * (half + 1) + row) * q.bins + turn
    if math.isnan(distances[at]):
        distances[at] = _length(q, float(column), float(row), 2.0 * math.pi * turn / q.bins)
    return float(distances[at])


@inner
def _length(q: Any, x: float, y: float, heading_rad: float) -> float:
    c, s = math.cos(heading_rad), math.sin(heading_rad)
    to_x, to_y = -(c * x + s * y) / q.radius, (s * x - c * y) / q.radius
    return float(q.radius * shortest(to_x, to_y, -heading_rad, q.reverses != 0)[0])


class SearchMemory(NamedTuple):
    """A Smac planner's memory."""

    search: Any  # The (1,) record of `search_of`.
    # Lengths of the shortest curves to a goal from cells of a window, which runs of a process share; NaN
    # until asked for. Nav2 computes all of them before the first plan.
    distances: Any


def search_memory(q: SmacPlanner2D | SmacPlannerHybrid, setting: PlannerSetting) -> SearchMemory:
    """Return the memory of a planner with these parameters."""
    search = search_of(q, setting.costmap, setting.resolution_m, setting.origin_xy_m)
    names = ("table", "bins", "radius", "reverses")
    return SearchMemory(record_of(search), _distances(*(search.get(name, 1) for name in names)))


@functools.lru_cache(maxsize=4)
def _distances(table: int, bins: int, radius: float, reverses: bool) -> NDArray[np.float32]:
    return np.full(table * ((table + 1) // 2) * bins, np.nan, dtype=np.float32)


def search_of(
    q: SmacPlanner2D | SmacPlannerHybrid, costmap: Costmap, resolution_m: float, origin_xy_m: tuple[float, float]
) -> dict[str, Any]:
    """Return the parameters that a planner's kernels get as `q`: its own, and what follows from them on a map.

    Lengths are in cells but for those of the map's frame. In addition to those of Nav2's names:

    - `resolution`, `origin_x`, `origin_y`: Of the map, in meters.
    - `smooths`, `refinements`: Whether the path is smoothed after the search, and how often again.
    - `polygon`, `circumscribed_cost`: The robot is a disc where the first is false; below the second its whole polygon is free.
    - `bins`, `radius`, `reverses`: Headings a turn is divided into, its least radius, and whether the robot may drive backward.
    - `table`: Edge of the window round the goal in which distances of curves are known.
    """
    found: dict[str, Any] = {
        **dict(q),
        "resolution": resolution_m,
        "origin_x": origin_xy_m[0],
        "origin_y": origin_xy_m[1],
        "tolerance": q.tolerance / resolution_m,
        "max_iterations": q.max_iterations if q.max_iterations > 0 else _ENDLESS,
        "max_on_approach_iterations": q.max_on_approach_iterations if q.max_on_approach_iterations > 0 else _ENDLESS,
        "smooths": q.smoother.max_iterations > 0 and (isinstance(q, SmacPlanner2D) or q.smooth_path),
        "refinements": q.smoother.refinement_num if q.smoother.do_refinement else 0,
        "radius": 1.0,
    }
    if isinstance(q, SmacPlanner2D):
        return found
    outline, layer = outline_of(costmap), costmap.inflation_layer
    farthest_m, nearest_m = circumscribed_radius_m(outline), inscribed_radius_m(outline)
    edge = int(q.lookup_table_size / resolution_m)
    return {
        **found,
        "polygon": bool(vertices_of(costmap.footprint)),
        "circumscribed_cost": (
            float(cost_at_distance(farthest_m, nearest_m, layer.cost_scaling_factor)) if layer.enabled else 0.0
        ),
        "bins": q.angle_quantization_bins,
        "radius": max(q.minimum_turning_radius / resolution_m, 1.0),
        "reverses": q.motion_model_for_search == "REEDS_SHEPP",
        "analytic_expansion_max_length": q.analytic_expansion_max_length / resolution_m,
        "table": edge + 1 - edge % 2,
    }
