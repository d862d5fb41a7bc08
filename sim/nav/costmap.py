"""The obstacle layers: what the scan marks and clears, globally and in the rolling window.

The global layer clears up to the end of a beam (ObstacleLayer), the local one stops two cells before it (VoxelLayer);
both clear to `raytrace_max_range` and mark to `obstacle_max_range`. Beams without a return, or nearer than
the scanner sees, neither mark nor clear.
"""

import math
from typing import Any, Final

import numpy as np

from vastflow.sim.nav.inflation import FREE, INSCRIBED, LETHAL, UNKNOWN, stamp_lethal
from vastflow.sim.numeric import inner, njit

UNSEEN: Final = 0
SEEN_FREE: Final = 1
MARKED: Final = 2

LOCAL_CELLS: Final = 60
"""Edge of the local window: 3 m at 0.05 m."""

SHORT_CLEARING: Final = 2


@njit
def observe(
    layer: Any,
    origin_x_m: float,
    origin_y_m: float,
    resolution_m: float,
    sensor_x_m: float,
    sensor_y_m: float,
    yaw_rad: float,
    directions: Any,
    ranges_m: Any,
    range_min_m: float,
    range_max_m: float,
    raytrace_m: float,
    obstacle_m: float,
    short_cells: int,
) -> None:
    """One scan into a layer (H, W) uint8 of UNSEEN, SEEN_FREE and MARKED: all clearing first, then all marking."""
    rows, columns = layer.shape
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    col0 = math.floor((sensor_x_m - origin_x_m) / resolution_m)
    row0 = math.floor((sensor_y_m - origin_y_m) / resolution_m)
    if row0 < 0 or col0 < 0 or row0 >= rows or col0 >= columns:
        return
    for b in range(ranges_m.shape[0]):
        reading = ranges_m[b]
        if not (reading >= range_min_m and reading < range_max_m):
            continue
        length = min(reading, raytrace_m)
        dx, dy = c * directions[b, 0] - s * directions[b, 1], s * directions[b, 0] + c * directions[b, 1]
        col1 = math.floor((sensor_x_m + length * dx - origin_x_m) / resolution_m)
        row1 = math.floor((sensor_y_m + length * dy - origin_y_m) / resolution_m)
        clear_line(layer, col0, row0, col1, row1, short_cells)
    for b in range(ranges_m.shape[0]):
        reading = ranges_m[b]
        if not (reading >= range_min_m and reading < range_max_m and reading <= obstacle_m):
            continue
        dx, dy = c * directions[b, 0] - s * directions[b, 1], s * directions[b, 0] + c * directions[b, 1]
        column = math.floor((sensor_x_m + reading * dx - origin_x_m) / resolution_m)
        row = math.floor((sensor_y_m + reading * dy - origin_y_m) / resolution_m)
        if row >= 0 and column >= 0 and row < rows and column < columns:
            layer[row, column] = MARKED


@njit
def clear_line(layer: Any, col0: int, row0: int, col1: int, row1: int, short_cells: int) -> None:
    """Bresenham from the sensor's cell to the beam's end, its last `short_cells` cells left as they are."""
    rows, columns = layer.shape
    d_col, d_row = abs(col1 - col0), abs(row1 - row0)
    step_col, step_row = (1 if col1 >= col0 else -1), (1 if row1 >= row0 else -1)
    longer = max(d_col, d_row)
    error_col, error_row = longer // 2, longer // 2
    column, row = col0, row0
    for _ in range(longer + 1 - short_cells):
        if row < 0 or column < 0 or row >= rows or column >= columns:
            return
        layer[row, column] = SEEN_FREE
        error_col += d_col
        if error_col >= longer:
            error_col -= longer
            column += step_col
        error_row += d_row
        if error_row >= longer:
            error_row -= longer
            row += step_row


@inner
def clear_disc(layer: Any, x_cells: float, y_cells: float, radius_cells: float) -> None:
    """Footprint clearing: nothing is marked in a cell that the robot's outline lies in or surrounds.

    The outline's own cells are cleared as well (Nav2 fills the polygon with its edge), or else the controller would
    take what the robot stands beside for a collision where it stands.
    """
    rows, columns = layer.shape
    row0, row1 = max(0, math.floor(y_cells - radius_cells)), min(rows, math.floor(y_cells + radius_cells) + 1)
    col0, col1 = max(0, math.floor(x_cells - radius_cells)), min(columns, math.floor(x_cells + radius_cells) + 1)
    for r in range(row0, row1):
        for c in range(col0, col1):
            dx, dy = max(c - x_cells, x_cells - c - 1, 0.0), max(r - y_cells, y_cells - r - 1, 0.0)
            if dx * dx + dy * dy <= radius_cells * radius_cells:
                layer[r, c] = SEEN_FREE


@inner
def roll(layer: Any, scratch: Any, shift_columns: int, shift_rows: int) -> None:
    """Move a rolling window by whole cells; what enters is UNSEEN."""
    rows, columns = layer.shape
    for r in range(rows):
        for c in range(columns):
            from_r, from_c = r + shift_rows, c + shift_columns
            inside = from_r >= 0 and from_c >= 0 and from_r < rows and from_c < columns
            scratch[r, c] = layer[from_r, from_c] if inside else UNSEEN
    for r in range(rows):
        for c in range(columns):
            layer[r, c] = scratch[r, c]


@inner
def inflate_layer(layer: Any, stamp: Any, lethal: Any, out: Any) -> None:
    """Costs (H, W) of a window that has no static layer: marked cells and their inflation; unseen is free."""
    rows, columns = layer.shape
    for r in range(rows):
        for c in range(columns):
            lethal[r, c] = layer[r, c] == MARKED
            out[r, c] = FREE
    stamp_lethal(lethal, stamp, out)


@inner
def merge_window(
    static: Any,
    layer: Any,
    stamp: Any,
    centre_column: int,
    centre_row: int,
    reach: int,
    costs: Any,
) -> Any:
    """Recompute the master costmap round the robot: static and obstacle layer by maximum, then inflation.

    Args:
        static: (H, W) uint8 of 0, 254, 255.
        layer: (H, W) obstacle layer.
        reach: Half edge of the window in cells; outside it `costs` stay as they are.
        costs: (H, W) uint8 master costmap, written in the window.

    Returns:
        (row0, row1, col0, col1) of the window.
    """
    rows, columns = static.shape
    margin = stamp.shape[0] // 2
    row0, row1 = max(0, centre_row - reach), min(rows, centre_row + reach + 1)
    col0, col1 = max(0, centre_column - reach), min(columns, centre_column + reach + 1)
    if row0 >= row1 or col0 >= col1:
        return 0, 0, 0, 0  # the robot is, or takes itself to be, far off the map
    wide_row0, wide_row1 = max(0, row0 - margin), min(rows, row1 + margin)
    wide_col0, wide_col1 = max(0, col0 - margin), min(columns, col1 + margin)
    lethal = np.zeros((wide_row1 - wide_row0, wide_col1 - wide_col0), dtype=np.uint8)
    out = np.zeros(lethal.shape, dtype=np.uint8)
    for r in range(lethal.shape[0]):
        for c in range(lethal.shape[1]):
            row, column = r + wide_row0, c + wide_col0
            lethal[r, c] = static[row, column] == LETHAL or layer[row, column] == MARKED
    stamp_lethal(lethal, stamp, out)
    for row in range(row0, row1):
        for column in range(col0, col1):
            cost = out[row - wide_row0, column - wide_col0]
            if cost < INSCRIBED and static[row, column] == UNKNOWN and layer[row, column] == UNSEEN:
                cost = UNKNOWN
            costs[row, column] = cost
    return row0, row1, col0, col1
