"""Draws the quickstart's map, an office floor of our own making.

    python tests/campaigns/draw_office.py campaigns/quickstart/maps/office.pgm

All lengths are in meters, x to the right and y up, from the south-west corner of the building.
"""

import sys
from pathlib import Path
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

RESOLUTION_M: Final = 0.05
BUILDING_M: Final = (15.0, 10.0)
MARGIN_M: Final = 0.25
"""Unknown space round the building; `origin` in office.yaml is minus this."""
SHELL_M: Final = 0.05
"""What is drawn of a piece of furniture: its outside."""
WALL, UNKNOWN, FREE = 0, 205, 254

Rectangle: TypeAlias = tuple[float, float, float, float]
"""x and y of the south-west corner, then width and depth."""

WALLS: Final[tuple[Rectangle, ...]] = (
    # Outside, 0.15 m.
    (0.0, 0.0, 15.0, 0.15),
    (0.0, 9.85, 15.0, 0.15),
    (0.0, 0.0, 0.15, 10.0),
    (14.85, 0.0, 0.15, 10.0),
    # Both sides of the corridor, then between the rooms, 0.1 m.
    (0.0, 4.1, 15.0, 0.1),
    (0.0, 6.2, 15.0, 0.1),
    (4.6, 6.2, 0.1, 3.8),
    (8.6, 6.2, 0.1, 3.8),
    (5.2, 0.0, 0.1, 4.2),
    (9.4, 0.0, 0.1, 4.2),
)
OPENINGS: Final[tuple[Rectangle, ...]] = (
    (3.1, 6.2, 1.0, 0.1),  # west office
    (5.1, 6.2, 1.0, 0.1),  # middle office
    (9.4, 6.2, 1.1, 0.1),  # laboratory
    (1.0, 4.1, 1.2, 0.1),  # meeting room
    (6.1, 4.1, 2.4, 0.1),  # kitchen, open to the corridor
    (12.0, 4.1, 1.1, 0.1),  # workshop
    (9.4, 2.3, 0.1, 1.0),  # from kitchen to workshop
)
FURNITURE: Final[tuple[Rectangle, ...]] = (
    # West office: two desks, a cabinet.
    (0.15, 8.2, 0.75, 1.65),
    (2.6, 9.1, 1.6, 0.75),
    (0.15, 6.3, 1.2, 0.4),
    # Middle office: desks back to back, a shelf.
    (6.7, 8.2, 1.5, 1.4),
    (4.7, 9.5, 1.4, 0.35),
    # Laboratory: a bench between two bays, benches at the wall, a rack.
    (11.4, 7.7, 0.9, 2.15),
    (8.7, 9.2, 1.7, 0.65),
    (14.2, 7.9, 0.65, 1.95),
    (13.2, 6.3, 0.9, 0.4),
    # Corridor: a copier and a locker.
    (7.0, 5.7, 0.7, 0.5),
    (14.35, 4.2, 0.5, 0.9),
    # Meeting room: the table, a sideboard.
    (1.7, 1.3, 2.0, 1.0),
    (4.8, 0.4, 0.4, 1.8),
    # Kitchen: a counter and a table.
    (5.3, 0.15, 4.1, 0.6),
    (7.9, 2.0, 0.8, 0.8),
    # Workshop: a mill, a workbench, shelves.
    (11.0, 1.6, 1.3, 1.0),
    (13.9, 0.15, 0.95, 2.6),
    (9.5, 0.15, 2.6, 0.4),
    (9.5, 3.7, 1.5, 0.4),
)
COLUMNS: Final[tuple[tuple[float, float, float], ...]] = ((6.4, 2.6, 0.2), (10.4, 5.9, 0.2))
"""Round columns: x and y of the center, radius."""


def office() -> NDArray[np.uint8]:
    """The map's gray values (H, W), row 0 in the north."""
    width_m, depth_m = (size + 2 * MARGIN_M for size in BUILDING_M)
    gray = np.full((_cells(depth_m), _cells(width_m)), UNKNOWN, dtype=np.uint8)
    _fill(gray, (0.0, 0.0, *BUILDING_M), FREE)
    for rectangles, value in ((WALLS, WALL), (OPENINGS, FREE), (FURNITURE, WALL)):
        for rectangle in rectangles:
            _fill(gray, rectangle, value)
    for x, y, width, depth in FURNITURE:  # a lidar that drew the map saw the outside alone
        _fill(gray, (x + SHELL_M, y + SHELL_M, width - 2 * SHELL_M, depth - 2 * SHELL_M), UNKNOWN)
    y_m, x_m = (np.indices(gray.shape) + 0.5) * RESOLUTION_M - MARGIN_M
    for center_x_m, center_y_m, radius_m in COLUMNS:
        gray[np.hypot(x_m - center_x_m, y_m - center_y_m) <= radius_m] = WALL
    return gray[::-1]


def pgm(gray: NDArray[np.uint8]) -> bytes:
    """`gray` as a binary PGM file."""
    height, width = gray.shape
    return b"P5\n%d %d\n255\n" % (width, height) + gray.tobytes()


def _fill(gray: NDArray[np.uint8], rectangle: Rectangle, value: int) -> None:
    x, y, width, depth = rectangle
    columns = slice(_cells(x + MARGIN_M), _cells(x + width + MARGIN_M))
    gray[_cells(y + MARGIN_M) : _cells(y + depth + MARGIN_M), columns] = value


def _cells(length_m: float) -> int:
    return round(length_m / RESOLUTION_M)


if __name__ == "__main__":
    Path(sys.argv[1]).write_bytes(pgm(office()))
