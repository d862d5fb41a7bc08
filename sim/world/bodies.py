"""Bodies of a world, and their walls for a robot and its lidar."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, TypeAlias

import numpy as np
import shapely

from vastflow.sim.model.elementary import cos_sin, hypots
from vastflow.sim.model.pose import Pose
from vastflow.sim.world.occupancy import FREE, OCCUPIED, OccupancyMap

LARGEST_CELL_M: Final = 0.025
"""Largest cell of walls that are made of bodies."""
_SEGMENTS: Final = 64
"""Segments of a disc's outline."""


@dataclass(frozen=True, slots=True)
class Disc:
    """A disc about a body's pose."""

    radius_m: float


@dataclass(frozen=True, slots=True)
class Box:
    """A rectangle about a body's pose: `length_m` along its x, `width_m` along its y."""

    length_m: float
    width_m: float


@dataclass(frozen=True, slots=True)
class Polygon:
    """A polygon in a body's frame.

    Attributes:
        vertices_m: Three (x, y) or more, without a repeated first one.
    """

    vertices_m: tuple[tuple[float, float], ...]


Shape: TypeAlias = Disc | Box | Polygon


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
        x_m, y_m = self.pose.x_m, self.pose.y_m
        match self.shape:
            case Disc(radius_m):
                turns = (cos_sin(math.tau * k / _SEGMENTS) for k in range(_SEGMENTS))
                return shapely.Polygon([(x_m + radius_m * c, y_m + radius_m * s) for c, s in turns])
            case Box(length_m, width_m):
                a, b = length_m / 2, width_m / 2
                vertices: Sequence[tuple[float, float]] = ((a, b), (-a, b), (-a, -b), (a, -b))
            case Polygon(vertices):
                pass
        c, s = cos_sin(self.pose.yaw_rad)
        return shapely.Polygon([(x_m + c * x - s * y, y_m + s * x + c * y) for x, y in vertices])


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
