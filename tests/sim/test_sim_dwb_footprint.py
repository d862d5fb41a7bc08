"""DWB's ObstacleFootprint: what it forbids and what it adds."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from table import each_row

from vastflow.sim.kernels.numeric import njit
from vastflow.sim.kernels.record import record_of
from vastflow.sim.nav2.controllers import dwb
from vastflow.sim.nav2.controllers.controller import ControllerInput
from vastflow.sim.nav2.costmaps.window import Window, outline_cost
from vastflow.sim.nav2.parameters.dwb import DwbParameters

CELLS = 60
RESOLUTION_M = 0.05
CENTER = (1.512, 1.493)
RECTANGLE = np.array([[0.3, 0.2], [0.3, -0.2], [-0.3, -0.2], [-0.3, 0.2]])
HUMBLE = DwbParameters()
FAST = HUMBLE.with_values(max_vel_x=0.5, max_speed_xy=0.5)
OUTLINED = FAST.with_values(
    BaseObstacle=FAST.BaseObstacle.with_values(enabled=False),
    ObstacleFootprint=FAST.ObstacleFootprint.with_values(enabled=True, scale=0.02),
)


@njit
def cost_under(costs, outline, x, y, c, s):
    return outline_cost(costs, outline, x, y, c, s)


@njit
def scored(records, memory, window, outline, pose, plan, goal):
    """Scores (V, W) of the ends of all samples, and what they are: speeds, yaw rates, ends."""
    situation = ControllerInput(window, outline, 0.2, pose, (0.1, 0.0), plan, 0.0, goal, 0.05, 0.0)
    _, n_speeds, n_turns = dwb.score(records[0], memory, situation)
    return memory.scores[:n_speeds, :n_turns].copy(), memory.ends[:n_speeds, :n_turns].copy()


def straight():
    return np.column_stack([np.arange(CENTER[0], CENTER[0] + 1.4, 0.025), np.full(56, CENTER[1])])


def scores_of(parameters, costs, outline=RECTANGLE):
    memory = dwb.new_memory(parameters, CELLS, CELLS)
    window = Window(costs, np.array([0.0, 0.0, RESOLUTION_M]))
    return scored(record_of(parameters), memory, window, outline, (*CENTER, 0.0), straight(), (9.0, CENTER[1], 0.0))


@settings(max_examples=80, deadline=None)
@given(
    st.integers(0, 10_000),
    st.tuples(st.floats(-1.0, 22.0), st.floats(-1.0, 22.0)),
    st.tuples(st.floats(0.5, 8.0), st.floats(0.5, 8.0)),
)
def test_upright_rectangle_lies_on_the_cells_of_its_border_and_may_not_leave_the_grid(seed, at, half):
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


@each_row(("cost", "expected"), [(253, 253), (254, -1), (255, -1)])
def test_lethal_and_unknown_cells_are_forbidden_under_the_outline_and_inscribed_ones_are_not(cost, expected):
    costs = np.zeros((20, 20), dtype=np.uint8)
    costs[10, 12] = cost
    outline = np.array([[2.4, 2.4], [2.4, -2.4], [-2.4, -2.4], [-2.4, 2.4]])
    assert cost_under(costs, outline, 10.5, 10.5, 1.0, 0.0) == expected


def test_what_lies_within_the_outline_does_not_count():
    costs = np.zeros((20, 20), dtype=np.uint8)
    costs[10, 10] = 254
    outline = np.array([[2.4, 2.4], [2.4, -2.4], [-2.4, -2.4], [-2.4, 2.4]])
    assert cost_under(costs, outline, 10.5, 10.5, 1.0, 0.0) == 0


def test_sample_is_scored_by_the_greatest_cost_under_the_outline_at_its_end():
    costs = np.add.outer(2 * np.arange(CELLS), np.arange(CELLS)).astype(np.uint8)
    blind = OUTLINED.with_values(ObstacleFootprint=OUTLINED.ObstacleFootprint.with_values(enabled=False))
    without, ends = scores_of(blind, costs)
    found, _ = scores_of(OUTLINED, costs)
    legal = np.isfinite(found)
    assert legal.sum() > 100
    for i, j in np.argwhere(legal)[::7]:
        x, y, c, s, _ = ends[i, j]
        expected = cost_under(costs, RECTANGLE, x, y, c / RESOLUTION_M, s / RESOLUTION_M)
        assert found[i, j] - without[i, j] == pytest.approx(0.02 * expected, abs=1e-3)


@each_row("name", ["BaseObstacle", "ObstacleFootprint"])
def test_with_sum_scores_the_costs_of_all_poses_add_up_the_last_one_twice(name):
    """Over equal costs a sample's sum is that of one pose times its poses: the robot's own, one a step, and the last again."""
    costs = np.full((CELLS, CELLS), 7, dtype=np.uint8)
    both = FAST.with_values(ObstacleFootprint=FAST.ObstacleFootprint.with_values(enabled=True, scale=0.02))
    once, ends = scores_of(both, costs)
    all_poses = both.with_values(**{name: getattr(both, name).with_values(sum_scores=True)})
    summed, _ = scores_of(all_poses, costs)
    legal = np.isfinite(once)
    assert np.array_equal(legal, np.isfinite(summed))
    poses = np.full(once.shape, np.nan)
    poses[legal] = (summed[legal] - once[legal]) / (0.02 * 7) + 1
    assert np.allclose(poses[legal], np.round(poses[legal]), atol=1e-2)
    assert np.round(poses[legal]).min() >= 3
    # The fastest straight sample: 0.5 m/s for 1.7 s in steps of 0.05 m.
    i, j = np.unravel_index(np.argmax(np.where(legal, ends[..., 0] - 1e-3 * ends[..., 4], -1)), once.shape)
    assert poses[i, j] == pytest.approx(math.ceil(0.5 * 1.7 / 0.05) + 2, abs=1.01)
