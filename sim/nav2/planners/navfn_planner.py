"""NavFn as the loop drives with it: every leg flooded afresh, within bounds.

As in Nav2, a leg is flooded from its start until its goal has a value, and walked back from there. The flood keeps within
bounds: where a path through a cell would cost `MARGIN` more than is to be expected, going by the least that is left to the
goal from there, it does not enter. No better path is lost by that, and along the best one the potential is the whole flood's
but for the order of NavFn's updates.
"""

import math
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from vastflow.sim.kernels.arrays import zero_pages
from vastflow.sim.kernels.numeric import addressed, inner
from vastflow.sim.nav2.parameters.servers import NavFn
from vastflow.sim.nav2.planners import navfn
from vastflow.sim.nav2.planners.navfn import (
    NEUTRAL,
    OBSTACLE,
    UNREACHED,
    cell,
    new_potential,
    new_scratch,
    travel_costs,
)
from vastflow.sim.nav2.planners.planner import NO_VALID_PATH, Planner, PlannerInput, PlannerSetting

Cell: TypeAlias = tuple[int, int]
"""Column and row, as NavFn counts them."""

MARGIN: Final = 0.05
MARGIN_COST: Final = 30 * NEUTRAL
"""Paths this much dearer than expected are flooded, too: the walk down the potential reads cells beside the best one."""

WIDER: Final = 1.5
"""Factor by which the bound of a path's cost grows if no path is within the first one; then it is dropped."""

FARTHER: Final = 1.25
"""So much more than is needed at once new lower bounds reach."""

LEG_LENGTHS: Final = 4
"""Points of a leg, in longer edges of the map."""

LEAST_CELL_COST: Final = 0.99 * NEUTRAL
"""Least cost of a cell on a straight path; NavFn's interpolated potential rises 0.5 % less than `NEUTRAL` along a diagonal."""

DETOUR: Final = 1.6
"""Expected cost of a map's paths over that of a straight line, inflation included; a longer path makes the bounds be
computed again."""

SPARE_COST: Final = 20 * NEUTRAL
WIDER_BOUNDS: Final = 2.0
ATTEMPTS: Final = 3
"""Maximum number of attempts to bound a path, each with `WIDER_BOUNDS` times the cost."""

BOUND: Final = np.dtype(
    [(name, np.float64) for name in ("reach", "detour")]
    + [(name, np.int64) for name in ("column", "row", "goal_column", "goal_row", "row0", "row1", "column0", "column1")]
)
"""Bounds of one leg: all cells on paths of at most `reach` from (column, row) to (goal_column, goal_row) have one, and are
in rows row0..row1 and columns column0..column1. `detour` is the excess of the leg's last plan over its bound."""


class NavFnMemory(NamedTuple):
    """Memory of NavFn from one plan to the next."""

    travel: Any  # (H, W) uint8, its costs of the global costmap.
    least: Any  # (H, W) uint8, its costs with nothing marked and nothing unknown.
    potential: Any  # (H, W) float32, what the last flood gave.
    scratch: Any  # See `new_scratch`.
    leg: Any  # (N, 2) points of a leg in cells.
    # (L, H, W) float32, what a path from a cell to a leg's goal costs at the least; 0 where nothing is known.
    to_goal: Any
    bounds: Any  # (L,) records of `BOUND`; none where the costmap has no map.
    floods: Any  # (1,) int64, floods so far.


class NavFnTables(NamedTuple):
    """NavFn's costs of a map; see `NavFnMemory`."""

    travel: NDArray[np.uint8]
    least: NDArray[np.uint8]


@addressed
def compute_path(q: Any, memory: NavFnMemory, given: PlannerInput) -> int:
    """Plan into `given.path`; return the number of poses, or minus an error code."""
    row0, row1, col0, col1 = given.changed
    rows, columns = memory.travel.shape
    row0, row1, col0, col1 = max(row0, 1), min(row1, rows - 1), max(col0, 1), min(col1, columns - 1)
    navfn.fill_travel_costs(given.costs, q.allow_unknown != 0, row0, row1, col0, col1, memory.travel)
    column, row = cell(given.place, given.start[0], given.start[1])
    n, end_x, end_y = _plan_leg(q, memory, given, column, row, given.goal[0], given.goal[1])
    if n == 0 or n + 1 > given.path.shape[0]:
        return -NO_VALID_PATH
    return int(_to_map(given, memory.leg, n, (end_x, end_y, given.goal[2])))


@inner
def _inside(travel: Any, column: int, row: int) -> bool:
    """Whether a cell is inside of the map's border, which NavFn never enters."""
    return column > 0 and row > 0 and column < travel.shape[1] - 1 and row < travel.shape[0] - 1


@inner
def _plan_leg(
    q: Any, memory: NavFnMemory, given: PlannerInput, column: int, row: int, goal_x_m: float, goal_y_m: float
) -> Any:
    """Plan a leg into `memory.leg`, last point first, in cells: (points, x, y of its end); no points if impossible.

    A goal in an obstacle is replaced by the nearest point that can be reached, as `_nearest` has them.
    """
    if not _inside(memory.travel, column, row):
        return 0, goal_x_m, goal_y_m
    before = memory.travel[row, column]
    # Nav2 clears the robot's cell: it may stand in the inflation of what it has come near to.
    memory.travel[row, column] = NEUTRAL
    n = 0
    # The nearest free point is the nearest that can be reached, unless the flood says otherwise.
    found, x_m, y_m = _nearest(q, memory, given, goal_x_m, goal_y_m, False)
    # NavFn floods until it meets the goal: where that can't be reached, until there is nothing left.
    start, stop = (column, row), cell(given.place, goal_x_m, goal_y_m)
    if found and not _flood(q, memory, given.leg, start, cell(given.place, x_m, y_m), stop):
        found, x_m, y_m = _nearest(q, memory, given, goal_x_m, goal_y_m, True)
    if found:
        end_column, end_row = cell(given.place, x_m, y_m)
        n = navfn.descend(memory.potential, end_column, end_row, column, row, memory.leg)
    memory.travel[row, column] = before
    return n, x_m, y_m


@inner
def _nearest(q: Any, memory: NavFnMemory, given: PlannerInput, x_m: float, y_m: float, reached: bool) -> Any:
    """(found, x, y): the point itself if its cell is free, or flooded; else the nearest such within NavFn's `tolerance`.

    NavFn tries points a cell apart, from `tolerance` below and left of the goal on: they lie off the cells as that does.
    """
    if _open(memory, given, x_m, y_m, reached):
        return True, x_m, y_m
    tolerance, nearest, found, best_x, best_y = q.tolerance, math.inf, False, x_m, y_m
    y = y_m - tolerance
    while y <= y_m + tolerance:
        x = x_m - tolerance
        while x <= x_m + tolerance:
            square = (x - x_m) * (x - x_m) + (y - y_m) * (y - y_m)
            if square < nearest and _open(memory, given, x, y, reached):
                nearest, found, best_x, best_y = square, True, x, y
            x += given.place[2]
        y += given.place[2]
    return found, best_x, best_y


@inner
def _open(memory: NavFnMemory, given: PlannerInput, x_m: float, y_m: float, reached: bool) -> bool:
    column, row = cell(given.place, x_m, y_m)
    if not _inside(memory.travel, column, row):
        return False
    return bool(memory.potential[row, column] < UNREACHED if reached else memory.travel[row, column] < OBSTACLE)


@inner
def _flood(q: Any, memory: NavFnMemory, leg: int, start: Cell, end: Cell, stop: Cell) -> bool:
    """Flood from a cell until the stop, or all cells, have a value; true if the end has one."""
    # A* does not find the best path, and which one it finds hangs on every cell it has been to. Without a map the cells on
    # the way are unknown, and dearer than any bound by what they may turn out to be; and the cells of a window move.
    if q.use_astar == 0 and memory.bounds.shape[0] > 0 and _flood_within_bounds(memory, leg, start, end, stop):
        return True
    # Nothing is above infinity, so any array will do for the lower bounds.
    _propagate(memory, memory.travel, start, stop, q.use_astar != 0, memory.potential, math.inf)
    return bool(memory.potential[end[1], end[0]] < UNREACHED)


@inner
def _propagate(
    memory: NavFnMemory, travel: Any, start: Cell, stop: Cell, astar: bool, lower: Any, bound: float
) -> None:
    memory.floods[0] += 1
    out, scratch = memory.potential, memory.scratch
    navfn.propagate(travel, start[0], start[1], stop[0], stop[1], astar, lower, bound, out, scratch)


@inner
def _flood_within_bounds(memory: NavFnMemory, leg: int, start: Cell, end: Cell, stop: Cell) -> bool:
    """Search among paths little dearer than the expected one; return whether one was found."""
    b, to_goal, (column, row), (end_column, end_row) = memory.bounds[leg], memory.to_goal[leg], start, end
    # No bound leads out of a cell that the bare map blocks; only the scan's clearing may have opened it.
    if memory.least[row, column] >= OBSTACLE:
        return False
    if b.goal_column != end_column or b.goal_row != end_row or to_goal[row, column] == 0.0:
        _bound_below(memory, leg, start, end, 0.0)
        b.detour = 1.0
    if to_goal[row, column] == 0.0:
        return False
    expected = b.detour * to_goal[row, column]
    for _ in range(2):
        margin = max(MARGIN * expected, MARGIN_COST)
        bound = expected + margin
        if bound + _straight(column, row, b.column, b.row) > b.reach:
            _bound_below(memory, leg, start, end, FARTHER * bound)
        _propagate(memory, memory.travel, start, stop, False, to_goal, bound)
        if memory.potential[end_row, end_column] < UNREACHED:
            expected = memory.potential[end_row, end_column]
            # A path that only just fits has been cut at its sides.
            if expected + 0.5 * margin <= bound:
                # The next plan to this goal begins with the excess that this one found: usually its first bound holds.
                b.detour = max(expected / to_goal[row, column], 1.0)
                return True
        else:
            expected *= WIDER
    return False


@inner
def _bound_below(memory: NavFnMemory, leg: int, start: Cell, end: Cell, reach: float) -> None:
    """Write lower bounds of the cost from each cell, itself included, to the end.

    They are NavFn's potential from the end over the unmarked map. Marks of the scan and unknown cells only make paths dearer, so
    the bounds hold as long as the end is headed for.

    Cells on no path from the start of at most `reach` have 0, the bound that always holds. `reach` is a wish: it is more where
    the start would have no bound. Overwrites the potential.
    """
    b, to_goal, (column, row), (end_column, end_row) = memory.bounds[leg], memory.to_goal[leg], start, end
    to_goal[b.row0 : b.row1, b.column0 : b.column1] = 0.0
    b.column, b.row, b.goal_column, b.goal_row = column, row, end_column, end_row
    b.reach = max(reach, DETOUR * _straight(column, row, end_column, end_row) + SPARE_COST)
    for attempt in range(ATTEMPTS):
        b.reach *= WIDER_BOUNDS if attempt > 0 else 1.0
        _lay_straight_lines(b, to_goal)
        _propagate(memory, memory.least, end, (-1, -1), False, to_goal, b.reach)
        if memory.potential[row, column] < UNREACHED:
            break
    for r in range(b.row0, b.row1):
        for c in range(b.column0, b.column1):
            value = memory.potential[r, c]
            to_goal[r, c] = value if value < UNREACHED else 0.0


@inner
def _straight(column: int, row: int, to_column: int, to_row: int) -> float:
    return float(LEAST_CELL_COST * math.hypot(column - to_column, row - to_row))


@inner
def _lay_straight_lines(b: Any, to_start: Any) -> None:
    """Write straight-line costs to the start into the box of the ellipse of ways that cost `reach`."""
    rows, columns = to_start.shape
    half = 0.5 * b.reach / LEAST_CELL_COST
    across, along = 0.5 * (b.goal_column - b.column), 0.5 * (b.goal_row - b.row)
    half_width, half_height = math.sqrt(half * half - along * along), math.sqrt(half * half - across * across)
    b.column0 = max(0, math.floor(b.column + across - half_width) - 2)
    b.column1 = min(columns, math.ceil(b.column + across + half_width) + 3)
    b.row0 = max(0, math.floor(b.row + along - half_height) - 2)
    b.row1 = min(rows, math.ceil(b.row + along + half_height) + 3)
    for r in range(b.row0, b.row1):
        for c in range(b.column0, b.column1):
            away_column, away_row = float(c - b.column), float(r - b.row)
            to_start[r, c] = LEAST_CELL_COST * math.sqrt(away_column * away_column + away_row * away_row)


@inner
def _to_map(given: PlannerInput, leg: Any, n: int, goal: Any) -> int:
    """Put `leg`, turned round, into `given.path` in meters, ending at the exact goal; the number of poses.

    NavFn gives every pose but the goal's the map's own heading.
    """
    out, resolution, (end_x_m, end_y_m, end_yaw_rad) = given.path, given.place[2], goal
    for i in range(n):
        out[i, 0] = given.place[0] + leg[n - 1 - i, 0] * resolution
        out[i, 1] = given.place[1] + leg[n - 1 - i, 1] * resolution
        out[i, 2] = 0.0
    end = n
    if n > 1:
        last, before = out[end - 1], out[end - 2]
        if math.hypot(last[0] - before[0], last[1] - before[1]) > math.hypot(end_x_m - before[0], end_y_m - before[1]):
            end -= 1
    out[end, 0], out[end, 1], out[end, 2] = end_x_m, end_y_m, end_yaw_rad
    return end + 1


class NavFnPlanner(NavFn, Planner):
    """The NavFn planner."""

    compute_path = compute_path
    overlaps = False

    def prepare(self, setting: PlannerSetting) -> NavFnTables:
        """Compute the map's travel costs."""
        return NavFnTables(travel_costs(setting.costs, self.allow_unknown), travel_costs(setting.free_costs))

    def memory(self, setting: PlannerSetting) -> NavFnMemory:
        """Each leg of a mission has bounds of its own."""
        shape, legs = setting.costs.shape, setting.legs if setting.costmap.sized_by_map else 0
        bounds = np.zeros(legs, dtype=BOUND)
        bounds["goal_column"] = -1
        return NavFnMemory(
            travel=setting.prepared.travel.copy(),
            least=setting.prepared.least,
            potential=new_potential(shape),
            scratch=new_scratch(shape),
            leg=np.zeros((LEG_LENGTHS * max(shape), 2)),
            to_goal=zero_pages((legs, *shape), np.float32),
            bounds=bounds,
            floods=np.zeros(1, dtype=np.int64),
        )
