"""Scans: taken at once or in a sweep, and used on arrival."""

import math
from typing import Any

from vastflow.sim.kernels.binding import Bound
from vastflow.sim.kernels.numeric import inner
from vastflow.sim.model.rates import TICK_S
from vastflow.sim.nav2.navigator.latency import delay
from vastflow.sim.nav2.navigator.state import LATE_SCANS, ODOMETRY_STEPS, SUBSTEPS
from vastflow.sim.world import lidar
from vastflow.sim.world.motion import wrapped
from vastflow.sim.world.noise import Scan


@inner
def sense(p: Any, m: Any, skips: Any, obstacles: Any, noise: Bound) -> bool:
    """Cast the beams of this tick. Whether the stack has a new scan: `m.ranges`, taken at `m.scan_odom_…`."""
    if p.late != 0:
        _take(p, m, skips, obstacles, noise)
        return next_scan(m)
    if m.tick % p.scan_ticks != 0:
        return False
    _cast(p, m, skips, obstacles, (m.true_x, m.true_y, m.true_yaw), 0, m.beams, m.ranges)
    _perturb(p, m, m.ranges[: m.beams], noise)
    m.scan_odom_x, m.scan_odom_y, m.scan_odom_yaw = m.odom_x, m.odom_y, m.odom_yaw
    return True


@inner
def next_scan(m: Any) -> bool:
    """Give the stack the next scan that has arrived: it and the odometry of its stamp."""
    scan = m.late_scans[m.scans_used % LATE_SCANS]
    if m.scans_used == m.scans_taken or scan[0] > m.tick * TICK_S + 1e-9 or scan[1] > m.odometry_step:
        return False
    ranges = m.late_ranges[m.scans_used % LATE_SCANS]
    for b in range(m.beams):
        m.ranges[b] = ranges[b]
    m.scan_odom_x, m.scan_odom_y, m.scan_odom_yaw = scan[2], scan[3], scan[4]
    m.scans_used += 1
    return True


@inner
def _take(p: Any, m: Any, skips: Any, obstacles: Any, noise: Bound) -> None:
    """Take this tick's measurements, and send off a complete scan."""
    starts = m.tick % p.scan_ticks == 0
    ranges = m.late_ranges[m.scans_taken % LATE_SCANS]
    if p.sweeps != 0 and m.tick > 0:
        if m.swept < m.beams and _sweep(p, m, skips, obstacles, ranges):
            _send_off(p, m, noise)
    elif starts:
        _stamp(m)
        _cast(p, m, skips, obstacles, (m.true_x, m.true_y, m.true_yaw), 0, m.beams, ranges)
        _send_off(p, m, noise)
    if p.sweeps != 0:
        m.swept_x, m.swept_y, m.swept_yaw = m.true_x, m.true_y, m.true_yaw
        if starts:
            m.swept = 0
            _stamp(m)


@inner
def _sweep(p: Any, m: Any, skips: Any, obstacles: Any, ranges: Any) -> bool:
    """The beams since the last tick, each from where the robot then was; whether they are the scan's last.

    The scanner turns once in its period, so a scanner that sees less than a turn is done before the period ends.
    """
    part = (m.tick - 1) % p.scan_ticks
    ticks_per_beam = p.angle_increment / (2.0 * math.pi) * p.scan_ticks
    dx, dy, dyaw = m.true_x - m.swept_x, m.true_y - m.swept_y, wrapped(m.true_yaw - m.swept_yaw)
    while m.swept < m.beams:
        share = m.swept * ticks_per_beam - part
        if share >= 1.0 and part < p.scan_ticks - 1:
            return False
        pose = m.swept_x + share * dx, m.swept_y + share * dy, m.swept_yaw + share * dyaw
        _cast(p, m, skips, obstacles, pose, m.swept, m.swept + 1, ranges)
        m.swept += 1
    return True


@inner
def _stamp(m: Any) -> None:
    """Stamp the scan that begins now with its odometry.

    A sweep keeps it for all its beams, as ROS drivers stamp the first one.
    """
    scan = m.late_scans[m.scans_taken % LATE_SCANS]
    row = m.odometry[(m.tick * SUBSTEPS) % ODOMETRY_STEPS]
    scan[1], scan[2], scan[3], scan[4] = m.tick * SUBSTEPS, row[0], row[1], row[2]


@inner
def _send_off(p: Any, m: Any, noise: Bound) -> None:
    """The scan is complete; scans don't overtake each other."""
    _perturb(p, m, m.late_ranges[m.scans_taken % LATE_SCANS, : m.beams], noise)
    arrives_s = m.tick * TICK_S + delay(m, p.latency.scan_age, p.latency.scan_jitter)
    m.scan_arrives = max(m.scan_arrives, arrives_s)
    m.late_scans[m.scans_taken % LATE_SCANS, 0] = m.scan_arrives
    m.scans_taken += 1


@inner
def _cast(p: Any, m: Any, skips: Any, obstacles: Any, pose: Any, first: int, end: int, ranges: Any) -> None:
    """Beams `first` to `end` of a robot at a pose."""
    x, y, yaw = pose
    c, sn = math.cos(yaw), math.sin(yaw)
    sensor = (x + c * p.mount_x - sn * p.mount_y, y + sn * p.mount_x + c * p.mount_y, yaw)
    lidar.scan(
        skips,
        p.world_resolution,
        p.origin_x,
        p.origin_y,
        obstacles,
        sensor,
        m.directions[first:end],
        p.range_min,
        p.range_max,
        ranges[first:end],
    )


@inner
def _perturb(p: Any, m: Any, ranges: Any, noise: Bound) -> None:
    lidar.perturb(noise, Scan(ranges, m.directions[: m.beams], p.range_min, p.range_max))
