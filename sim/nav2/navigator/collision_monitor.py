"""Nav2's collision monitor: the last word on a command, from the newest scan alone (nav2_collision_monitor)."""

import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vastflow.sim.kernels.numeric import inner
from vastflow.sim.model.elementary import hypot
from vastflow.sim.model.polygon import MOST_VERTICES
from vastflow.sim.model.rates import TICK_S
from vastflow.sim.nav2.parameters.servers import MOST_ZONES, MonitorZone

STOP, SLOWDOWN, LIMIT, APPROACH = range(4)
_ACTIONS: Final = ("stop", "slowdown", "limit", "approach")

ZONE: Final = (
    *("action", "vertices", "radius_m", "reach_m", "min_points"),
    *("ratio", "v_mps", "w_radps", "ahead_s", "step_s"),
)
"""Columns of a zone's row; `ahead_s` is 0 but for an approach, and of a circle `vertices` is 0."""


def zones_reach_m(rows: NDArray[np.float64], fastest_mps: float, scan_period_s: float) -> float:
    """Greatest distance (m) of a point that can enter one of the zones before the next scan; 0 without zones."""
    reach_m, ahead_s = rows[:, ZONE.index("reach_m")], rows[:, ZONE.index("ahead_s")]
    return float(np.max(reach_m + fastest_mps * (ahead_s + (scan_period_s + 0.1)) + 0.1, initial=0.0))


def zone_rows(zones: Sequence[MonitorZone]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(MOST_ZONES, Z) of `ZONE` and (MOST_ZONES, MOST_VERTICES, 2) in the robot's frame (m), zeros behind the last."""
    rows, points = np.zeros((MOST_ZONES, len(ZONE))), np.zeros((MOST_ZONES, MOST_VERTICES, 2))
    for k, zone in enumerate(zones):
        reach_m = max((hypot(x_m, y_m) for x_m, y_m in zone.vertices), default=zone.radius)
        ahead_s = zone.time_before_collision if zone.action == "approach" else 0.0
        rows[k] = (
            *(_ACTIONS.index(zone.action), len(zone.vertices), zone.radius, reach_m, zone.min_points),
            *(zone.slowdown_ratio, zone.linear_limit, zone.angular_limit, ahead_s, zone.simulation_time_step),
        )
        if zone.vertices:
            points[k, : len(zone.vertices)] = zone.vertices
    return rows, points


@inner
def gather_near_points(p: Any, m: Any) -> None:
    """Collect the points of the scan that a command could bring under the footprint.

    They are in the robot's frame at the time of the scan.
    """
    q = p.velocity_smoother
    fastest_mps = math.hypot(max(q.max_velocity[0], -q.min_velocity[0]), max(q.max_velocity[1], -q.min_velocity[1]))
    # The robot drives on for one scan period before the next scan comes; 0.1 s more is ample.
    ahead_s = p.collision_monitor.time_before_collision + (0.1 + p.scan_ticks * TICK_S)
    reach_m = max(p.circumscribed_radius + fastest_mps * ahead_s + 0.1, p.zones_reach)
    n = 0
    for b in range(m.beams):
        reading = m.ranges[b]
        if not (reading >= p.range_min and reading <= p.range_max and reading <= reach_m):
            continue
        m.near_points[0, n] = p.mount_x + reading * m.directions[b, 0]
        m.near_points[1, n] = p.mount_y + reading * m.directions[b, 1]
        n += 1
    m.near = n


@inner
def approach(p: Any, m: Any, v_mps: float, w_radps: float, vy_mps: float) -> float:
    """The factor 0..1 of a command: its time to collision, as a share of `time_before_collision`.

    A point counts when it lies in the padded footprint; `min_points` of them are a collision. With so many inside already
    the factor is 0, whatever the command: a robot among ghost points can't leave them. The simulated motion's clock
    starts at 0 after its first step, as in Nav2.
    """
    q = p.collision_monitor
    if q.enabled == 0 or m.near < q.min_points:
        return 1.0
    return _approach(p, m, -1, q.min_points, q.time_before_collision, q.simulation_time_step, (v_mps, w_radps, vy_mps))


@inner
def zoned(p: Any, m: Any, v_mps: float, w_radps: float, vy_mps: float) -> float:
    """Return the least factor 0..1 of a command that the zones of the file leave.

    Each zone is asked about the whole command.
    """
    factor = 1.0
    for k in range(p.zone_count):
        zone = p.zones[k]
        if m.near < zone[4]:
            continue
        x, y, yaw = _since_scan(m)
        if zone[8] > 0.0:
            factor = min(factor, _approach(p, m, k, zone[4], zone[8], zone[9], (v_mps, w_radps, vy_mps)))
        elif _points_in_zone(p, m, k, x, y, yaw) >= zone[4]:
            if zone[0] == STOP:
                return 0.0
            if zone[0] == SLOWDOWN:
                factor = min(factor, zone[5])
            elif zone[0] == LIMIT:
                factor = min(factor, _share(zone[6], math.hypot(v_mps, vy_mps)), _share(zone[7], w_radps))
    return float(factor)


@inner
def _share(limit: float, speed: float) -> float:
    return limit / abs(speed) if abs(speed) > limit else 1.0


@inner
def _since_scan(m: Any) -> Any:
    """The robot's x, y and yaw now in the frame that it had at the scan."""
    c, s = math.cos(m.scan_odom_yaw), math.sin(m.scan_odom_yaw)
    moved_x, moved_y = m.odom_x - m.scan_odom_x, m.odom_y - m.scan_odom_y
    return c * moved_x + s * moved_y, c * moved_y - s * moved_x, m.odom_yaw - m.scan_odom_yaw


@inner
def _approach(p: Any, m: Any, k: int, least: float, ahead_s: float, step_s: float, command: Any) -> float:
    """Return the time, as a share of `ahead_s`, until `least` points are in zone `k` (the footprint for -1)."""
    v_mps, w_radps, vy_mps = command
    x, y, yaw = _since_scan(m)
    if _points_within(p, m, k, x, y, yaw) >= least:
        return 0.0
    if v_mps == 0.0 and w_radps == 0.0 and vy_mps == 0.0:
        return 1.0
    t_s = 0.0
    while t_s < ahead_s:
        c, s = math.cos(yaw), math.sin(yaw)
        x += v_mps * step_s * c - vy_mps * step_s * s
        y += v_mps * step_s * s + vy_mps * step_s * c
        yaw += w_radps * step_s
        if _points_within(p, m, k, x, y, yaw) >= least:
            return float(t_s / ahead_s)
        t_s += step_s
    return 1.0


@inner
def _points_within(p: Any, m: Any, k: int, x_m: float, y_m: float, yaw_rad: float) -> int:
    return _points_inside(p, m, x_m, y_m, yaw_rad) if k < 0 else _points_in_zone(p, m, k, x_m, y_m, yaw_rad)


@inner
def _points_in_zone(p: Any, m: Any, k: int, x_m: float, y_m: float, yaw_rad: float) -> int:
    """Count the near points in a zone of a robot at a pose in the scan's robot frame."""
    zone, vertices = p.zones[k], int(p.zones[k, 1])
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    count = 0
    for i in range(m.near):
        dx, dy = m.near_points[0, i] - x_m, m.near_points[1, i] - y_m
        square = dx * dx + dy * dy
        if square > zone[3] * zone[3] or (vertices == 0 and square >= zone[2] * zone[2]):
            continue
        if vertices == 0 or _in_outline(p.zone_points[k], vertices, c * dx + s * dy, c * dy - s * dx):
            count += 1
    return count


@inner
def _points_inside(p: Any, m: Any, x_m: float, y_m: float, yaw_rad: float) -> int:
    """Count the near points in the padded footprint at a pose in the scan's robot frame."""
    inner_square = p.inscribed_radius * p.inscribed_radius
    outer_square = p.circumscribed_radius * p.circumscribed_radius
    count = 0
    c, s = 0.0, 0.0
    for k in range(m.near):
        dx, dy = m.near_points[0, k] - x_m, m.near_points[1, k] - y_m
        square = dx * dx + dy * dy
        if square > outer_square:
            continue
        if square > inner_square:
            if c == 0.0 and s == 0.0:
                c, s = math.cos(yaw_rad), math.sin(yaw_rad)
            if not _in_outline(m.outline, m.vertices, c * dx + s * dy, c * dy - s * dx):
                continue
        count += 1
    return count


@inner
def _in_outline(outline: Any, vertices: int, x_m: float, y_m: float) -> bool:
    """True if a point is inside of the outline, which may be concave, by counting crossed edges (Shimrat)."""
    inside = False
    before = vertices - 1
    for k in range(vertices):
        ax, ay, bx, by = outline[before, 0], outline[before, 1], outline[k, 0], outline[k, 1]
        if (y_m <= ay) == (y_m > by) and ax + (y_m - ay) * (bx - ax) / (by - ay) > x_m:
            inside = not inside
        before = k
    return inside
