"""The ticks of a run: 50 ms of sensing, localization, mapping, planning, control, actuation and free motion each."""

import math
from typing import Any

from vastflow.sim.kernels.binding import Bound
from vastflow.sim.kernels.numeric import inner, njit
from vastflow.sim.kernels.streams import ODOMETRY, PHASES, normal_pair, uniform
from vastflow.sim.model.rates import TICK_S
from vastflow.sim.nav2.amcl.localization import estimate, localize
from vastflow.sim.nav2.amcl.particles import Cloud
from vastflow.sim.nav2.controllers.binding import reset
from vastflow.sim.nav2.controllers.speed_zones import limit_speed
from vastflow.sim.nav2.navigator import state
from vastflow.sim.nav2.navigator.behavior import behave, note
from vastflow.sim.nav2.navigator.collision_monitor import approach, gather_near_points, zoned
from vastflow.sim.nav2.navigator.latency import (
    TWIST_STEPS,
    count_step,
    delay,
    draw_phases,
    order,
    receive_command,
    receive_odometry,
)
from vastflow.sim.nav2.navigator.mapping import clear_global, clear_local, publish_local, update_global, update_local
from vastflow.sim.nav2.navigator.state import SUBSTEPS, Grids, Local, Route
from vastflow.sim.world import lidar
from vastflow.sim.world.motion import Body, due, limited, move_freely, moved, place_movers, steered, wrapped
from vastflow.sim.world.noise import Scan

DONE, PHYSICS, APPEARS = 0, 1, 2


@njit
def start(parameters: Any, memory: Any) -> None:
    """Draw the phases of loops: in Nav2 they are arbitrary, and differ from run to run."""
    p, m = parameters[0], memory[0]
    m.phase_local = int(uniform(m.streams[PHASES]) * p.local_ticks)
    m.phase_global = int(uniform(m.streams[PHASES]) * p.global_ticks)
    m.phase_publish = int(uniform(m.streams[PHASES]) * p.publish_ticks)
    draw_phases(p, m)


@njit
def advance(
    parameters: Any,
    memory: Any,
    g: Grids,
    local: Local,
    cloud: Cloud,
    route: Route,
    controller: Bound,
    noise: Bound,
    rows: Any,
    body: Body,
    hold: int,
    until_tick: int,
) -> int:
    """Run the stack (the fields of `Stack`) and the free motion of the robot's body, tick by tick.

    Args:
        hold: State of the engine, see `vastflow.sim.world.motion`.
        until_tick: Ticks of the run after which to come back at the latest.

    Returns:
        Why it came back: DONE when the ticks are done or with the tick in which the mission ended; PHYSICS when the engine has
        to move the body by the tick's `velocities`; `APPEARS + k` when obstacle k of the body's has to appear before the
        next tick.
    """
    p, m = parameters[0], memory[0]
    status = m.status
    while m.tick < until_tick and m.status == status:
        index = due(body, m.tick)
        if index >= 0:
            return APPEARS + index
        place_movers(body, m.tick, 0.0)
        _see_truth(m, body.pose[0], body.pose[1], body.pose[2])
        is_new = _sense(p, m, g.skips, body.obstacles, noise)
        while is_new:
            gather_near_points(p, m)
            if m.initialized == 1 and p.without_map == 0.0:
                localize(p, m, g.cubed, cloud)
            is_new = p.late != 0 and _next_scan(m)
        if m.initialized == 1:
            _navigate(p, m, g, local, route, controller)
        _actuate(p, m)
        if m.tick % state.ROW_TICKS == 0:
            _record(p, m, rows)
        m.tick += 1
        place = g.skips, p.world_resolution, p.origin_x, p.origin_y
        is_free = move_freely(*place, body, m.velocities, TICK_S / SUBSTEPS, hold, m.tick - 1)
        place_movers(body, m.tick - 1, 0.0)
        if not is_free:
            return PHYSICS
    return DONE


@njit
def conclude(parameters: Any, memory: Any, body: Body, rows: Any) -> None:
    """The recording's last row: where the robot is when the run ends."""
    p, m = parameters[0], memory[0]
    _see_truth(m, body.pose[0], body.pose[1], body.pose[2])
    _record(p, m, rows)


@njit
def halt(memory: Any, controller: Bound) -> None:
    """Cancel the mission: the robot brakes and stops."""
    m = memory[0]
    reset(controller)
    m.state, m.status, m.path_n = state.ENDED, state.RESTING, 0
    order(m, 0.0, 0.0)


@inner
def _navigate(p: Any, m: Any, g: Grids, local: Local, route: Route, controller: Bound) -> None:
    """A tick of the stack behind its sensors, from the estimate to the command."""
    estimate(m)
    if m.clear_global == 1:
        clear_global(p, m, g)
    if m.clear_local == 1:
        clear_local(m, local)
    if m.tick % p.local_ticks == m.phase_local or m.has_local == 0:
        update_local(p, m, g, local)
        if p.local_costmap.speed_filter.enabled:
            limit_speed(g.zones, m.x, m.y)
    if m.tick % p.publish_ticks == m.phase_publish:
        publish_local(local)
    if m.tick % p.global_ticks == m.phase_global or m.has_global == 0:
        update_global(p, m, g)
        if p.global_costmap.speed_filter.enabled:
            limit_speed(g.zones, m.x, m.y)
    behave(p, m, g, local, route, controller)


@inner
def _sense(p: Any, m: Any, skips: Any, obstacles: Any, noise: Bound) -> bool:
    """Cast the beams of this tick. Whether the stack has a new scan: `m.ranges`, taken at `m.scan_odom_…`."""
    if p.late != 0:
        _take(p, m, skips, obstacles, noise)
        return _next_scan(m)
    if m.tick % p.scan_ticks != 0:
        return False
    _cast(p, m, skips, obstacles, (m.true_x, m.true_y, m.true_yaw), 0, m.beams, m.ranges)
    _perturb(p, m, m.ranges[: m.beams], noise)
    m.scan_odom_x, m.scan_odom_y, m.scan_odom_yaw = m.odom_x, m.odom_y, m.odom_yaw
    return True


@inner
def _next_scan(m: Any) -> bool:
    """Give the stack the next scan that has arrived: it and the odometry of its stamp."""
    scan = m.late_scans[m.scans_used % state.LATE_SCANS]
    if m.scans_used == m.scans_taken or scan[0] > m.tick * TICK_S + 1e-9 or scan[1] > m.odometry_step:
        return False
    ranges = m.late_ranges[m.scans_used % state.LATE_SCANS]
    for b in range(m.beams):
        m.ranges[b] = ranges[b]
    m.scan_odom_x, m.scan_odom_y, m.scan_odom_yaw = scan[2], scan[3], scan[4]
    m.scans_used += 1
    return True


@inner
def _take(p: Any, m: Any, skips: Any, obstacles: Any, noise: Bound) -> None:
    starts = m.tick % p.scan_ticks == 0
    ranges = m.late_ranges[m.scans_taken % state.LATE_SCANS]
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
    scan = m.late_scans[m.scans_taken % state.LATE_SCANS]
    row = m.odometry[(m.tick * SUBSTEPS) % state.ODOMETRY_STEPS]
    scan[1], scan[2], scan[3], scan[4] = m.tick * SUBSTEPS, row[0], row[1], row[2]


@inner
def _send_off(p: Any, m: Any, noise: Bound) -> None:
    """The scan is complete; scans don't overtake each other."""
    _perturb(p, m, m.late_ranges[m.scans_taken % state.LATE_SCANS, : m.beams], noise)
    arrives_s = m.tick * TICK_S + delay(m, p.latency.scan_age, p.latency.scan_jitter)
    m.scan_arrives = max(m.scan_arrives, arrives_s)
    m.late_scans[m.scans_taken % state.LATE_SCANS, 0] = m.scan_arrives
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


@inner
def _see_truth(m: Any, x_m: float, y_m: float, yaw_rad: float) -> None:
    if m.tick > 0:
        dx, dy = x_m - m.true_x, y_m - m.true_y
        m.true_v = (dx * math.cos(yaw_rad) + dy * math.sin(yaw_rad)) / TICK_S
        m.true_vy = (dy * math.cos(yaw_rad) - dx * math.sin(yaw_rad)) / TICK_S
        m.true_w = wrapped(yaw_rad - m.true_yaw) / TICK_S
        m.distance += math.hypot(dx, dy)
    m.true_x, m.true_y, m.true_yaw = x_m, y_m, yaw_rad


@inner
def _send(p: Any, m: Any) -> None:
    """The command path: velocity smoother, then the collision monitor."""
    receive_command(m, m.tick * SUBSTEPS + m.smoother_step)
    q = p.velocity_smoother
    v, w, vy = m.command_v, m.command_w, m.command_vy
    if (m.tick - m.command_tick) * TICK_S > q.velocity_timeout:
        v, w, vy = 0.0, 0.0, 0.0
    before_v, before_w, before_vy = m.smooth_v, m.smooth_w, m.smooth_vy
    if q.closed_loop != 0:
        before_v, before_w, before_vy = _mean_twist(m, q.odom_duration)
    m.smooth_v = _smoothed(q, 0, v, before_v)
    m.smooth_w = _smoothed(q, 2, w, before_w)
    m.smooth_vy = _smoothed(q, 1, vy, before_vy)
    factor = approach(p, m, m.smooth_v, m.smooth_w, m.smooth_vy)
    if p.zone_count > 0:
        factor = min(factor, zoned(p, m, m.smooth_v, m.smooth_w, m.smooth_vy))
    m.sent_v, m.sent_w, m.sent_vy = m.smooth_v * factor, m.smooth_w * factor, m.smooth_vy * factor
    if factor == 0.0 and m.stopped == 0:
        note(m, state.EVENT_STOPPED, 0, 0.0)
    m.stopped = int(factor == 0.0)


@inner
def _mean_twist(m: Any, duration_s: float) -> Any:
    """(v, ω, vy): the mean of what odometry reported in the last seconds, its newest included."""
    count = int(min(duration_s / TICK_S + 1e-9, m.tick, state.MOST_TWISTS - 1)) + 1
    v, w, vy = 0.0, 0.0, 0.0
    for k in range(count):
        twist = m.twists[(m.tick - k) % state.MOST_TWISTS]
        v, w, vy = v + twist[0] / count, w + twist[1] / count, vy + twist[2] / count
    return v, w, vy


@inner
def _smoothed(q: Any, axis: int, command: float, previous: float) -> float:
    """The command within the velocity limits, and within one cycle's acceleration or braking of the one before."""
    target = min(max(command, q.min_velocity[axis]), q.max_velocity[axis])
    speeds_up = abs(target) >= abs(previous) and target * previous >= 0.0
    limit = q.max_accel[axis] if speeds_up else -q.max_decel[axis]
    return float(previous + min(max(target - previous, -limit * TICK_S), limit * TICK_S))


@inner
def _actuate(p: Any, m: Any) -> None:
    """Run the command path in its step of the tick and the actuators' limits in each.

    Odometry counts what the wheels do, blocked or not.
    """
    noise = p.perturbation.odometry_noise_std_deviation
    dt_s = TICK_S / SUBSTEPS
    m.odom_v, m.odom_w, m.odom_vy = 0.0, 0.0, 0.0
    for k in range(SUBSTEPS):
        if k == m.smoother_step:
            _send(p, m)
        m.wheel_v = limited(m.sent_v, m.wheel_v, p.max_speed, p.max_acceleration, dt_s)
        m.wheel_w = limited(m.sent_w, m.wheel_w, p.max_yaw_rate, p.max_yaw_acceleration, dt_s)
        if p.min_turning_radius > 0.0:
            m.wheel_w = steered(m.wheel_v, m.wheel_w, p.min_turning_radius)
        if p.is_omni != 0.0:
            m.wheel_vy = limited(m.sent_vy, m.wheel_vy, p.max_speed, p.max_acceleration, dt_s)
        v, w, vy = m.wheel_v, m.wheel_w, m.wheel_vy
        if noise > 0.0:
            a, b = normal_pair(m.streams[ODOMETRY])
            v, w = v * (1.0 + noise * a), w * (1.0 + noise * b)
            if p.is_omni != 0.0:
                a, _ = normal_pair(m.streams[ODOMETRY])
                vy = vy * (1.0 + noise * a)
        dv, dw, dvy = (v, w, vy) if p.drifts == 0.0 else _drifted(p, m, v, w, vy, dt_s)
        m.counted_x, m.counted_y, m.counted_yaw = moved(m.counted_x, m.counted_y, m.counted_yaw, dv, dw, dvy, dt_s)
        m.velocities[k, 0], m.velocities[k, 1], m.velocities[k, 2] = m.wheel_v, m.wheel_w, m.wheel_vy
        if k >= SUBSTEPS - TWIST_STEPS:
            m.odom_v += v / TWIST_STEPS
            m.odom_w += w / TWIST_STEPS
            m.odom_vy += vy / TWIST_STEPS
        if p.late != 0:
            count_step(m, m.tick * SUBSTEPS + k + 1, v, w, vy)
    if p.late != 0:
        receive_odometry(p, m, (m.tick + 1) * SUBSTEPS)
    else:
        m.odom_x, m.odom_y, m.odom_yaw = m.counted_x, m.counted_y, m.counted_yaw
    twist = m.twists[(m.tick + 1) % state.MOST_TWISTS]
    twist[0], twist[1], twist[2] = m.odom_v, m.odom_w, m.odom_vy


@inner
def _drifted(p: Any, m: Any, v: float, w: float, vy: float, dt_s: float) -> Any:
    """(v, ω, vy) by which odometry's pose goes on, see `OdometryDrift`; its twist stays the wheels'."""
    q = p.odometry
    driven_m, turn_rad = math.sqrt(v * v + vy * vy) * dt_s, abs(w) * dt_s
    along = math.sqrt(q.translation_std_per_meter**2 * driven_m + q.translation_std_per_radian**2 * turn_rad) / dt_s
    turning = math.sqrt(q.rotation_std_per_meter**2 * driven_m + q.rotation_std_per_radian**2 * turn_rad) / dt_s
    a, b = normal_pair(m.streams[ODOMETRY])
    if p.is_omni != 0.0:
        c, _ = normal_pair(m.streams[ODOMETRY])
        vy += along * c
    return v + along * a, w + turning * b, vy


@inner
def _record(p: Any, m: Any, rows: Any) -> None:
    """A row of the recording, its poses and the covariance in the map's frame."""
    if m.rows == rows.shape[0]:
        return
    row = rows[m.rows]
    row[0] = round(m.tick * TICK_S * 1e3)
    _record_pose(p, row[1:4], m.true_x, m.true_y, wrapped(m.true_yaw))
    c, s = math.cos(m.planning_yaw), math.sin(m.planning_yaw)
    x, y = m.planning_x + (c * m.x - s * m.y), m.planning_y + (s * m.x + c * m.y)
    _record_pose(p, row[4:7], x, y, m.yaw if m.planning_yaw == 0.0 else wrapped(m.planning_yaw + m.yaw))
    row[7], row[8] = round(m.true_v * 1e3), round(m.true_w * 1e3)
    row[9], row[10] = round(m.command_v * 1e3), round(m.command_w * 1e3)
    row[11], row[12] = round(m.sent_v * 1e3), round(m.sent_w * 1e3)
    row[13] = m.localized
    xx, xy, yy = m.pose_xx, m.pose_xy, m.pose_yy
    if p.grid_yaw != 0.0:
        c, s = p.grid_cos, p.grid_sin
        xx, xy, yy = (
            c * c * m.pose_xx - 2.0 * c * s * m.pose_xy + s * s * m.pose_yy,
            c * s * (m.pose_xx - m.pose_yy) + (c * c - s * s) * m.pose_xy,
            s * s * m.pose_xx + 2.0 * c * s * m.pose_xy + c * c * m.pose_yy,
        )
    row[14], row[15], row[16] = round(xx * 1e6), round(xy * 1e6), round(yy * 1e6)
    row[17] = round(m.pose_aa * 1e6)
    if p.is_omni != 0.0:
        row[18], row[19], row[20] = round(m.true_vy * 1e3), round(m.command_vy * 1e3), round(m.sent_vy * 1e3)
    m.localized = 0
    m.rows += 1


@inner
def _record_pose(p: Any, row: Any, x_m: float, y_m: float, yaw_rad: float) -> None:
    if p.grid_yaw != 0.0:
        dx, dy = x_m - p.origin_x, y_m - p.origin_y
        x_m = p.origin_x + p.grid_cos * dx - p.grid_sin * dy
        y_m = p.origin_y + p.grid_sin * dx + p.grid_cos * dy
        yaw_rad = wrapped(yaw_rad + p.grid_yaw)
    row[0], row[1], row[2] = round(x_m * 1e3), round(y_m * 1e3), round(yaw_rad * 1e3)
