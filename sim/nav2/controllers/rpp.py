"""Regulated Pure Pursuit (nav2_regulated_pure_pursuit_controller, Jazzy)."""

import math
from typing import Any, NamedTuple

import numpy as np

from vastflow.sim.kernels.numeric import addressed, inner
from vastflow.sim.nav2.controllers.controller import Controller, ControllerInput, PlanCut, Setting, SpeedLimits
from vastflow.sim.nav2.controllers.rotation_shim import rotation
from vastflow.sim.nav2.costmaps.inflation import FREE, INSCRIBED, UNKNOWN
from vastflow.sim.nav2.costmaps.window import Window, cost_at, outline_hits
from vastflow.sim.nav2.parameters.rpp import RppParameters
from vastflow.sim.world.motion import wrapped


class RppMemory(NamedTuple):
    """State of the controller."""

    reached: Any  # (1,) int64, whether the carrot has been within the goal's tolerance.
    tolerance_m: Any  # (1,) float64, the goal checker's `xy_goal_tolerance`.


@addressed
def reset(memory: RppMemory) -> None:
    """Forget that the goal was reached, as Nav2 does with every new path and at the end of an action."""
    memory.reached[0] = 0


@addressed
def compute_velocity(q: Any, memory: RppMemory, given: ControllerInput) -> Any:
    """Command (valid, v, ω) toward the carrot on the plan; invalid if the path to it is blocked."""
    window, outline, pose, twist, plan = given.window, given.outline, given.pose, given.twist, given.plan
    n, inscribed_radius_m, end_yaw_rad = plan.shape[0], given.inscribed_radius_m, given.plan_end_yaw_rad
    lookahead_m, curvature_lookahead_m = q.lookahead_dist, q.curvature_lookahead_dist
    if q.use_velocity_scaled_lookahead_dist != 0:
        # By the measured speed, not by the one ordered last: a robot that was stopped looks near again.
        lookahead_m = min(max(abs(twist[0]) * q.lookahead_time, q.min_lookahead_dist), q.max_lookahead_dist)
    if q.allow_reversing != 0:
        cusp_m = _cusp(pose, plan, n)
        lookahead_m, curvature_lookahead_m = min(lookahead_m, cusp_m), min(curvature_lookahead_m, cusp_m)
    ahead, aside = _carrot(pose, plan, n, lookahead_m)
    carrot_m = math.sqrt(ahead * ahead + aside * aside)
    bend_ahead, bend_aside = ahead, aside
    if q.use_fixed_curvature_lookahead != 0:
        bend_ahead, bend_aside = _carrot(pose, plan, n, curvature_lookahead_m)
    direction = -1.0 if q.allow_reversing != 0 and ahead < 0.0 else 1.0
    bearing = math.atan2(bend_aside, bend_ahead) if direction > 0.0 else math.atan2(-bend_aside, -bend_ahead)
    # Nav2 looks at the carrot, which near the goal is the plan's end.
    near = carrot_m < memory.tolerance_m[0]
    if q.use_rotate_to_heading != 0 and q.stateful != 0 and near:
        memory.reached[0] = 1
    if q.use_rotate_to_heading != 0 and (near or memory.reached[0] != 0):
        v, w = 0.0, rotation(q, wrapped(end_yaw_rad - pose[2]), twist[1], given.dt_s)
    elif q.use_rotate_to_heading != 0 and abs(bearing) > q.rotate_to_heading_min_angle:
        v, w = 0.0, rotation(q, bearing, twist[1], given.dt_s)
    else:
        square = bend_ahead * bend_ahead + bend_aside * bend_aside
        # Arc through the robot and the carrot, tangent to its heading; the limit spares a division by nearly zero
        # (Nav2's 0.001).
        curvature = 2.0 * bend_aside / square if square > 0.001 else 0.0
        cost = cost_at(window, pose[0], pose[1])
        v = direction * _regulated_speed(q, cost, inscribed_radius_m, pose, plan, n, curvature)
        w = v * curvature
    if q.use_collision_detection != 0 and _collides(q, window, outline, pose, v, w, carrot_m):
        return False, 0.0, 0.0
    return True, v, w


@inner
def _cusp(pose: Any, plan: Any, n: int) -> float:
    """Distance of the first point where the plan reverses, or turns in place; infinite where it does neither."""
    for i in range(1, n - 1):
        before_x, before_y = plan[i, 0] - plan[i - 1, 0], plan[i, 1] - plan[i - 1, 1]
        after_x, after_y = plan[i + 1, 0] - plan[i, 0], plan[i + 1, 1] - plan[i, 1]
        # Of NavFn's points the goal alone has a heading of its own, and may lie where the one before it does.
        turns = i == n - 2 and after_x == 0.0 and after_y == 0.0
        if turns or before_x * after_x + before_y * after_y < 0.0:
            return math.hypot(plan[i, 0] - pose[0], plan[i, 1] - pose[1])
    return math.inf


@inner
def _carrot(pose: Any, plan: Any, n: int, lookahead_m: float) -> Any:
    """Return the point where the plan crosses the lookahead circle, else its end, in the robot's frame."""
    x, y = plan[n - 1, 0] - pose[0], plan[n - 1, 1] - pose[1]
    last_x, last_y = x, y
    for i in range(n):
        px, py = plan[i, 0] - pose[0], plan[i, 1] - pose[1]
        square = px * px + py * py
        if square >= lookahead_m * lookahead_m:
            x, y = px, py
            if i > 0:
                dx, dy = px - last_x, py - last_y
                along, square = last_x * dx + last_y * dy, dx * dx + dy * dy
                inside = lookahead_m * lookahead_m - last_x * last_x - last_y * last_y
                # Root of |last + part · d| = lookahead that lies ahead on the segment; rounding may take it beyond the
                # segment's ends.
                part = min((math.sqrt(max(along * along + square * inside, 0.0)) - along) / square, 1.0)
                x, y = last_x + part * dx, last_y + part * dy
            break
        last_x, last_y = px, py
    c, s = math.cos(pose[2]), math.sin(pose[2])
    return c * x + s * y, -s * x + c * y


@inner
def _regulated_speed(
    q: Any, cost: int, inscribed_radius_m: float, pose: Any, plan: Any, n: int, curvature: float
) -> float:
    desired = q.desired_linear_vel
    by_curve, by_cost = desired, desired
    # Infinite on a straight line, where kernels divide as C++ does.
    radius_m = 1.0 / abs(curvature)
    if q.use_regulated_linear_velocity_scaling != 0 and radius_m < q.regulated_linear_scaling_min_radius:
        by_curve = desired * radius_m / q.regulated_linear_scaling_min_radius
    if q.use_cost_regulated_linear_velocity_scaling != 0 and cost != FREE and cost != UNKNOWN:
        # Nav2's inverse of the inflation layer's cost begins at 253, the cost itself at 252.
        clearance_m = inscribed_radius_m - math.log(cost / INSCRIBED) / q.inflation_cost_scaling_factor
        if clearance_m < q.cost_scaling_dist:
            by_cost = desired * q.cost_scaling_gain * clearance_m / q.cost_scaling_dist
    speed = max(min(by_curve, by_cost), q.regulated_linear_scaling_min_speed)
    walked_m = 0.0
    for i in range(1, n):
        dx, dy = plan[i, 0] - plan[i - 1, 0], plan[i, 1] - plan[i - 1, 1]
        walked_m += math.sqrt(dx * dx + dy * dy)
    if walked_m < q.approach_velocity_scaling_dist:
        end_m = math.hypot(plan[n - 1, 0] - pose[0], plan[n - 1, 1] - pose[1])
        # Nav2 scales by the distance to the plan's end as the crow flies, and decides by the length of the plan.
        by_approach = speed * end_m / q.approach_velocity_scaling_dist
        speed = min(speed, max(by_approach, q.min_approach_linear_velocity))
    return float(min(abs(speed), desired))


@inner
def _collides(q: Any, window: Window, outline: Any, pose: Any, v: float, w: float, carrot_m: float) -> bool:
    """True if the outline meets a lethal cell here or on the arc to the carrot within the time."""
    x, y, yaw = pose
    if outline_hits(window, outline, x, y, yaw):
        return True
    # By steps of a cell no lethal cell can be jumped over, and no pose is looked at twice.
    if abs(v) < 0.01 and abs(w) > 0.01:
        # In place: steps in which the farthest vertex moves by one cell.
        farthest_m = 0.0
        for k in range(outline.shape[0]):
            farthest_m = max(farthest_m, math.hypot(outline[k, 0], outline[k, 1]))
        dt_s = 2.0 * math.sin(0.5 * window.place[2] / farthest_m) / abs(w)
    else:
        dt_s = window.place[2] / abs(v)
    k = 1
    while k * dt_s < q.max_allowed_time_to_collision_up_to_carrot:
        k += 1
        x += dt_s * v * math.cos(yaw)
        y += dt_s * v * math.sin(yaw)
        yaw += dt_s * w
        # Beyond the carrot the arc leaves the plan, which turns away from what stands there.
        if math.hypot(x - pose[0], y - pose[1]) > carrot_m:
            return False
        if outline_hits(window, outline, x, y, yaw):
            return True
    return False


class Rpp(RppParameters, Controller):
    """The RPP controller."""

    compute_velocity = compute_velocity
    reset = reset
    set_plan = reset

    def memory(self, setting: Setting) -> RppMemory:
        """The goal checker's tolerance, and no goal reached."""
        return RppMemory(np.zeros(1, dtype=np.int64), np.array([setting.xy_goal_tolerance_m]))

    def speed_limits(self) -> SpeedLimits:
        """Its desired speed alone."""
        return SpeedLimits(("desired_linear_vel",), self.desired_linear_vel)

    def plan_cut(self, setting: Setting) -> PlanCut:
        """Cut the path at the local costmap's edge, which Nav2 takes to be half a cell nearer."""
        reach_m = setting.half_edge_m - 0.25 * setting.resolution_m
        return PlanCut(search_m=reach_m, two_points=True, around_m=reach_m)
