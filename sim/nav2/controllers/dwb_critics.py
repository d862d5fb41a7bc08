"""State of DWB's critics: distances from the local plan, changes of direction, and arrival at the goal.

Source: dwb_critics and costmap_queue of Nav2 (Humble).
"""

import math
from typing import Any, NamedTuple

import numpy as np

from vastflow.sim.kernels.numeric import inner
from vastflow.sim.nav2.costmaps.inflation import UNKNOWN
from vastflow.sim.nav2.costmaps.window import Window
from vastflow.sim.world.motion import wrapped

DISTANCE, DX, DY, FOLLOWING, TAKEN = 0, 1, 2, 3, 4
"""Columns of `PathGrid.cells`."""

_SOURCES, _NEW_SOURCES, _PLAN, _CURSOR, _TOP = 0, 1, 2, 3, 4
"""Indices of `PathGrid.counts`."""


class PathGrid(NamedTuple):
    """Distance in cells from the local plan, grown on demand.

    Nav2's queue hands cells out by their Manhattan distance from the source that reached them first, the latest
    first among equals, obstacles and all; that distance is a cell's value. Cells are numbered
    row by row in the window with a border of one cell round it, whose cells count as reached.
    """

    cells: Any  # (N, 5) int32: distance or -1, offset from the source, next in the bin, last plan it was a source of.
    bins: Any  # (D,) int32, first waiting cell at each distance, or -1.
    sources: Any  # (2, N) int32, the plan's cells in its order: those the grid grew from, those of now.
    counts: Any  # (5,) int64: sources, new sources and plans; lowest bin that may be filled, highest that was.


class Trends(NamedTuple):
    """Memory of the stateful critics."""

    # (3, 3) int64, for forward speed, yaw rate, and speed to the left: last sign, only positive allowed, only
    # negative allowed.
    signs: Any
    stood: Any  # (3,) float64, pose at the last change of sign.
    latched: Any  # (2,) int64, within the goal's tolerance, slow enough to rotate there.


def new_path_grid(rows: int, columns: int) -> PathGrid:
    """A grid for windows of one shape."""
    cells = np.zeros((rows + 2, columns + 2, 5), dtype=np.int32)
    cells[1:-1, 1:-1, DISTANCE] = -1
    return PathGrid(
        cells=cells.reshape(-1, 5),
        bins=np.full(rows + columns - 1, -1, dtype=np.int32),
        sources=np.zeros((2, rows * columns), dtype=np.int32),
        counts=np.zeros(5, dtype=np.int64),
    )


@inner
def lay(grid: PathGrid, window: Window, plan: Any, n: int, nose_x_m: float, nose_y_m: float) -> Any:
    """Put the first `n` points of a local plan on the grid; return the local goal's and its nose's cell.

    The plan counts from where it enters the window to where it leaves it or meets a cell without information. The cells are
    the last that counts of it, and of the plan with its last point moved to the nose position; -1 where nothing counts.
    """
    counts = grid.counts
    counts[_PLAN] += 1
    counts[_NEW_SOURCES] = 0
    hole = 2.0 * window.place[2]
    goal, nose, left = -1, -1, False
    # The last point comes twice: where the nose shall be, which is no source, and where it is.
    for k in range(n + 1):
        i = min(k, n - 1)
        x, y = plan[i, 0], plan[i, 1]
        if k == n - 1:
            x, y = nose_x_m, nose_y_m
        last, gone, steps, dx, dy = goal, left, 1, 0.0, 0.0
        if i > 0:
            dx, dy = x - plan[i - 1, 0], y - plan[i - 1, 1]
            if dx * dx + dy * dy > hole * hole:
                # Nav2 fills holes wider than two cells (nav_2d_utils, `adjustPlanResolution`).
                steps = max(1, int((math.sqrt(dx * dx + dy * dy) - hole) / window.place[2]) - 1)
        for step in range(1, steps + 1):
            if gone:
                break
            part = steps - step
            at = _cell(window, x - part * (dx / steps), y - part * (dy / steps))
            if at < 0:
                # Nav2 stops where the plan leaves the window after it was in it; points before it enters are skipped.
                gone = last >= 0
                continue
            last = at
            # A cell is a source once: the number of the plan stands for a set that need not be cleared.
            if k != n - 1 and grid.cells[at, TAKEN] != counts[_PLAN]:
                grid.cells[at, TAKEN] = counts[_PLAN]
                grid.sources[1, counts[_NEW_SOURCES]] = at
                counts[_NEW_SOURCES] += 1
        if k == n - 1:
            nose = last
        else:
            goal, left = last, gone
    _restart(grid.cells, grid.bins, grid.sources, counts, window.costs.shape[0], window.costs.shape[1])
    return goal, nose


@inner
def _cell(window: Window, x_m: float, y_m: float) -> int:
    rows, columns = window.costs.shape
    x, y = (x_m - window.place[0]) / window.place[2], (y_m - window.place[1]) / window.place[2]
    if not (x >= 0.0 and y >= 0.0 and x < columns and y < rows) or window.costs[int(y), int(x)] == UNKNOWN:
        return -1
    return int((int(y) + 1) * (columns + 2) + int(x) + 1)


@inner
def _restart(cells: Any, bins: Any, sources: Any, counts: Any, rows: int, columns: int) -> None:
    """Grow again if the sources have changed."""
    n = counts[_NEW_SOURCES]
    # The plan changes once a second, and its cells in the window less often: what has grown can stay.
    same = n == counts[_SOURCES]
    for i in range(n):
        if not same:
            break
        same = sources[0, i] == sources[1, i]
    if same:
        return
    for row in range(1, rows + 1):
        for at in range(row * (columns + 2) + 1, row * (columns + 2) + 1 + columns):
            cells[at, DISTANCE] = -1
    for k in range(counts[_TOP] + 1):
        bins[k] = -1
    counts[_CURSOR], counts[_TOP], counts[_SOURCES] = 0, 0, n
    for i in range(n):
        sources[0, i] = sources[1, i]
        _push(cells, bins, int(sources[0, i]), 0, 0, 0)


@inner
def grow(cells: Any, bins: Any, counts: Any, at: int, stride: int) -> int:
    """Expand the grid from its sources until it reaches a cell, and return that cell's distance."""
    cursor, top = counts[_CURSOR], counts[_TOP]
    while cells[at, DISTANCE] < 0:
        while bins[cursor] < 0:
            cursor += 1
        here = int(bins[cursor])
        bins[cursor] = cells[here, FOLLOWING]
        # Nav2's CostmapQueue hands on each cell's source: distances may be a little too great, and are reproduced.
        dx, dy = int(cells[here, DX]), int(cells[here, DY])
        left = _push(cells, bins, here - 1, dx - 1, dy, cursor)
        down = _push(cells, bins, here - stride, dx, dy - 1, cursor)
        right = _push(cells, bins, here + 1, dx + 1, dy, cursor)
        up = _push(cells, bins, here + stride, dx, dy + 1, cursor)
        top = max(top, max(max(left, down), max(right, up)))
        # A cell may lie nearer to its source than the one it was reached from.
        cursor = min(cursor, min(min(left, down), min(right, up)))
    counts[_CURSOR], counts[_TOP] = cursor, top
    return int(cells[at, DISTANCE])


@inner
def _push(cells: Any, bins: Any, at: int, dx: int, dy: int, cursor: int) -> int:
    """Queue an unreached cell in its bin and return the bin; return the cursor for a reached cell."""
    if cells[at, DISTANCE] >= 0:
        return cursor
    distance = abs(dx) + abs(dy)
    cells[at, DISTANCE], cells[at, DX], cells[at, DY] = distance, dx, dy
    cells[at, FOLLOWING] = bins[distance]
    bins[distance] = at
    return distance


@inner
def at_goal(q: Any, latched: Any, x_m: float, y_m: float, speed_mps: float, goal: Any) -> int:
    """Return the demand of RotateToGoal, latched until a reset: 0 none, 1 slow down, 2 only rotate."""
    dx, dy = x_m - goal[0], y_m - goal[1]
    # Both are latched: a robot that the noise of localization takes out of the tolerance goes on rotating, as in Nav2.
    if dx * dx + dy * dy <= q.xy_goal_tolerance * q.xy_goal_tolerance:
        latched[0] = 1
    if latched[0] != 0 and speed_mps * speed_mps <= q.trans_stopped_velocity * q.trans_stopped_velocity:
        latched[1] = 1
    return int(latched[0] + latched[1])


@inner
def debrief(critic: Any, trends: Trends, pose: Any, v_mps: float, w_radps: float, vy_mps: float) -> None:
    """Let Oscillation know the command that was chosen, (0, 0, 0) where none was."""
    signs, stood = trends.signs, trends.stood
    flipped = _flips(signs, 0, v_mps)
    # A robot that drives may swing its yaw rate as it likes; only one that barely drives oscillates by turning.
    if critic.x_only_threshold < 0.0 or abs(v_mps) <= critic.x_only_threshold:
        flipped = _flips(signs, 1, w_radps) or flipped
        flipped = _flips(signs, 2, vy_mps) or flipped
    if flipped:
        stood[0], stood[1], stood[2] = pose[0], pose[1], pose[2]
    dx, dy = pose[0] - stood[0], pose[1] - stood[1]
    reset_m, reset_rad = critic.oscillation_reset_dist, critic.oscillation_reset_angle
    moved = reset_m >= 0.0 and dx * dx + dy * dy > reset_m * reset_m
    # Nav2 takes the plain difference of two yaws in (-π, π]: to pass ±π lifts the restriction at once.
    turned = reset_rad >= 0.0 and abs(wrapped(pose[2]) - wrapped(stood[2])) > reset_rad
    restricted = signs[0, 1] + signs[0, 2] + signs[1, 1] + signs[1, 2] + signs[2, 1] + signs[2, 2] > 0
    if restricted and (moved or turned):
        clear(signs)


@inner
def clear(signs: Any) -> None:
    """Lift all restrictions."""
    for axis in range(3):
        for k in range(3):
            signs[axis, k] = 0


@inner
def _flips(signs: Any, axis: int, velocity: float) -> bool:
    """Take a velocity's sign into account; True where it is the opposite of the last."""
    if velocity == 0.0:
        return False
    sign = 1 if velocity > 0.0 else -1
    flipped = signs[axis, 0] == -sign
    if flipped:
        signs[axis, 1 if sign > 0 else 2] = 1
    signs[axis, 0] = sign
    return bool(flipped)
