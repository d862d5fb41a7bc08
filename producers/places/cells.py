"""The cells of a map: those that an area on the floor covers, and lengths on them.

Lengths are those of `vastflow.sim.world.octile`, which is imported with the first question. It takes numba and scipy along, half a
second, and a campaign whose producers' work is all in the store asks nothing.
"""

import math

import numpy as np
from numpy.typing import NDArray
from shapely.geometry import Polygon
from shapely.geometry.polygon import orient

from vastflow.sim.world.occupancy import OccupancyMap


def touched_cells(occupancy: OccupancyMap, footprint: Polygon) -> NDArray[np.int64]:
    """(K, 2) row and column of the map's cells that a convex `footprint` touches, walls or not."""
    return _cells(occupancy, footprint, 0.5)


def centerd_cells(occupancy: OccupancyMap, area: Polygon) -> NDArray[np.int64]:
    """(K, 2) row and column of the map's cells whose center lies in a convex `area`."""
    return _cells(occupancy, area, 0.0)


def _cells(occupancy: OccupancyMap, area: Polygon, half: float) -> NDArray[np.int64]:
    """Return the cells that a convex area touches with the square of 2 × `half` cells round their center."""
    outline = occupancy.frame.points_to_grid(np.array(orient(area).exterior.coords))
    occupancy = occupancy.upright
    (left, bottom), (right, top) = outline.min(axis=0).tolist(), outline.max(axis=0).tolist()
    first = np.maximum(occupancy.cell_of(left, bottom), 0)
    last = np.minimum(occupancy.cell_of(right, top), np.array(occupancy.shape) - 1)
    if np.any(last < first):  # it lies beside the map, however far
        return np.empty((0, 2), dtype=np.int64)
    rows, columns = np.mgrid[first[0] : last[0] + 1, first[1] : last[1] + 1]
    cells = np.column_stack((rows.ravel(), columns.ravel()))
    centers = (cells[:, ::-1] + 0.5) * occupancy.resolution_m + occupancy.origin_xy_m
    sides = np.diff(outline, axis=0)
    normals = np.column_stack((sides[:, 1], -sides[:, 0]))
    # Separating axes: the grid's own are the bounds above. A tenth of the time of one shapely box a cell.
    beyond = centers @ normals.T - np.sum(outline[:-1] * normals, axis=1)
    return np.asarray(cells[~np.any(beyond > np.abs(normals).sum(axis=1) * occupancy.resolution_m * half, axis=1)])


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
