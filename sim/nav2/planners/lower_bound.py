"""Lower bounds of path costs to a goal: NavFn's potential from it over the unmarked map.

Marks of the scan and unknown cells only make paths dearer, so what is computed once for a goal holds as long as it is headed for.
"""

import math
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vastflow.sim.kernels.numeric import inner
from vastflow.sim.nav2.planners.navfn import NEUTRAL, UNREACHED, propagate

LEAST_CELL_COST: Final = 0.99 * NEUTRAL
"""Of a cell's path in a straight line; NavFn's interpolated potential rises 0.5 % less than `NEUTRAL` along a diagonal."""

DETOUR: Final = 1.6
"""Of a map's paths over the straight line, inflation counted in; where one is longer, the bounds are computed again."""

SPARE_COST: Final = 20 * NEUTRAL
WIDER: Final = 2.0
ATTEMPTS: Final = 3
"""To find a path at all, each time among paths `WIDER` as dear."""

BOUND: Final = np.dtype(
    [(name, np.float64) for name in ("reach", "detour")]
    + [(name, np.int64) for name in ("column", "row", "goal_column", "goal_row", "row0", "row1", "column0", "column1")]
)
"""What is known of one leg: on paths of at most `reach` from (column, row) to (goal_column, goal_row) all cells have a bound.

Rows row0..row1 and columns column0..column1 hold them all. By `detour` the leg's last plan was dearer than its bound.
"""


class Bounds(NamedTuple):
    """Lower bounds for each leg of a path.

    Attributes:
        least: (H, W) uint8 travel costs with nothing marked and nothing unknown.
        to_goal: (L, H, W) float32, what a path from a cell to the leg's goal costs at the least; 0 where nothing is known.
        legs: (L,) records of `BOUND`.
    """

    least: Any
    to_goal: Any
    legs: Any


def new_bounds(legs: int, least: NDArray[np.uint8]) -> Bounds:
    """Bounds of which nothing is known; memory is taken up where they are written only."""
    records = np.zeros(legs, dtype=BOUND)
    records["goal_column"] = -1
    return Bounds(least, np.zeros((legs, *least.shape), dtype=np.float32), records)


@inner
def bound_below(
    b: Any,
    least: Any,
    to_goal: Any,
    column: int,
    row: int,
    goal_column: int,
    goal_row: int,
    reach: float,
    potential: Any,
    scratch: Any,
) -> int:
    """Write lower bounds of the cost to a goal into `to_goal` (H, W).

    They hold on all paths of at most `reach` from a cell, that cell included.

    Cells that are out of reach or out of the way have 0, the bound that always holds. `reach` is a wish: it is more where the
    cell would have no bound. Overwrites `potential`. Returns the number of floods.
    """
    for r in range(b.row0, b.row1):
        for c in range(b.column0, b.column1):
            to_goal[r, c] = 0.0
    b.column, b.row, b.goal_column, b.goal_row = column, row, goal_column, goal_row
    b.reach = max(reach, DETOUR * straight(column, row, goal_column, goal_row) + SPARE_COST)
    floods = 0
    while True:
        _lay_straight_lines(b, to_goal)
        propagate(least, goal_column, goal_row, -1, -1, False, to_goal, b.reach, potential, scratch)
        floods += 1
        if potential[row, column] < UNREACHED or floods == ATTEMPTS:
            break
        b.reach *= WIDER
    for r in range(b.row0, b.row1):
        for c in range(b.column0, b.column1):
            value = potential[r, c]
            to_goal[r, c] = value if value < UNREACHED else 0.0
    return floods


@inner
def covers(b: Any, column: int, row: int, bound: float) -> bool:
    """Whether all cells on paths of at most `bound` from a cell are known."""
    return bool(bound + straight(column, row, b.column, b.row) <= b.reach)


@inner
def straight(column: int, row: int, to_column: int, to_row: int) -> float:
    """The least that a path between two cells costs."""
    return float(LEAST_CELL_COST * math.hypot(column - to_column, row - to_row))


@inner
def _lay_straight_lines(b: Any, to_start: Any) -> None:
    """Write straight-line costs to the leg's start into the box of an ellipse.

    On the ellipse, straight lines from the start by a cell to the goal cost `reach`.
    """
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
