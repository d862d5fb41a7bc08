"""The local costmap as seen by controller and behaviors, and the cost of a footprint in it."""

import math
from typing import Any, NamedTuple

from vastflow.sim.kernels.numeric import inner
from vastflow.sim.nav2.costmaps.inflation import FREE, LETHAL, UNKNOWN


class Window(NamedTuple):
    costs: Any  # (R, C) uint8.
    place: Any  # (3,) float64: x, y of the lower left corner in the odom frame, and the resolution, in meters.


@inner
def cost_at(window: Window, x_m: float, y_m: float) -> int:
    """Cost at a point of the odom frame; unknown outside the window."""
    column = math.floor((x_m - window.place[0]) / window.place[2])
    row = math.floor((y_m - window.place[1]) / window.place[2])
    if row < 0 or column < 0 or row >= window.costs.shape[0] or column >= window.costs.shape[1]:
        return UNKNOWN
    return int(window.costs[row, column])


@inner
def outline_hits(window: Window, outline: Any, x_m: float, y_m: float, yaw_rad: float) -> bool:
    """True if the outline (V, 2) at a pose of the odom frame touches a lethal cell.

    The edges are Bresenham lines between the vertices' cells (nav2_costmap_2d, `FootprintCollisionChecker`). Cells
    outside the window are no hits.
    """
    per_m = 1.0 / window.place[2]
    x, y = (x_m - window.place[0]) * per_m, (y_m - window.place[1]) * per_m
    c, s = math.cos(yaw_rad) * per_m, math.sin(yaw_rad) * per_m
    if not _lethal_within(window.costs, outline, x, y, c, s):
        return False
    last = outline.shape[0] - 1
    first_column, first_row, column, row = 0, 0, 0, 0
    for k in range(last + 1):
        next_column = _floor(x + (c * outline[k, 0] - s * outline[k, 1]))
        next_row = _floor(y + (s * outline[k, 0] + c * outline[k, 1]))
        if k == 0:
            first_column, first_row = next_column, next_row
        elif line_hits(window.costs, column, row, next_column, next_row):
            return True
        column, row = next_column, next_row
    # Nav2 draws the closing edge from the first vertex to the last, and a line's cells depend on its direction.
    return bool(line_hits(window.costs, first_column, first_row, column, row))


@inner
def outline_cost(costs: Any, outline: Any, x: float, y: float, c: float, s: float) -> int:
    """The greatest cost under the outline (V, 2); -1 off the grid, or on a lethal or unknown cell.

    The edges are Bresenham lines between the vertices' cells, the closing one drawn from the last vertex to the first
    (dwb_critics, `ObstacleFootprintCritic`).

    Args:
        x, y: The robot's position in cells from the grid's corner.
        c, s: Cosine and sine of its heading, times cells per meter.
    """
    last = outline.shape[0] - 1
    greatest, column, row = FREE, 0, 0
    for k in range(-1, last + 1):
        vertex = last if k < 0 else k
        vertex_x = x + (c * outline[vertex, 0] - s * outline[vertex, 1])
        vertex_y = y + (s * outline[vertex, 0] + c * outline[vertex, 1])
        if not (vertex_x >= 0.0 and vertex_y >= 0.0 and vertex_x < costs.shape[1] and vertex_y < costs.shape[0]):
            return -1
        next_column, next_row = int(vertex_x), int(vertex_y)
        if k >= 0:
            greatest = max(greatest, _line_cost(costs, column, row, next_column, next_row))
            if greatest >= LETHAL:
                return -1
        column, row = next_column, next_row
    return greatest


@inner
def _lethal_within(costs: Any, outline: Any, x: float, y: float, c: float, s: float) -> bool:
    """True if the outline's box holds a lethal cell, which is rare and three times faster to test."""
    left, right, low, high = x, x, y, y
    for k in range(outline.shape[0]):
        vertex_x = x + (c * outline[k, 0] - s * outline[k, 1])
        vertex_y = y + (s * outline[k, 0] + c * outline[k, 1])
        left, right = min(left, vertex_x), max(right, vertex_x)
        low, high = min(low, vertex_y), max(high, vertex_y)
    column, end_column = max(_floor(left), 0), min(_floor(right) + 1, costs.shape[1])
    found = False
    for row in range(max(_floor(low), 0), min(_floor(high) + 1, costs.shape[0])):
        line = costs[row, column:end_column]
        for k in range(line.shape[0]):
            found |= line[k] == LETHAL
    return found


@inner
def _floor(number: float) -> int:
    # Portable code has no instruction for math.floor: it would be a call.
    whole = int(number)
    return whole - 1 if number < whole else whole


@inner
def line_hits(costs: Any, column: int, row: int, end_column: int, end_row: int) -> bool:
    """Whether Bresenham's line between two cells meets a lethal one; cells outside the costmap are none."""
    return bool(_line_cost(costs, column, row, end_column, end_row) == LETHAL)


@inner
def _line_cost(costs: Any, column: int, row: int, end_column: int, end_row: int) -> int:
    """Greatest cost of a line's cells in the grid; lethal wins over unknown."""
    rows, columns = costs.shape
    greatest = FREE
    d_column, d_row = abs(end_column - column), abs(end_row - row)
    step_column, step_row = (1 if end_column >= column else -1), (1 if end_row >= row else -1)
    longer = max(d_column, d_row)
    error_column, error_row = longer // 2, longer // 2
    for _ in range(longer + 1):
        if 0 <= row < rows and 0 <= column < columns:
            greatest = max(greatest, int(costs[row, column]))
            if costs[row, column] == LETHAL:
                return LETHAL
        error_column += d_column
        if error_column >= longer:
            error_column -= longer
            column += step_column
        error_row += d_row
        if error_row >= longer:
            error_row -= longer
            row += step_row
    return greatest
