"""Walls as few rectangles: what physics collides with."""

import math

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from vastflow.sim.maps import OccupancyMap


def wall_rectangles(occupancy: OccupancyMap) -> NDArray[np.float64]:
    """Rectangles (N, 4) as x0, y0, x1, y1 in metres whose union borders the map's occupied cells.

    Cells that touch nothing but occupied cells are left out, since nothing can reach them. Runs of cells in a row are
    merged with equal runs in the rows above.
    """
    occupied = occupancy.occupied
    inner = ndimage.binary_erosion(occupied, structure=np.ones((3, 3)), border_value=1)
    shell = occupied & ~inner
    rectangles: list[tuple[int, int, int, int]] = []
    open_runs: dict[tuple[int, int], int] = {}
    for row in range(shell.shape[0] + 1):
        runs = _runs(shell[row]) if row < shell.shape[0] else set()
        for run in [run for run in open_runs if run not in runs]:
            rectangles.append((run[0], open_runs.pop(run), run[1], row))
        for run in runs:
            open_runs.setdefault(run, row)
    cells = np.array(sorted(rectangles), dtype=np.float64).reshape(-1, 4)
    return np.asarray(cells * occupancy.resolution_m + np.tile(np.asarray(occupancy.origin_xy_m), 2))


def _runs(row: NDArray[np.bool_]) -> set[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(np.concatenate([[0], row.astype(np.int8), [0]])))
    return {(int(start), int(end)) for start, end in edges.reshape(-1, 2)}


class WallIndex:
    """A map's wall rectangles by tile, so that a run gives physics only the walls it comes near.

    Attributes:
        rectangles: (N, 4) as from `wall_rectangles`.
    """

    TILE_M = 2.0

    def __init__(self, occupancy: OccupancyMap) -> None:
        self.rectangles = wall_rectangles(occupancy)
        self._tiles: dict[tuple[int, int], list[int]] = {}
        spans = np.floor(self.rectangles / self.TILE_M).astype(np.int64)
        for index, (x0, y0, x1, y1) in enumerate(spans.tolist()):
            for x in range(x0, x1 + 1):
                for y in range(y0, y1 + 1):
                    self._tiles.setdefault((x, y), []).append(index)

    def tile_of(self, x_m: float, y_m: float) -> tuple[int, int]:
        """The tile that holds a point."""
        return math.floor(x_m / self.TILE_M), math.floor(y_m / self.TILE_M)

    def around(self, tile: tuple[int, int]) -> list[int]:
        """Rectangles in a tile and its eight neighbours, in increasing order."""
        x, y = tile
        near = {index for dx in (-1, 0, 1) for dy in (-1, 0, 1) for index in self._tiles.get((x + dx, y + dy), ())}
        return sorted(near)
