"""MPPI's judgment of outlines against drawing each of them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vastflow.sim.kernels.numeric import njit
from vastflow.sim.kernels.record import record_of
from vastflow.sim.nav2.controllers.mppi_critics import cost_values, lay_frame
from vastflow.sim.nav2.controllers.mppi_outlines import lay_room, outline_collides
from vastflow.sim.nav2.controllers.mppi_samples import SIDE
from vastflow.sim.nav2.costmaps.window import Window, outline_hits
from vastflow.sim.nav2.parameters.mppi import CostParameters, MppiParameters

CARRIER = np.array([[0.55, 0.45], [0.55, -0.45], [-0.55, -0.45], [-0.55, 0.45]])
ARROW = np.array([[0.5, 0.0], [-0.3, -0.4], [-0.1, 0.05], [-0.3, 0.4]])
CELL_M = 0.05
RECORD = record_of(MppiParameters(CostCritic=CostParameters(consider_footprint=True)))


@njit
def judged(window, outline, pose, poses, circumscribed_cost, record):
    """Return for poses (N, 3) in cells whether each outline collides, computed and drawn."""
    frame_costs, values = np.zeros(SIDE * SIDE, dtype=np.float32), np.zeros(256, dtype=np.float32)
    near, lethal = np.ones(SIDE * SIDE, dtype=np.uint8), np.ones(SIDE * SIDE, dtype=np.int32)
    cost_values(record[0].CostCritic, values, 10.0)
    frame = lay_frame(frame_costs, values, window, pose)
    vertices = np.zeros(2 * len(outline))
    lay_room(near, lethal, vertices, frame, window, outline, circumscribed_cost)
    room = near, lethal, vertices, len(outline)
    found = np.zeros((len(poses), 2), dtype=np.bool_)
    for k in range(len(poses)):
        x, y, yaw_rad = poses[k, 0] * frame.columns, poses[k, 1] * frame.rows, poses[k, 2]
        x_m, y_m = frame.left_m + x * CELL_M, frame.bottom_m + y * CELL_M
        is_near = near[int(y) * frame.columns + int(x)] != 0
        found[k, 0] = is_near and outline_collides(room, frame, x, y, yaw_rad)
        leaves = False
        for v in range(outline.shape[0]):
            c, s = np.cos(yaw_rad) / CELL_M, np.sin(yaw_rad) / CELL_M
            vertex_x = x + (c * outline[v, 0] - s * outline[v, 1])
            vertex_y = y + (s * outline[v, 0] + c * outline[v, 1])
            leaves |= not (1.0 <= vertex_x < frame.columns - 1 and 1.0 <= vertex_y < frame.rows - 1)
        found[k, 1] = leaves or outline_hits(window, outline, x_m, y_m, yaw_rad)
    return found


def poses_of(rng, count=400):
    """Places as shares of the frame, and headings."""
    return np.column_stack([rng.uniform(0.0, 1.0, count), rng.uniform(0.0, 1.0, count), rng.uniform(-9.0, 9.0, count)])


@pytest.mark.parametrize("outline", [CARRIER, ARROW])
@given(
    seed=st.integers(0, 2**32 - 1),
    shape=st.tuples(st.integers(40, 130), st.integers(40, 130)),
    lethal=st.integers(0, 40),
)
@settings(max_examples=40, deadline=None)
def test_outline_collides_at_a_lethal_cell_or_outside_the_window(outline, seed, shape, lethal):
    rng = np.random.default_rng(seed)
    costs = np.full(shape, 100, dtype=np.uint8)
    costs[rng.integers(0, shape[0], lethal), rng.integers(0, shape[1], lethal)] = 254
    window = Window(costs, np.array([-1.5, 2.0, CELL_M]))
    quick, drawn = judged(window, outline, (0.0, 3.0, 0.0), poses_of(rng), 1.0, RECORD).T
    # Half of a cell's width apart in rounding: a vertex on a cell's edge may fall to either side.
    assert np.count_nonzero(quick != drawn) <= 1


def test_window_larger_than_the_frame_is_cut_round_the_robot():
    rng = np.random.default_rng(5)
    costs = np.full((300, 280), 100, dtype=np.uint8)
    costs[rng.integers(0, 300, 200), rng.integers(0, 280, 200)] = 254
    window = Window(costs, np.array([-7.0, -7.5, CELL_M]))
    quick, drawn = judged(window, CARRIER, (4.0, -3.0, 0.0), poses_of(rng, 4000), 1.0, RECORD).T
    assert np.count_nonzero(quick != drawn) <= 2
    assert 0.05 < quick.mean() < 0.95


def test_outlines_of_cheap_centers_are_not_drawn():
    costs = np.zeros((100, 100), dtype=np.uint8)
    costs[50, 50] = 254  # without inflation: a cost below the threshold everywhere else
    poses = np.array([[0.5, 0.5, 0.0], [0.5 + 9 / 102, 0.5, 0.0]])
    window = Window(costs, np.array([0.0, 0.0, CELL_M]))
    assert judged(window, CARRIER, (2.5, 2.5, 0.0), poses, 60.0, RECORD)[:, 0].tolist() == [False, False]
