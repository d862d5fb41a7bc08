"""Differences of the world from the robot's map: displaced walls and missing furniture."""

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vastflow.sim.model.elementary import normals
from vastflow.sim.world.occupancy import FREE, OccupancyMap

FURNITURE_M: Final = 2.0
"""Longest side of furniture's bounding box: furniture is apart from all other occupied cells."""
LARGEST_CELL_M: Final = 0.025
"""Largest cell of a world with displaced walls, which shows offsets of less than a cell of the map."""
_WAVES: Final = 64
_NODES: Final = 8
"""Nodes per correlation length; offsets are linear between them."""
_ROWS: Final = 256


@dataclass(frozen=True, slots=True)
class WorldDifference:
    """Random difference of a world from its map.

    Attributes:
        wall_offset_m: Standard deviation of the walls' offset along either axis.
        correlation_length_m: Correlation length of the offsets.
        missing_share: Probability that a piece of furniture is missing.
    """

    seed: int
    wall_offset_m: float = 0.0
    correlation_length_m: float = 2.0
    missing_share: float = 0.0


def differing(occupancy: OccupancyMap, difference: WorldDifference) -> OccupancyMap:
    """Return the walls in the map's frame; its cells are fractions of the map's where walls are displaced.

    Offsets are a Gaussian random field of squared exponential covariance, the sum of random waves (Rahimi and Recht, Random Features
    for Large-Scale Kernel Machines, 2007). Walls stay whole while its standard deviation is well below the correlation length.
    """
    cells, fold = occupancy.cells, 1
    if difference.missing_share > 0.0:
        cells = _without_furniture(occupancy, difference)
    if difference.wall_offset_m > 0.0:
        fold = math.ceil(occupancy.resolution_m / LARGEST_CELL_M - 1e-9)
        cells = _offset(cells, occupancy.resolution_m, fold, difference)
    return replace(occupancy, cells=cells, resolution_m=occupancy.resolution_m / fold)


def _rng(difference: WorldDifference, stream: int) -> np.random.Generator:
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence([difference.seed, stream])))


def _without_furniture(occupancy: OccupancyMap, difference: WorldDifference) -> NDArray[np.int8]:
    """Free each piece of furniture at the stated probability, in reading order."""
    from scipy import ndimage  # imported in half a second

    labels, _ = ndimage.label(occupancy.occupied, np.ones((3, 3)))
    most = FURNITURE_M / occupancy.resolution_m + 1e-9
    pieces = [
        index
        for index, (rows, columns) in enumerate(ndimage.find_objects(labels), 1)
        if max(rows.stop - rows.start, columns.stop - columns.start) <= most
    ]
    gone = _rng(difference, 0).random(len(pieces)) < difference.missing_share
    return np.where(np.isin(labels, np.array(pieces, dtype=np.int64)[gone]), FREE, occupancy.cells).astype(np.int8)


def _offset(cells: NDArray[np.int8], resolution_m: float, fold: int, difference: WorldDifference) -> NDArray[np.int8]:
    """Displace cells (H, W) into (fold H, fold W); beyond the map everything is as at its border."""
    from scipy import ndimage

    rows, columns = cells.shape
    node_m = difference.correlation_length_m / _NODES
    nodes = [math.ceil(n * resolution_m / node_m) + 2 for n in (rows, columns)]
    y_m, x_m = (np.arange(n) * node_m for n in nodes)
    rng = _rng(difference, 1)
    offsets_cells = [_field(rng, y_m, x_m, difference) / resolution_m for _ in range(2)]
    column = (np.arange(columns * fold) + 0.5) / fold
    world = np.empty((rows * fold, columns * fold), dtype=np.int8)
    for first in range(0, len(world), _ROWS):
        row = (np.arange(first, min(first + _ROWS, len(world))) + 0.5) / fold
        places = np.meshgrid(row, column, indexing="ij")
        on_nodes = np.stack(places) * (resolution_m / node_m)
        from_row, from_column = (
            np.floor(place - ndimage.map_coordinates(offset, on_nodes, order=1)).astype(np.int64)
            for place, offset in zip(places, offsets_cells, strict=True)
        )
        world[first : first + _ROWS] = cells[from_row.clip(0, rows - 1), from_column.clip(0, columns - 1)]
    return world


def _field(
    rng: np.random.Generator, y_m: NDArray[np.float64], x_m: NDArray[np.float64], difference: WorldDifference
) -> NDArray[np.float64]:
    """Draw offsets (len(y_m), len(x_m)) in meters."""
    from vastflow.sim.kernels.arrays import cos_sins  # campaign files are read without kernels

    wave = normals(rng, (2, _WAVES), np.float64) / difference.correlation_length_m
    phase = rng.uniform(0.0, 2.0 * math.pi, _WAVES)
    field = np.zeros((len(y_m), len(x_m)))
    for along_y, along_x, begin in zip(*wave, phase, strict=True):
        (cos_y, sin_y), (cos_x, sin_x) = cos_sins(y_m * along_y), cos_sins(x_m * along_x + begin)
        field += cos_y[:, None] * cos_x - sin_y[:, None] * sin_x
    return difference.wall_offset_m * math.sqrt(2.0 / _WAVES) * field
