"""Costmap updates: the local costmap in the odom frame, and the global one, on the map or in a window."""

import math
from typing import Any

from vastflow.sim.kernels.numeric import inner
from vastflow.sim.nav2.costmaps.costmap import (
    MARKED,
    UNSEEN,
    clear_polygon,
    merge_window,
    observe,
    remove_small_groups,
    remove_small_marks,
    roll,
)
from vastflow.sim.nav2.costmaps.filters import NOTHING, keep_out, keep_out_of_window, override_at
from vastflow.sim.nav2.costmaps.inflation import FREE, LETHAL, UNKNOWN, stamp_lethal
from vastflow.sim.nav2.navigator.state import Grids, Local


@inner
def update_local(p: Any, m: Any, g: Grids, local: Local) -> None:
    """Roll the window to the robot, clear and mark by the newest scan from where it was taken, inflate."""
    q = p.local_costmap
    resolution = q.resolution
    rows, columns = local.layer.shape
    place = local.window.place
    if q.rolling_window:
        column = math.floor(m.odom_x / resolution) - columns // 2
        row = math.floor(m.odom_y / resolution) - rows // 2
        if m.has_local == 1 and (column != m.local_column or row != m.local_row):
            roll(local.layer, local.scratch, column - m.local_column, row - m.local_row, UNSEEN)
        m.local_column, m.local_row = column, row
        place[0], place[1] = column * resolution, row * resolution
    m.has_local, m.local_current = 1, 1
    if q.obstacle_layer.enabled:
        taken_at = (m.scan_odom_x, m.scan_odom_y, m.scan_odom_yaw)
        _observe(p, m, q.obstacle_layer, local.layer, (place[0], place[1], resolution), taken_at)
        if q.obstacle_layer.footprint_clearing_enabled:
            clear_polygon(local.layer, place, m.outline[: m.vertices], m.odom_x, m.odom_y, m.odom_yaw)
    costs = local.window.costs
    for r in range(rows):
        for k in range(columns):
            local.lethal[r, k] = local.layer[r, k] == MARKED
            costs[r, k] = FREE
    if q.static_layer.enabled:
        _mark_static(p, m, g.static, local)
    if q.denoise_layer.enabled:
        remove_small_groups(q.denoise_layer, local.lethal, local.scratch)
    stamp_lethal(local.lethal, local.stamp, costs)
    if local.keepout.cells.shape[0] > 0:
        map_odom = (m.map_odom_x, m.map_odom_y, m.map_odom_yaw)
        keep_out_of_window(local.window, local.keepout, map_odom, q.keepout_filter, m.x, m.y)


@inner
def _observe(p: Any, m: Any, parameters: Any, layer: Any, place: Any, robot: Any) -> None:
    """Clear and mark a layer by the newest scan, which a robot at a pose took."""
    x, y, yaw = robot
    c, sn = math.cos(yaw), math.sin(yaw)
    sensor = x + c * p.mount_x - sn * p.mount_y, y + sn * p.mount_x + c * p.mount_y, yaw
    directions, ranges = m.directions[: m.beams], m.ranges[: m.beams]
    observe(parameters, layer, place, sensor, directions, ranges, p.range_min, p.range_max)


@inner
def publish_local(local: Local) -> None:
    for r in range(local.window.costs.shape[0]):
        for c in range(local.window.costs.shape[1]):
            local.published.costs[r, c] = local.window.costs[r, c]
    for k in range(3):
        local.published.place[k] = local.window.place[k]


@inner
def _mark_static(p: Any, m: Any, static: Any, local: Local) -> None:
    """The map's walls where localization takes them to be: its error makes phantom walls."""
    place = local.window.place
    c, sn = math.cos(m.map_odom_yaw), math.sin(m.map_odom_yaw)
    for r in range(local.layer.shape[0]):
        for k in range(local.layer.shape[1]):
            x, y = place[0] + (k + 0.5) * place[2], place[1] + (r + 0.5) * place[2]
            column = math.floor((m.map_odom_x + c * x - sn * y - p.origin_x) / p.resolution)
            row = math.floor((m.map_odom_y + sn * x + c * y - p.origin_y) / p.resolution)
            if 0 <= row < static.shape[0] and 0 <= column < static.shape[1] and static[row, column] == LETHAL:
                local.lethal[r, k] = 1


@inner
def update_global(p: Any, m: Any, g: Grids) -> None:
    """Clear and mark by the newest scan, then merge and inflate what may have changed.

    The scan lies where it was taken by the estimate.
    """
    q = p.global_costmap
    m.global_current, m.has_global = 1, 1
    if q.rolling_window:
        _roll_global(m, g, UNKNOWN if q.track_unknown_space else FREE)
    if q.obstacle_layer.enabled == 0:
        return
    place = (g.place[0], g.place[1], g.place[2])
    column = math.floor((m.x - place[0]) / place[2])
    row = math.floor((m.y - place[1]) / place[2])
    c, sn = math.cos(m.map_odom_yaw), math.sin(m.map_odom_yaw)
    x = m.map_odom_x + c * m.scan_odom_x - sn * m.scan_odom_y
    y = m.map_odom_y + sn * m.scan_odom_x + c * m.scan_odom_y
    _observe(p, m, q.obstacle_layer, g.layer, place, (x, y, m.map_odom_yaw + m.scan_odom_yaw))
    if q.obstacle_layer.footprint_clearing_enabled:
        clear_polygon(g.layer, place, m.outline[: m.vertices], m.x, m.y, m.yaw)
    reach_m = max(q.obstacle_layer.raytrace_max_range, q.obstacle_layer.obstacle_max_range) + 0.1
    _merge(p, m, g, column, row, math.ceil(reach_m / place[2]) + g.stamp.shape[0] // 2)


@inner
def _roll_global(m: Any, g: Grids, entering: int) -> None:
    """Move the window to the robot, as Nav2's `updateOrigin` rounds it: what stays in it keeps marks and costs."""
    place, (rows, columns) = g.place, g.layer.shape
    shift_columns = int((m.x - 0.5 * (columns - 0.5) * place[2] - place[0]) / place[2])
    shift_rows = int((m.y - 0.5 * (rows - 0.5) * place[2] - place[1]) / place[2])
    if shift_columns != 0 or shift_rows != 0:
        roll(g.layer, g.scratch, shift_columns, shift_rows, UNSEEN)
        roll(g.costs, g.scratch, shift_columns, shift_rows, entering)
        place[0] += shift_columns * place[2]
        place[1] += shift_rows * place[2]
        m.changed_row0, m.changed_row1, m.changed_column0, m.changed_column1 = 0, rows, 0, columns


@inner
def clear_local(m: Any, local: Local) -> None:
    """The clear-entirely service of the local costmap; it is not current until its next update."""
    m.clear_local, m.local_current = 0, 0
    for r in range(local.layer.shape[0]):
        for c in range(local.layer.shape[1]):
            local.layer[r, c] = UNSEEN
            local.window.costs[r, c] = FREE


@inner
def clear_global(p: Any, m: Any, g: Grids) -> None:
    """The clear-entirely service of the global costmap: the static layer alone is left; not current until its next update."""
    m.clear_global, m.global_current = 0, 0
    for r in range(g.layer.shape[0]):
        for c in range(g.layer.shape[1]):
            g.layer[r, c] = UNSEEN
    _merge(p, m, g, g.layer.shape[1] // 2, g.layer.shape[0] // 2, max(g.layer.shape[0], g.layer.shape[1]))


@inner
def _merge(p: Any, m: Any, g: Grids, column: int, row: int, reach: int) -> None:
    layer = g.layer
    override = NOTHING
    if g.keepout.shape[0] > 0:
        own_row, own_column = (
            math.floor((m.y - g.place[1]) / g.place[2]),
            math.floor((m.x - g.place[0]) / g.place[2]),
        )
        if 0 <= own_row < g.keepout.shape[0] and 0 <= own_column < g.keepout.shape[1]:
            override = override_at(p.global_costmap.keepout_filter, g.keepout[own_row, own_column])
        if m.overridden and override == NOTHING:  # the robot left the zone: what lies behind is lethal again
            column, row, reach = layer.shape[1] // 2, layer.shape[0] // 2, max(layer.shape[0], layer.shape[1])
        m.overridden = override != NOTHING
    denoise = p.global_costmap.denoise_layer
    if denoise.enabled:
        rows, columns = layer.shape
        top, bottom = max(0, row - reach), max(min(rows, row + reach + 1), 0)
        left, right = max(0, column - reach), max(min(columns, column + reach + 1), 0)
        remove_small_marks(denoise, g.static, layer, g.lethal, top, bottom, left, right, g.quiet)
        layer = g.quiet
    row0, row1, col0, col1 = merge_window(g.static, g.static_costs, layer, g.stamp, column, row, reach, g.costs)
    if g.keepout.shape[0] > 0:
        keep_out(g.costs, g.keepout, override, row0, row1, col0, col1)
    if m.changed_row1 > m.changed_row0:
        row0, row1 = min(row0, m.changed_row0), max(row1, m.changed_row1)
        col0, col1 = min(col0, m.changed_column0), max(col1, m.changed_column1)
    m.changed_row0, m.changed_row1, m.changed_column0, m.changed_column1 = row0, row1, col0, col1
