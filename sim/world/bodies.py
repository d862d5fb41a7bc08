"""Bodies of a world, and their walls for a robot and its lidar."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray

from vastflow.sim.model.elementary import hypots
from vastflow.sim.model.pose import Pose
from vastflow.sim.model.shape import Disc, Shape, outline_at, polygons_about
from vastflow.sim.world.occupancy import FREE, OCCUPIED, OccupancyMap

DISC, EDGE = 0.0, 1.0
"""Kinds of outlines."""
_HAIR: Final = 1e-6
"""Cells by which an outline is wider where it is looked up: rounding may not lose a cell."""
LOWEST_M: Final = 0.02
HIGHEST_M: Final = 0.4
"""Heights between which a body stands in the way of a robot or its lidar: thresholds are driven over, tables under."""
LARGEST_CELL_M: Final = 0.025
"""Largest cell of walls that are made of bodies."""


@dataclass(frozen=True, slots=True)
class Body:
    """A body of a world, at rest.

    Attributes:
        name: Name in its file.
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


def bodies_on(grid: OccupancyMap, bodies: Sequence[Body]) -> tuple[Body, ...]:
    """Return bodies as far as they stand on a grid.

    Where it ends the world does, for beams, contacts, and clearances. A disc about a point of the grid stays whole, as it is nearest to any place of the grid within it; another one becomes a polygon.
    """
    rows, columns = grid.shape
    ground = shapely.Polygon(grid.corners_of(np.array([(0, 0), (0, columns), (rows, columns), (rows, 0)])))
    shapely.prepare(ground)
    found: list[Body] = []
    for body in bodies:
        x_m, y_m = body.pose.x_m, body.pose.y_m
        whole = shapely.Point(x_m, y_m) if isinstance(body.shape, Disc) else body.outline
        if ground.covers(whole):
            found.append(body)
            continue
        for part in shapely.get_parts(body.outline.intersection(ground)):
            pieces = polygons_about(x_m, y_m, part) if isinstance(part, shapely.Polygon) else ()
            found += (replace(body, shape=each, pose=Pose(x_m, y_m, 0.0)) for each in pieces)
    return tuple(found)


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


@dataclass(frozen=True, eq=False, slots=True)
class Outlines:
    """Outlines of bodies by the cells of a grid that they cross, so that beams meet them exactly.

    Attributes:
        named: (H, W) int32, 0 for a cell that none crosses; otherwise those in it are `members[starts[n - 1] : starts[n]]`.
        parts: (P, 5) float64 in cells: `DISC`, x, y, radius, 0; or `EDGE` and x, y of its two ends.
    """

    named: NDArray[np.int32]
    starts: NDArray[np.int32]
    members: NDArray[np.int32]
    parts: NDArray[np.float64]


def outlines_of(bodies: Sequence[Body], grid: OccupancyMap) -> Outlines:
    """Return the outlines of bodies on a grid."""
    parts: list[tuple[float, ...]] = []
    crossed: list[NDArray[np.int64]] = []
    for body in bodies:
        xy = grid.in_cells(np.array(body.outline.exterior.coords))[:, ::-1]
        if isinstance(body.shape, Disc):
            ((y, x),), radius = grid.in_cells(np.array([(body.pose.x_m, body.pose.y_m)])), body.shape.radius_m
            radius /= grid.resolution_m
            row, column = _within(grid, np.array([(x - radius, y - radius), (x + radius, y + radius)]))
            right, up = np.abs(column + 0.5 - x), np.abs(row + 0.5 - y)
            nearest = hypots(np.maximum(right - 0.5, 0.0), np.maximum(up - 0.5, 0.0))
            crosses = (nearest <= radius + _HAIR) & (hypots(right + 0.5, up + 0.5) >= radius - _HAIR)
            parts.append((DISC, x, y, radius, 0.0))
            crossed.append(row[crosses] * grid.shape[1] + column[crosses])
            continue
        for (x0, y0), (x1, y1) in pairwise(xy.tolist()):
            row, column = _within(grid, np.array([(x0, y0), (x1, y1)]))
            dx, dy = x1 - x0, y1 - y0
            off = np.abs((column + 0.5 - x0) * dy - (row + 0.5 - y0) * dx)
            crosses = off <= 0.5 * (abs(dx) + abs(dy)) + _HAIR * math.sqrt(dx * dx + dy * dy)
            parts.append((EDGE, x0, y0, x1, y1))
            crossed.append(row[crosses] * grid.shape[1] + column[crosses])
    at = np.concatenate(crossed)
    order = np.argsort(at, kind="stable")
    cells, starts = np.unique(at[order], return_index=True)
    named = np.zeros(grid.shape, dtype=np.int32)
    named.reshape(-1)[cells] = np.arange(1, len(cells) + 1)
    members = np.repeat(np.arange(len(parts), dtype=np.int32), list(map(len, crossed)))[order]
    return Outlines(named, np.append(starts, len(at)).astype(np.int32), members, np.array(parts))


def _within(grid: OccupancyMap, xy: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return row and column (K,) of the cells of a grid that the bounds of points (x, y) touch."""
    low = np.maximum(np.floor(xy.min(axis=0) - _HAIR), 0).astype(np.int64)
    high = np.minimum(np.floor(xy.max(axis=0) + _HAIR) + 1, grid.shape[::-1]).astype(np.int64)
    row, column = np.mgrid[low[1] : max(high[1], low[1]), low[0] : max(high[0], low[0])]
    return row.reshape(-1), column.reshape(-1)


def distances_to(bodies: Sequence[Body], xy_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the distance (N,) of each point (N, 2) to the nearest body, 0 inside of one."""
    nearest_m = np.full(len(xy_m), math.inf)
    for body in bodies:
        if isinstance(body.shape, Disc):
            apart_m = hypots(xy_m[:, 0] - body.pose.x_m, xy_m[:, 1] - body.pose.y_m) - body.shape.radius_m
            np.minimum(nearest_m, apart_m, out=nearest_m)
    if others := [body.outline for body in bodies if not isinstance(body.shape, Disc)]:
        _, apart_m = shapely.STRtree(others).query_nearest(
            shapely.points(xy_m), all_matches=False, return_distance=True
        )
        np.minimum(nearest_m, apart_m, out=nearest_m)
    return np.asarray(np.maximum(nearest_m, 0.0))
