"""CostCritic's collisions of the robot's outline (nav2_mppi_controller, `consider_footprint`).

Most outlines of thousands have no lethal cell near them. The cost under the center says so, or else how many lethal cells the
outline's box holds, which is four sums; lines are drawn for the others alone.
"""

from typing import Any

from vastflow.sim.kernels.lanes import load, splat, store
from vastflow.sim.kernels.numeric import inner
from vastflow.sim.kernels.sincos import sincos
from vastflow.sim.nav2.controllers.mppi_critics import COLLISION, Frame
from vastflow.sim.nav2.controllers.mppi_samples import ROW, STEP, Space
from vastflow.sim.nav2.costmaps.inflation import LETHAL
from vastflow.sim.nav2.costmaps.window import Window, line_hits


@inner
def lay_room(near: Any, lethal: Any, frame: Frame, window: Window, circumscribed_cost: float) -> None:
    """Write a cycle's `near` and `lethal`, see `Space`; outlines are looked at from a center's cost on."""
    least_cost, columns = max(circumscribed_cost, 1.0), frame.columns
    for k in range(columns):
        near[k], lethal[k] = 1, 0
    for r in range(1, frame.rows - 1):
        begin = r * columns
        near[begin], lethal[begin] = 1, 0
        counted = 0
        for c in range(1, columns - 1):
            cost = window.costs[frame.row + r, frame.column + c]
            counted += cost == LETHAL
            near[begin + c] = cost >= least_cost
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
            if outline_collides(space.lethal, frame, given.window, given.outline, x, y, yaw_rad):
                space.costs[first + lane] += crash - space.touched[first + lane] * weight
                space.touched[first + lane] = COLLISION
                break


@inner
def outline_collides(
    lethal: Any, frame: Frame, window: Window, outline: Any, x: float, y: float, yaw_rad: float
) -> bool:
    """Whether, at (x, y) in cells, a vertex is outside the frame or an edge meets a lethal cell."""
    sine, cosine = sincos(yaw_rad)
    c, s = cosine / frame.resolution_m, sine / frame.resolution_m
    least_x, most_x, least_y, most_y = x, x, y, y
    for k in range(outline.shape[0]):
        vertex_x = x + (c * outline[k, 0] - s * outline[k, 1])
        vertex_y = y + (s * outline[k, 0] + c * outline[k, 1])
        least_x, most_x = min(least_x, vertex_x), max(most_x, vertex_x)
        least_y, most_y = min(least_y, vertex_y), max(most_y, vertex_y)
    if least_x < 1.0 or least_y < 1.0 or most_x >= frame.columns - 1 or most_y >= frame.rows - 1:
        return True
    if not _holds_lethal(lethal, frame, int(least_x), int(least_y), int(most_x), int(most_y)):
        return False
    last = outline.shape[0] - 1
    first_column, first_row, column, row = 0, 0, 0, 0
    for k in range(last + 1):
        next_column = int(x + (c * outline[k, 0] - s * outline[k, 1]))
        next_row = int(y + (s * outline[k, 0] + c * outline[k, 1]))
        if k == 0:
            first_column, first_row = next_column, next_row
        elif _edge_hits(lethal, frame, window, column, row, next_column, next_row):
            return True
        column, row = next_column, next_row
    return bool(_edge_hits(lethal, frame, window, first_column, first_row, column, row))


@inner
def _edge_hits(lethal: Any, frame: Frame, window: Window, column: int, row: int, end_column: int, end_row: int) -> bool:
    """Whether an edge between two cells of the frame meets a lethal cell, by the line of `outline_hits`."""
    left, right, below, top = min(column, end_column), max(column, end_column), min(row, end_row), max(row, end_row)
    return _holds_lethal(lethal, frame, left, below, right, top) and line_hits(
        window.costs, frame.column + column, frame.row + row, frame.column + end_column, frame.row + end_row
    )


@inner
def _holds_lethal(lethal: Any, frame: Frame, left: int, below: int, right: int, top: int) -> bool:
    """Whether a box of cells, ends included, has a lethal cell."""
    over, under = top * frame.columns, (below - 1) * frame.columns
    return bool(lethal[over + right] - lethal[over + left - 1] != lethal[under + right] - lethal[under + left - 1])
