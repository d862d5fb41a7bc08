"""One tick of the navigation stack: 50 ms of sensing, localization, mapping, planning, control and actuation."""

import math
from typing import Any, Final

from vastflow.sim import lidar
from vastflow.sim.nav.amcl import Cloud
from vastflow.sim.nav.behaviour import behave
from vastflow.sim.nav.localization import estimate, localize
from vastflow.sim.nav.mapping import GLOBAL_TICKS, LOCAL_TICKS, clear_global, clear_local, update_global, update_local
from vastflow.sim.nav.state import ROW_TICKS, RUNNING, SUBSTEPS, TICK_S, Grids, Route
from vastflow.sim.numeric import inner, njit
from vastflow.sim.robot import arc, limited, wrapped
from vastflow.sim.streams import LIDAR, PHASES, uniform

SMOOTHER_ACCELERATION_MPS2: Final = 2.5
SMOOTHER_YAW_ACCELERATION_RADPS2: Final = 3.2
"""Velocity smoother of Nav2 Jazzy's default file: open loop, 20 Hz."""

SCAN_TICKS: Final = 2


@njit
def start(memory: Any) -> None:
    """Draw the phases of the costmap loops: in Nav2 they are arbitrary, and differ from run to run."""
    m = memory[0]
    m.phase_local = int(uniform(m.streams[PHASES]) * LOCAL_TICKS)
    m.phase_global = int(uniform(m.streams[PHASES]) * GLOBAL_TICKS)


@njit
def nav_tick(
    parameters: Any,
    memory: Any,
    g: Grids,
    cloud: Cloud,
    route: Route,
    obstacles: Any,
    rows: Any,
    x_m: float,
    y_m: float,
    yaw_rad: float,
) -> int:
    """Advance the stack (the fields of `Stack`) by 50 ms from the true pose; `velocities` then says what physics does.

    Returns:
        RUNNING, SUCCEEDED or ABORTED.
    """
    p, m = parameters[0], memory[0]
    _see_truth(m, x_m, y_m, yaw_rad)
    if m.tick % SCAN_TICKS == 0:
        _scan(p, m, g.leap, obstacles)
        localize(p, m, g.cubed, cloud)
    estimate(m)
    if m.clear_global == 1:
        clear_global(p, m, g)
    if m.clear_local == 1:
        clear_local(m)
    if m.tick % LOCAL_TICKS == m.phase_local or m.has_local == 0:
        update_local(p, m, g.stamp)
    if m.tick % GLOBAL_TICKS == m.phase_global:
        update_global(p, m, g)
    m.command_v, m.command_w = behave(p, m, g, route)
    _actuate(p, m)
    if m.tick % ROW_TICKS == 0 or m.status != RUNNING:
        _record(m, rows)
    m.tick += 1
    return int(m.status)


@inner
def _see_truth(m: Any, x_m: float, y_m: float, yaw_rad: float) -> None:
    if m.tick > 0:
        dx, dy = x_m - m.true_x, y_m - m.true_y
        m.true_v = (dx * math.cos(yaw_rad) + dy * math.sin(yaw_rad)) / TICK_S
        m.true_w = wrapped(yaw_rad - m.true_yaw) / TICK_S
        m.distance += math.hypot(dx, dy)
    m.true_x, m.true_y, m.true_yaw = x_m, y_m, yaw_rad


@inner
def _scan(p: Any, m: Any, leap: Any, obstacles: Any) -> None:
    c, sn = math.cos(m.true_yaw), math.sin(m.true_yaw)
    sensor = (m.true_x + c * p.mount_x - sn * p.mount_y, m.true_y + sn * p.mount_x + c * p.mount_y, m.true_yaw)
    lidar.scan(
        leap,
        p.resolution,
        p.origin_x,
        p.origin_y,
        obstacles,
        sensor,
        m.directions,
        p.range_min,
        p.range_max,
        m.ranges,
    )
    lidar.perturb(m.ranges, m.streams[LIDAR], p.random_drop_percentage, p.gaussian_noise_std_deviation, m.order)


@inner
def _actuate(p: Any, m: Any) -> None:
    """Smoother, then the actuators' limits at each physics step; odometry integrates what the wheels do."""
    m.smooth_v = limited(m.command_v, m.smooth_v, p.max_speed, SMOOTHER_ACCELERATION_MPS2, TICK_S)
    m.smooth_w = limited(m.command_w, m.smooth_w, p.max_yaw_rate, SMOOTHER_YAW_ACCELERATION_RADPS2, TICK_S)
    dt_s = TICK_S / SUBSTEPS
    for k in range(SUBSTEPS):
        m.wheel_v = limited(m.smooth_v, m.wheel_v, p.max_speed, p.max_acceleration, dt_s)
        m.wheel_w = limited(m.smooth_w, m.wheel_w, p.max_yaw_rate, p.max_yaw_acceleration, dt_s)
        m.odom_x, m.odom_y, m.odom_yaw = arc(m.odom_x, m.odom_y, m.odom_yaw, m.wheel_v, m.wheel_w, dt_s)
        m.velocities[k, 0], m.velocities[k, 1] = m.wheel_v, m.wheel_w


@inner
def _record(m: Any, rows: Any) -> None:
    if m.rows == rows.shape[0]:
        return
    row = rows[m.rows]
    row[0] = round(m.tick * TICK_S * 1e3)
    row[1], row[2], row[3] = round(m.true_x * 1e3), round(m.true_y * 1e3), round(wrapped(m.true_yaw) * 1e3)
    row[4], row[5], row[6] = round(m.x * 1e3), round(m.y * 1e3), round(m.yaw * 1e3)
    row[7], row[8] = round(m.true_v * 1e3), round(m.true_w * 1e3)
    row[9], row[10] = round(m.command_v * 1e3), round(m.command_w * 1e3)
    row[11] = m.localized
    m.localized = 0
    m.rows += 1
