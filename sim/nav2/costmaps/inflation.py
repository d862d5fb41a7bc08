"""The inflation layer: cost by distance to the nearest lethal cell.

Costs are Nav2's bytes: 0 free, 1..252 inflated, 253 inscribed, 254 lethal, 255 unknown.
"""

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vastflow.sim.kernels.arrays import exps
from vastflow.sim.kernels.numeric import inner, njit
from vastflow.sim.model.elementary import exp, hypots, log

FREE: Final = 0
INSCRIBED: Final = 253
LETHAL: Final = 254
UNKNOWN: Final = 255


def cost_stamp(
    resolution_m: float, inscribed_radius_m: float, inflation_radius_m: float, cost_scaling_factor: float
) -> NDArray[np.uint8]:
    """Cost (2R+1, 2R+1) round one lethal cell, R = ceil(inflation radius / resolution) cells.

    254 at the center, 253 within the inscribed radius, floor(252 exp(-k (d - r_inscribed))) beyond, 0 past R cells.
    """
    if cost_scaling_factor > 0.0:  # farther away all costs are 0
        inflation_radius_m = min(
            inflation_radius_m, inscribed_radius_m + log(252.0) / cost_scaling_factor + resolution_m
        )
    reach = math.ceil(inflation_radius_m / resolution_m)
    offsets = np.arange(-reach, reach + 1)
    cells = hypots(offsets[:, None], offsets[None, :])
    distance_m = cells * resolution_m
    powers = -cost_scaling_factor * np.maximum(distance_m - inscribed_radius_m, 0.0)
    cost = np.floor(252.0 * exps(powers.ravel()).reshape(powers.shape))
    cost = np.where(distance_m <= inscribed_radius_m, float(INSCRIBED), np.minimum(cost, 252.0))
    cost[cells > reach] = FREE
    cost[reach, reach] = LETHAL
    return cost.astype(np.uint8)


def cost_at_distance(distance_m: float, inscribed_radius_m: float, cost_scaling_factor: float) -> float:
    """Cost of a cell at a distance from the nearest lethal one (Nav2's `computeCost`).

    It is not 254 at distance 0, and does not end at the inflation radius.
    """
    if distance_m <= inscribed_radius_m:
        return float(INSCRIBED)
    return math.floor(252.0 * exp(-cost_scaling_factor * (distance_m - inscribed_radius_m)))


def inflate(
    costmap_u8: NDArray[np.uint8],
    resolution_m: float,
    inscribed_radius_m: float,
    inflation_radius_m: float,
    cost_scaling_factor: float,
) -> NDArray[np.uint8]:
    """A costmap (H, W) of 0, 254 and 255 cells with inflation, as Nav2's layer computes it.

    An unknown cell stays unknown unless its inflated cost is at least 253.
    """
    stamp = cost_stamp(resolution_m, inscribed_radius_m, inflation_radius_m, cost_scaling_factor)
    return with_unknown(costmap_u8, inflation_of(costmap_u8, stamp))


def inflation_of(costmap_u8: NDArray[np.uint8], stamp: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Costs (H, W) round the lethal cells of a costmap, unknown cells no exception."""
    out = np.zeros(costmap_u8.shape, dtype=np.uint8)
    stamp_lethal(np.ascontiguousarray(costmap_u8 == LETHAL).view(np.uint8), stamp, out)
    return out


def with_unknown(costmap_u8: NDArray[np.uint8], costs: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Inflation `costs` with the unknown cells of `costmap_u8`, except where they are inscribed or lethal."""
    return np.where((costmap_u8 == UNKNOWN) & (costs < INSCRIBED), np.uint8(UNKNOWN), costs)


@njit
def stamp_lethal(lethal: Any, stamp: Any, out: Any) -> None:
    """Raise `out` (H, W) to `stamp` round every lethal cell; exact, as cost falls with distance."""
    rows, columns = lethal.shape
    for row in range(rows):
        for column in range(columns):
            if lethal[row, column] == 0:
                continue
            out[row, column] = LETHAL
            # A cell walled in by lethal cells is never the nearest one to a free cell.
            if (
                0 < row < rows - 1
                and 0 < column < columns - 1
                and lethal[row - 1, column]
                and lethal[row + 1, column]
                and lethal[row, column - 1]
                and lethal[row, column + 1]
            ):
                continue
            raise_round(out, stamp, row, column, (0, rows, 0, columns))


@inner
def raise_round(costs: Any, stamp: Any, row: int, column: int, window: Any) -> None:
    """Raise `costs` to `stamp` round a cell within a window (row0, row1, col0, col1)."""
    row0, row1, col0, col1 = window
    reach = stamp.shape[0] // 2
    left, right = max(col0, column - reach), min(col1, column + reach + 1)
    if left >= right:
        return
    for r in range(max(row0, row - reach), min(row1, row + reach + 1)):
        target = costs[r, left:right]
        source = stamp[r - row + reach, left - column + reach : right - column + reach]
        for i in range(target.shape[0]):
            target[i] = max(target[i], source[i])
