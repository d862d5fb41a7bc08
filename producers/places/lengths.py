"""Lengths on a ground's cells: `vastflow.sim.world.octile`, which is imported with the first question.

It takes numba and scipy along, half a second, and a campaign whose producers' work is all in the store asks nothing.
"""

import math

import numpy as np
from numpy.typing import NDArray

from vastflow.sim.world.occupancy import OccupancyMap


def distance_field(
    free: NDArray[np.bool_], row: int, column: int, limit_cells: float = math.inf
) -> NDArray[np.float32]:
    """See `vastflow.sim.world.octile.distance_field`."""
    from vastflow.sim.world import octile

    return octile.distance_field(free, row, column, limit_cells)


def descend(field: NDArray[np.float32], row: int, column: int) -> NDArray[np.int64]:
    """See `vastflow.sim.world.octile.descend`."""
    from vastflow.sim.world import octile

    return octile.descend(field, row, column)


def shortest_path(
    occupancy: OccupancyMap, free: NDArray[np.bool_], stops_xy_m: NDArray[np.float64]
) -> tuple[NDArray[np.float64], float] | None:
    """See `vastflow.sim.world.octile.shortest_path`."""
    from vastflow.sim.world import octile

    return octile.shortest_path(occupancy, free, stops_xy_m)
