"""The building as an occupancy grid: a slice at the height of the laser, in ROS map_server's format."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import yaml
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from vastflow.producers.floorplan.building import Building, SolidBlock, Wall
from vastflow.producers.floorplan.geometry import Outline
from vastflow.sim.model.faults import Fault, FileError, Place
from vastflow.sim.world.occupancy import FREE, OCCUPIED, UNKNOWN, OccupancyMap

RESOLUTION_M: Final = 0.05
LASER_HEIGHT_M: Final = 0.193
"""Height of the lidar of a TurtleBot 4."""

BORDER_CELLS: Final = 25
"""Unknown cells round the rooms, on each side; more only where a wall would not fit in."""

MOST_CELLS: Final = 50_000_000

GRAY_UNKNOWN: Final = 200
GRAY_OCCUPIED: Final = 0
GRAY_FREE: Final = 255
OCCUPIED_THRESHOLD: Final = 0.65
FREE_THRESHOLD: Final = 0.196

ROUNDING_CELLS: Final = 1e-6
"""Added before truncation, so that rounding noise does not choose the cell of a point on the border of two."""


@dataclass(frozen=True, eq=False)
class FloorGrid:
    """An occupancy grid.

    Attributes:
        gray: (H, W) uint8 as in the picture, row 0 at the top: 0 occupied, 255 free, 200 unknown.
        origin_xy_m: World position of the picture's lower left corner.
    """

    gray: NDArray[np.uint8]
    resolution_m: float
    origin_xy_m: tuple[float, float]
    laser_height_m: float

    @property
    def occupancy(self) -> OccupancyMap:
        """The map that is read from the grid's files."""
        cells = np.full(self.gray.shape, UNKNOWN, dtype=np.int8)
        cells[self.gray == GRAY_FREE] = FREE
        cells[self.gray == GRAY_OCCUPIED] = OCCUPIED
        return OccupancyMap(np.ascontiguousarray(cells[::-1]), self.resolution_m, self.origin_xy_m)

    def picture(self) -> bytes:
        """The picture as PGM (P5)."""
        rows, columns = self.gray.shape
        return b"P5\n%d %d\n255\n" % (columns, rows) + self.gray.tobytes()

    def header(self, image: str) -> bytes:
        """The map's YAML file; `image` is the picture's place relative to it."""
        content = {
            "image": image,
            "resolution": self.resolution_m,
            "origin": [*self.origin_xy_m, 0.0],
            "negate": 0,
            "occupied_thresh": OCCUPIED_THRESHOLD,
            "free_thresh": FREE_THRESHOLD,
            "laser_height": self.laser_height_m,
        }
        return yaml.safe_dump(content, sort_keys=False).encode()


def grid_of(
    building: Building, resolution_m: float = RESOLUTION_M, laser_height_m: float = LASER_HEIGHT_M
) -> FloorGrid:
    """The slice of a building at the height of the laser.

    Floors are free, walls occupied, columns and dividers occupied where they are as high as the laser; entryways that
    are open at that height are free, and a cell beyond both faces. Windows stay wall: nobody drives through glass.
    Borders of what is drawn belong to it, so a wall is up to a cell thicker than it is, and so is an entryway wider.

    Raises:
        FileError: more than `MOST_CELLS` cells.
    """
    low_x, low_y, high_x, high_y = building.floor_bounds
    beyond_m = max(abs(o - i) for i, o in zip(building.floor_bounds, building.bounds, strict=True))
    border = max(BORDER_CELLS, math.ceil(beyond_m / resolution_m) + 2)
    columns, rows = (
        _cells((high - low) / resolution_m) + 2 * border for low, high in ((low_x, high_x), (low_y, high_y))
    )
    if rows * columns > MOST_CELLS:
        what = f"{high_x - low_x:g} m × {high_y - low_y:g} m at {resolution_m:g} m are {rows * columns:,} cells"
        place = Place(building.file, where=f"Floor plan {building.name}")
        raise FileError([Fault(place, what, f"at most {MOST_CELLS:,} are allowed")])
    picture = Image.new("L", (columns, rows), GRAY_UNKNOWN)
    draw = ImageDraw.Draw(picture)

    def fill(outline: Outline, gray: int) -> None:
        corners = [
            (_cells((x - low_x) / resolution_m + border), _cells((y - low_y) / resolution_m + border))
            for x, y in outline
        ]
        draw.polygon(corners, fill=gray)

    for room in building.rooms:
        fill(room.outline, GRAY_FREE)
    solids: list[Wall | SolidBlock] = [*building.walls, *building.obstacles]
    for solid in solids:
        if laser_height_m <= solid.height_m:
            fill(solid.outline, GRAY_OCCUPIED)
    for hole in building.holes:
        if hole.kind == "Entryway":
            for x0, x1 in hole.section(laser_height_m):
                fill(hole.footprint(x0, x1, resolution_m), GRAY_FREE)
    # To the micrometer: the map's digest must not hang on the last bit of a C library's cosine.
    origin_m = (round(low_x - border * resolution_m, 6), round(low_y - border * resolution_m, 6))
    gray = np.asarray(picture, dtype=np.uint8)[::-1]
    return FloorGrid(np.ascontiguousarray(gray), resolution_m, origin_m, laser_height_m)


def _cells(value: float) -> int:
    return math.trunc(value + ROUNDING_CELLS)
