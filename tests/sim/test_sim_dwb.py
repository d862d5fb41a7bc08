"""DWB against a plain reading of Nav2's algorithm, and its critics one by one."""

import math
from collections import defaultdict
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from vastflow.sim.kernels.numeric import njit
from vastflow.sim.nav.controllers import dwb
from vastflow.sim.nav.controllers.controller import ControllerInput
from vastflow.sim.nav.controllers.dwb_critics import grow, lay, new_path_grid
from vastflow.sim.nav.controllers.dwb_rollout import legal, step_count
from vastflow.sim.nav.inflation import inflate
from vastflow.sim.nav.outline import padded_outline
from vastflow.sim.nav.parameters.dwb import DwbParameters
from vastflow.sim.nav.record import record_of
from vastflow.sim.nav.window import Window

CELLS = 60
RESOLUTION_M = 0.05
OUTLINE = padded_outline(0.22, 0.01)
CORNER = (10.0 / 3.0, -20.0 / 7.0)
CENTER = (CORNER[0] + 1.512, CORNER[1] + 1.493)
HUMBLE = DwbParameters()
FAST = HUMBLE.with_values(max_vel_x=0.5, max_speed_xy=0.5, min_vel_x=-0.1)


@njit
def commanded(records, memory, window, outline, pose, twist, plan, n, goal):
    situation = ControllerInput(window, outline, 0.2255, pose, twist, plan[:n], 0.0, goal, 0.05)
    return dwb.compute_velocity(records[0], memory, situation)


@njit
def scored(records, memory, window, pose, twist, plan, n, goal):
    """Scores (V, W) of all samples, infinite for those that are not legal."""
    q = records[0]
    situation = ControllerInput(window, OUTLINE, 0.2255, pose, twist, plan[:n], 0.0, goal, 0.05)
    setting, n_speeds, n_turns = dwb.score(q, memory, situation)
    scores = memory.scores[:n_speeds, :n_turns].copy()
    for i in range(n_speeds):
        for j in range(n_turns):
            steps = step_count(q, memory.speeds[i], memory.turns[j])
            first = memory.first[i, j]
            if not legal(q, setting, memory.speeds[i], steps, memory.sums, first, window.costs, 1.0 / window.place[2]):
                scores[i, j] = np.inf
    return scores


@njit
def distances(grid, window, plan, n, nose_x, nose_y):
    rows, columns = window.costs.shape
    goal, nose = lay(grid, window, plan, n, nose_x, nose_y)
    out = np.empty((rows, columns), dtype=np.int64)
    for row in range(rows):
        for column in range(columns):
            at = (row + 1) * (columns + 2) + column + 1
            out[row, column] = grow(grid.cells, grid.bins, grid.counts, at, columns + 2)
    return out, goal, nose


def window(costs=None, corner=CORNER):
    costs = np.zeros((CELLS, CELLS), dtype=np.uint8) if costs is None else costs
    return Window(costs, np.array([*corner, RESOLUTION_M]))


def walls(*boxes):
    """A window of inflated walls: rows and columns (r0, r1, c0, c1) each."""
    costs = np.zeros((CELLS, CELLS), dtype=np.uint8)
    for r0, r1, c0, c1 in boxes:
        costs[r0:r1, c0:c1] = 254
    return window(inflate(costs, RESOLUTION_M, 0.22549849971227903, 0.55, 3.0))


def straight(bearing=0.0, start=CENTER, length_m=1.45, spacing_m=0.025):
    s = np.arange(0.0, length_m, spacing_m)
    return np.column_stack([start[0] + s * math.cos(bearing), start[1] + s * math.sin(bearing)])


def bent(seed, length=58):
    """A wandering plan from near the window's middle."""
    rng = np.random.default_rng(seed)
    heading = rng.uniform(-np.pi, np.pi) + np.cumsum(rng.normal(0.0, 0.08, length))
    steps = 0.025 * np.column_stack([np.cos(heading), np.sin(heading)])
    return np.array(CENTER) + rng.normal(0.0, 0.05, 2) + np.cumsum(steps, axis=0)


def chosen(parameters, w, pose, twist, plan, goal, memory=None):
    memory = dwb.new_memory(parameters, *w.costs.shape) if memory is None else memory
    return commanded(record_of(parameters), memory, w, OUTLINE, pose, twist, plan, len(plan), goal)


# The plain reading.


def cell_of(w, x, y):
    """(column, row) or None off the window."""
    column, row = math.floor((x - w.place[0]) / w.place[2]), math.floor((y - w.place[1]) / w.place[2])
    inside = 0 <= row < w.costs.shape[0] and 0 <= column < w.costs.shape[1]
    return (column, row) if inside else None


def velocities(current, low, high, up, down, time_s, n):
    def reached(v, target):
        return min(target, v + up * time_s) if v < target else max(target, v + down * time_s)

    current = min(max(current, low), high)
    bottom, top = reached(current, low), reached(current, high)
    if abs(bottom - top) < 1e-5:
        return [bottom]
    step, values = (top - bottom) / (n - 1), [bottom]
    while values[-1] + step <= top + 1e-5:
        values.append(values[-1] + step)
    flips = [k for k in range(len(values) - 1) if values[k] < 0.0 < values[k + 1]]
    return [*values[: flips[0] + 1], 0.0, *values[flips[0] + 1 :]] if flips else values


def trajectory(p, pose, twist, v, w):
    (x, y, yaw), (vx, wz) = pose, twist
    n = max(1, math.ceil(max(abs(v) * p.sim_time / p.linear_granularity, abs(w) * p.sim_time / p.angular_granularity)))
    dt, poses = p.sim_time / n, [pose]
    for _ in range(n):
        vx = min(v, vx + p.acc_lim_x * dt) if vx < v else max(v, vx + p.decel_lim_x * dt)
        wz = min(w, wz + p.acc_lim_theta * dt) if wz < w else max(w, wz + p.decel_lim_theta * dt)
        x, y, yaw = x + vx * dt * math.cos(yaw), y + vx * dt * math.sin(yaw), yaw + wz * dt
        poses.append((x, y, yaw))
    return poses


def queue_distances(w, sources):
    """Nav2's queue: by distance from the source, the latest first among equals; {cell: Manhattan distance}."""
    rows, columns = w.costs.shape
    bins, seen, values = defaultdict(list), set(), {}

    def put(cell, source):
        if cell not in seen and 0 <= cell[0] < columns and 0 <= cell[1] < rows:
            seen.add(cell)
            bins[(cell[0] - source[0]) ** 2 + (cell[1] - source[1]) ** 2].append((cell, source))

    for source in sources:
        put(source, source)
    while bins:
        nearest = min(bins)
        cell, source = bins[nearest].pop()
        if not bins[nearest]:
            del bins[nearest]
        values[cell] = abs(cell[0] - source[0]) + abs(cell[1] - source[1])
        for dx, dy in ((-1, 0), (0, -1), (1, 0), (0, 1)):
            put((cell[0] + dx, cell[1] + dy), source)
    return values


def plan_cells(w, plan):
    """The cells that count, in order, holes of more than two cells filled."""
    points = [plan[0]]
    for a, b in pairwise(plan):
        length = math.dist(a, b)
        if length > 2 * w.place[2]:
            n = int((length - 2 * w.place[2]) / w.place[2]) - 1
            points += [a + k / n * (b - a) for k in range(1, n)]
        points.append(b)
    cells = []
    for x, y in points:
        cell = cell_of(w, x, y)
        if cell is not None and w.costs[cell[1], cell[0]] != 255:
            cells.append(cell)
        elif cells:
            break
    return cells


def plain_scores(p, w, pose, twist, plan, goal, signs=(0, 0)):
    """[(v, ω, score)] of all samples; `signs` forbids a direction of v and ω, as Oscillation does."""
    half = 0.5 * w.place[2]
    to_goal = math.atan2(goal[1] - pose[1], goal[0] - pose[0])
    reach = p.GoalAlign.forward_point_distance
    nose_plan = plan.copy()
    nose_plan[-1] += reach * math.cos(to_goal), reach * math.sin(to_goal)
    path = queue_distances(w, plan_cells(w, plan))
    ends = {"goal": plan_cells(w, plan)[-1:], "nose": plan_cells(w, nose_plan)[-1:]}
    to_end = {name: queue_distances(w, cells) for name, cells in ends.items()}
    goal_m = math.dist(pose[:2], goal[:2])
    out = []
    for v in velocities(twist[0], p.min_vel_x, p.max_vel_x, p.acc_lim_x, p.decel_lim_x, p.sim_time, p.vx_samples):
        for turn in velocities(
            twist[1],
            -p.max_vel_theta,
            p.max_vel_theta,
            p.acc_lim_theta,
            p.decel_lim_theta,
            p.sim_time,
            p.vtheta_samples,
        ):
            if abs(v) ** 2 > p.max_speed_xy**2 + 1e-5 or (v == 0.0 and turn == 0.0):
                continue
            poses = trajectory(p, pose, twist, v, turn)
            cells = [cell_of(w, x, y) for x, y, _ in poses]
            x, y, yaw = poses[-1]
            ahead = {
                name: cell_of(w, x + d * math.cos(yaw), y + d * math.sin(yaw))
                for name, d in (("path", p.PathAlign.forward_point_distance), ("goal", reach))
            }
            illegal = v * signs[0] < 0.0 or turn * signs[1] < 0.0 or None in cells or None in ahead.values()
            if illegal or any(w.costs[row, column] >= 253 for column, row in cells):
                out.append((v, turn, math.inf))
                continue
            total = 0.0
            if goal_m <= p.xy_goal_tolerance:
                error = abs((goal[2] - yaw + math.pi) % (2 * math.pi) - math.pi)
                if abs(twist[0]) <= p.trans_stopped_velocity:
                    total = math.inf if v != 0.0 else error * p.RotateToGoal.scale
                elif abs(v) >= abs(twist[0]):
                    total = math.inf
                else:
                    total = (v * v * p.RotateToGoal.slowing_factor + error) * p.RotateToGoal.scale
            total += int(w.costs[cells[-1][1], cells[-1][0]]) * p.BaseObstacle.scale
            total += to_end["nose"][ahead["goal"]] * (half * p.GoalAlign.scale)
            if goal_m > p.PathAlign.forward_point_distance:
                total += path[ahead["path"]] * (half * p.PathAlign.scale)
            total += path[cells[-1]] * (half * p.PathDist.scale)
            total += to_end["goal"][cells[-1]] * (half * p.GoalDist.scale)
            out.append((v, turn, total))
    return out


def both(p, w, pose, twist, plan, goal):
    """Scores of kernel and plain reading in the same order, and what the kernel chooses."""
    plain = plain_scores(p, w, pose, twist, plan, goal)
    memory = dwb.new_memory(p, *w.costs.shape)
    table = scored(record_of(p), memory, w, pose, twist, plan, len(plan), goal)
    names = [(v, turn) for v in memory.speeds[: table.shape[0]] for turn in memory.turns[: table.shape[1]]]
    kernel = dict(zip(names, table.ravel(), strict=True))
    return plain, kernel, chosen(p, w, pose, twist, plan, goal)


situation = {
    "seed": st.integers(0, 2**32 - 1),
    "yaw": st.floats(-3.1, 3.1),
    "v": st.floats(0.0, 0.3),
    "turn": st.floats(-1.1, 1.1),
    "parameters": st.sampled_from([HUMBLE, FAST]),
}


@settings(max_examples=12, deadline=None)
@given(**situation)
@example(seed=3, yaw=0.0, v=0.0, turn=0.0, parameters=HUMBLE)
def test_every_sample_has_the_score_of_the_plain_reading(seed, yaw, v, turn, parameters):
    rng = np.random.default_rng(seed)
    boxes = [(r, r + 5, c, c + 5) for r, c in rng.integers(0, 55, (3, 2))]
    pose, plan = (*CENTER, yaw), bent(seed)
    goal = (CENTER[0] + rng.uniform(-3.0, 3.0), CENTER[1] + rng.uniform(-3.0, 3.0), rng.uniform(-3.0, 3.0))
    plain, kernel, _ = both(parameters, walls(*boxes), pose, (v, turn), plan, goal)
    assert [kernel[v, turn] for v, turn, _ in plain] == pytest.approx([score for *_, score in plain], abs=1e-9)
    assert sum(score < math.inf for score in kernel.values()) == sum(score < math.inf for *_, score in plain)


@settings(max_examples=12, deadline=None)
@given(**situation)
def test_the_command_is_the_first_legal_sample_with_the_lowest_score(seed, yaw, v, turn, parameters):
    rng = np.random.default_rng(seed)
    boxes = [(r, r + 6, c, c + 6) for r, c in rng.integers(0, 54, (4, 2))]
    pose, plan = (*CENTER, yaw), bent(seed)
    plain, _, command = both(parameters, walls(*boxes), pose, (v, turn), plan, (9.0, 2.0, 0.0))
    legal = [sample for sample in plain if sample[2] < math.inf]
    if legal:
        lowest = min(score for *_, score in legal)
        # Which of several is first can hang on a last bit of the plain reading's sums.
        best = [(True, v_mps, w_radps) for v_mps, w_radps, score in legal if score <= lowest + 1e-8]
        assert command == best[0] or (len(best) > 1 and command in best)
    else:
        assert command == (False, 0.0, 0.0)


@pytest.mark.parametrize("speed", [0.1, 0.26])
@pytest.mark.parametrize("seed", range(3))
def test_at_the_goal_every_sample_has_the_score_of_the_plain_reading(speed, seed):
    # With seed 0 within 0.1 m of the goal, where PathAlign is not asked any more.
    goal = (CENTER[0] + 0.07 * (seed + 1), CENTER[1] + 0.05 * seed, 1.0)
    plan = np.array([CENTER, [CENTER[0] + 0.02, CENTER[1] + 0.01], goal[:2]])
    plain, kernel, _ = both(HUMBLE, window(), (*CENTER, -0.7), (speed, 0.4), plan, goal)
    assert [kernel[v, turn] for v, turn, _ in plain] == pytest.approx([score for *_, score in plain], abs=1e-9)


# The samples.


@pytest.mark.parametrize("current", [-0.4, 0.0, 0.13, 0.9])
def test_samples_reach_both_ends_and_hold_zero(current):
    memory = dwb.new_memory(HUMBLE, CELLS, CELLS)
    scored(record_of(HUMBLE), memory, window(), (*CENTER, 0.0), (0.1, current), straight(), 50, (9.0, 0.0, 0.0))
    turns = memory.turns
    assert turns[[0, -1]] == pytest.approx([-1.0, 1.0])
    assert 0.0 in turns
    assert np.all(np.diff(turns) > 0.0)
    assert memory.speeds[[0, 19]] == pytest.approx([0.0, 0.26])


def test_samples_are_what_the_accelerations_reach_within_the_roll_outs_time():
    slow = HUMBLE.with_values(acc_lim_x=0.02, decel_lim_x=-0.05)
    memory = dwb.new_memory(slow, CELLS, CELLS)
    scored(record_of(slow), memory, window(), (*CENTER, 0.0), (0.15, 0.0), straight(), 50, (9.0, 0.0, 0.0))
    assert memory.speeds[[0, 19]] == pytest.approx([0.15 - 0.05 * 1.7, 0.15 + 0.02 * 1.7])


def test_a_robot_that_cannot_turn_has_one_yaw_rate():
    stiff = HUMBLE.with_values(max_vel_theta=0.0)
    table = scored(
        record_of(stiff),
        dwb.new_memory(stiff, CELLS, CELLS),
        window(),
        (*CENTER, 0.0),
        (0.1, 0.0),
        straight(),
        50,
        (9.0, 0.0, 0.0),
    )
    assert table.shape == (20, 1)


def test_samples_slower_than_both_least_speeds_are_left_out():
    lively = HUMBLE.with_values(min_speed_xy=0.1, min_speed_theta=0.5)
    memory = dwb.new_memory(lively, CELLS, CELLS)
    table = scored(record_of(lively), memory, window(), (*CENTER, 0.0), (0.1, 0.0), straight(), 50, (9.0, 0.0, 0.0))
    slow = (memory.speeds[: len(table), None] ** 2 < 0.01 - 1e-5) & (np.abs(memory.turns) < 0.5 - 1e-5)
    assert np.isinf(table[slow]).all()
    assert np.isfinite(table[~slow]).all()


# The grids.


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_path_distances_are_those_of_nav2s_queue(seed):
    w, plan = window(corner=(CORNER[0] + 0.6, CORNER[1])), bent(seed)
    cells = plan_cells(w, plan)
    values, goal, _ = distances(new_path_grid(CELLS, CELLS), w, plan, len(plan), *plan[-1])
    expected = queue_distances(w, cells)
    assert values.tolist() == [[expected[column, row] for column in range(CELLS)] for row in range(CELLS)]
    assert divmod(goal, CELLS + 2) == (cells[-1][1] + 1, cells[-1][0] + 1)


def test_path_distances_of_a_straight_plan_are_manhattan_from_the_nearest_cell_of_it():
    plan = np.column_stack([CORNER[0] + 0.525 + 0.025 * np.arange(40), np.full(40, CORNER[1] + 1.025)])
    values, _, _ = distances(new_path_grid(CELLS, CELLS), window(), plan, len(plan), *plan[-1])
    columns, rows = np.meshgrid(np.arange(CELLS), np.arange(CELLS))
    sources = np.array(sorted(set(plan_cells(window(), plan))))
    away = np.hypot(columns[..., None] - sources[:, 0], rows[..., None] - sources[:, 1])
    nearest = sources[np.argmin(away, axis=2)]
    np.testing.assert_array_equal(values, np.abs(columns - nearest[..., 0]) + np.abs(rows - nearest[..., 1]))


def test_a_grid_that_was_used_gives_what_a_new_one_gives():
    grid = new_path_grid(CELLS, CELLS)
    short = straight(0.3, length_m=0.6)
    for plan in (short, np.add(short, [0.0, 0.1]), bent(2), bent(2), bent(3)):
        used, _, _ = distances(grid, window(), plan, len(plan), *plan[-1])
        fresh, _, _ = distances(new_path_grid(CELLS, CELLS), window(), plan, len(plan), *plan[-1])
        np.testing.assert_array_equal(used, fresh)


def test_the_plan_counts_up_to_the_first_cell_without_information():
    costs = np.zeros((CELLS, CELLS), dtype=np.uint8)
    costs[:, 45] = 255
    plan = straight()
    values, goal, _ = distances(new_path_grid(CELLS, CELLS), window(costs), plan, len(plan), *plan[-1])
    assert goal % (CELLS + 2) - 1 == 44
    assert values[29, 50] == 6


def test_holes_of_more_than_two_cells_are_filled():
    plan = straight(spacing_m=0.4)
    values, _, _ = distances(new_path_grid(CELLS, CELLS), window(), plan, len(plan), *plan[-1])
    expected = queue_distances(window(), plan_cells(window(), plan))
    assert len(plan_cells(window(), plan)) > len(plan)
    assert values[29].tolist() == [expected[column, 29] for column in range(CELLS)]


def test_a_nose_outside_the_window_is_the_last_point_on_the_way_there():
    plan = straight(length_m=1.4)
    nosed = plan + [[0.4 if k == len(plan) - 1 else 0.0, 0.0] for k in range(len(plan))]
    _, goal, nose = distances(new_path_grid(CELLS, CELLS), window(), plan, len(plan), *nosed[-1])
    assert goal % (CELLS + 2) - 1 == plan_cells(window(), plan)[-1][0]
    assert nose % (CELLS + 2) - 1 == plan_cells(window(), nosed)[-1][0]
    assert nose > goal


# The critics' own rules.


def test_no_sample_is_legal_where_the_robot_stands_in_inscribed_cost():
    assert chosen(HUMBLE, walls((0, CELLS, 34, 36)), (*CENTER, 0.0), (0.0, 0.0), straight(), (9.0, 0.0, 0.0)) == (
        False,
        0.0,
        0.0,
    )


def test_without_base_obstacle_a_wall_is_driven_through():
    blind = HUMBLE.with_values(BaseObstacle=HUMBLE.BaseObstacle.with_values(enabled=False))
    wall = walls((0, CELLS, 34, 36))
    valid, v, _ = chosen(blind, wall, (*CENTER, 0.0), (0.26, 0.0), straight(), (9.0, CENTER[1], 0.0))
    assert (valid, v) == (True, pytest.approx(0.26))


def test_a_plan_outside_the_window_leaves_no_legal_sample():
    plan = straight(start=(CENTER[0] + 5.0, CENTER[1]))
    assert not chosen(HUMBLE, window(), (*CENTER, 0.0), (0.0, 0.0), plan, (9.0, 0.0, 0.0))[0]


def test_near_the_goal_a_fast_robot_may_only_slow_down():
    goal = (CENTER[0] + 0.1, CENTER[1], 1.5)
    valid, v, _ = chosen(HUMBLE, window(), (*CENTER, 0.0), (0.26, 0.0), np.array([CENTER, goal[:2]]), goal)
    assert valid
    assert v < 0.26


def test_at_the_goal_a_slow_robot_turns_to_the_goals_heading():
    goal = (CENTER[0] + 0.1, CENTER[1], 1.5)
    valid, v, w = chosen(HUMBLE, window(), (*CENTER, 0.0), (0.1, 0.0), np.array([CENTER, goal[:2]]), goal)
    assert (valid, v) == (True, 0.0)
    assert w > 0.5


def test_the_default_parameters_are_in_their_ranges():
    assert DwbParameters.model_validate(dict(HUMBLE)) == HUMBLE
