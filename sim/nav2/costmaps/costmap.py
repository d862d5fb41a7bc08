"""The obstacle layers of both costmaps, marked and cleared by scans, and the Denoise layer (nav2_costmap_2d).

An ObstacleLayer clears up to the end of a beam, a VoxelLayer stops two cells before it; both clear to `raytrace_max_range` and
mark to `obstacle_max_range`. Beams without a return, or nearer than the scanner sees, neither mark nor clear.
"""

import math
from typing import Any, Final

import numpy as np
import scipy.ndimage
from numpy.typing import NDArray

from vastflow.sim.kernels.numeric import inner, njit
from vastflow.sim.nav2.costmaps.inflation import FREE, INSCRIBED, LETHAL, UNKNOWN, raise_round
from vastflow.sim.nav2.parameters.costmap import DenoiseLayer

UNSEEN: Final = 0
SEEN_FREE: Final = 1
MARKED: Final = 2


@njit
def observe(
    q: Any, layer: Any, place: Any, sensor: Any, directions: Any, ranges_m: Any, range_min_m: float, range_max_m: float
) -> None:
    """One scan into a layer (H, W) uint8 of UNSEEN, SEEN_FREE and MARKED: all clearing first, then all marking.

    Args:
        q: Parameters of the obstacle layer.
        place: x, y of the layer's lower left corner and its resolution, meters.
        sensor: x, y of the scanner in the layer's frame, and the robot's yaw.
        directions: (B, 2) beams in the robot's frame.
    """
    rows, columns = layer.shape
    origin_x_m, origin_y_m, resolution_m = place
    sensor_x_m, sensor_y_m, yaw_rad = sensor
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    col0 = math.floor((sensor_x_m - origin_x_m) / resolution_m)
    row0 = math.floor((sensor_y_m - origin_y_m) / resolution_m)
    if row0 < 0 or col0 < 0 or row0 >= rows or col0 >= columns:
        return
    # Nav2's ObstacleLayer clears with all observations before it marks with any: a beam never erases what another one
    # marks.
    for b in range(ranges_m.shape[0] if q.clearing else 0):
        reading = ranges_m[b]
        if not (reading >= range_min_m and reading < range_max_m):
            continue
        length = min(reading, q.raytrace_max_range)
        dx, dy = c * directions[b, 0] - s * directions[b, 1], s * directions[b, 0] + c * directions[b, 1]
        col1 = math.floor((sensor_x_m + length * dx - origin_x_m) / resolution_m)
        row1 = math.floor((sensor_y_m + length * dy - origin_y_m) / resolution_m)
        clear_line(layer, col0, row0, col1, row1, q.short_clearing_cells)
    # A beam that met nothing has no point to mark; Nav2 clears along it only where `inf_is_valid` gives it a length.
    nearest_m = max(range_min_m, q.obstacle_min_range)
    for b in range(ranges_m.shape[0] if q.marking else 0):
        reading = ranges_m[b]
        if not (reading >= nearest_m and reading < range_max_m and reading <= q.obstacle_max_range):
            continue
        dx, dy = c * directions[b, 0] - s * directions[b, 1], s * directions[b, 0] + c * directions[b, 1]
        column = math.floor((sensor_x_m + reading * dx - origin_x_m) / resolution_m)
        row = math.floor((sensor_y_m + reading * dy - origin_y_m) / resolution_m)
        if row >= 0 and column >= 0 and row < rows and column < columns:
            layer[row, column] = MARKED


@njit
def clear_line(layer: Any, col0: int, row0: int, col1: int, row1: int, short_cells: int) -> None:
    """Bresenham from the sensor's cell to the beam's end, its last `short_cells` cells left as they are.

    The line ends where it leaves the layer. The sensor's cell is in it.
    """
    rows, columns = layer.shape
    d_col, d_row = abs(col1 - col0), abs(row1 - row0)
    step_col, step_row = (1 if col1 >= col0 else -1), (1 if row1 >= row0 else -1)
    room_col = columns - 1 - col0 if step_col > 0 else col0
    room_row = rows - 1 - row0 if step_row > 0 else row0
    if d_col >= d_row:
        longer, shorter, room, room_aside = d_col, d_row, room_col, room_row
        step, aside = step_col, step_row * columns
    else:
        longer, shorter, room, room_aside = d_row, d_col, room_row, room_col
        step, aside = step_row * columns, step_col
    # Nav2's `bresenham2D` begins with half an error: other rounding would clear other cells at the ends of beams.
    error = longer // 2
    # The number of steps is known beforehand, so that the loop needs no test for the layer's edge.
    last = min(longer - short_cells, room)
    if shorter > 0:
        # The last step before the line has gone aside once more than there is room.
        last = min(last, ((room_aside + 1) * longer - error - 1) // shorter)
    cells = layer.ravel()
    at = row0 * columns + col0
    for _ in range(last + 1):
        cells[at] = SEEN_FREE
        error += shorter
        over = error >= longer
        at += step + (aside if over else 0)
        error -= longer if over else 0


@inner
def clear_polygon(layer: Any, place: Any, outline: Any, x_m: float, y_m: float, yaw_rad: float) -> None:
    """Clear the footprint: unmark the cells of the robot's outline and inside of it.

    That is how Nav2 fills a polygon, edge and all. Where a vertex lies off the layer nothing is cleared.

    Args:
        outline: (V, 2) of the robot at (x, y, yaw) in the layer's frame.
    """
    rows, columns = layer.shape
    count = outline.shape[0]
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    vertices = np.empty((count, 2), dtype=np.int64)
    for k in range(count):
        vertices[k, 0] = math.floor((x_m + (outline[k, 0] * c - outline[k, 1] * s) - place[0]) / place[2])
        vertices[k, 1] = math.floor((y_m + (outline[k, 0] * s + outline[k, 1] * c) - place[1]) / place[2])
    left, right = vertices[:, 0].min(), vertices[:, 0].max()
    if left < 0 or right >= columns or vertices[:, 1].min() < 0 or vertices[:, 1].max() >= rows:
        return
    # Columns' extents instead of a list of cells that would have to be sorted, as Nav2 does it in `convexFillCells`.
    lowest, highest = np.full(right - left + 1, rows), np.full(right - left + 1, -1)
    for k in range(count):
        end = (k + 1) % count
        _extend(lowest, highest, vertices[k, 0] - left, vertices[k, 1], vertices[end, 0] - left, vertices[end, 1])
    for column in range(right - left + 1):
        for row in range(lowest[column], highest[column] + 1):
            layer[row, left + column] = SEEN_FREE


@inner
def _extend(lowest: Any, highest: Any, column: int, row: int, end_column: int, end_row: int) -> None:
    """Let the rows of each column reach over the cells of a line."""
    d_column, d_row = abs(end_column - column), abs(end_row - row)
    step_column, step_row = (1 if end_column > column else -1), (1 if end_row > row else -1)
    longer, error = max(d_column, d_row), max(d_column, d_row) // 2
    for k in range(longer + 1):
        lowest[column], highest[column] = min(lowest[column], row), max(highest[column], row)
        if k == longer:
            break
        error += min(d_column, d_row)
        over = error >= longer
        error -= longer if over else 0
        if d_column >= d_row or over:
            column += step_column
        if d_column < d_row or over:
            row += step_row


@inner
def roll(layer: Any, scratch: Any, shift_columns: int, shift_rows: int, entering: int) -> None:
    """Move a rolling window by whole cells; those that enter get the value `entering`."""
    rows, columns = layer.shape
    for r in range(rows):
        for c in range(columns):
            from_r, from_c = r + shift_rows, c + shift_columns
            inside = from_r >= 0 and from_c >= 0 and from_r < rows and from_c < columns
            # By a copy: in place, the direction of the loops would depend on that of the shift.
            scratch[r, c] = layer[from_r, from_c] if inside else entering
    for r in range(rows):
        for c in range(columns):
            layer[r, c] = scratch[r, c]


@inner
def merge_window(
    static: Any, static_costs: Any, layer: Any, stamp: Any, center_column: int, center_row: int, reach: int, costs: Any
) -> Any:
    """Recompute the master costmap round the robot: static and obstacle layer by maximum, then inflation.

    Returns (row0, row1, col0, col1) of the window that was written.

    Args:
        static: (H, W) uint8 of 0, 254, 255.
        static_costs: (H, W) uint8 inflation of the static layer's lethal cells, unknown cells no exception.
        layer: (H, W) obstacle layer.
        reach: Half edge of the window in cells; outside it `costs` stay as they are.
        costs: (H, W) uint8 master costmap, written in the window.
    """
    rows, columns = static.shape
    margin = stamp.shape[0] // 2
    row0, row1 = max(0, center_row - reach), min(rows, center_row + reach + 1)
    col0, col1 = max(0, center_column - reach), min(columns, center_column + reach + 1)
    if row0 >= row1 or col0 >= col1:
        return 0, 0, 0, 0  # the robot is, or takes itself to be, far off the map
    for row in range(row0, row1):
        for column in range(col0, col1):
            costs[row, column] = static_costs[row, column]
    # Inflation is the maximum over lethal cells, so the walls' share need not be made again.
    for row in range(max(0, row0 - margin), min(rows, row1 + margin)):
        marks = layer[row]
        for column in range(max(0, col0 - margin), min(columns, col1 + margin)):
            if marks[column] == MARKED and static[row, column] != LETHAL:
                _stamp_within(static, layer, stamp, row, column, row0, row1, col0, col1, costs)
    for row in range(row0, row1):
        for column in range(col0, col1):
            # After the inflation, which unknown cells let pass; what a scan has seen is known.
            if static[row, column] == UNKNOWN and layer[row, column] == UNSEEN and costs[row, column] < INSCRIBED:
                costs[row, column] = UNKNOWN
    return row0, row1, col0, col1


@inner
def _stamp_within(
    static: Any, layer: Any, stamp: Any, row: int, column: int, row0: int, row1: int, col0: int, col1: int, costs: Any
) -> None:
    """Raise `costs` in a window to the stamp round a marked cell unless lethal cells enclose it."""
    rows, columns = layer.shape
    if row0 <= row < row1 and col0 <= column < col1:
        costs[row, column] = LETHAL
    if 0 < row < rows - 1 and 0 < column < columns - 1:
        walled_in = True
        for r, c in ((row - 1, column), (row + 1, column), (row, column - 1), (row, column + 1)):
            walled_in = walled_in and (layer[r, c] == MARKED or static[r, c] == LETHAL)
        # A cell that lethal ones enclose raises none that they do not raise: inside of thick marks nothing is stamped.
        if walled_in:
            return
    raise_round(costs, stamp, row, column, (row0, row1, col0, col1))


def denoised(static: NDArray[np.uint8], q: DenoiseLayer) -> NDArray[np.uint8]:
    """The static layer (H, W) without its groups of fewer than `minimal_group_size` lethal cells."""
    lethal = static == LETHAL
    structure = np.ones((3, 3)) if q.group_connectivity_type == 8 else None
    labels, _ = scipy.ndimage.label(lethal, structure)
    small = np.bincount(labels.ravel()) < q.minimal_group_size
    # Label 0 is all that is not lethal.
    small[0] = False
    return np.where(small[labels], np.uint8(FREE), static)


@inner
def remove_small_groups(q: Any, lethal: Any, scratch: Any) -> None:
    """Clear flags (R, C) uint8 in groups of fewer than `minimal_group_size`; `scratch` is overwritten."""
    rows, columns = lethal.shape
    group = np.empty((max(q.minimal_group_size, 1), 2), dtype=np.int64)
    for row in range(rows):
        for column in range(columns):
            scratch[row, column] = lethal[row, column] != 0 and _is_large(q, lethal, group, row, column)
    for row in range(rows):
        for column in range(columns):
            lethal[row, column] = scratch[row, column]


@inner
def remove_small_marks(
    q: Any, static: Any, layer: Any, lethal: Any, row0: int, row1: int, col0: int, col1: int, out: Any
) -> None:
    """Copy a window of a layer into `out` with small groups of marks freed; `lethal` is overwritten there.

    Walls of the static layer count as members of groups.
    """
    for row in range(row0, row1):
        for column in range(col0, col1):
            lethal[row, column] = layer[row, column] == MARKED or static[row, column] == LETHAL
            out[row, column] = layer[row, column]
    window = lethal[row0:row1, col0:col1]
    group = np.empty((max(q.minimal_group_size, 1), 2), dtype=np.int64)
    for row in range(row0, row1):
        for column in range(col0, col1):
            if layer[row, column] == MARKED and not _is_large(q, window, group, row - row0, column - col0):
                out[row, column] = SEEN_FREE


@inner
def _is_large(q: Any, lethal: Any, group: Any, row: int, column: int) -> bool:
    """Whether a lethal cell has at least as many with it as a group must."""
    rows, columns = lethal.shape
    group[0, 0], group[0, 1] = row, column
    count, at = 1, 0
    while at < count < q.minimal_group_size:
        for dy in range(-1, 2):
            for dx in range(-1, 2):
                if q.group_connectivity_type == 4 and dx != 0 and dy != 0:
                    continue
                r, c = group[at, 0] + dy, group[at, 1] + dx
                if r < 0 or c < 0 or r >= rows or c >= columns or lethal[r, c] == 0 or count >= q.minimal_group_size:
                    continue
                # A search among a few cells: groups end at `minimal_group_size`, usually 2, so that a set would cost
                # more.
                known = False
                for k in range(count):
                    known = known or (group[k, 0] == r and group[k, 1] == c)
                if not known:
                    group[count, 0], group[count, 1] = r, c
                    count += 1
        at += 1
    return bool(count >= q.minimal_group_size)
