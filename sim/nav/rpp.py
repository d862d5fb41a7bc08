"""Regulated Pure Pursuit (nav2_regulated_pure_pursuit_controller, Jazzy)."""

import math
from typing import Any, Final

from vastflow.sim.nav.costmap import LOCAL_CELLS
from vastflow.sim.nav.inflation import FREE, INSCRIBED, LETHAL
from vastflow.sim.nav.state import OUTLINE_POINTS, TICK_S
from vastflow.sim.numeric import inner
from vastflow.sim.robot import wrapped

SEARCH_M: Final = 1.5
"""How far along the plan the point nearest to the robot is sought: half the local costmap's edge."""


@inner
def pursue(p: Any, m: Any, path: Any) -> Any:
    """Command (valid, v, ω) towards the carrot on the path; not valid when the way there is blocked."""
    _prune(m, path)
    carrot_x, carrot_y, end_m = _carrot(p, m, path)
    c, sn = math.cos(m.yaw), math.sin(m.yaw)
    ahead = c * (carrot_x - m.x) + sn * (carrot_y - m.y)
    aside = -sn * (carrot_x - m.x) + c * (carrot_y - m.y)
    carrot_m = math.hypot(ahead, aside)
    bearing = math.atan2(aside, ahead)
    if carrot_m < p.xy_goal_tolerance and end_m < p.xy_goal_tolerance:
        v, w = 0.0, _rotation(p, m, wrapped(m.goal_yaw - m.yaw))
    elif abs(bearing) > p.rotate_to_heading_min_angle:
        v, w = 0.0, _rotation(p, m, bearing)
    else:
        curvature = 2.0 * aside / (carrot_m * carrot_m) if carrot_m > 1e-3 else 0.0
        v = _regulated_speed(p, m, path, curvature, end_m)
        w = v * curvature
    if _collides(p, m, v, w, carrot_m):
        return False, 0.0, 0.0
    return True, v, w


@inner
def _prune(m: Any, path: Any) -> None:
    """Advance the path index to the point nearest to the robot, within the search distance."""
    nearest, best, along = math.inf, m.path_i, 0.0
    for i in range(m.path_i, m.path_n):
        if i > m.path_i:
            along += math.hypot(path[i, 0] - path[i - 1, 0], path[i, 1] - path[i - 1, 1])
            if along > SEARCH_M:
                break
        away = math.hypot(path[i, 0] - m.x, path[i, 1] - m.y)
        if away < nearest:
            nearest, best = away, i
    m.path_i = best


@inner
def _carrot(p: Any, m: Any, path: Any) -> Any:
    """The path's crossing of the lookahead circle (x, y), and the length of the path that remains, up to 2 m."""
    found, x, y = False, path[m.path_n - 1, 0], path[m.path_n - 1, 1]
    remaining = 0.0
    for i in range(m.path_i, m.path_n):
        px, py = path[i, 0], path[i, 1]
        if i > m.path_i:
            remaining += math.hypot(px - path[i - 1, 0], py - path[i - 1, 1])
        if not found and math.hypot(px - m.x, py - m.y) >= p.lookahead_dist:
            found, x, y = True, px, py
            if i > m.path_i:
                x, y = _on_circle(path[i - 1, 0] - m.x, path[i - 1, 1] - m.y, px - m.x, py - m.y, p.lookahead_dist)
                x, y = x + m.x, y + m.y
        if found and remaining > 2.0:
            break
    return x, y, remaining


@inner
def _on_circle(x0: float, y0: float, x1: float, y1: float, radius: float) -> Any:
    """Where the segment from inside to outside crosses the circle round the origin."""
    dx, dy = x1 - x0, y1 - y0
    a, b, c = dx * dx + dy * dy, 2.0 * (x0 * dx + y0 * dy), x0 * x0 + y0 * y0 - radius * radius
    if a == 0.0:
        return x1, y1
    t = (-b + math.sqrt(max(b * b - 4.0 * a * c, 0.0))) / (2.0 * a)
    t = min(max(t, 0.0), 1.0)
    return x0 + t * dx, y0 + t * dy


@inner
def _rotation(p: Any, m: Any, angle_rad: float) -> float:
    """Yaw rate of turning in place towards an angle, under the acceleration limit, slow enough to stop there."""
    sign = 1.0 if angle_rad > 0.0 else -1.0
    rate = sign * p.rotate_to_heading_angular_vel
    step = p.max_angular_accel * TICK_S
    rate = min(max(rate, m.wheel_w - step), m.wheel_w + step)
    stopping = math.sqrt(2.0 * p.max_angular_accel * abs(angle_rad))
    return sign * stopping if abs(rate) > stopping else rate


@inner
def _regulated_speed(p: Any, m: Any, path: Any, curvature: float, end_m: float) -> float:
    """Desired speed reduced in curves, near obstacles and near the path's end."""
    speed = p.desired_linear_vel
    by_curve = speed
    if abs(curvature) > 0.0 and 1.0 / abs(curvature) < p.regulated_linear_scaling_min_radius:
        by_curve = speed / (abs(curvature) * p.regulated_linear_scaling_min_radius)
    by_cost = speed
    cost = local_cost(p, m, m.odom_x, m.odom_y)
    if FREE < cost <= INSCRIBED:
        clearance = p.inscribed_radius - math.log(cost / 253.0) / p.cost_scaling_factor
        if clearance < p.cost_scaling_dist:
            by_cost = speed * p.cost_scaling_gain * clearance / p.cost_scaling_dist
    slow = max(min(by_curve, by_cost), p.regulated_linear_scaling_min_speed)
    if end_m < p.approach_velocity_scaling_dist:
        last_m = math.hypot(path[m.path_n - 1, 0] - m.x, path[m.path_n - 1, 1] - m.y)
        approach = max(speed * last_m / p.approach_velocity_scaling_dist, p.min_approach_linear_velocity)
        slow = min(slow, approach)
    return float(min(max(slow, 0.0), speed))


@inner
def _collides(p: Any, m: Any, v: float, w: float, carrot_m: float) -> bool:
    """Whether the outline meets a lethal cell on the arc ahead, up to the carrot and the allowed time."""
    if outline_hits(p, m, m.odom_x, m.odom_y):
        return True
    if abs(v) < 1e-3:
        return False  # a round robot that turns in place sweeps nothing new
    dt_s = p.resolution / abs(v)
    x, y, yaw, t = m.odom_x, m.odom_y, m.odom_yaw, dt_s
    while t < p.max_allowed_time_to_collision_up_to_carrot:
        x += dt_s * v * math.cos(yaw)
        y += dt_s * v * math.sin(yaw)
        yaw += dt_s * w
        if math.hypot(x - m.odom_x, y - m.odom_y) > carrot_m:
            return False
        if outline_hits(p, m, x, y):
            return True
        t += dt_s
    return False


@inner
def outline_hits(p: Any, m: Any, x_m: float, y_m: float) -> bool:
    """Whether the padded footprint's outline, with its centre at an odometry position, touches a lethal cell."""
    if local_cost(p, m, x_m, y_m) < m.outline_cost:
        return False
    for k in range(OUTLINE_POINTS):
        if local_cost(p, m, x_m + m.outline[k, 0], y_m + m.outline[k, 1]) == LETHAL:
            return True
    return False


@inner
def local_cost(p: Any, m: Any, x_m: float, y_m: float) -> int:
    """Cost of the local costmap at a point of the odom frame; free outside the window."""
    column = math.floor(x_m / p.resolution) - m.local_column
    row = math.floor(y_m / p.resolution) - m.local_row
    if row < 0 or column < 0 or row >= LOCAL_CELLS or column >= LOCAL_CELLS:
        return FREE
    return int(m.local_costs[row, column])
