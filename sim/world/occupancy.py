"""Occupancy maps of robot and world."""

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vastflow.sim.model.digest import digest
from vastflow.sim.model.pose import GridFrame

FREE: Final = 0
OCCUPIED: Final = 100
UNKNOWN: Final = -1


@dataclass(frozen=True, eq=False)
class OccupancyMap:
    """A grid of occupancy.

    Attributes:
        cells: (H, W) int8, row 0 at the lowest y: 0 free, 1..99 between, 100 occupied, -1 unknown.
        resolution_m: Edge of a cell.
        origin_xy_m: Map position of the lower left corner of cell (0, 0).
        yaw_rad: Counter-clockwise turn of the grid about that corner: at most an eighth of a turn, see `vastflow.sim.world.map_file.load_map`.
    """

    cells: NDArray[np.int8]
    resolution_m: float
    origin_xy_m: tuple[float, float]
    yaw_rad: float = 0.0

    @property
    def shape(self) -> tuple[int, int]:
        rows, columns = self.cells.shape
        return rows, columns

    @cached_property
    def free(self) -> NDArray[np.bool_]:
        """Mask (H, W) of cells known to be free."""
        return np.asarray(self.cells == FREE)

    @cached_property
    def occupied(self) -> NDArray[np.bool_]:
        """Mask (H, W) of walls."""
        return np.asarray(self.cells == OCCUPIED)

    @cached_property
    def frame(self) -> GridFrame:
        """The grid's frame, for all arithmetic on cells."""
        return GridFrame(self.origin_xy_m, self.yaw_rad)

    @cached_property
    def upright(self) -> "OccupancyMap":
        """The grid in its own frame, not turned."""
        return replace(self, yaw_rad=0.0)

    def cell_of(self, x_m: float, y_m: float) -> tuple[int, int]:
        """Return (row, column) of the cell at a point of the map, which may be outside of the grid."""
        x_m, y_m = self.frame.to_grid(x_m, y_m)
        return (
            math.floor((y_m - self.origin_xy_m[1]) / self.resolution_m),
            math.floor((x_m - self.origin_xy_m[0]) / self.resolution_m),
        )

    def center_of(self, row: int, column: int) -> tuple[float, float]:
        """Return the map position (x, y) in meters of a cell's center."""
        return self.frame.to_map(
            self.origin_xy_m[0] + (column + 0.5) * self.resolution_m,
            self.origin_xy_m[1] + (row + 0.5) * self.resolution_m,
        )

    def centers_of(self, cells: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return map positions (N, 2) of the centers of cells (N, 2) of row and column."""
        return self.frame.points_to_map((cells[:, ::-1] + 0.5) * self.resolution_m + np.asarray(self.origin_xy_m))

    def corners_of(self, cells: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return map positions (N, 2) of the lower left corners of cells (N, 2)."""
        return self.frame.points_to_map(cells[:, ::-1] * self.resolution_m + np.asarray(self.origin_xy_m))

    def in_cells(self, xy_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return points (N, 2) of the map as fractional row and column; the floor is the cell."""
        return (self.frame.points_to_grid(xy_m) - self.origin_xy_m)[:, ::-1] / self.resolution_m

    def contains(self, row: int, column: int) -> bool:
        rows, columns = self.shape
        return 0 <= row < rows and 0 <= column < columns

    @cached_property
    def digest(self) -> str:
        """Digest of cells, resolution, and frame."""
        cells = np.ascontiguousarray(self.cells)
        origin = [*self.origin_xy_m, *([self.yaw_rad] if self.yaw_rad else [])]
        return digest(list(cells.shape), cells.tobytes().hex(), self.resolution_m, origin)
