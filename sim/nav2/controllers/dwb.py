"""The DWB controller (dwb_core of Nav2 Humble): sampled speeds, rolled out, the best by the sum of critics.

A trajectory's score depends on its last pose alone, and its other poses only decide whether it is legal. So all
samples get the score of their end first, and only those that could be chosen are followed on the way there; with
`sum_scores` all of them are. With scores that never fall when a critic is added, that is the same choice as Nav2's, whose
order of samples decides ties.

Critics are summed in Nav2's numbers of 32 bits and in the order of the file's list: many samples are as good as each
other but for the rounding, which then decides.

Nav2's `short_circuit_trajectory_evaluation` leaves critics out once a sample is worse than the best. That changes no
choice, and is not here.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from vastflow.sim.kernels.numeric import addressed, inner
from vastflow.sim.model.elementary import hypot
from vastflow.sim.nav2.controllers.controller import Controller, ControllerInput, PlanCut, Setting, SpeedLimits
from vastflow.sim.nav2.controllers.dwb_critics import (
    DISTANCE,
    PathGrid,
    Trends,
    at_goal,
    clear,
    debrief,
    grow,
    lay,
    new_path_grid,
)
from vastflow.sim.nav2.controllers.dwb_rollout import along, possible, roll_out, sample, step_count, sum_headings
from vastflow.sim.nav2.costmaps.inflation import INSCRIBED
from vastflow.sim.nav2.costmaps.window import outline_cost
from vastflow.sim.nav2.parameters.dwb import DwbParameters

ROTATE, OSCILLATION, OBSTACLE, GOAL_ALIGN, PATH_ALIGN, PATH_DIST, GOAL_DIST, PREFER_FORWARD, TWIRLING, FOOTPRINT = (
    range(10)
)
"""Critics in `DwbMemory.raw` and `scales`: the order of `DwbParameters`."""


class DwbMemory(NamedTuple):
    """State and working space of the controller."""

    ahead: Any  # ahead, aside: Samples of the last call, ahead and to the left (m/s).
    aside: Any
    speeds: Any  # speeds, sideways: (V,) all pairs of them, of each speed ahead those to the left in turn.
    sideways: Any
    turns: Any  # (W,) samples of the last call.
    order: Any  # (C,) int64, the critics of `raw` and `scales` as the file lists them.
    raw: Any  # raw, scales: (C,) what each critic says of an end, and what a point of it counts.
    scales: Any
    scores: Any  # (V, W) of the ends, infinite where a critic forbids it.
    ends: Any  # (V, W, 5): x, y in cells, cosine and sine of the heading, its distance from the goal's.
    # (P, 2) of the cosine and sine of the headings before each step, beginning with 0, of the sample at hand.
    sums: Any
    grid: PathGrid
    trends: Trends


class _Setting(NamedTuple):
    """Values that all samples of a call share; positions are in cells from the window's corner."""

    x: float
    y: float
    yaw_rad: float
    v_mps: float  # v_mps, vy_mps, w_radps: Measured.
    vy_mps: float
    w_radps: float
    goal_state: int  # Of `at_goal`.
    goal: int  # goal, nose: Cells of GoalDist and GoalAlign.
    nose: int
    bounded: bool  # Whether a trajectory may not leave the window.
    obstructed: bool  # obstructed, outlined: Whether its center, and whether its outline, may not collide.
    outlined: bool
    summed: bool  # Whether one of them counts at all poses.


def new_memory(q: DwbParameters, rows: int, columns: int) -> DwbMemory:
    """Memory for a local costmap of `rows` × `columns` cells."""
    # Zero comes on top of the samples where they change sign without it.
    ahead, turns = max(2, q.vx_samples) + 1, max(2, q.vtheta_samples) + 1
    strafes = q.min_vel_y != 0.0 or q.max_vel_y != 0.0
    aside = max(2, q.vy_samples) + 1 if strafes else 1
    speeds = ahead * aside
    fastest_mps = hypot(max(abs(q.min_vel_x), abs(q.max_vel_x)), max(abs(q.min_vel_y), abs(q.max_vel_y)))
    # Room for the longest trajectory: its steps are as fine as the granularity of the speed or of the turn, whichever
    # needs more.
    steps_v = math.ceil(fastest_mps * q.sim_time / q.linear_granularity) + 1
    steps_w = math.ceil(q.max_vel_theta * q.sim_time / q.angular_granularity) + 1
    return DwbMemory(
        ahead=np.zeros(ahead),
        aside=np.zeros(aside),
        speeds=np.zeros(speeds),
        sideways=np.zeros(speeds),
        turns=np.zeros(turns),
        # Nav2 adds the critics in the order of the file, and 32-bit sums depend on the order in their last bit.
        order=np.argsort([critic.place for critic in q.critics()], kind="stable"),
        raw=np.zeros(FOOTPRINT + 1),
        scales=np.zeros(FOOTPRINT + 1),
        scores=np.zeros((speeds, turns)),
        ends=np.zeros((speeds, turns, 5)),
        sums=np.zeros((max(steps_v, steps_w) + 1, 2)),
        grid=new_path_grid(rows, columns),
        trends=Trends(np.zeros((3, 3), dtype=np.int64), np.zeros(3), np.zeros(2, dtype=np.int64)),
    )


@addressed
def reset(memory: DwbMemory) -> None:
    """Forget restrictions and that the goal was reached, as Nav2 does with every new path."""
    clear(memory.trends.signs)
    memory.trends.latched[0], memory.trends.latched[1] = 0, 0


@addressed
def compute_velocity(q: Any, memory: DwbMemory, given: ControllerInput) -> Any:
    """Command (valid, v, ω, vy) of the legal sample with the lowest score; not valid when none is legal."""
    setting, ground, n_speeds, n_turns = score(q, memory, given)
    i, j = _choose(q, memory, ground, setting, n_speeds, n_turns)
    v, w, vy = (memory.speeds[i], memory.turns[j], memory.sideways[i]) if i >= 0 else (0.0, 0.0, 0.0)
    if q.Oscillation.enabled != 0:
        debrief(q.Oscillation, memory.trends, given.pose, v, w, vy)
    return i >= 0, v, w, vy


@inner
def score(q: Any, memory: DwbMemory, given: ControllerInput) -> Any:
    """Score the ends of all samples: the setting, the ground of `along`, and the numbers of speeds and yaw rates."""
    setting = _prepare(q, memory, given)
    v, vy, w, time_s = setting.v_mps, setting.vy_mps, setting.w_radps, q.sim_time
    # Nav2 samples within what can be reached in `sim_time`, not in one cycle (its `KinematicParameters` and XYTheta
    # iterator).
    n_ahead = sample(memory.ahead, v, q.min_vel_x, q.max_vel_x, q.acc_lim_x, q.decel_lim_x, time_s, q.vx_samples)
    n_aside = sample(memory.aside, vy, q.min_vel_y, q.max_vel_y, q.acc_lim_y, q.decel_lim_y, time_s, q.vy_samples)
    n_speeds = n_ahead * n_aside
    for i in range(n_speeds):
        memory.speeds[i], memory.sideways[i] = memory.ahead[i // n_aside], memory.aside[i % n_aside]
    limit = q.max_vel_theta
    n_turns = sample(memory.turns, w, -limit, limit, q.acc_lim_theta, q.decel_lim_theta, time_s, q.vtheta_samples)
    cells_per_m = 1.0 / given.window.place[2]
    roll_out(q, setting, memory, n_speeds, n_turns, cells_per_m, given.goal[2])
    ground = given.window.costs, given.outline, cells_per_m
    _score_ends(q, setting, memory, ground, n_speeds, n_turns)
    return setting, ground, n_speeds, n_turns


@inner
def _prepare(q: Any, memory: DwbMemory, given: ControllerInput) -> _Setting:
    window, pose, twist, plan, goal = given.window, given.pose, given.twist, given.plan, given.goal
    n = plan.shape[0]
    dx, dy = goal[0] - pose[0], goal[1] - pose[1]
    away_m = math.sqrt(dx * dx + dy * dy)
    # GoalAlign wants the nose beyond the local goal, in the direction from here to the goal.
    reach_m = q.GoalAlign.forward_point_distance
    nose_x, nose_y = plan[n - 1, 0] + reach_m, plan[n - 1, 1]
    if away_m > 0.0:
        nose_x, nose_y = plan[n - 1, 0] + reach_m * dx / away_m, plan[n - 1, 1] + reach_m * dy / away_m
    goal_cell, nose_cell = lay(memory.grid, window, plan, n, nose_x, nose_y)
    # The critics of the grids count meters, and only half of each. With scale 0 Nav2 does not even let one forbid.
    half_m, scales = 0.5 * window.place[2], memory.scales
    # Nav2's scores have scales and totals in 32 bits: two samples that tie there must tie here, where the first one
    # wins.
    scales[ROTATE] = np.float32(q.RotateToGoal.scale * q.RotateToGoal.enabled)
    scales[OSCILLATION] = np.float32(q.Oscillation.scale * q.Oscillation.enabled)
    scales[OBSTACLE] = np.float32(q.BaseObstacle.scale * q.BaseObstacle.enabled)
    scales[GOAL_ALIGN] = np.float32(half_m * q.GoalAlign.scale * q.GoalAlign.enabled)
    scales[PATH_ALIGN] = np.float32(half_m * q.PathAlign.scale * q.PathAlign.enabled)
    scales[PATH_DIST] = np.float32(half_m * q.PathDist.scale * q.PathDist.enabled)
    scales[GOAL_DIST] = np.float32(half_m * q.GoalDist.scale * q.GoalDist.enabled)
    scales[PREFER_FORWARD] = np.float32(q.PreferForward.scale * q.PreferForward.enabled)
    scales[TWIRLING] = np.float32(q.Twirling.scale * q.Twirling.enabled)
    scales[FOOTPRINT] = np.float32(q.ObstacleFootprint.scale * q.ObstacleFootprint.enabled)
    # Nav2 turns PathAlign off near the goal, where its forward point would lie beyond the path's end.
    if away_m <= q.PathAlign.forward_point_distance:
        scales[PATH_ALIGN] = 0.0
    obstructed, outlined = scales[OBSTACLE] != 0.0, scales[FOOTPRINT] != 0.0
    summed = (obstructed and q.BaseObstacle.sum_scores != 0) or (outlined and q.ObstacleFootprint.sum_scores != 0)
    return _Setting(
        (pose[0] - window.place[0]) / window.place[2],
        (pose[1] - window.place[1]) / window.place[2],
        pose[2],
        twist[0],
        given.lateral_mps,
        twist[1],
        at_goal(q, memory.trends.latched, pose[0], pose[1], math.hypot(twist[0], given.lateral_mps), goal),
        goal_cell,
        nose_cell,
        obstructed or outlined or scales[PATH_DIST] != 0.0 or scales[GOAL_DIST] != 0.0,
        obstructed,
        outlined,
        summed,
    )


@inner
def _score_ends(q: Any, setting: _Setting, memory: DwbMemory, ground: Any, n_speeds: int, n_turns: int) -> None:
    """Sum of the critics at every sample's end; infinite where one forbids the sample."""
    costs, outline, cells_per_m = ground
    speeds, turns, ends, scores, signs = memory.speeds, memory.turns, memory.ends, memory.scores, memory.trends.signs
    cells, bins, counts = memory.grid.cells, memory.grid.bins, memory.grid.counts
    order, raw, scales = memory.order, memory.raw, memory.scales
    rows, columns = costs.shape
    stride, nowhere = columns + 2, rows * columns + 1
    goal_x, goal_y = setting.goal % stride - 1, setting.goal // stride - 1
    nose_goal_x, nose_goal_y = setting.nose % stride - 1, setting.nose // stride - 1
    ahead_goal = q.GoalAlign.forward_point_distance * cells_per_m
    ahead_path = q.PathAlign.forward_point_distance * cells_per_m
    free = scales[OSCILLATION] == 0.0
    # The tests of a speed's sign stand outside of the inner loop: what they exclude is a whole row of samples.
    forward, backward = free or signs[0, 2] == 0, free or signs[0, 1] == 0
    to_left, to_right = free or signs[1, 2] == 0, free or signs[1, 1] == 0
    leftward, rightward = free or signs[2, 2] == 0, free or signs[2, 1] == 0
    square = setting.v_mps * setting.v_mps + setting.vy_mps * setting.vy_mps
    rotating = scales[ROTATE] != 0.0 and setting.goal_state == 2
    slowing = scales[ROTATE] != 0.0 and setting.goal_state == 1
    for k in range(raw.shape[0]):
        raw[k] = 0.0
    for i in range(n_speeds):
        v, vy = speeds[i], memory.sideways[i]
        excluded = (v > 0.0 and not forward) or (v < 0.0 and not backward)
        excluded = excluded or (vy > 0.0 and not leftward) or (vy < 0.0 and not rightward)
        excluded = excluded or (rotating and (v != 0.0 or vy != 0.0)) or (slowing and v * v + vy * vy >= square)
        for j in range(n_turns):
            w = turns[j]
            scores[i, j] = math.inf
            # Forbidden samples stay infinite and are never looked at by the costlier critics, as an exception of Nav2's
            # critic ends a sample.
            if excluded or (w > 0.0 and not to_left) or (w < 0.0 and not to_right) or not possible(q, v, vy, w):
                continue
            x, y, c, s = ends[i, j, 0], ends[i, j, 1], ends[i, j, 2], ends[i, j, 3]
            inside = x >= 0.0 and y >= 0.0 and x < columns and y < rows
            # Nav2's grid critics throw for a pose off the window, GoalAlign and PathAlign for their forward point.
            if setting.bounded and not inside:
                continue
            if rotating:
                raw[ROTATE] = ends[i, j, 4]
            elif slowing:
                raw[ROTATE] = (v * v + vy * vy) * q.RotateToGoal.slowing_factor + ends[i, j, 4]
            if setting.obstructed:
                raw[OBSTACLE] = costs[int(y), int(x)]
                # BaseObstacle takes the center's cost alone: inscribed is where a disc collides.
                if raw[OBSTACLE] >= INSCRIBED:
                    continue
            if setting.outlined:
                raw[FOOTPRINT] = outline_cost(costs, outline, x, y, c * cells_per_m, s * cells_per_m)
                if raw[FOOTPRINT] < 0.0:
                    continue
            if setting.summed and not _sum_up(q, setting, memory, ground, i, j):
                continue
            if scales[GOAL_ALIGN] != 0.0:
                nose_x, nose_y = x + ahead_goal * c, y + ahead_goal * s
                if not (nose_x >= 0.0 and nose_y >= 0.0 and nose_x < columns and nose_y < rows):
                    continue
                away = abs(int(nose_x) - nose_goal_x) + abs(int(nose_y) - nose_goal_y)
                raw[GOAL_ALIGN] = away if setting.nose >= 0 else nowhere
            if scales[PATH_ALIGN] != 0.0:
                nose_x, nose_y = x + ahead_path * c, y + ahead_path * s
                if not (nose_x >= 0.0 and nose_y >= 0.0 and nose_x < columns and nose_y < rows):
                    continue
                raw[PATH_ALIGN] = nowhere
                if setting.goal >= 0:
                    at = (int(nose_y) + 1) * stride + int(nose_x) + 1
                    away = cells[at, DISTANCE]
                    # The grid of distances grows only as far as it is asked: most cells of a window are never looked
                    # up.
                    raw[PATH_ALIGN] = away if away >= 0 else grow(cells, bins, counts, at, stride)
            if setting.goal < 0 and (scales[PATH_DIST] != 0.0 or scales[GOAL_DIST] != 0.0):
                continue
            if scales[PATH_DIST] != 0.0:
                at = (int(y) + 1) * stride + int(x) + 1
                away = cells[at, DISTANCE]
                raw[PATH_DIST] = away if away >= 0 else grow(cells, bins, counts, at, stride)
            if scales[GOAL_DIST] != 0.0:
                raw[GOAL_DIST] = abs(int(x) - goal_x) + abs(int(y) - goal_y)
            raw[TWIRLING] = abs(w)
            raw[PREFER_FORWARD] = abs(w) * q.PreferForward.theta_scale
            if v < 0.0 or (v < q.PreferForward.strafe_x and abs(w) < q.PreferForward.strafe_theta):
                raw[PREFER_FORWARD] = q.PreferForward.penalty
            total = np.float32(0.0)
            for k in order:
                # Rounded after each critic, as a C++ float is; the product is a double there as well.
                total = np.float32(total + raw[k] * scales[k])
            scores[i, j] = total


@inner
def _sum_up(q: Any, setting: _Setting, memory: DwbMemory, ground: Any, i: int, j: int) -> bool:
    """Replace a sample's end costs by the sums over all its poses where they count; False if illegal."""
    legal, center, outline = followed(q, setting, memory, ground, i, j)
    if q.BaseObstacle.sum_scores != 0:
        memory.raw[OBSTACLE] = center
    if q.ObstacleFootprint.sum_scores != 0:
        memory.raw[FOOTPRINT] = outline
    return bool(legal)


@inner
def followed(q: Any, setting: _Setting, memory: DwbMemory, ground: Any, i: int, j: int) -> Any:
    """Follow a sample, see `along`."""
    target = (memory.speeds[i], memory.sideways[i])
    steps = step_count(q, target[0], target[1], memory.turns[j])
    sums = memory.sums[: steps + 1]
    sum_headings(q, sums, setting.yaw_rad, setting.w_radps, memory.turns[j])
    return along(q, setting, target, steps, sums, memory.ends[i, j], ground)


@inner
def _choose(q: Any, memory: DwbMemory, ground: Any, setting: _Setting, n_speeds: int, n_turns: int) -> Any:
    """Return the indices of the first legal sample with the lowest score, or (-1, -1)."""
    scores = memory.scores
    best, best_i, best_j = math.inf, -1, -1
    for i in range(n_speeds):
        for j in range(n_turns):
            if scores[i, j] < best:
                best, best_i, best_j = scores[i, j], i, j
    if best_i < 0:
        return -1, -1
    # The end decides for nearly all samples, so only the best is followed all its way, where Nav2 follows each. If it
    # collides on its way, those of the others are followed that might win.
    if followed(q, setting, memory, ground, best_i, best_j)[0]:
        return best_i, best_j
    scores[best_i, best_j] = math.inf
    best, best_i, best_j = math.inf, -1, -1
    for i in range(n_speeds):
        for j in range(n_turns):
            if scores[i, j] < best and followed(q, setting, memory, ground, i, j)[0]:
                best, best_i, best_j = scores[i, j], i, j
    return best_i, best_j


class Dwb(DwbParameters, Controller):
    """The DWB controller."""

    compute_velocity = compute_velocity
    reset = reset
    set_plan = reset

    def memory(self, setting: Setting) -> DwbMemory:
        return new_memory(self, setting.rows, setting.columns)

    def speed_limits(self) -> SpeedLimits:
        """Its greatest speeds; a limit in m/s only if it is below `max_speed_xy`."""
        return SpeedLimits(
            ("max_speed_xy", "max_vel_x", "max_vel_y", "max_vel_theta"), self.max_speed_xy, only_lower=True
        )

    def plan_cut(self, setting: Setting) -> PlanCut:
        """All points round the robot that have not been left behind: it keeps path behind the robot."""
        return PlanCut(
            search_m=self.forward_prune_distance,
            within_m=min(setting.half_edge_m, self.prune_distance),
            around_m=min(setting.half_edge_m, self.forward_prune_distance),
        )
