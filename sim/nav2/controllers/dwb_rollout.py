"""DWB's samples and where they lead: velocities within reach and their roll-outs (StandardTrajectoryGenerator).

The headings of a roll-out depend on its yaw rate and its number of steps alone, and once the speed is reached the
positions are linear in sums of their cosines and sines: the end of a trajectory is found without walking it.
"""

import math
from typing import Any, Final

from vastflow.sim.kernels.numeric import inner
from vastflow.sim.nav2.costmaps.inflation import INSCRIBED
from vastflow.sim.nav2.costmaps.window import outline_cost
from vastflow.sim.world.motion import wrapped

SAME_VELOCITY: Final = 1e-5
"""Tolerance of Nav2's velocity iterators (m/s, rad/s)."""


@inner
def sample(
    out: Any, current: float, low: float, high: float, acceleration: float, deceleration: float, time_s: float, n: int
) -> int:
    """Write velocities within reach in `time_s` to `out`, evenly spaced with both ends, and 0 between signs; their number."""
    current = min(max(current, low), high)
    top = approach(current, high, acceleration, deceleration, time_s)
    bottom = approach(current, low, acceleration, deceleration, time_s)
    step = 1.0 if abs(bottom - top) < SAME_VELOCITY else (top - bottom) / (max(2, n) - 1)
    count, velocity, zero = 0, bottom, True
    # Nav2 adds the step up; a product would differ from it in the last digit, and that can decide a tie.
    while velocity <= top + SAME_VELOCITY and count < out.shape[0]:
        out[count] = velocity
        count += 1
        if zero and velocity < 0.0 and velocity + step > 0.0 and velocity + step <= top + SAME_VELOCITY:
            out[count] = 0.0
            count += 1
            zero = False
        velocity += step
    return count


@inner
def possible(q: Any, v_mps: float, vy_mps: float, w_radps: float) -> bool:
    """Whether the robot can move like that: not too fast, not too slow, not at rest (`isValidSpeed`)."""
    square = v_mps * v_mps + vy_mps * vy_mps
    if q.max_speed_xy >= 0.0 and square > q.max_speed_xy * q.max_speed_xy + SAME_VELOCITY:
        return False
    slow = q.min_speed_xy >= 0.0 and square + SAME_VELOCITY < q.min_speed_xy * q.min_speed_xy
    if slow and q.min_speed_theta >= 0.0 and abs(w_radps) + SAME_VELOCITY < q.min_speed_theta:
        return False
    return bool(square != 0.0 or w_radps != 0.0)


@inner
def step_count(q: Any, v_mps: float, vy_mps: float, w_radps: float) -> int:
    """Steps of a sample's roll-out, fine enough for both granularities at the sample's own velocities."""
    speed = math.hypot(v_mps, vy_mps) if vy_mps != 0.0 else abs(v_mps)
    by_length = speed * q.sim_time / q.linear_granularity
    by_turn = abs(w_radps) * q.sim_time / q.angular_granularity
    longer = max(by_length, by_turn)
    steps = int(longer)
    return max(1, steps + 1 if longer > steps else steps)


@inner
def approach(velocity: float, target: float, acceleration: float, deceleration: float, dt_s: float) -> float:
    """The velocity after `dt_s` on the way to a target; as in Nav2 the sign of the difference decides."""
    if velocity < target:
        return min(target, velocity + acceleration * dt_s)
    return max(target, velocity + deceleration * dt_s)


@inner
def roll_out(
    q: Any, setting: Any, memory: Any, n_speeds: int, n_turns: int, cells_per_m: float, goal_rad: float
) -> None:
    """Write the end poses of all samples; samples of one yaw rate share their sums of headings."""
    speeds, sideways, turns, sums, ends = memory.speeds, memory.sideways, memory.turns, memory.sums, memory.ends
    for j in range(n_turns):
        steps, c, s, heading_error = 0, 0.0, 0.0, 0.0
        for i in range(n_speeds):
            n = step_count(q, speeds[i], sideways[i], turns[j])
            if n != steps:
                steps = n
                c, s, end_rad = sum_headings(q, sums[: steps + 1], setting.yaw_rad, setting.w_radps, turns[j])
                heading_error = abs(wrapped(goal_rad - end_rad))
            # Euler steps while the speed changes, then all the rest at once.
            dt_s = q.sim_time / steps
            cells = dt_s * cells_per_m
            x, y, v, vy, k = setting.x, setting.y, setting.v_mps, setting.vy_mps, 0
            while k < steps and (v != speeds[i] or vy != sideways[i]):
                v = approach(v, speeds[i], q.acc_lim_x, q.decel_lim_x, dt_s)
                vy = approach(vy, sideways[i], q.acc_lim_y, q.decel_lim_y, dt_s)
                dx, dy = sums[k + 1, 0] - sums[k, 0], sums[k + 1, 1] - sums[k, 1]
                x += v * cells * dx - vy * cells * dy
                y += v * cells * dy + vy * cells * dx
                k += 1
            dx, dy = sums[steps, 0] - sums[k, 0], sums[steps, 1] - sums[k, 1]
            ends[i, j, 0] = x + (v * cells * dx - vy * cells * dy)
            ends[i, j, 1] = y + (v * cells * dy + vy * cells * dx)
            ends[i, j, 2], ends[i, j, 3], ends[i, j, 4] = c, s, heading_error


@inner
def sum_headings(q: Any, sums: Any, yaw_rad: float, w_radps: float, target_radps: float) -> Any:
    """Write the sums (steps + 1, 2) of a roll-out: cosine, sine and angle of its last heading."""
    steps = sums.shape[0] - 1
    dt_s = q.sim_time / steps
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    along, across, w, turning, c_step, s_step = 0.0, 0.0, w_radps, math.inf, 1.0, 0.0
    sums[0, 0], sums[0, 1] = 0.0, 0.0
    for k in range(1, steps + 1):
        along += c
        across += s
        sums[k, 0], sums[k, 1] = along, across
        w = approach(w, target_radps, q.acc_lim_theta, q.decel_lim_theta, dt_s)
        if w != turning:
            turning = w
            c_step, s_step = math.cos(w * dt_s), math.sin(w * dt_s)
        c, s = c * c_step - s * s_step, s * c_step + c * s_step
        yaw_rad += w * dt_s
    return c, s, yaw_rad


@inner
def along(q: Any, setting: Any, target: Any, steps: int, sums: Any, end: Any, ground: Any) -> Any:
    """Follow a sample's roll-out from the robot's pose and sum the costs that it meets: (legal, center, outline).

    It is legal if it stays in the window and out of collision. The sums are those of the costs under the center and of the
    greatest costs under the outline at its poses, where these are looked at.

    Args:
        target: The sample's speeds, ahead and to the left.
        sums: Sums of the sample's headings, as `sum_headings` writes them.
        end: (5,) of the sample, see `DwbMemory.ends`.
        ground: Costs of the window, the robot's outline, cells per meter.
    """
    costs, outline, cells_per_m = ground
    rows, columns = costs.shape
    dt_s = q.sim_time / steps
    cells = dt_s * cells_per_m
    x, y, v, vy = setting.x, setting.y, setting.v_mps, setting.vy_mps
    center_cost, outline_costs, here, under = 0, 0, 0, 0
    for k in range(steps + 1):
        # A heading is what the next step adds to the sums.
        c, s = end[2], end[3]
        if k < steps:
            c, s = sums[k + 1, 0] - sums[k, 0], sums[k + 1, 1] - sums[k, 1]
        if not (x >= 0.0 and y >= 0.0 and x < columns and y < rows):
            if setting.bounded:
                return False, 0, 0
        elif setting.obstructed:
            here = int(costs[int(y), int(x)])
            if here >= INSCRIBED:
                return False, 0, 0
            center_cost += here
        if setting.outlined:
            under = outline_cost(costs, outline, x, y, c * cells_per_m, s * cells_per_m)
            if under < 0:
                return False, 0, 0
            outline_costs += under
        if k < steps:
            v = approach(v, target[0], q.acc_lim_x, q.decel_lim_x, dt_s)
            vy = approach(vy, target[1], q.acc_lim_y, q.decel_lim_y, dt_s)
            x += v * cells * c - vy * cells * s
            y += v * cells * s + vy * cells * c
    # Nav2's trajectories have their last pose twice.
    return True, center_cost + here, outline_costs + under
