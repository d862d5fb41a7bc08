"""The Rotation Shim (nav2_rotation_shim_controller, Jazzy): turns in place toward a new path before the controller follows it."""

import math
from typing import Any

from vastflow.sim.kernels.numeric import inner
from vastflow.sim.nav2.costmaps.window import Window, outline_hits
from vastflow.sim.world.motion import wrapped


@inner
def renew(p: Any, m: Any) -> None:
    """Start with a new path: its heading is due, with `rotate_to_heading_once` of the first of several to one pose alone."""
    same = m.shim_planned != 0 and m.shim_turns == 0
    same = same and m.shim_end_x == m.goal_x and m.shim_end_y == m.goal_y and m.shim_end_yaw == m.goal_yaw
    m.heading_due, m.shim_at_goal = int(not (same and p.rotation_shim.rotate_to_heading_once != 0)), 0
    m.shim_planned, m.shim_end_x, m.shim_end_y, m.shim_end_yaw = 1, m.goal_x, m.goal_y, m.goal_yaw


@inner
def turn(p: Any, m: Any, window: Window, path: Any, w_radps: float, dt_s: float) -> Any:
    """(turns, ω): whether the robot turns in place in this cycle, and how fast; else the controller has the turn.

    The first `m.path_n` poses of `path` (N, 3) are the path, in the map's frame; `w_radps` is by odometry.
    """
    q = p.rotation_shim
    w_radps = w_radps if q.closed_loop != 0 else m.shim_w
    if q.rotate_to_goal_heading != 0:
        if math.hypot(m.goal_x - m.x, m.goal_y - m.y) <= abs(p.goal_checker.xy_goal_tolerance):
            m.shim_at_goal = 1
        if m.shim_at_goal != 0:
            angle = wrapped(m.goal_yaw - m.yaw)
            w = rotation(q, angle, w_radps, dt_s)
            if _is_free(q, m, window, angle, w, dt_s):
                m.shim_w = w
                return True, w
    if m.heading_due != 0:
        found, bearing = _bearing(q, m, path)
        threshold = q.angular_disengage_threshold if m.shim_turns != 0 else q.angular_dist_threshold
        if found and abs(bearing) > threshold:
            m.shim_turns = 1
            w = rotation(q, bearing, w_radps, dt_s)
            if _is_free(q, m, window, bearing, w, dt_s):
                m.shim_w = w
                return True, w
        m.heading_due = 0
    m.shim_turns = 0
    return False, 0.0


@inner
def _bearing(q: Any, m: Any, path: Any) -> Any:
    """(found, angle): the direction of the first pose `forward_sampling_distance` along the path, if any."""
    for i in range(1, m.path_n):
        if math.hypot(path[i, 0] - path[0, 0], path[i, 1] - path[0, 1]) >= q.forward_sampling_distance:
            if q.use_path_orientations != 0:
                # Nav2 compares a heading on the map with one of odometry's.
                return True, wrapped(path[i, 2] - m.odom_yaw)
            return True, wrapped(math.atan2(path[i, 1] - m.y, path[i, 0] - m.x) - m.yaw)
    return False, 0.0


@inner
def rotation(q: Any, angle_rad: float, w_radps: float, dt_s: float) -> float:
    """Yaw rate of turning in place by an angle, under the acceleration limit, slow enough to stop there."""
    sign = 1.0 if angle_rad > 0.0 else -1.0
    step = q.max_angular_accel * dt_s
    rate = min(max(sign * q.rotate_to_heading_angular_vel, w_radps - step), w_radps + step)
    stopping = math.sqrt(2.0 * q.max_angular_accel * abs(angle_rad))
    return sign * stopping if abs(rate) > stopping else rate


@inner
def _is_free(q: Any, m: Any, window: Window, angle_rad: float, w_radps: float, dt_s: float) -> bool:
    """Whether the outline meets nothing while the robot turns, up to where the controller would take over.

    Nav2 asks for that end with a sign, so it finds it only where the robot turns to the right.
    """
    remaining = abs(angle_rad) - q.angular_dist_threshold
    ahead_s = 0.0
    while ahead_s < q.simulate_ahead_time:
        ahead_s += dt_s
        if wrapped(-w_radps * ahead_s) >= remaining:
            return True
        if outline_hits(window, m.outline[: m.vertices], m.odom_x, m.odom_y, m.odom_yaw + w_radps * ahead_s):
            return False
    return True
