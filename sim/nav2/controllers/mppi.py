"""Model Predictive Path Integral control (nav2_mppi_controller, Jazzy)."""

import math
from dataclasses import replace
from typing import Any, Final

from vastflow.sim.kernels.lanes import addresses_of, either, load, lower, splat, store
from vastflow.sim.kernels.numeric import addressed, inner
from vastflow.sim.nav2.controllers.controller import Controller, ControllerInput, PlanCut, Setting, SpeedLimits
from vastflow.sim.nav2.controllers.mppi_critics import (
    COLLISION,
    Frame,
    add_cost,
    cost_values,
    followed_point,
    furthest_point,
    judge_alignment,
    judge_bearing,
    judge_cells,
    judge_following,
    judge_goal,
    judge_goal_angle,
    judge_turns,
    judge_twirling,
    lay_frame,
    lay_plan,
    lay_table,
    mark,
    mark_headings,
    obstacle_values,
    raised,
)
from vastflow.sim.nav2.controllers.mppi_outlines import judge_outlines, lay_room
from vastflow.sim.nav2.controllers.mppi_samples import (
    ROW,
    STEP,
    Draw,
    MppiMemory,
    Space,
    add_weighted,
    add_weighted_lateral,
    follow,
    missing_speed,
    new_memory,
    next_noise,
)
from vastflow.sim.nav2.parameters.mppi import MppiParameters
from vastflow.sim.world.motion import steered, wrapped

NEGLIGIBLE: Final = 1e-9
"""A group of samples of smaller weights than this times the best one's is left out of the mean: 2e-6 of it in all."""

UNSMOOTHED: Final = 20
"""A sequence of no more steps than this is left as it is."""


@addressed
def reset(memory: MppiMemory) -> None:
    """Forget the sequence, the commands, and the kept noise, as at the end of a FollowPath action."""
    memory.kept_noise[0] = -1
    for axis in range(memory.sequence.shape[0]):
        for t in range(memory.sequence.shape[1]):
            memory.sequence[axis, t] = 0.0
        for i in range(4):
            memory.history[axis, i] = 0.0


@addressed
def compute_velocity(q: Any, memory: MppiMemory, given: ControllerInput) -> Any:
    """Command (valid, v, ω, vy) from the mean of the samples; not valid when all of them collide.

    As Nav2 releases it, MPPI tries again then and never takes back the flag that stops the critics, so no further try can
    be valid. With `retry_scores` one is.
    """
    pose, twist, goal, sequence = given.pose, given.twist, given.goal, memory.sequence
    space = addresses_of(memory.space)
    goal_m = math.hypot(goal[0] - pose[0], goal[1] - pose[1])
    if q.ObstaclesCritic.enabled != 0:
        obstacle_values(q.ObstaclesCritic, space.values, goal_m, sequence.shape[1])
    else:
        cost_values(q.CostCritic, space.values, goal_m)
    frame = lay_frame(space.frame, space.values, given.window, pose)
    if q.CostCritic.consider_footprint != 0:
        room = space.near, space.lethal, space.vertices
        lay_room(*room, frame, given.window, given.outline, memory.circumscribed_cost[0])
    lowest, highest, beyond, backwards = _prices(q, memory.unlimited_mps, goal_m)
    used = sequence.shape[1] * memory.space.costs.shape[0]
    rise, fall, turn = q.model_dt * q.ax_max, -q.model_dt * q.ax_min, q.model_dt * q.az_max
    lateral_rise, lateral_fall = q.model_dt * q.ay_max, -q.model_dt * q.ay_min
    radius_m, is_omni = memory.min_turning_radius_m[0], sequence.shape[0] == 3
    for _ in range(1 + (q.retry_attempt_limit if q.retry_scores != 0 else 0)):
        # Nav2 draws in a thread while it is not asked, or once for all cycles with `regenerate_noises: false`.
        noise_at = memory.kept_noise[0]
        if q.regenerate_noises != 0 or noise_at < 0:
            noise_at = next_noise(memory.stream, memory.next_noise, memory.space.noise.shape[0], used)
            memory.kept_noise[0] = noise_at
        v, w, vy = twist[0], twist[1], given.lateral_mps
        draw = Draw(
            noise_at, v, w, rise, fall, turn, vy, lateral_rise, lateral_fall, lowest, highest, beyond, backwards
        )
        if _sample(q, memory, space, frame, draw, given, goal_m):
            _judge_plan(q, memory, space, frame, given, goal_m)
            _weigh(space, q.batch_size, q.temperature)
            _average(space, sequence, q.batch_size, draw)
            # Nav2 limits the mean by its speeds and accelerations before it smooths it, not after: smoothing may leave
            # them a little.
            _limit(sequence[0], q.vx_min, q.vx_max, rise, fall)
            _limit(sequence[1], -q.wz_max, q.wz_max, turn, turn)
            if is_omni:
                _limit(sequence[2], -q.vy_max, q.vy_max, lateral_rise, lateral_fall)
            if radius_m > 0.0:
                for t in range(sequence.shape[1]):
                    sequence[1, t] = steered(sequence[0, t], sequence[1, t], radius_m)
            # Nav2 shifts the sequence only if a control cycle lasts a step of the model; else its first command is
            # given.
            shift = 1 if abs(q.model_dt - given.dt_s) < 1e-6 else 0
            _smooth(sequence, memory.history, memory.line, shift)
            v, w, vy = sequence[0, shift], sequence[1, shift], sequence[2, shift] if is_omni else 0.0
            if shift == 1:
                for axis in range(sequence.shape[0]):
                    for t in range(1, sequence.shape[1]):
                        sequence[axis, t - 1] = sequence[axis, t]
            return True, v, w, vy
        reset(memory)
    return False, 0.0, 0.0, 0.0


@inner
def _prices(q: Any, unlimited_mps: Any, goal_m: float) -> Any:
    """The last four of `Draw`; as in Nav2, ConstraintCritic keeps the range without a speed limit."""
    vx_min_mps, vx_max_mps, vy_max_mps = unlimited_mps[0], unlimited_mps[1], unlimited_mps[2]
    # Nav2's `min_vel`: the sign of `vx_min` with the length of both axes together.
    lowest = math.copysign(math.hypot(vx_min_mps, vy_max_mps), vx_min_mps)
    beyond = q.ConstraintCritic.cost_weight * q.model_dt if q.ConstraintCritic.enabled != 0 else 0.0
    forward = q.PreferForwardCritic.enabled != 0 and goal_m >= q.PreferForwardCritic.threshold_to_consider
    backwards = q.PreferForwardCritic.cost_weight * q.model_dt if forward else 0.0
    return lowest, math.hypot(vx_max_mps, vy_max_mps), beyond, backwards


@inner
def _sample(q: Any, memory: Any, space: Space, frame: Frame, draw: Draw, given: ControllerInput, goal_m: float) -> bool:
    """Draw and follow all samples, and judge them by everything but the plan: False when every one collides."""
    pose, twist, goal, sequence = given.pose, given.twist, given.goal, memory.sequence
    steps, dt_s, is_omni = sequence.shape[1], q.model_dt, sequence.shape[0] == 3
    min_turning_radius_m = memory.min_turning_radius_m[0]
    twirling = q.TwirlingCritic.enabled != 0 and goal_m >= memory.goal_tolerance_m[0]
    _center(q, space, sequence)
    # The first step is the same for all samples: it goes by the measured twist, which no control of this cycle can
    # change.
    x_m, y_m = pose[0] + twist[0] * math.cos(pose[2]) * dt_s, pose[1] + twist[0] * math.sin(pose[2]) * dt_s
    if is_omni:
        x_m -= given.lateral_mps * math.sin(pose[2]) * dt_s
        y_m += given.lateral_mps * math.cos(pose[2]) * dt_s
    yaw_rad = pose[2] + twist[1] * dt_s
    x, y = (x_m - frame.left_m) / frame.resolution_m, (y_m - frame.bottom_m) / frame.resolution_m
    start = (x, y, math.cos(yaw_rad), math.sin(yaw_rad))
    # Tracks are in cells from here on: the critics look cells up far more often than they measure meters.
    scale = dt_s / frame.resolution_m
    priced, cell_stride = q.CostCritic.enabled != 0, q.CostCritic.trajectory_point_step
    avoids_obstacles = q.ObstaclesCritic.enabled != 0
    if avoids_obstacles:
        priced, cell_stride = True, 1
    outlined, motion = q.CostCritic.consider_footprint != 0, (yaw_rad, dt_s)
    cells = (steps - 1) // cell_stride + 1
    # Nav2 divides the weight by 254 as it reads it, and the sum by the number of points.
    cell_weight = q.CostCritic.cost_weight / 254.0 / cells
    crash = cell_weight * q.CostCritic.collision_cost
    if avoids_obstacles:
        cell_weight, crash = 1.0, q.ObstaclesCritic.critical_weight * q.ObstaclesCritic.collision_cost
    at_goal = q.GoalCritic.enabled != 0 and goal_m < q.GoalCritic.threshold_to_consider
    goal_cell = (goal[0] - frame.left_m) / frame.resolution_m, (goal[1] - frame.bottom_m) / frame.resolution_m
    goal_weight = q.GoalCritic.cost_weight * frame.resolution_m / steps
    turning = q.GoalAngleCritic.enabled != 0 and goal_m < q.GoalAngleCritic.threshold_to_consider
    off_rad, turn_weight = wrapped(yaw_rad - given.plan_end_yaw_rad), q.GoalAngleCritic.cost_weight / steps
    aligned = q.PathAlignCritic.enabled != 0 and goal_m >= q.PathAlignCritic.threshold_to_consider
    mark_stride = q.PathAlignCritic.trajectory_point_step
    marks = (steps - 1) // mark_stride
    held = q.VelocityDeadbandCritic.enabled != 0
    for first in range(0, q.batch_size, ROW):
        if is_omni:
            # Drawn, followed, and judged group by group: one group's track fits into the first-level cache, all of them
            # do not.
            follow(space, space.lateral_center, first, steps, draw, start, scale, dt_s)
        else:
            follow(space, None, first, steps, draw, start, scale, dt_s)
        if min_turning_radius_m > 0.0:
            judge_turns(space, first, steps, scale, min_turning_radius_m, draw.beyond)
        if priced:
            judge_cells(space, first, cells, cell_stride, frame, cell_weight, crash)
            if outlined:
                judge_outlines(space, first, cells, cell_stride, frame, given, motion, cell_weight, crash)
        if at_goal:
            judge_goal(space, first, steps, goal_cell, goal_weight)
        if turning:
            judge_goal_angle(space, first, steps, dt_s, off_rad, turn_weight)
        if twirling:
            judge_twirling(space, first, steps, twist[1], q.TwirlingCritic.cost_weight, q.TwirlingCritic.cost_power)
        if held:
            slowness = q.VelocityDeadbandCritic
            missing = missing_speed(space, first, steps, draw, slowness.deadband_velocities, is_omni)
            add_cost(space, first, raised(missing * splat(slowness.cost_weight * dt_s), slowness.cost_power))
        if aligned:
            mark(space, first, marks, mark_stride)
            if q.PathAlignCritic.use_path_orientations != 0:
                mark_headings(space, first, marks, mark_stride, yaw_rad, dt_s)
    if priced:
        # Nav2 fails the cycle if all samples collide, whatever the other critics say.
        for sample in range(q.batch_size):
            if space.touched[sample] < COLLISION:
                return True
        return False
    return True


@inner
def _judge_plan(q: Any, memory: Any, space: Space, frame: Frame, given: ControllerInput, goal_m: float) -> None:
    pose, plan, free = given.pose, given.plan, memory.free
    steps, n = memory.sequence.shape[1], plan.shape[0]
    aligned = q.PathAlignCritic.enabled != 0 and goal_m >= q.PathAlignCritic.threshold_to_consider
    followed = q.PathFollowCritic.enabled != 0 and goal_m >= q.PathFollowCritic.threshold_to_consider and n > 1
    faced = q.PathAngleCritic.enabled != 0 and goal_m >= q.PathAngleCritic.threshold_to_consider
    if not (aligned or followed or faced):
        return
    lay_plan(space.plan, free, given.window, frame, plan, n)
    # Three critics ask for it; Nav2 too computes it once in a cycle.
    furthest = furthest_point(space, q.batch_size, n)
    scale = lay_table(q.PathAlignCritic, space, plan, free, memory.lengths, furthest) if aligned else 0.0
    point = followed_point(q.PathFollowCritic, free, furthest, n)
    ahead = min(furthest + q.PathAngleCritic.offset_from_furthest, n - 1)
    mode, facing_rad = q.PathAngleCritic.mode, plan[ahead, 2] if q.PathAngleCritic.mode == 2 else 0.0
    if mode == 1 and abs(q.vx_min) < 1e-6:
        mode = 0  # a robot that can't reverse has the front towards the path where 1 lets it choose
    if faced:
        towards_rad = math.atan2(plan[ahead, 1] - pose[1], plan[ahead, 0] - pose[0])
        bearing = abs(wrapped(towards_rad - pose[2]))
        if mode == 1:
            bearing = min(bearing, math.pi - bearing)
        elif mode == 2 and abs(wrapped(towards_rad - facing_rad)) > 0.5 * math.pi:
            bearing = math.pi - bearing
        faced = bearing >= q.PathAngleCritic.max_angle_to_furthest
    marks = (steps - 1) // q.PathAlignCritic.trajectory_point_step
    align_weight = q.PathAlignCritic.cost_weight * frame.resolution_m
    follow_weight = q.PathFollowCritic.cost_weight * frame.resolution_m
    angle_weight = q.PathAngleCritic.cost_weight
    per_rad = 1.0 / frame.resolution_m if q.PathAlignCritic.use_path_orientations != 0 else 0.0
    for first in range(0, q.batch_size, ROW):
        if scale > 0.0:
            judge_alignment(space, first, marks, furthest, scale, align_weight, per_rad)
        if followed:
            judge_following(space, first, point, follow_weight)
        if faced:
            judge_bearing(space, first, ahead, mode, facing_rad, angle_weight)


@inner
def _center(q: Any, space: Space, sequence: Any) -> None:
    """Write the sequence and the gains of γ."""
    # γ/σ² times the product of a control and the mean (Williams et al. 2017); the mean's own product, which Nav2 takes
    # off, is the same for all samples.
    gain_v, gain_w = q.gamma / (q.vx_std * q.vx_std), q.gamma / (q.wz_std * q.wz_std)
    center = space.center
    for t in range(sequence.shape[1]):
        v, w = sequence[0, t], sequence[1, t]
        center[4 * t], center[4 * t + 1] = v, w
        center[4 * t + 2], center[4 * t + 3] = gain_v * v, gain_w * w
    if sequence.shape[0] == 3:
        gain_y = q.gamma / (q.vy_std * q.vy_std)
        for t in range(sequence.shape[1]):
            space.lateral_center[2 * t], space.lateral_center[2 * t + 1] = sequence[2, t], gain_y * sequence[2, t]


@inner
def _weigh(space: Space, samples: int, temperature: float) -> None:
    """Weights exp(-(S - min S) / temperature) of the samples; padding in the last group gets zero."""
    costs, weights = space.costs, space.weights
    # The least cost is subtracted, else all weights of a long horizon would be 0 in 32 bits.
    least = costs[0]
    for sample in range(samples):
        least = min(least, costs[sample])
    # exp(-z) is the 64th power of exp(-z / 64), Taylor's polynomial; past 40 nothing is left of it.
    best, scale, most = splat(least), splat(1.0 / (64.0 * temperature)), splat(40.0 / 64.0)
    one, none = splat(1.0), splat(0.0)
    for k in range(0, samples, ROW):
        z = (load(costs, k) - best) * scale
        x = lower(z, most)
        e = one - x * splat(1.0 / 6.0)
        e = one - x * splat(1.0 / 5.0) * e
        e = one - x * splat(1.0 / 4.0) * e
        e = one - x * splat(1.0 / 3.0) * e
        e = one - x * splat(1.0 / 2.0) * e
        e = one - x * e
        for _ in range(6):
            e = e * e
        store(weights, k, either(z, most, e, none))
    for sample in range(samples, (samples + ROW - 1) // ROW * ROW):
        # The last group's lanes beyond the batch were drawn and judged like samples, and must not count.
        weights[sample] = 0.0


@inner
def _average(space: Space, sequence: Any, samples: int, draw: Draw) -> None:
    """The sequence becomes the weighted mean of the samples, which are drawn again: they would not fit in the cache."""
    weights, sums = space.weights, space.sums
    steps, is_omni = sequence.shape[1], sequence.shape[0] == 3
    for k in range(steps * STEP):
        sums[k] = 0.0
    if is_omni:
        for k in range(steps * ROW):
            space.lateral_sums[k] = 0.0
    total = 0.0
    waiting = -1
    for first in range(0, samples, ROW):
        # Most groups weigh nothing at the usual temperature; they need not be drawn again.
        share = 0.0
        for sample in range(first, first + ROW):
            share += weights[sample]
        if share < NEGLIGIBLE:
            continue
        # Of the weights that are averaged, not of all: the negligible ones take no part in the mean either.
        total += share
        if is_omni:
            add_weighted_lateral(space, first, load(weights, first), steps, draw)
        if waiting < 0:
            waiting = first
        else:
            add_weighted(space, waiting, load(weights, waiting), first, load(weights, first), steps, draw)
            waiting = -1
    if waiting >= 0:
        add_weighted(space, waiting, load(weights, waiting), waiting, splat(0.0), steps, draw)
    for t in range(steps):
        for axis in range(2):
            sequence[axis, t] = _sum_of(sums, t * STEP + axis * ROW) / total
        if is_omni:
            sequence[2, t] = _sum_of(space.lateral_sums, t * ROW) / total


@inner
def _sum_of(sums: Any, first: int) -> float:
    total = 0.0
    for k in range(first, first + ROW):
        total += sums[k]
    return total


@inner
def _limit(speeds: Any, lowest: float, highest: float, rise: float, fall: float) -> None:
    """Limit the speeds (T,) of a sequence, and their changes from step to step."""
    last = 0.0
    for t in range(speeds.shape[0]):
        speed = min(max(speeds[t], lowest), highest)
        if t > 0:
            # Backwards, speeding up and slowing down change places, as in Nav2's `applyControlSequenceConstraints`.
            slower, faster = (fall, rise) if last > 0.0 else (rise, fall)
            speed = min(max(speed, last - slower), last + faster)
        speeds[t] = speed
        last = speed


@inner
def _smooth(sequence: Any, history: Any, line: Any, shift: int) -> None:
    """Smooth all steps but the last (Savitzky-Golay, 9 points, quadratic); write the command to `history`.

    On their left stand the last four commands, on their right the last step as often as needed.
    """
    count = sequence.shape[1] - 1
    # Nav2 does not smooth a sequence shorter than its filter's needs.
    if count < UNSMOOTHED:
        return
    for axis in range(sequence.shape[0]):
        for i in range(4):
            line[i] = history[axis, i]
        for t in range(count + 4):
            line[t + 4] = sequence[axis, min(t, count)]
        for t in range(count):
            # Coefficients of the quadratic filter over 9 points (Savitzky and Golay 1964), as in Nav2; their sum is
            # 231.
            total = 59.0 * line[t + 4] + 54.0 * (line[t + 3] + line[t + 5]) + 39.0 * (line[t + 2] + line[t + 6])
            total += 14.0 * (line[t + 1] + line[t + 7]) - 21.0 * (line[t] + line[t + 8])
            sequence[axis, t] = total / 231.0
        for i in range(3):
            history[axis, i] = history[axis, i + 1]
        history[axis, 3] = sequence[axis, shift]


@addressed
def set_plan(memory: MppiMemory) -> None:
    """Keep the control sequence when a new path arrives."""


class Mppi(MppiParameters, Controller):
    """The MPPI controller. With the controller server's period for `model_dt` the sequence is shifted between commands."""

    compute_velocity = compute_velocity
    reset = reset
    set_plan = set_plan

    def memory(self, setting: Setting) -> MppiMemory:
        """The stream, the goal's tolerance, and the circumscribed cost of the run."""
        return new_memory(self, setting.stream, setting.circumscribed_cost, abs(setting.xy_goal_tolerance_m))

    def speed_limits(self) -> SpeedLimits:
        """All its speeds by the same share, however great a limit in m/s is."""
        return SpeedLimits(("vx_max", "vx_min", "vy_max", "wz_max"), self.vx_max)

    @property
    def plan_ahead_m(self) -> float:
        """`prune_distance`."""
        return self.prune_distance

    def plan_cut(self, setting: Setting) -> PlanCut:
        """The usual one, up to where the path reverses with `enforce_path_inversion`."""
        return replace(
            super().plan_cut(setting),
            to_inversion=self.enforce_path_inversion,
            inversion_xy_m=self.inversion_xy_tolerance,
            inversion_yaw_rad=self.inversion_yaw_tolerance,
        )
