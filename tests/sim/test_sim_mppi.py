"""MPPI against a plain reading of it in NumPy."""

import math

import numpy as np
import pytest
from alone import Alone, straight
from table import each_row

from vastflow.sim.nav2.controllers.mppi_critics import lay_frame
from vastflow.sim.nav2.controllers.mppi_samples import SIDE, noise
from vastflow.sim.nav2.costmaps.window import Window
from vastflow.sim.nav2.parameters.mppi import (
    CostParameters,
    MppiParameters,
    ObstaclesParameters,
    TwirlingParameters,
    VelocityDeadbandParameters,
)

PARAMETERS = MppiParameters()
SMALL = PARAMETERS.with_values(batch_size=400)
TOLERANCE_M = 0.25
BY_DISTANCE = {
    "CostCritic": CostParameters(enabled=False),
    "ObstaclesCritic": ObstaclesParameters(enabled=True, inflation_radius=0.7, cost_scaling_factor=3.0),
}
TURNING_LITTLE = {"TwirlingCritic": TwirlingParameters(enabled=True, cost_weight=20.0)}
TURNING_FAST = {"VelocityDeadbandCritic": VelocityDeadbandParameters(enabled=True, deadband_velocities=(0.1, 0.0, 0.4))}


def bend():
    turn = np.arange(0.0, 1.2, 0.025)
    return np.column_stack([0.8 * np.sin(turn), 0.8 * (1 - np.cos(turn))])


def blob(column, row):
    rows, columns = np.indices((60, 60))
    away = np.maximum(abs(rows - row), abs(columns - column))
    return np.select([away <= 2, away <= 6], [254, 253], np.maximum(0, 270 - 20 * away)).astype(np.uint8)


def avoids_obstacles(q, under, goal_m, inscribed_m=0.1855):
    """Return costs of ObstaclesCritic for samples (K, T) on cells of these costs; the radius drops out."""
    scale, touched = q.cost_scaling_factor, (under > 0) & (under < 253)
    away = (scale * inscribed_m - np.log(np.maximum(under, 1)) + np.log(253.0)) / scale - inscribed_m
    near = np.where(touched & (away < q.collision_margin_distance), q.collision_margin_distance - away, 0.0).sum(1)
    repulsion = np.where(touched, q.inflation_radius - away, 0.0).sum(1) * (goal_m >= q.near_goal_distance)
    raw = np.where((under >= 253).any(1), q.collision_cost, near)
    return q.critical_weight * raw + q.repulsion_weight * (repulsion - repulsion.min()) / under.shape[1]


def plain(q, sequence, numbers, map_costs, pose, twist, plan, end_yaw_rad, goal):
    """Costs (K,), controls (K, T, 2) and the next sequence before it is smoothed, as the reference describes them."""
    T, K, dt = q.time_steps, q.batch_size, q.model_dt
    c = sequence[None] + numbers
    v, w = np.full(K, twist[0]), np.full(K, twist[1])
    vs, ws = np.zeros((K, T)), np.zeros((K, T))
    vs[:, 0], ws[:, 0] = v, w
    for t in range(1, T):
        up, down = np.where(v > 0, q.ax_max, -q.ax_min) * dt, np.where(v > 0, -q.ax_min, q.ax_max) * dt
        v = np.clip(c[:, t - 1, 0], v - down, v + up)
        w = np.clip(c[:, t - 1, 1], w - q.az_max * dt, w + q.az_max * dt)
        c[:, t - 1, 0], c[:, t - 1, 1] = v, w
        vs[:, t], ws[:, t] = v, w
    yaw = pose[2] + np.cumsum(ws * dt, axis=1)
    before = np.column_stack([np.full(K, pose[2]), yaw[:, :-1]])
    x = pose[0] + np.cumsum(vs * np.cos(before) * dt, axis=1)
    y = pose[1] + np.cumsum(vs * np.sin(before) * dt, axis=1)

    def cost_at(px, py):
        column, row = np.floor((px + 1.5) / 0.05).astype(int), np.floor((py + 1.5) / 0.05).astype(int)
        inside = (column >= 0) & (row >= 0) & (column < 60) & (row < 60)
        return np.where(inside, map_costs[np.clip(row, 0, 59), np.clip(column, 0, 59)], 255).astype(int)

    # Without headings of their own the plan's points have the map's.
    headings, plan = plan[:, 2] if plan.shape[1] == 3 else np.zeros(len(plan)), plan[:, :2]

    def off(angle):
        return np.abs((angle + np.pi) % (2 * np.pi) - np.pi)

    goal_m = math.hypot(goal[0] - pose[0], goal[1] - pose[1])
    costs = np.zeros(K)
    highest, lowest = math.hypot(q.vx_max, q.vy_max), -math.hypot(q.vx_min, q.vy_max)
    costs += q.ConstraintCritic.cost_weight * dt * (np.maximum(vs - highest, 0) + np.maximum(lowest - vs, 0)).sum(1)
    step = q.CostCritic.trajectory_point_step
    under = cost_at(x[:, ::step], y[:, ::step])
    collides = (under >= 253).any(1)
    summed = np.zeros(K) if goal_m < q.CostCritic.near_goal_distance else under.sum(1)
    if q.CostCritic.enabled:
        priced = np.where(collides, q.CostCritic.collision_cost, summed)
        costs += priced * q.CostCritic.cost_weight / 254 / under.shape[1]
    if q.ObstaclesCritic.enabled:
        costs += avoids_obstacles(q.ObstaclesCritic, cost_at(x, y), goal_m)
    if goal_m < q.GoalCritic.threshold_to_consider:
        costs += q.GoalCritic.cost_weight * np.hypot(x - goal[0], y - goal[1]).mean(1)
    if goal_m < q.GoalAngleCritic.threshold_to_consider:
        costs += q.GoalAngleCritic.cost_weight * off(yaw - end_yaw_rad).mean(1)
    free = cost_at(plan[:, 0], plan[:, 1]) < 253
    furthest = 0
    for k in range(K):
        away = np.hypot(*(plan[furthest:] - (x[k, -1], y[k, -1])).T)
        furthest += int(away.argmin())
    blocked = int((~free[:furthest]).sum())
    align = q.PathAlignCritic
    judged = goal_m >= align.threshold_to_consider and furthest >= align.offset_from_furthest
    if judged and not (blocked > 2 and blocked / furthest > align.max_path_occupancy_ratio):
        marks = slice(align.trajectory_point_step, T, align.trajectory_point_step)
        xs, ys = np.column_stack([x[:, 0], x[:, marks]]), np.column_stack([y[:, 0], y[:, marks]])
        along = np.cumsum(np.hypot(np.diff(xs), np.diff(ys)), axis=1)
        lengths = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(plan[:furthest], axis=0).T))])
        nearest = np.abs(lengths[None, None] - along[..., None]).argmin(2)
        away = np.hypot(xs[:, 1:] - plan[nearest, 0], ys[:, 1:] - plan[nearest, 1])
        if align.use_path_orientations:
            away = np.hypot(away, off(headings[nearest] - yaw[:, marks]))
        good = free[nearest]
        costs += align.cost_weight * (away * good).sum(1) / np.maximum(good.sum(1), 1)
    follow = q.PathFollowCritic
    if goal_m >= follow.threshold_to_consider:
        at = min(furthest + follow.offset_from_furthest, len(plan) - 1)
        while at < len(plan) - 2 and not free[at]:
            at += 1
        costs += follow.cost_weight * np.hypot(x[:, -1] - plan[at, 0], y[:, -1] - plan[at, 1])
    angle = q.PathAngleCritic
    at = min(furthest + angle.offset_from_furthest, len(plan) - 1)
    towards = np.arctan2(plan[at, 1] - np.r_[pose[1], y[:, -1]], plan[at, 0] - np.r_[pose[0], x[:, -1]])
    if angle.mode == 2:
        towards += np.pi * (off(towards - headings[at]) > np.pi / 2)
    if goal_m >= angle.threshold_to_consider and off(towards[0] - pose[2]) >= angle.max_angle_to_furthest:
        costs += angle.cost_weight * off(yaw[:, -1] - towards[1:])
    if goal_m >= q.PreferForwardCritic.threshold_to_consider:
        costs += q.PreferForwardCritic.cost_weight * dt * np.maximum(-vs, 0).sum(1)
    if q.TwirlingCritic.enabled and goal_m >= TOLERANCE_M:
        costs += (q.TwirlingCritic.cost_weight * np.abs(ws).mean(1)) ** q.TwirlingCritic.cost_power
    slow = q.VelocityDeadbandCritic
    if slow.enabled:
        least_mps, _, least_radps = slow.deadband_velocities
        missing = [np.maximum(least_mps - np.abs(vs), 0), np.maximum(least_radps - np.abs(ws), 0)]
        costs += (slow.cost_weight * dt * np.sum(missing, axis=(0, 2))) ** slow.cost_power
    costs += q.gamma * ((sequence / (q.vx_std**2, q.wz_std**2))[None] * (c - sequence[None])).sum((1, 2))
    weights = np.exp(-(costs - costs.min()) / q.temperature)
    return costs, np.tensordot(weights / weights.sum(), c, 1)


def smoothed(q, sequence, history):
    limits_v, limits_w = (q.vx_min, q.vx_max), (-q.wz_max, q.wz_max)
    u = np.column_stack([np.clip(sequence[:, 0], *limits_v), np.clip(sequence[:, 1], *limits_w)])
    for t in range(1, len(u)):
        up, down = (q.ax_max, -q.ax_min) if u[t - 1, 0] > 0 else (-q.ax_min, q.ax_max)
        u[t, 0] = np.clip(u[t, 0], u[t - 1, 0] - down * q.model_dt, u[t - 1, 0] + up * q.model_dt)
        u[t, 1] = np.clip(u[t, 1], u[t - 1, 1] - q.az_max * q.model_dt, u[t - 1, 1] + q.az_max * q.model_dt)
    kernel = np.array([-21, 14, 39, 54, 59, 54, 39, 14, -21]) / 231
    line = np.vstack([history, u, np.repeat(u[-1:], 4, axis=0)])
    out = u.copy()
    for t in range(len(u) - 1):
        out[t] = kernel @ line[t : t + 9]
    return out


def numbers_of(memory, q):
    """The noise (K, T, 2) that the last cycle used."""
    groups = math.ceil(q.batch_size / 16)
    used = groups * q.time_steps * 16
    start = int(memory.next_noise[0]) - used
    rows = numbers_in(memory.space.noise[start : start + used]).reshape(2, groups, q.time_steps, 16)
    return rows.transpose(1, 3, 2, 0).reshape(groups * 16, q.time_steps, 2)[: q.batch_size]


def numbers_in(words):
    """Noise (2, n) for v and ω of words (n,)."""
    both = np.array([words, np.asarray(words) << np.uint32(16)], dtype=np.uint32)
    return both.view(np.float32).astype(float)


def judged(q, costs, pose, twist, plan, goal, v_mps=0.0):
    """Return the costs of the samples round a sequence of one speed, ours and plain."""
    controller, sequence = Alone(q), np.column_stack([np.full(56, v_mps), np.zeros(56)])
    controller.memory.sequence[:] = sequence.T
    controller.command(plan, costs, pose, twist, goal)
    numbers = numbers_of(controller.memory, q)
    expected, _ = plain(q, sequence, numbers, costs, pose, twist, plan, goal[2], goal)
    return np.asarray(controller.memory.space.costs)[: q.batch_size], expected


AHEAD, FREE = (5.0, 0.0, 0.0), np.zeros((60, 60), dtype=np.uint8)
SITUATIONS = {
    "open": (FREE, (0.0, 0.0, 0.0), (0.3, 0.0), straight(), AHEAD),
    "beside a blob": (blob(42, 34), (0.0, 0.0, 0.1), (0.4, 0.1), straight(), AHEAD),
    "a blob on the plan": (blob(50, 30), (0.0, 0.0, 0.0), (0.2, 0.0), straight(), AHEAD),
    "a bend": (FREE, (0.0, 0.1, 0.4), (0.4, 0.5), bend(), AHEAD),
    "the plan behind": (FREE, (0.0, 0.0, 2.5), (0.0, 0.0), straight(), AHEAD),
    "driving backwards": (FREE, (0.0, 0.0, 0.0), (-0.2, 0.3), straight(), AHEAD),
    "near the goal": (FREE, (0.0, 0.0, 0.2), (0.2, 0.0), straight(0.9), (0.9, 0.0, 0.5)),
    "at the goal": (FREE, (0.0, 0.0, 1.0), (0.1, 0.0), straight(0.3), (0.3, 0.0, 0.0)),
}


@each_row("name", SITUATIONS)
def test_three_cycles_match_plain_implementation(name):
    costs, pose, twist, plan, goal = SITUATIONS[name]
    controller = Alone(SMALL)
    sequence, history = np.zeros((56, 2)), np.zeros((4, 2))
    for _ in range(3):
        valid, v, w, _ = controller.command(plan, costs, pose, twist, goal)
        _, mean = plain(SMALL, sequence, numbers_of(controller.memory, SMALL), costs, pose, twist, plan, goal[2], goal)
        after = smoothed(SMALL, mean, history)
        assert valid
        assert (v, w) == pytest.approx(tuple(after[1]), abs=3e-3)
        history = np.vstack([history[1:], after[1]])
        sequence = np.vstack([after[1:], after[-1:]])


def test_sample_costs_match_plain_implementation():
    costs, pose, twist, plan, goal = SITUATIONS["beside a blob"]
    found, expected = judged(SMALL, costs, pose, twist, plan, goal)
    near = expected < 100  # a sample on the rim of a cell may count as a collision in one reading alone
    assert near.sum() > 200
    assert np.median(np.abs(found[near] - expected[near])) < 1e-3
    assert np.mean(np.abs(found[near] - expected[near]) > 0.1) < 0.02


@each_row("goal_m", [5.0, 0.4])
def test_obstacles_critic_prices_the_samples_by_distances_to_obstacles_as_nav2_does(goal_m):
    costs, pose, twist, plan, _ = SITUATIONS["beside a blob"]
    q = SMALL.with_values(**BY_DISTANCE)
    found, expected = judged(q, costs, pose, twist, plan, (goal_m, 0.0, 0.0))
    free = expected < 100
    assert 100 < free.sum() < q.batch_size
    assert found[~free].min() > 1e5
    # The least repulsion among all samples, which Nav2 takes away, changes no weight: both are compared from their medians.
    apart = (found - np.median(found[free])) - (expected - np.median(expected[free]))
    assert np.median(np.abs(apart[free])) < 1e-3
    assert np.mean(np.abs(apart[free]) > 0.1) < 0.03


@each_row("name", ["a bend", "at the goal"])
@each_row("power", [1, 2])
@each_row("critic", [TURNING_LITTLE, TURNING_FAST])
def test_critic_of_speeds_adds_the_costs_of_the_plain_reading(name, power, critic):
    ((group, values),) = critic.items()
    on, off = (SMALL.with_values(**{group: values.with_values(enabled=e, cost_power=power)}) for e in (True, False))
    ours, theirs = np.subtract(judged(on, *SITUATIONS[name]), judged(off, *SITUATIONS[name]))
    assert np.ptp(theirs) > 0.1 or (name == "at the goal") == (critic is TURNING_LITTLE)
    np.testing.assert_allclose(ours, theirs, rtol=1e-3, atol=1e-2)


def judged_by_headings(q, pose, twist, heading_rad):
    """Return the costs, ours and plain, of going on along a straight plan whose poses head elsewhere."""
    plan = np.column_stack([straight(), np.full(len(straight()), heading_rad)])
    return judged(q, SITUATIONS["open"][0], pose, twist, plan, AHEAD, twist[0])


@each_row(
    ("name", "changed", "pose", "twist", "heading_rad"),
    [
        ("PathAlignCritic", {"use_path_orientations": True}, (0.0, 0.1, 0.3), (0.4, 0.1), 0.8),
        ("PathAngleCritic", {"mode": 2}, (0.0, 0.0, 2.0), (-0.3, 0.1), math.pi),
        ("PathAngleCritic", {"mode": 2}, (0.0, 0.0, 2.0), (0.3, 0.1), 0.2),
    ],
)
def test_critic_compares_headings_of_plan_when_configured(name, changed, pose, twist, heading_rad):
    q = SMALL.with_values(**{name: getattr(SMALL, name).with_values(**changed)})
    found, expected = judged_by_headings(q, pose, twist, heading_rad)
    # What the sequence itself costs by γ is the same for all samples.
    apart = np.abs(found - expected - np.median(found - expected))
    assert np.median(apart) < 2e-3
    assert np.mean(apart > 0.1) < 0.02
    usual, _ = judged_by_headings(SMALL, pose, twist, heading_rad)
    assert (np.ptp(found - usual) > 0.1) == (heading_rad != 0.2)


@each_row(("vx_min", "alike"), [(0.0, True), (-0.35, False)])
def test_path_angle_critic_keeps_front_of_robot_that_can_not_reverse_toward_path(vx_min, alike):
    found = []
    for mode in (0, 1):
        q = SMALL.with_values(vx_min=vx_min, PathAngleCritic=SMALL.PathAngleCritic.with_values(mode=mode))
        found.append(judged_by_headings(q, (0.0, 0.0, 2.0), (0.1, 0.1), 0.0)[0])
    assert np.array_equal(*found) == alike


def test_command_is_invalid_when_all_samples_collide():
    controller = Alone(SMALL)
    assert controller.command(straight(), np.full((60, 60), 253, dtype=np.uint8), goal=AHEAD)[:3] == (False, 0.0, 0.0)
    assert not np.asarray(controller.memory.sequence).any()


@each_row(("retry_scores", "valid"), [(False, 0), (True, 12)])
def test_retry_gives_a_command_only_where_critics_judge_it(retry_scores, valid):
    """A robot at full speed before a wall goes on with a sequence; Nav2's retry is lost."""
    parameters = SMALL.with_values(retry_scores=retry_scores)
    costs = np.zeros((60, 60), dtype=np.uint8)
    costs[:, 34:] = 253
    found = []
    for seed in range(12):
        controller = Alone(parameters, seed=seed + 1)
        controller.memory.sequence[0] = 0.5
        found.append(controller.command(straight(), costs, twist=(0.5, 0.0), goal=AHEAD)[0])
        assert retry_scores or not np.asarray(controller.memory.sequence).any()
    assert sum(found) == valid


def test_reset_controller_is_as_new_but_for_its_noise():
    controller = Alone(SMALL)
    for _ in range(3):
        controller.command(straight(), twist=(0.2, 0.0), goal=AHEAD)
    controller.reset()
    assert not np.asarray(controller.memory.sequence).any() and not np.asarray(controller.memory.history).any()


def test_shared_noise_is_normal_and_independent():
    v, w = numbers_in(noise(112_000, 0.2, 0.4))
    for f, g in ((v, w), (np.abs(v), np.abs(w)), (np.abs(v), w), (v, np.abs(w))):
        assert np.corrcoef(f, g)[0, 1] == pytest.approx(0.0, abs=0.005)
    for numbers, spread in ((v, 0.2), (w, 0.4)):
        assert numbers.mean() == pytest.approx(0.0, abs=0.003 * spread)
        assert numbers.std() == pytest.approx(spread, rel=0.003)
        assert (numbers**4).mean() == pytest.approx(3.0 * spread**4, rel=0.01)
        for lag in (1, 8, 16, 896, 112_000):
            assert np.corrcoef(numbers[:-lag], numbers[lag:])[0, 1] == pytest.approx(0.0, abs=0.005)


LONG = np.array([[0.45, 0.2], [0.45, -0.2], [-0.45, -0.2], [-0.45, 0.2]])


def command_of_long(costs, **critic):
    """Return the command for a robot 0.9 m long at the origin that looks along its path."""
    controller = Alone(MppiParameters(CostCritic=CostParameters(**critic)), outline=LONG)
    return controller.command(straight(), costs, goal=(3.0, 0.0, 0.0))


def test_outline_collides_where_nose_is_in_wall_and_not_where_center_is_inscribed():
    costs = np.full((60, 60), 100, dtype=np.uint8)
    costs[:, 38:] = 254  # 0.4 m ahead
    assert [command_of_long(costs, consider_footprint=judged)[0] for judged in (False, True)] == [True, False]
    costs[:] = 253
    assert [command_of_long(costs, consider_footprint=judged)[0] for judged in (False, True)] == [False, True]


def test_long_robot_does_not_turn_between_narrow_walls():
    costs = np.full((60, 60), 100, dtype=np.uint8)
    costs[:24], costs[36:] = 254, 254  # 0.3 m to both sides; the corners reach 0.49 m
    valid, v_mps, w_radps, _ = command_of_long(costs, consider_footprint=True)
    assert valid
    assert v_mps > 0.02
    assert abs(w_radps) < 0.3


@each_row("regenerate", [False, True])
def test_noise_is_kept_between_cycles_where_it_is_not_regenerated(regenerate):
    """Nav2 draws it at the start and at each reset (nav2_mppi_controller, noise_generator.cpp of 1.3.12)."""
    controller, starts = Alone(SMALL.with_values(regenerate_noises=regenerate)), []
    for cycle in range(4):
        assert controller.command(straight())[0]
        starts.append(int(controller.memory.kept_noise[0]))
        if cycle == 2:
            controller.reset()
    assert len({*starts[:3]}) == (3 if regenerate else 1)
    assert starts[3] != starts[2]


def test_frame_of_large_window_is_cropped_at_its_corner():
    window = Window(np.arange((SIDE + 9) * (SIDE + 7), dtype=np.uint64).reshape(SIDE + 9, -1) % 251, (1.0, 2.0, 0.5))
    out, values = np.zeros(SIDE * SIDE), np.arange(251.0)
    for pose, (row, column) in (((1.1, 2.1, 0.0), (0, 0)), ((999.0, 999.0, 0.0), (11, 9))):
        frame = lay_frame.py_func(out, values, window, pose)
        assert (frame.row, frame.column, frame.rows, frame.columns) == (row - 1, column - 1, SIDE, SIDE)
        assert (frame.left_m, frame.bottom_m) == (1.0 + 0.5 * (column - 1), 2.0 + 0.5 * (row - 1))
        laid = out.reshape(SIDE, SIDE)[1:-1, 1:-1]
        np.testing.assert_array_equal(laid, window.costs[row : row + SIDE - 2, column : column + SIDE - 2])
