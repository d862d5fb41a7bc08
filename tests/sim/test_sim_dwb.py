"""DWB's samples, its grids, and what its critics forbid; `test_sim_nav2_conformance` has it beside Nav2's answers."""

import math
from itertools import pairwise

import numpy as np
import pytest
from table import each_row

from vastflow.sim.kernels.numeric import njit
from vastflow.sim.kernels.record import record_of
from vastflow.sim.nav2.controllers import dwb
from vastflow.sim.nav2.controllers.controller import ControllerInput
from vastflow.sim.nav2.controllers.dwb_critics import grow, lay, new_path_grid
from vastflow.sim.nav2.costmaps.inflation import inflate
from vastflow.sim.nav2.costmaps.outline import padded_outline
from vastflow.sim.nav2.costmaps.window import Window
from vastflow.sim.nav2.parameters.dwb import DwbParameters

CELLS = 60
RESOLUTION_M = 0.05
OUTLINE = padded_outline(0.22, 0.01)
CORNER = (10.0 / 3.0, -20.0 / 7.0)
CENTER = (CORNER[0] + 1.512, CORNER[1] + 1.493)
HUMBLE = DwbParameters()
FAST = HUMBLE.with_values(max_vel_x=0.5, max_speed_xy=0.5, min_vel_x=-0.1)


@njit
def commanded(records, memory, window, outline, pose, twist, plan, n, goal):
    situation = ControllerInput(window, outline, 0.2255, pose, twist, plan[:n], 0.0, goal, 0.05, 0.0)
    return dwb.compute_velocity(records[0], memory, situation)[:3]


@njit
def scored(records, memory, window, pose, twist, plan, n, goal):
    """Scores (V, W) of the ends of all samples, infinite for those that are not legal."""
    situation = ControllerInput(window, OUTLINE, 0.2255, pose, twist, plan[:n], 0.0, goal, 0.05, 0.0)
    _, n_speeds, n_turns = dwb.score(records[0], memory, situation)
    return memory.scores[:n_speeds, :n_turns].copy()


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


# Cells.


def cell_of(w, x, y):
    """(column, row) or None off the window."""
    column, row = math.floor((x - w.place[0]) / w.place[2]), math.floor((y - w.place[1]) / w.place[2])
    inside = 0 <= row < w.costs.shape[0] and 0 <= column < w.costs.shape[1]
    return (column, row) if inside else None


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


# The samples.


@each_row("current", [-0.4, 0.0, 0.13, 0.9])
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


def test_robot_that_cannot_turn_has_one_yaw_rate():
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


def test_path_distances_of_a_straight_plan_are_manhattan_from_the_nearest_cell_of_it():
    plan = np.column_stack([CORNER[0] + 0.525 + 0.025 * np.arange(40), np.full(40, CORNER[1] + 1.025)])
    values, _, _ = distances(new_path_grid(CELLS, CELLS), window(), plan, len(plan), *plan[-1])
    columns, rows = np.meshgrid(np.arange(CELLS), np.arange(CELLS))
    sources = np.array(sorted(set(plan_cells(window(), plan))))
    away = np.abs(columns[..., None] - sources[:, 0]) + np.abs(rows[..., None] - sources[:, 1])
    np.testing.assert_array_equal(values, away.min(axis=2))


def test_grid_that_was_used_gives_what_a_new_one_gives():
    grid = new_path_grid(CELLS, CELLS)
    short = straight(0.3, length_m=0.6)
    for plan in (short, np.add(short, [0.0, 0.1]), bent(2), bent(2), bent(3)):
        used, _, _ = distances(grid, window(), plan, len(plan), *plan[-1])
        fresh, _, _ = distances(new_path_grid(CELLS, CELLS), window(), plan, len(plan), *plan[-1])
        np.testing.assert_array_equal(used, fresh)


def test_plan_counts_up_to_the_first_cell_without_information():
    costs = np.zeros((CELLS, CELLS), dtype=np.uint8)
    costs[:, 45] = 255
    plan = straight()
    values, goal, _ = distances(new_path_grid(CELLS, CELLS), window(costs), plan, len(plan), *plan[-1])
    assert goal % (CELLS + 2) - 1 == 44
    assert values[29, 50] == 6


def test_holes_of_more_than_two_cells_are_filled():
    plan = straight(spacing_m=0.4)
    values, _, _ = distances(new_path_grid(CELLS, CELLS), window(), plan, len(plan), *plan[-1])
    sources = {column for column, row in plan_cells(window(), plan) if row == 29}
    assert len(plan_cells(window(), plan)) > len(plan)
    assert values[29].tolist() == [min(abs(column - each) for each in sources) for column in range(CELLS)]


def test_nose_outside_the_window_is_the_last_point_on_the_way_there():
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


def test_plan_outside_the_window_leaves_no_legal_sample():
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


def added_by(name, **values):
    """Speeds (V, 1), yaw rates (1, W) and what a critic adds to the scores of their samples."""
    w, plan, goal = window(), straight(), (9.0, CENTER[1], 0.0)
    scores = []
    for enabled in (False, True):
        critic = getattr(FAST, name).with_values(enabled=enabled, **values)
        parameters = FAST.with_values(**{name: critic})
        memory = dwb.new_memory(parameters, CELLS, CELLS)
        scores.append(scored(record_of(parameters), memory, w, (*CENTER, 0.0), (0.1, 0.0), plan, len(plan), goal))
    speeds, turns = memory.speeds[: scores[0].shape[0], None], memory.turns[None, : scores[0].shape[1]]
    assert np.array_equal(np.isinf(scores[0]), np.isinf(scores[1]))
    legal = np.isfinite(scores[0])
    return speeds, turns, legal, np.where(legal, scores[1], 0.0) - np.where(legal, scores[0], 0.0)


def test_prefer_forward_punishes_driving_backward_and_strafing_and_else_counts_turns():
    v, w, legal, added = added_by("PreferForward", scale=5.0, penalty=30.0, strafe_x=0.2, strafe_theta=0.3)
    punished = (v < 0.0) | ((v < 0.2) & (np.abs(w) < 0.3))
    expected = 5.0 * np.where(punished, 30.0, 10.0 * np.abs(w))
    assert (punished & legal).any()
    assert (~punished & legal).any()
    assert np.allclose(added[legal], expected[legal], atol=1e-3)


def test_twirling_counts_turns_where_it_has_a_scale():
    _, w, legal, added = added_by("Twirling", scale=2.0)
    assert np.allclose(added[legal], np.broadcast_to(2.0 * np.abs(w), added.shape)[legal], atol=1e-3)
    assert not added_by("Twirling")[3].any()


def test_default_parameters_are_in_their_ranges():
    assert DwbParameters.model_validate(dict(HUMBLE)) == HUMBLE
