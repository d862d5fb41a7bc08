"""Keepout filters (nav2_costmap_2d): cells that are kept out of, drawn as a mask.

A mask is a map of its own cells. It raises a costmap after all its layers, so that nothing is inflated round it.
"""

import math
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vastflow.sim.kernels.numeric import inner
from vastflow.sim.nav2.costmaps import inflation
from vastflow.sim.nav2.costmaps.inflation import INSCRIBED, LETHAL
from vastflow.sim.nav2.costmaps.window import Window
from vastflow.sim.world.occupancy import OCCUPIED, UNKNOWN, OccupancyMap

NOTHING: Final = inflation.UNKNOWN
"""Cost of a mask's cell that leaves the costmap unchanged."""


class Mask(NamedTuple):
    """A mask as kernels have it."""

    cells: Any  # (R, C); (0, 0) where there is none.
    place: Any  # (2, 3) float64: (x, y, 1) in the frame of the map's grid to the mask's column and row.


def keepout_mask(mask: OccupancyMap | None, occupancy: OccupancyMap) -> Mask:
    """A keepout mask over a map, as costs: 100 is lethal, unknown cells are `NOTHING`."""
    if mask is None:
        return Mask(np.zeros((0, 0), dtype=np.uint8), np.zeros((2, 3)))
    costs = np.floor(mask.cells * (LETHAL / OCCUPIED) + 0.5)
    return Mask(np.where(mask.cells == UNKNOWN, NOTHING, costs).astype(np.uint8), mask_place(mask, occupancy))


def on_map(mask: Mask, occupancy: OccupancyMap) -> NDArray[np.uint8]:
    """The costs (H, W) of a mask at the centers of a map's cells; (0, 0) without a mask."""
    if mask.cells.size == 0:
        return np.asarray(mask.cells)
    rows, columns = occupancy.shape
    x, y = (
        occupancy.origin_xy_m[axis] + (np.arange(count) + 0.5) * occupancy.resolution_m
        for axis, count in ((0, columns), (1, rows))
    )
    column, row = (np.floor(np.add.outer(by[1] * y + by[2], by[0] * x)).astype(np.int64) for by in mask.place)
    inside = (column >= 0) & (row >= 0) & (column < mask.cells.shape[1]) & (row < mask.cells.shape[0])
    found = np.full(occupancy.shape, NOTHING, dtype=np.uint8)
    found[inside] = mask.cells[row[inside], column[inside]]
    return found


def with_keepout(costs: NDArray[np.uint8], keepout: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Costs (H, W) after a keepout filter; without one, as they are."""
    if keepout.size == 0:
        return costs
    raised = (keepout != NOTHING) & ((keepout > costs) | (costs == inflation.UNKNOWN))
    return np.where(raised, keepout, costs)


def mask_place(mask: OccupancyMap, occupancy: OccupancyMap) -> NDArray[np.float64]:
    def cell(x_m: float, y_m: float) -> NDArray[np.float64]:
        on_mask_m = mask.frame.to_grid(*occupancy.frame.to_map(x_m, y_m))
        return (np.array(on_mask_m) - mask.origin_xy_m) / mask.resolution_m

    corner = cell(0.0, 0.0)
    return np.column_stack([cell(1.0, 0.0) - corner, cell(0.0, 1.0) - corner, corner])


@inner
def override_at(q: Any, cost: int) -> Any:
    """The cost that replaces a filter's while the robot is on a lethal cell of the mask, or `NOTHING`."""
    if q.override_lethal_cost and INSCRIBED <= cost <= LETHAL:
        return min(q.lethal_override_cost, INSCRIBED - 1)
    return NOTHING


@inner
def keep_out(costs: Any, keepout: Any, override: int, row0: int, row1: int, col0: int, col1: int) -> None:
    """Raise a window of a costmap (H, W) to what `on_map` gave; for `override` see `override_at`."""
    for row in range(row0, row1):
        for column in range(col0, col1):
            _raise(costs, row, column, keepout[row, column], override)


@inner
def keep_out_of_window(window: Window, mask: Mask, map_odom: Any, q: Any, x_m: float, y_m: float) -> None:
    """Raise a window of the odom frame to a mask, for a robot at (x, y) on the map."""
    inside, own_row, own_column = cell_of(mask, x_m, y_m)
    override = override_at(q, mask.cells[own_row, own_column]) if inside else NOTHING
    c, s = math.cos(map_odom[2]), math.sin(map_odom[2])
    place = window.place
    for row in range(window.costs.shape[0]):
        for column in range(window.costs.shape[1]):
            x, y = place[0] + (column + 0.5) * place[2], place[1] + (row + 0.5) * place[2]
            found, mask_row, mask_column = cell_of(mask, map_odom[0] + c * x - s * y, map_odom[1] + s * x + c * y)
            if found:
                _raise(window.costs, row, column, mask.cells[mask_row, mask_column], override)


@inner
def cell_of(mask: Mask, x_m: float, y_m: float) -> Any:
    """(found, row, column) of a position."""
    column = math.floor(mask.place[0, 0] * x_m + mask.place[0, 1] * y_m + mask.place[0, 2])
    row = math.floor(mask.place[1, 0] * x_m + mask.place[1, 1] * y_m + mask.place[1, 2])
    return 0 <= row < mask.cells.shape[0] and 0 <= column < mask.cells.shape[1], row, column


@inner
def _raise(costs: Any, row: int, column: int, cost: int, override: int) -> None:
    here = costs[row, column]
    if cost != NOTHING and (cost > here or here == inflation.UNKNOWN):
        costs[row, column] = cost if override == NOTHING else override
