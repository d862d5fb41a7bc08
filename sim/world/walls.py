"""Walls as few rectangles: what physics collides with."""

import math

import numpy as np
from numpy.typing import NDArray

from vastflow.sim.world.occupancy import OccupancyMap


def wall_rectangles(occupancy: OccupancyMap) -> NDArray[np.float64]:
    """Return rectangles (N, 4) as x0, y0, x1, y1 in meters whose union borders the map's occupied cells.

    Cells without a free neighbor, which nothing can reach, are left out. Runs of cells in a row are merged with equal runs in the rows above.
    """
    framed = np.pad(occupancy.occupied, 1, constant_values=True)
    across = framed[:, :-2] & framed[:, 1:-1] & framed[:, 2:]
    shell = occupancy.occupied & ~(across[:-2] & across[1:-1] & across[2:])
    edges = np.diff(np.pad(shell.astype(np.int8), ((0, 0), (1, 1))), axis=1)
    row, first = np.nonzero(edges == 1)
    last = np.nonzero(edges == -1)[1]
    order = np.lexsort((row, last, first))
    row, first, last = row[order], first[order], last[order]
    new = np.ones(len(row), dtype=np.bool_)
    new[1:] = (np.diff(first) != 0) | (np.diff(last) != 0) | (np.diff(row) != 1)
    begins = np.flatnonzero(new)
    ends = np.append(begins[1:], len(row))[: len(begins)] - 1
    cells = np.column_stack([first[begins], row[begins], last[begins], row[ends] + 1]).astype(np.float64)
    return np.asarray(cells * occupancy.resolution_m + np.tile(np.asarray(occupancy.origin_xy_m), 2))


class WallIndex:
    """A map's wall rectangles by tile, so that a run gives physics only the walls it comes near."""

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
        return math.floor(x_m / self.TILE_M), math.floor(y_m / self.TILE_M)

    def around(self, tile: tuple[int, int]) -> list[int]:
        """Return rectangles in a tile and its eight neighbors, in increasing order."""
        x, y = tile
        near = {index for dx in (-1, 0, 1) for dy in (-1, 0, 1) for index in self._tiles.get((x + dx, y + dy), ())}
        return sorted(near)
