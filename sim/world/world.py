"""The world that a robot drives in, and the map that it has of it."""

import functools
import math
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Final

import numpy as np

from vastflow.sim.model.digest import FileContent, digest
from vastflow.sim.world import map_file
from vastflow.sim.world.bodies import LARGEST_CELL_M, Body, bodies_on, walls_of
from vastflow.sim.world.difference import WorldDifference, differing
from vastflow.sim.world.occupancy import FREE, UNKNOWN, OccupancyMap
from vastflow.sim.world.readers.reader import WorldError
from vastflow.sim.world.readers.registry import check_within, known_reader, read_file, reader_of

CACHED_MAPS: Final = 6
"""Kept worlds, and tables of maps: about 45 bytes a cell, 130 MB for a building of 85 m × 85 m."""
CACHED_WORLDS: Final = 2
"""Kept tables of worlds that differ from their map, with up to four times its cells; each belongs to one configuration."""
MARGIN_M: Final = 2.0
"""Ground around the bodies of a world without a map."""
MOST_CELLS: Final = 64_000_000
"""Maximum number of cells of a world without a map: 200 m × 200 m."""


@dataclass(frozen=True, eq=False)
class World:
    """A world that a robot drives in.

    Attributes:
        map: Map that the robot has; None without one.
        difference: Difference of the walls from the map; None without one.
        bodies: Bodies that stand in it by a file of its own; None where cells say what stands there.
        cells: Cells that stand in it by a file of its own; None where bodies or the map say what stands there.
        source: The file that says what stands in it; None where it is from no file.
    """

    map: OccupancyMap | None
    difference: WorldDifference | None = None
    bodies: tuple[Body, ...] | None = None
    cells: OccupancyMap | None = None
    source: FileContent | None = None

    @cached_property
    def walls(self) -> OccupancyMap:
        """The walls as they stand: what bodies meet and lidars see, on the map's grid or fractions of its cells."""
        grid = self.map
        if self.bodies is not None:
            walls = walls_of(self.bodies, self._grid_around(self.bodies) if grid is None else grid)
        elif self.cells is not None:
            walls = self.cells if grid is None else _on_grid(self.cells, grid)
        else:
            assert grid is not None
            walls = grid
        return walls if self.difference is None else differing(walls, self.difference)

    @property
    def ground(self) -> OccupancyMap:
        """The grid on which things are placed: the map, or the walls without one."""
        return self.walls if self.map is None else self.map

    @property
    def bounds_m(self) -> tuple[float, float, float, float]:
        """x0, y0, x1, y1 of the ground."""
        rows, columns = self.ground.shape
        corners = self.ground.corners_of(np.array([(0, 0), (0, columns), (rows, 0), (rows, columns)]))
        (x0, y0), (x1, y1) = corners.min(axis=0).tolist(), corners.max(axis=0).tolist()
        return x0, y0, x1, y1

    @cached_property
    def digest(self) -> str:
        """Digest of map, cells, bodies, and difference; that of one part alone is the part's own."""
        parts = [each.digest for each in (self.map, self.cells) if each is not None]
        if self.bodies is not None:
            shown = [repr((body.shape, body.pose, body.bottom_m, body.top_m)) for body in self.bodies]
            parts.append(digest("world", shown))
        return parts[0] if len(parts) == 1 and self.difference is None else digest(parts, repr(self.difference))

    def _grid_around(self, bodies: tuple[Body, ...]) -> OccupancyMap:
        """Return an empty grid around bodies, in whole cells from the origin."""
        bounds = np.array([body.outline.bounds for body in bodies])
        x0, y0 = (math.floor(low / LARGEST_CELL_M) for low in (bounds[:, :2].min(axis=0) - MARGIN_M).tolist())
        x1, y1 = (math.ceil(high / LARGEST_CELL_M) for high in (bounds[:, 2:].max(axis=0) + MARGIN_M).tolist())
        if (count := (x1 - x0) * (y1 - y0)) > MOST_CELLS:
            right = (
                f"at most {MOST_CELLS:,} cells of {LARGEST_CELL_M:g} m around its bodies, or a map whose grid it takes"
            )
            raise WorldError(f"{self.source and self.source.path}: expected {right}, got {count:,} cells")
        origin_xy_m = x0 * LARGEST_CELL_M, y0 * LARGEST_CELL_M
        return OccupancyMap(np.full((y1 - y0, x1 - x0), FREE, dtype=np.int8), LARGEST_CELL_M, origin_xy_m)


def _on_grid(cells: OccupancyMap, grid: OccupancyMap) -> OccupancyMap:
    """Return cells on fractions of a map's grid; what lies beyond them is unknown."""
    fold = math.ceil(grid.resolution_m / LARGEST_CELL_M - 1e-9)
    rows, columns = (count * fold for count in grid.shape)
    found = replace(grid, cells=np.full((rows, columns), UNKNOWN, np.int8), resolution_m=grid.resolution_m / fold)
    for row in range(rows):
        centers_m = found.centers_of(np.column_stack((np.full(columns, row), np.arange(columns))))
        at = np.floor(cells.in_cells(centers_m)).astype(np.int64)
        there = np.flatnonzero(((at >= 0) & (at < cells.shape)).all(axis=1))
        found.cells[row, there] = cells.cells[tuple(at[there].T)]
    return found


def world_at(path: Path, within: Path | None = None) -> World:
    """Return the world of a map or another file; see `read_file`.

    Args:
        within: Folder that must contain its files, links followed; None for a user's own, which may lie anywhere.
    """
    if within is not None:
        check_within(path, within)
    return _world_of(read_file(path), FileContent(str(path), ""))


def world_content(path: Path, within: Path | None = None) -> FileContent:
    """Return a map or a world's file as a value, with its world's digest; raises as `world_at`."""
    known_reader(path)
    return FileContent(str(path), world_at(path, within).digest)


def map_content(path: str | Path) -> FileContent:
    """Return a map as a value with the digest of its cells, whatever its suffix.

    Raises:
        WorldError: it can't be read, or is another kind of world.
    """
    if reader_of(Path(path)) not in (None, map_file.RosMap):
        raise WorldError(f"{path}: expected a map_server YAML file, got another kind of world")
    return FileContent(str(path), map_file.load_map(path).digest)


def free_unknown_cells(file: FileContent) -> int:
    """Return how many cells of a map look unknown and are free; see `vastflow.sim.world.map_file.free_unknown_cells`."""
    return map_file.free_unknown_cells(Path(file.path))


@functools.lru_cache(maxsize=CACHED_MAPS)
def read_world(
    file: FileContent, difference: WorldDifference | None = None, world_file: FileContent | None = None
) -> World:
    """Return the world of a map or a file, changed by a difference or a file of its own.

    Raises:
        WorldError: a file can't be read, or has changed since the campaign was read.
    """
    if difference is None and world_file is None:
        world = _world_of(read_file(Path(file.path)), file)
        check_unchanged(file, world)
        return world
    standing = World(None) if world_file is None else read_world(world_file)
    known, bodies = read_world(file).map, standing.bodies
    if known is not None and bodies is not None:
        bodies = bodies_on(known, bodies)
    return World(known, difference, bodies, standing.map, world_file or file)


def check_unchanged(file: FileContent, found: World) -> None:
    """Raise a `WorldError` if what was found in a file is not what it was when the campaign was read."""
    if found.digest != file.digest:
        raise WorldError(f"{file.path} changed since the campaign was read. Run the campaign again.")


def read_grid(file: FileContent) -> OccupancyMap:
    """Return the cells of a map or mask, or the walls of another world; see `read_world`."""
    return read_world(file).ground


def _world_of(found: tuple[Body, ...] | OccupancyMap, source: FileContent) -> World:
    return World(found, source=source) if isinstance(found, OccupancyMap) else World(None, bodies=found, source=source)
