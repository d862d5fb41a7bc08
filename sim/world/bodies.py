"""Bodies of a world, and their walls for a robot and its lidar."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import shapely

from vastflow.sim.model.elementary import hypots
from vastflow.sim.model.pose import Pose
from vastflow.sim.model.shape import Disc, Shape, outline_at
from vastflow.sim.world.occupancy import FREE, OCCUPIED, OccupancyMap

LARGEST_CELL_M: Final = 0.025
"""Largest cell of walls that are made of bodies."""


@dataclass(frozen=True, slots=True)
class Body:
    """A body of a world, at rest.

    Attributes:
        name: As its file calls it.
        pose: In the map's frame.
        bottom_m, top_m: Heights above the floor between which it is.
    """

    name: str
    shape: Shape
    pose: Pose
    bottom_m: float = 0.0
    top_m: float = math.inf

    @property
    def outline(self) -> shapely.Polygon:
        """The outline in the map's frame (m)."""
        return outline_at(self.shape, self.pose)


def walls_of(bodies: Sequence[Body], occupancy: OccupancyMap) -> OccupancyMap:
    """Return bodies as walls on a map's grid, in cells of `LARGEST_CELL_M` at most.

    A cell is a wall if a body covers its center, or crosses it and is thinner than a cell.
    """
    fold = math.ceil(occupancy.resolution_m / LARGEST_CELL_M - 1e-9)
    cell_m = occupancy.resolution_m / fold
    rows, columns = (count * fold for count in occupancy.shape)
    cells = np.full((rows, columns), FREE, dtype=np.int8)
    for body in bodies:
        outline = shapely.transform(body.outline, lambda xy_m: occupancy.in_cells(xy_m)[:, ::-1] * fold)
        x0, y0, x1, y1 = outline.bounds
        row0, row1 = max(math.floor(y0), 0), min(math.ceil(y1), rows)
        column0, column1 = max(math.floor(x0), 0), min(math.ceil(x1), columns)
        if row0 >= row1 or column0 >= column1:
            continue
        row, column = np.mgrid[row0:row1, column0:column1]
        if isinstance(body.shape, Disc):  # without an outline's sines, which differ from host to host
            ((y, x),) = occupancy.in_cells(np.array([(body.pose.x_m, body.pose.y_m)])) * fold
            covered = hypots(column + 0.5 - x, row + 0.5 - y) <= body.shape.radius_m / cell_m
        else:
            shapely.prepare(outline)
            covered = shapely.contains_xy(outline, column + 0.5, row + 0.5)
        if outline.area < 0.5 * outline.length:  # of a long wall: thinner than a cell
            x, y = np.floor(shapely.get_coordinates(shapely.segmentize(outline, 0.25))).astype(np.int64).T
            there = (row0 <= y) & (y < row1) & (column0 <= x) & (x < column1)
            covered[y[there] - row0, x[there] - column0] = True
        cells[row0:row1, column0:column1][covered] = OCCUPIED
    return replace(occupancy, cells=cells, resolution_m=cell_m)
