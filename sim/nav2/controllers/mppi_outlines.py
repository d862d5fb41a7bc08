"""CostCritic's collisions of the robot's outline (nav2_mppi_controller, `consider_footprint`).

Most outlines of thousands have no lethal cell near them. The cost under the center says so, or else how many lethal cells the
outline's box holds, which is four sums; lines are drawn for the others alone. Kernels that run for each outline take addresses
and numbers, never arrays, whose references numba would count.
"""

from typing import Any, Final

from vastflow.sim.kernels.lanes import load, splat, store
from vastflow.sim.kernels.numeric import inner
from vastflow.sim.kernels.sincos import sincos
from vastflow.sim.nav2.controllers.mppi_critics import COLLISION, Frame
from vastflow.sim.nav2.controllers.mppi_samples import ROW, STEP, Space
from vastflow.sim.nav2.costmaps.inflation import LETHAL
from vastflow.sim.nav2.costmaps.window import Window

_HIT: Final = 2
"""Value of `near` at a lethal cell."""


@inner
def lay_room(
    near: Any, lethal: Any, vertices: Any, frame: Frame, window: Window, outline: Any, circumscribed_cost: float
) -> None:
    """Write a cycle's `near`, `lethal`, and `vertices`, see `Space`; outlines are looked at from a center's cost on."""
    least_cost, columns = max(circumscribed_cost, 1.0), frame.columns
    for k in range(outline.shape[0]):
        vertices[2 * k], vertices[2 * k + 1] = outline[k, 0], outline[k, 1]
    for k in range(columns):
        near[k], lethal[k] = 1, 0
    for r in range(1, frame.rows - 1):
        begin = r * columns
        near[begin], lethal[begin] = 1, 0
        counted = 0
        for c in range(1, columns - 1):
            cost = window.costs[frame.row + r, frame.column + c]
            counted += cost == LETHAL
            near[begin + c] = _HIT if cost == LETHAL else int(cost >= least_cost)
            lethal[begin + c] = lethal[begin + c - columns] + counted
        near[begin + columns - 1] = 1
    for k in range((frame.rows - 1) * columns, frame.rows * columns):
        near[k] = 1


@inner
def judge_outlines(
    space: Space,
    first: int,
    points: int,
    stride: int,
    frame: Frame,
    given: Any,
    motion: Any,
    weight: float,
    crash: float,
) -> None:
    """Mark the samples of a group whose outline collides at one of `points` points, `stride` steps apart.

    Args:
        given: `ControllerInput`.
        motion: The heading at the track's first point (rad), and the time between two (s).
        weight, crash: Weight and collision cost of `judge_cells`, which has judged the centers and left the numbers of their cells.
    """
    headed = False
    for lane in range(ROW):
        if space.touched[first + lane] >= COLLISION:
            continue
        for p in range(points):
            if space.near[space.cells[p * ROW + lane]] == 0:
                continue
            if not headed:
                yaw, dt, headed = splat(motion[0]), splat(motion[1]), True
                for t in range((points - 1) * stride + 1):
                    if t % stride == 0:
                        store(space.yaws, t // stride * ROW, yaw)
                    yaw = yaw + load(space.turns, t * ROW) * dt
            k = p * stride * STEP + lane
            x, y, yaw_rad = space.track[k], space.track[k + ROW], space.yaws[p * ROW + lane]
            room = space.near, space.lethal, space.vertices, given.outline.shape[0]
            if outline_collides(room, frame, x, y, yaw_rad):
                space.costs[first + lane] += crash - space.touched[first + lane] * weight
                space.touched[first + lane] = COLLISION
                break


@inner
def outline_collides(room: Any, frame: Frame, x: float, y: float, yaw_rad: float) -> bool:
    """Whether, at (x, y) in cells, a vertex is outside the frame or an edge meets a lethal cell.

    Args:
        room: `near`, `lethal`, and `vertices` of `Space`, and the number of vertices.
    """
    near, lethal, vertices, count = room
    sine, cosine = sincos(yaw_rad)
    c, s = cosine / frame.resolution_m, sine / frame.resolution_m
    least_x, most_x, least_y, most_y = x, x, y, y
    for k in range(count):
        vertex_x = x + (c * vertices[2 * k] - s * vertices[2 * k + 1])
        vertex_y = y + (s * vertices[2 * k] + c * vertices[2 * k + 1])
        least_x, most_x = min(least_x, vertex_x), max(most_x, vertex_x)
        least_y, most_y = min(least_y, vertex_y), max(most_y, vertex_y)
    columns = frame.columns
    if least_x < 1.0 or least_y < 1.0 or most_x >= columns - 1 or most_y >= frame.rows - 1:
        return True
    if not _holds_lethal(lethal, columns, int(least_x), int(least_y), int(most_x), int(most_y)):
        return False
    first_column, first_row, column, row = 0, 0, 0, 0
    for k in range(count):
        next_column = int(x + (c * vertices[2 * k] - s * vertices[2 * k + 1]))
        next_row = int(y + (s * vertices[2 * k] + c * vertices[2 * k + 1]))
        if k == 0:
            first_column, first_row = next_column, next_row
        elif _edge_hits(near, lethal, columns, column, row, next_column, next_row):
            return True
        column, row = next_column, next_row
    return bool(_edge_hits(near, lethal, columns, first_column, first_row, column, row))


@inner
def _edge_hits(near: Any, lethal: Any, columns: int, column: int, row: int, end_column: int, end_row: int) -> bool:
    """Whether an edge between two cells of the frame meets a lethal cell, by the line of `outline_hits`."""
    left, right, below, top = min(column, end_column), max(column, end_column), min(row, end_row), max(row, end_row)
    if not _holds_lethal(lethal, columns, left, below, right, top):
        return False
    d_column, d_row = right - left, top - below
    step_column, step_row = (1 if end_column >= column else -1), (columns if end_row >= row else -columns)
    longer, at = max(d_column, d_row), row * columns + column
    error_column, error_row = longer // 2, longer // 2
    for _ in range(longer + 1):
        if near[at] == _HIT:
            return True
        error_column += d_column
        if error_column >= longer:
            error_column -= longer
            at += step_column
        error_row += d_row
        if error_row >= longer:
            error_row -= longer
            at += step_row
    return False


@inner
def _holds_lethal(lethal: Any, columns: int, left: int, below: int, right: int, top: int) -> bool:
    """Whether a box of cells, ends included, has a lethal cell."""
    over, under = top * columns, (below - 1) * columns
    return bool(lethal[over + right] - lethal[over + left - 1] != lethal[under + right] - lethal[under + left - 1])
