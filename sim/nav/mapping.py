"""Costmap updates: the rolling window in the odom frame at 5 Hz, the global map at 1 Hz."""

import math
from typing import Any, Final

from vastflow.sim.nav.costmap import (
    LOCAL_CELLS,
    SHORT_CLEARING,
    UNSEEN,
    clear_disc,
    inflate_layer,
    merge_window,
    observe,
    roll,
)
from vastflow.sim.nav.inflation import FREE
from vastflow.sim.nav.navfn import NEUTRAL, UNREACHED, fill_travel_costs
from vastflow.sim.nav.state import Grids
from vastflow.sim.numeric import inner

LOCAL_TICKS: Final = 4
GLOBAL_TICKS: Final = 20

CLEARED: Final = 64
"""By this much a travel cost falls where an obstacle went, and not where a mark moved by two cells."""


@inner
def update_local(p: Any, m: Any, stamp: Any) -> None:
    """Roll the window to the robot, clear and mark by the newest scan, inflate. There is no static layer in it."""
    column = math.floor(m.odom_x / p.resolution) - LOCAL_CELLS // 2
    row = math.floor(m.odom_y / p.resolution) - LOCAL_CELLS // 2
    if m.has_local == 1 and (column != m.local_column or row != m.local_row):
        roll(m.local_layer, m.local_scratch, column - m.local_column, row - m.local_row)
    m.local_column, m.local_row, m.has_local = column, row, 1
    c, sn = math.cos(m.odom_yaw), math.sin(m.odom_yaw)
    observe(
        m.local_layer,
        column * p.resolution,
        row * p.resolution,
        p.resolution,
        m.odom_x + c * p.mount_x - sn * p.mount_y,
        m.odom_y + sn * p.mount_x + c * p.mount_y,
        m.odom_yaw,
        m.directions,
        m.ranges,
        p.range_min,
        p.range_max,
        p.raytrace_max_range,
        p.obstacle_max_range,
        SHORT_CLEARING,
    )
    clear_disc(
        m.local_layer,
        m.odom_x / p.resolution - column,
        m.odom_y / p.resolution - row,
        (p.robot_radius + p.footprint_padding) / p.resolution,
    )
    inflate_layer(m.local_layer, stamp, m.local_lethal, m.local_costs)


@inner
def update_global(p: Any, m: Any, g: Grids) -> None:
    """Clear and mark by the newest scan at the estimated pose, then merge and inflate what it can have changed."""
    column = math.floor((m.x - p.origin_x) / p.resolution)
    row = math.floor((m.y - p.origin_y) / p.resolution)
    c, sn = math.cos(m.yaw), math.sin(m.yaw)
    observe(
        g.layer,
        p.origin_x,
        p.origin_y,
        p.resolution,
        m.x + c * p.mount_x - sn * p.mount_y,
        m.y + sn * p.mount_x + c * p.mount_y,
        m.yaw,
        m.directions,
        m.ranges,
        p.range_min,
        p.range_max,
        p.raytrace_max_range,
        p.obstacle_max_range,
        0,
    )
    clear_disc(
        g.layer,
        (m.x - p.origin_x) / p.resolution,
        (m.y - p.origin_y) / p.resolution,
        (p.robot_radius + p.footprint_padding) / p.resolution,
    )
    reach = math.ceil((max(p.raytrace_max_range, p.obstacle_max_range) + 0.1) / p.resolution)
    _merge(p, m, g, column, row, reach + g.stamp.shape[0] // 2)


@inner
def clear_local(m: Any) -> None:
    """The clear-entirely service of the local costmap."""
    m.clear_local = 0
    for r in range(LOCAL_CELLS):
        for c in range(LOCAL_CELLS):
            m.local_layer[r, c] = UNSEEN
            m.local_costs[r, c] = FREE


@inner
def clear_global(p: Any, m: Any, g: Grids) -> None:
    """The clear-entirely service of the global costmap: the static layer alone is left."""
    m.clear_global = 0
    for r in range(g.layer.shape[0]):
        for c in range(g.layer.shape[1]):
            g.layer[r, c] = UNSEEN
    _merge(p, m, g, g.layer.shape[1] // 2, g.layer.shape[0] // 2, max(g.layer.shape[0], g.layer.shape[1]))


@inner
def _merge(p: Any, m: Any, g: Grids, column: int, row: int, reach: int) -> None:
    row0, row1, col0, col1 = merge_window(g.static, g.layer, g.stamp, column, row, reach, g.costs)
    rows, columns = g.travel.shape
    row0, row1, col0, col1 = max(row0, 1), min(row1, rows - 1), max(col0, 1), min(col1, columns - 1)
    fill_travel_costs(g.costs, p.allow_unknown != 0.0, row0, row1, col0, col1, g.travel)
    if m.dirty == 1 or not (0 <= row < rows and 0 <= column < columns):
        return
    # What fell in price matters only where it may lie on a better way: nearer to the goal than the robot is, and not
    # farther from both than the way the robot has. Localization moves a wall's marks by a cell or two at any time.
    here = g.potential[row, column]
    for r in range(row0, row1):
        for c in range(col0, col1):
            if g.travel[r, c] + CLEARED < g.flooded[r, c]:
                away = math.hypot(r - row, c - column)
                if g.potential[r, c] + NEUTRAL * away < here or g.potential[r, c] >= UNREACHED:
                    m.dirty = 1
                    return
