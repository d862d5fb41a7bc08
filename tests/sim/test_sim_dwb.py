"""DWB's samples, grids, critics, and memory; `test_sim_nav2_conformance` compares it with Nav2's answers."""

import math
from itertools import pairwise

import alone
import numpy as np
import pytest
from alone import CELLS, OUTLINE, RESOLUTION_M, Alone, walls
from hypothesis import given, settings
from hypothesis import strategies as st
from table import each_row

from vastflow.sim.kernels.numeric import njit
from vastflow.sim.kernels.record import record_of
from vastflow.sim.nav2.controllers import dwb
from vastflow.sim.nav2.controllers.dwb_critics import grow, lay, new_path_grid
from vastflow.sim.nav2.costmaps.window import Window, outline_cost
from vastflow.sim.nav2.parameters.dwb import DwbParameters

RECTANGLE = np.array([[0.3, 0.2], [0.3, -0.2], [-0.3, -0.2], [-0.3, 0.2]])
CORNER = (10.0 / 3.0, -20.0 / 7.0)
CENTER = (CORNER[0] + 1.512, CORNER[1] + 1.493)
HERE = (*CENTER, 0.0)
AHEAD = (9.0, CENTER[1], 0.0)
HUMBLE = DwbParameters()
FAST = HUMBLE.with_values(max_vel_x=0.5, max_speed_xy=0.5, min_vel_x=-0.1)
IN_PLACE = HUMBLE.with_values(max_vel_x=0.0)
OMNI = DwbParameters(
    max_vel_x=0.3, max_speed_xy=0.4, min_vel_y=-0.3, max_vel_y=0.3, acc_lim_y=2.5, decel_lim_y=-2.5, vx_samples=4
)


@njit
def scored(records, memory, given):
    return dwb.score(records[0], memory, given)[2:]


@njit
def cost_under(costs, outline, x, y, c, s):
    return outline_cost(costs, outline, x, y, c, s)


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


def window(costs=None):
    costs = np.zeros((CELLS, CELLS), dtype=np.uint8) if costs is None else costs
    return Window(costs, np.array([*CORNER, RESOLUTION_M]))


def straight(bearing=0.0, length_m=1.45, spacing_m=0.025):
    return alone.straight(length_m, bearing, CENTER, spacing_m)


def bent(seed, length=58):
    """A wandering plan from near the window's middle."""
    rng = np.random.default_rng(seed)
    heading = rng.uniform(-np.pi, np.pi) + np.cumsum(rng.normal(0.0, 0.08, length))
    steps = 0.025 * np.column_stack([np.cos(heading), np.sin(heading)])
    return np.array(CENTER) + rng.normal(0.0, 0.05, 2) + np.cumsum(steps, axis=0)


def command(parameters, costs=None, pose=HERE, twist=(0.0, 0.0), plan=None, goal=AHEAD, controller=None):
    """The command (valid, v, ω, vy)."""
    controller, plan = controller or Alone(parameters, CORNER), straight() if plan is None else plan
    return controller.command(plan, costs, pose, twist, goal, end_yaw=0.0)


def scores(parameters, costs=None, pose=HERE, twist=(0.1, 0.0), plan=None, lateral=0.0, outline=RECTANGLE):
    """Return scores (V, W) of samples, infinite for those that are not legal, and the memory."""
    controller, plan = Alone(parameters, CORNER, outline=outline), straight() if plan is None else plan
    given = controller.given(plan, costs, pose, twist, AHEAD, 0.0, lateral)
    n, m = scored(record_of(parameters), controller.memory, given)
    return controller.memory.scores[:n, :m].copy(), controller.memory


def test_samples_below_both_least_speeds_are_illegal():
    table, memory = scores(HUMBLE.with_values(min_speed_xy=0.1, min_speed_theta=0.5))
    slow = (memory.speeds[: len(table), None] ** 2 < 0.01 - 1e-5) & (np.abs(memory.turns) < 0.5 - 1e-5)
    assert np.isinf(table[slow]).all()
    assert np.isfinite(table[~slow]).all()


def test_speeds_ahead_are_combined_with_speeds_to_the_side():
    table, memory = scores(OMNI, twist=(0.0, 0.0))
    assert len(table) == 4 * 5
    assert memory.speeds[:6] == pytest.approx([0.0] * 5 + [0.1])
    assert memory.sideways[:5] == pytest.approx([-0.3, -0.15, 0.0, 0.15, 0.3])
    fast = np.hypot(memory.speeds[:20], memory.sideways[:20]) > 0.4 + 1e-5  # than max_speed_xy
    assert fast.sum() == 2
    assert np.isinf(table[fast]).all()
    assert np.isfinite(table[~fast]).any(axis=1).all()
    table, memory = scores(OMNI.with_values(min_vel_y=0.0, max_vel_y=0.0), twist=(0.0, 0.0))
    assert len(table) == 4
    assert not memory.sideways.any()


def test_sample_to_the_side_ends_to_the_side():
    """The robot looks at 0.5 rad and already moves to its left as fast as the sample."""
    parameters = OMNI.with_values(vtheta_samples=21)
    table, memory = scores(parameters, pose=(*CENTER, 0.5), twist=(0.0, 0.0), lateral=0.3)
    unturned = int(np.argmin(np.abs(memory.turns[: table.shape[1]])))
    found = next(i for i in range(len(table)) if memory.speeds[i] == 0.0 and memory.sideways[i] == pytest.approx(0.3))
    assert memory.turns[unturned] == pytest.approx(0.0, abs=1e-9)
    end, reach_m = memory.ends[found, unturned, :2] * RESOLUTION_M, 0.3 * OMNI.sim_time
    assert end == pytest.approx((1.512 - reach_m * math.sin(0.5), 1.493 + reach_m * math.cos(0.5)))


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


def grown(plan, w=None, grid=None, nose=None):
    return distances(grid or new_path_grid(CELLS, CELLS), w or window(), plan, len(plan), *(nose or plan[-1]))


def test_path_distances_are_manhattan_from_the_nearest_cell_of_the_plan():
    plan = np.column_stack([CORNER[0] + 0.525 + 0.025 * np.arange(40), np.full(40, CORNER[1] + 1.025)])
    columns, rows = np.meshgrid(np.arange(CELLS), np.arange(CELLS))
    sources = np.array(sorted(set(plan_cells(window(), plan))))
    away = np.abs(columns[..., None] - sources[:, 0]) + np.abs(rows[..., None] - sources[:, 1])
    np.testing.assert_array_equal(grown(plan)[0], away.min(axis=2))


def test_reused_grid_matches_new_grid():
    grid = new_path_grid(CELLS, CELLS)
    for plan in (straight(0.3, length_m=0.6), bent(2), bent(2), bent(3)):
        np.testing.assert_array_equal(grown(plan, grid=grid)[0], grown(plan)[0])


def test_plan_counts_up_to_the_first_unknown_cell():
    costs = np.zeros((CELLS, CELLS), dtype=np.uint8)
    costs[:, 45] = 255
    values, goal, _ = grown(straight(), window(costs))
    assert goal % (CELLS + 2) - 1 == 44
    assert values[29, 50] == 6


def test_holes_of_more_than_two_cells_are_filled():
    plan = straight(spacing_m=0.4)
    sources = {column for column, row in plan_cells(window(), plan) if row == 29}
    assert len(plan_cells(window(), plan)) > len(plan)
    assert grown(plan)[0][29].tolist() == [min(abs(column - each) for each in sources) for column in range(CELLS)]


def test_nose_outside_the_window_is_the_last_point_on_the_way():
    plan = straight(length_m=1.4)
    nosed = plan + [[0.4 if k == len(plan) - 1 else 0.0, 0.0] for k in range(len(plan))]
    _, goal, nose = grown(plan, nose=tuple(nosed[-1]))
    assert goal % (CELLS + 2) - 1 == plan_cells(window(), plan)[-1][0]
    assert nose % (CELLS + 2) - 1 == plan_cells(window(), nosed)[-1][0]
    assert nose > goal


def test_base_obstacle_forbids_inscribed_cost_under_the_robot():
    costs = walls((0, CELLS, 34, 36))
    assert command(HUMBLE, costs) == (False, 0.0, 0.0, 0.0)
    blind = HUMBLE.with_values(BaseObstacle=HUMBLE.BaseObstacle.with_values(enabled=False))
    assert command(blind, costs, twist=(0.26, 0.0))[:2] == (True, pytest.approx(0.26))


def added_by(name, **values):
    """Speeds (V, 1), yaw rates (1, W) and what a critic adds to the scores of their samples."""
    found = []
    for enabled in (False, True):
        critic = getattr(FAST, name).with_values(enabled=enabled, **values)
        table, memory = scores(FAST.with_values(**{name: critic}), outline=OUTLINE)
        found.append(table)
    legal = np.isfinite(found[0])
    speeds, turns = memory.speeds[: legal.shape[0], None], memory.turns[None, : legal.shape[1]]
    assert np.array_equal(legal, np.isfinite(found[1]))
    return speeds, turns, legal, np.subtract(found[1], found[0], where=legal, out=np.zeros(legal.shape))


def test_prefer_forward_punishes_backing_and_strafing_and_else_counts_turns():
    v, w, legal, added = added_by("PreferForward", scale=5.0, penalty=30.0, strafe_x=0.2, strafe_theta=0.3)
    punished = (v < 0.0) | ((v < 0.2) & (np.abs(w) < 0.3))
    expected = 5.0 * np.where(punished, 30.0, 10.0 * np.abs(w))
    assert (punished & legal).any()
    assert (~punished & legal).any()
    assert np.allclose(added[legal], expected[legal], atol=1e-3)


def test_twirling_critic_scales_turns():
    _, w, legal, added = added_by("Twirling", scale=2.0)
    assert np.allclose(added[legal], np.broadcast_to(2.0 * np.abs(w), added.shape)[legal], atol=1e-3)
    assert not added_by("Twirling")[3].any()


@settings(max_examples=80, deadline=None)
@given(
    st.integers(0, 10_000),
    st.tuples(st.floats(-1.0, 22.0), st.floats(-1.0, 22.0)),
    st.tuples(st.floats(0.5, 8.0), st.floats(0.5, 8.0)),
)
def test_outline_cost_is_the_greatest_on_the_border_of_a_rectangle(seed, at, half):
    costs = np.random.default_rng(seed).integers(0, 253, (20, 22)).astype(np.uint8)
    (x, y), (half_x, half_y) = at, half
    outline = np.array([[half_x, half_y], [half_x, -half_y], [-half_x, -half_y], [-half_x, half_y]])
    found = cost_under(costs, outline, x, y, 1.0, 0.0)
    low, high = np.floor([x - half_x, y - half_y]).astype(int), np.floor([x + half_x, y + half_y]).astype(int)
    if x - half_x < 0 or y - half_y < 0 or x + half_x >= 22 or y + half_y >= 20:
        assert found == -1
        return
    box = costs[low[1] : high[1] + 1, low[0] : high[0] + 1]
    assert found == max(box[0].max(), box[-1].max(), box[:, 0].max(), box[:, -1].max())


def test_outline_may_not_meet_lethal_and_unknown_cells():
    for cell, cost, expected in (((10, 12), 253, 253), ((10, 12), 254, -1), ((10, 12), 255, -1), ((10, 10), 254, 0)):
        costs = np.zeros((20, 20), dtype=np.uint8)
        costs[cell] = cost
        assert cost_under(costs, 8.0 * RECTANGLE * (1.0, 1.5), 10.5, 10.5, 1.0, 0.0) == expected


BOTH = FAST.with_values(min_vel_x=0.0, ObstacleFootprint=FAST.ObstacleFootprint.with_values(enabled=True, scale=0.02))


def test_obstacle_footprint_scores_the_greatest_cost_under_the_outline_at_the_end():
    costs = np.add.outer(2 * np.arange(CELLS), np.arange(CELLS)).astype(np.uint8)
    found, memory = scores(BOTH, costs)
    without, _ = scores(BOTH.with_values(ObstacleFootprint=FAST.ObstacleFootprint), costs)
    legal = np.isfinite(found)
    assert legal.sum() > 100
    for i, j in np.argwhere(legal)[::7]:
        x, y, c, s, _ = memory.ends[i, j]
        expected = cost_under(costs, RECTANGLE, x, y, c / RESOLUTION_M, s / RESOLUTION_M)
        assert found[i, j] - without[i, j] == pytest.approx(0.02 * expected, abs=1e-3)


@each_row("name", ["BaseObstacle", "ObstacleFootprint"])
def test_sum_scores_adds_the_costs_of_all_poses_and_the_last_twice(name):
    """Over equal costs a sample's sum is that of one pose times its poses."""
    costs = np.full((CELLS, CELLS), 7, dtype=np.uint8)
    once, memory = scores(BOTH, costs)
    summed, _ = scores(BOTH.with_values(**{name: getattr(BOTH, name).with_values(sum_scores=True)}), costs)
    legal = np.isfinite(once)
    assert np.array_equal(legal, np.isfinite(summed))
    poses = (summed[legal] - once[legal]) / (0.02 * 7) + 1
    assert np.allclose(poses, np.round(poses), atol=1e-2)
    assert np.round(poses).min() >= 3
    # The fastest straight sample: 0.5 m/s for 1.7 s in steps of 0.05 m.
    ends = memory.ends[: once.shape[0], : once.shape[1]][legal]
    fastest = np.argmax(ends[:, 0] - 1e-3 * ends[:, 4])
    assert poses[fastest] == pytest.approx(math.ceil(0.5 * 1.7 / 0.05) + 2, abs=1.01)


def test_reached_goal_is_remembered_until_a_reset():
    controller = Alone(HUMBLE, CORNER)
    near, far = ((CENTER[0] + away, CENTER[1], 1.5) for away in (0.1, 3.0))
    command(HUMBLE, goal=near, controller=controller)
    assert command(HUMBLE, goal=far, controller=controller)[1] == 0.0
    controller.reset()
    assert command(HUMBLE, goal=far, controller=controller)[1] == pytest.approx(0.26)


def turning_about(parameters, moved_m=0.0, turned_rad=0.0):
    """Turn left, then right as the plan flips, then twice as it flips back and the robot may have moved."""
    controller, moved = Alone(parameters, CORNER), (CENTER[0] + moved_m, CENTER[1], turned_rad)
    found = []
    for bearing, pose in ((2.0, HERE), (-2.0, HERE), (2.0, moved), (2.0, moved)):
        plan = straight(bearing)
        goal = (*(plan[-1] + 3.0 * (plan[-1] - plan[0])), 0.0)
        found.append(command(parameters, pose=pose, plan=plan, goal=goal, controller=controller)[2])
    return [math.copysign(1, w) for w in found]


@each_row(
    ("moved_m", "turned_rad", "expected"),
    [
        (0.0, 0.0, [1, -1, -1, -1]),
        (0.06, 0.0, [1, -1, -1, 1]),
        (0.0, -0.25, [1, -1, -1, 1]),
        (0.04, 0.0, [1, -1, -1, -1]),
        (0.0, -0.15, [1, -1, -1, -1]),
    ],
)
def test_oscillation_critic_forbids_reversal_until_robot_moved(moved_m, turned_rad, expected):
    assert turning_about(IN_PLACE, moved_m, turned_rad) == expected
    free = IN_PLACE.with_values(Oscillation=HUMBLE.Oscillation.with_values(enabled=False))
    assert turning_about(free, moved_m, turned_rad) == [1, -1, 1, 1]


def test_oscillation_leaves_yaw_rates_of_a_driving_robot_free():
    controller, turns = Alone(HUMBLE, CORNER), []
    for y in (2.0, -2.0, 2.0):
        plan, goal = straight(math.atan2(y, 3.0)), (CENTER[0] + 3.0, CENTER[1] + y, 0.0)
        turns.append(command(HUMBLE, twist=(0.26, 0.0), plan=plan, goal=goal, controller=controller))
    assert all(v > 0.05 for _, v, _, _ in turns)
    assert [math.copysign(1, w) for _, _, w, _ in turns] == [1, -1, 1]


def test_oscillation_forbids_a_change_of_side_until_the_robot_moved():
    only = ("PathDist", "GoalDist", "Oscillation")
    groups = {name: group.with_values(enabled=name in only) for name, group in OMNI if hasattr(group, "place")}
    parameters = OMNI.with_values(max_vel_x=0.0, **groups)
    controller, lateral = Alone(parameters, CORNER), []
    for side in (1, -1, 1):
        goal = (CENTER[0], CENTER[1] + 9.0 * side, 0.0)
        plan = straight(side * math.pi / 2, length_m=1.2)
        lateral.append(command(parameters, plan=plan, goal=goal, controller=controller)[3])
    assert lateral[0] > 0.1
    assert lateral[1] < -0.1
    assert lateral[2] <= 0.0
