"""Shared by Smac searches: parameters, collision checks, and heuristics."""

import functools
import heapq
import math
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vastflow.sim.kernels.numeric import inner
from vastflow.sim.kernels.record import record_of
from vastflow.sim.model.polygon import vertices_of
from vastflow.sim.nav2.costmaps.inflation import INSCRIBED, UNKNOWN, cost_at_distance
from vastflow.sim.nav2.costmaps.outline import circumscribed_radius_m, inscribed_radius_m, outline_of
from vastflow.sim.nav2.costmaps.window import Window, outline_hits
from vastflow.sim.nav2.parameters.costmap import Costmap
from vastflow.sim.nav2.parameters.servers import SmacPlanner2D, SmacPlannerHybrid, SmootherParameters
from vastflow.sim.nav2.planners.curves import shortest
from vastflow.sim.nav2.planners.planner import PlannerSetting

_ENDLESS: Final = 1 << 40

WHOLE: Final = 252.0
"""The greatest cost of a cell that is free."""


@dataclass(frozen=True, slots=True)
class Search:
    """Search parameters of kernels: lengths in cells except for the map's frame, times as iterations.

    Attributes:
        resolution, origin_x, origin_y: Of the map, in meters.
        bins: Headings a turn is divided into; 1 where a path has none.
        radius: The least radius of a turn.
        circumscribed_cost: Below it the whole polygon of a robot is free; the robot is a disc where `polygon` is 0.
        smoother_iterations: 0 where the path stays as it is searched.
        table: Edge of the window round the goal in which distances of curves are known.
    """

    resolution: float
    origin_x: float
    origin_y: float
    tolerance: float
    allow_unknown: bool
    max_iterations: int
    max_on_approach_iterations: int
    cost_penalty: float
    smoother_tolerance: float
    smoother_iterations: int
    w_data: float
    w_smooth: float
    refinements: int
    polygon: bool = False
    circumscribed_cost: float = 0.0
    bins: int = 1
    radius: float = 1.0
    reverses: bool = False
    interpolates: bool = False
    change_penalty: float = 0.0
    non_straight_penalty: float = 1.0
    reverse_penalty: float = 1.0
    travel_distance_reward: float = 1.0
    quadratic: bool = False
    halves: bool = False
    expansion_ratio: float = 1.0
    expansion_length: float = 0.0
    expansion_cost: float = 252.0
    expansion_override: bool = False
    table: int = 1


@inner
def collides(q: Any, cost: int) -> bool:
    """Whether the center of a robot can't be in a cell of this cost."""
    return bool(cost >= INSCRIBED and not (cost == UNKNOWN and q.allow_unknown != 0))


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


_BORDER = 3
_TINY = 1e-5


class Ground(NamedTuple):
    """The costs from the goal, as far as they were asked for.

    Attributes:
        values: (h, w) float32: 0 unknown yet, negative in the open set, positive once they are final.
        goal: (3,) float64 x, y in cells and the bin of its heading.
    """

    values: Any
    goal: Any


@inner
def new_ground(q: Any, costs: Any, goal: Any) -> Ground:
    """Return the ground with only the goal's cell known."""
    part = 2 if q.halves != 0 else 1
    rows, columns = (costs.shape[0] + part - 1) // part, (costs.shape[1] + part - 1) // part
    values = np.zeros((rows, columns), dtype=np.float32)
    values[int(goal[1]) // part, int(goal[0]) // part] = -_TINY
    return Ground(values, goal)


@inner
def over_ground(q: Any, ground: Ground, waiting: Any, costs: Any, x: int, y: int) -> float:
    """The cost of the best way over the cells from one to the goal; 0 where there is none.

    As in Nav2 it costs no turn, and cells near the map's border, or in an inscribed radius, are not entered. With `q.halves`
    four cells count as one, of the least cost among them.

    Args:
        waiting: Open set, (expected cost, cell), first as `[(0.0, goal's cell)]`.
    """
    part = 2 if q.halves != 0 else 1
    column, row = x // part, y // part
    values = ground.values
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
                share = cost / WHOLE
                share = share * share if q.quadratic != 0 else share
                step = 1.0 if dx == 0 or dy == 0 else math.sqrt(2.0)
                value = np.float32(cells[here] + step * (1.0 + q.cost_penalty * share))
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


def new_distances(table: int, bins: int) -> NDArray[np.float32]:
    """Lengths of the shortest curves to a goal from cells of a window; NaN until asked for.

    Nav2 computes all of them before the first plan.
    """
    return np.full(table * ((table + 1) // 2) * bins, np.nan, dtype=np.float32)


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
    """From a pose to the origin."""
    c, s = math.cos(heading_rad), math.sin(heading_rad)
    to_x, to_y = -(c * x + s * y) / q.radius, (s * x - c * y) / q.radius
    return float(q.radius * shortest(to_x, to_y, -heading_rad, q.reverses != 0)[0])


class SearchMemory(NamedTuple):
    """The (1,) record of `Search`, and `new_distances`, which runs of a process share."""

    search: Any
    distances: Any


def search_memory(q: SmacPlanner2D | SmacPlannerHybrid, setting: PlannerSetting) -> SearchMemory:
    """Return the memory of a planner with these parameters."""
    search = search_of(q, setting.costmap, setting.resolution_m, setting.origin_xy_m)
    return SearchMemory(record_of(search), _distances(search.table, search.bins, search.radius, search.reverses))


@functools.lru_cache(maxsize=4)
def _distances(table: int, bins: int, radius: float, reverses: bool) -> NDArray[np.float32]:
    """Distances for one curve, shared by the runs of a process and filled on demand."""
    return new_distances(table, bins)


def search_of(
    q: SmacPlanner2D | SmacPlannerHybrid, costmap: Costmap, resolution_m: float, origin_xy_m: tuple[float, float]
) -> Search:
    """Convert a planner's parameters to cells of a map."""
    common: dict[str, Any] = {
        "resolution": resolution_m,
        "origin_x": origin_xy_m[0],
        "origin_y": origin_xy_m[1],
        "tolerance": q.tolerance / resolution_m,
        "allow_unknown": q.allow_unknown,
        "max_iterations": _end(q.max_iterations),
        "max_on_approach_iterations": _end(q.max_on_approach_iterations),
        **_smoothing(q.smoother),
    }
    if isinstance(q, SmacPlanner2D):
        return Search(**common, cost_penalty=q.cost_travel_multiplier)
    outline, layer = outline_of(costmap), costmap.inflation_layer
    farthest_m, nearest_m = circumscribed_radius_m(outline), inscribed_radius_m(outline)
    edge = int(q.lookup_table_size / resolution_m)
    if not q.smooth_path:
        common["smoother_iterations"] = 0
    return Search(
        **common,
        cost_penalty=q.cost_penalty,
        polygon=bool(vertices_of(costmap.footprint)),
        circumscribed_cost=cost_at_distance(farthest_m, nearest_m, layer.cost_scaling_factor) if layer.enabled else 0.0,
        bins=q.angle_quantization_bins,
        radius=max(q.minimum_turning_radius / resolution_m, 1.0),
        reverses=q.motion_model_for_search == "REEDS_SHEPP",
        interpolates=q.allow_primitive_interpolation,
        change_penalty=q.change_penalty,
        non_straight_penalty=q.non_straight_penalty,
        reverse_penalty=q.reverse_penalty,
        travel_distance_reward=1.0 - q.retrospective_penalty,
        quadratic=q.use_quadratic_cost_penalty,
        halves=q.downsample_obstacle_heuristic,
        expansion_ratio=q.analytic_expansion_ratio,
        expansion_length=q.analytic_expansion_max_length / resolution_m,
        expansion_cost=q.analytic_expansion_max_cost,
        expansion_override=q.analytic_expansion_max_cost_override,
        table=edge + 1 - edge % 2,
    )


def _smoothing(q: SmootherParameters) -> dict[str, Any]:
    return {
        "smoother_tolerance": q.tolerance,
        "smoother_iterations": q.max_iterations,
        "w_data": q.w_data,
        "w_smooth": q.w_smooth,
        "refinements": q.refinement_num if q.do_refinement else 0,
    }


def _end(iterations: int) -> int:
    return iterations if iterations > 0 else _ENDLESS
