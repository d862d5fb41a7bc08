"""NavFn's floods, its paths and the widths it passes; `test_sim_nav2_conformance` has both beside Nav2's answers."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from navfn_paths import path, potential
from table import each_row

from vastflow.sim.nav2.costmaps.inflation import inflate
from vastflow.sim.nav2.costmaps.outline import inscribed_radius_m, padded_outline
from vastflow.sim.nav2.planners.navfn import new_potential, new_scratch, propagate, travel_costs

F = np.float32
UNREACHED = F(1e10)
INSCRIBED_M = inscribed_radius_m(padded_outline(0.22, 0.01))
COSTMAPS = st.tuples(st.integers(5, 24), st.integers(5, 24)).flatmap(
    lambda shape: arrays(np.uint8, shape, elements=st.sampled_from([0] * 6 + [60, 128, 252, 253, 254, 255]))
)


@given(COSTMAPS, st.data())
@settings(max_examples=40, deadline=None)
def test_flood_in_used_memory_is_a_flood_in_new_memory(costmap, data):
    travel = travel_costs(costmap)
    rows, columns = costmap.shape
    out, scratch = new_potential(costmap.shape), new_scratch(costmap.shape)
    for _ in range(3):
        root = data.draw(st.integers(1, columns - 2)), data.draw(st.integers(1, rows - 2))
        stop = data.draw(st.tuples(st.integers(1, columns - 2), st.integers(1, rows - 2)))
        fresh = new_potential(costmap.shape)
        reached = propagate(travel, *root, *stop, False, fresh, np.inf, fresh, new_scratch(costmap.shape))
        assert propagate(travel, *root, *stop, False, out, np.inf, out, scratch) == reached
        np.testing.assert_array_equal(out, fresh)
        assert not scratch[1].any()


@given(COSTMAPS, st.floats(50.0, 3000.0), st.data())
@settings(max_examples=60, deadline=None)
def test_flood_enters_only_cells_on_paths_within_bound(costmap, bound, data):
    rows, columns = costmap.shape
    root = data.draw(st.integers(1, columns - 2)), data.draw(st.integers(1, rows - 2))
    travel = travel_costs(costmap)
    travel[root[1], root[0]] = 50
    lower = (40.0 * np.hypot(*np.indices(costmap.shape))).astype(F)
    out, scratch = new_potential(costmap.shape), new_scratch(costmap.shape)
    propagate(travel, *root, -1, -1, False, lower, bound, out, scratch)
    near = np.zeros(costmap.shape, dtype=bool)
    near[root[1] - 1 : root[1] + 2, root[0]], near[root[1], root[0] - 1 : root[0] + 2] = True, True
    before = np.full(costmap.shape, UNREACHED)
    before[1:-1, 1:-1] = np.min([out[:-2, 1:-1], out[2:, 1:-1], out[1:-1, :-2], out[1:-1, 2:]], axis=0)
    assert (before + lower <= bound)[(out < UNREACHED) & ~near].all()
    assert (out <= UNREACHED).all()
    assert not scratch[1].any()


def test_way_within_bounds_has_the_potential_of_the_whole_flood():
    costmap = a_wall_with_a_gap()
    travel, to_goal = travel_costs(costmap), potential(costmap, (70, 12))
    whole, out = potential(costmap, (8, 8), (70, 12)), new_potential(travel.shape)
    least = float(to_goal[8, 8])
    assert not propagate(travel, 8, 8, 70, 12, False, to_goal, 0.9 * least, out, new_scratch(travel.shape))
    out = new_potential(travel.shape)
    assert propagate(travel, 8, 8, 70, 12, False, to_goal, least + 1500.0, out, new_scratch(travel.shape))
    assert out[12, 70] == whole[12, 70]
    assert (out < UNREACHED).sum() < 0.9 * (whole < UNREACHED).sum()


def test_astar_floods_less_and_finds_no_shorter_path():
    costmap = np.zeros((120, 120), dtype=np.uint8)
    costmap[30:90, 60] = 254
    inflated = inflate(costmap, 0.05, INSCRIBED_M, 0.70, 3.0)
    reached, lengths = [], []
    for use in (False, True):
        reached.append((potential(inflated, (20, 60), (100, 60), use_astar=use) < UNREACHED).sum())
        way = path(inflated, (20, 60), (100, 60), use_astar=use)
        lengths.append(np.hypot(*np.diff(way, axis=0).T).sum())
    assert reached[1] < 0.9 * reached[0]
    assert lengths[1] >= 0.99 * lengths[0]


def a_wall_with_a_gap():
    """60 × 80 cells, a wall across with a gap of 14 cells, inflated as Nav2 does by default."""
    costmap = np.zeros((60, 80), dtype=np.uint8)
    costmap[:, 40] = 254
    costmap[38:52, 40] = 0
    return inflate(costmap, 0.05, INSCRIBED_M, 0.70, 3.0)


def test_potential_is_that_of_nav2_and_of_its_early_stop():
    """The last value is that of Nav2's own planner for a wall with a door."""
    full, early = (potential(a_wall_with_a_gap(), (8, 8), stop)[3, 45] for stop in (None, (45, 3)))
    assert full == pytest.approx(9363.865, rel=1e-6)
    assert early == pytest.approx(14438.769, rel=1e-6)
    costmap = np.zeros((81, 81), dtype=np.uint8)
    costmap[[0, -1]] = costmap[:, [0, -1]] = costmap[40] = 254
    costmap[40, 36:45] = 0
    assert potential(inflate(costmap, 0.05, INSCRIBED_M, 0.70, 3.0), (40, 15), (40, 65))[65, 40] == 5611.0


def test_travel_costs_match_navfn():
    costmap = np.pad(np.array([[0, 1, 60, 128, 201, 252, 253, 254, 255, 100]], dtype=np.uint8), 1)
    assert travel_costs(costmap, True)[1].tolist() == [254, 50, 50, 98, 152, 210, 251, 254, 254, 253, 130, 254]
    assert travel_costs(costmap, False)[1, 9] == 254


@each_row(
    ("resolution_m", "radius_m", "scaling", "robot_radius", "cells", "passes"),
    [
        (0.05, 0.70, 3.0, 0.22, 9, True),
        (0.05, 0.70, 3.0, 0.22, 8, False),
        (0.06, 0.45, 4.0, 0.175, 7, True),
        (0.06, 0.45, 4.0, 0.175, 6, False),
        (0.05, 0.70, 3.0, 0.175, 7, True),
        (0.05, 0.70, 3.0, 0.175, 6, False),
    ],
)
def test_door_is_passed_from_the_width_that_nav2_passes(resolution_m, radius_m, scaling, robot_radius, cells, passes):
    static = np.zeros((60, 80), dtype=np.uint8)
    static[:, 39:41] = 254
    static[25 : 25 + cells, 39:41] = 0
    inscribed_m = inscribed_radius_m(padded_outline(robot_radius, 0.01))
    way = path(inflate(static, resolution_m, inscribed_m, radius_m, scaling), (10, 29), (70, 29))
    assert (len(way) > 0) == passes


@given(st.integers(3, 75), st.integers(3, 55), st.integers(3, 75), st.integers(3, 55))
@settings(max_examples=60, deadline=None)
def test_path_leads_from_start_to_goal_in_small_steps(x0, y0, x1, y1):
    costmap = a_wall_with_a_gap()
    if costmap[y0, x0] >= 253 or costmap[y1, x1] >= 253:
        return
    way = path(costmap, (x0, y0), (x1, y1))
    steps = np.hypot(*np.diff(way, axis=0).T)
    assert tuple(way[-1]) == (x1, y1)
    assert math.dist(way[0], (x0, y0)) <= 1.5
    # Half a cell down the gradient, or from cell to cell beside what was not reached.
    assert steps.size == 0 or steps.max() < 2.0
    near = np.rint(way).astype(int)
    assert (costmap[near[:, 1], near[:, 0]] < 253).all()


def test_unknown_ground_is_driven_where_it_is_allowed_and_only_there():
    costmap = np.zeros((30, 40), dtype=np.uint8)
    costmap[:, 18:22] = 255
    assert [len(path(costmap, (5, 15), (35, 15), allow_unknown=allow)) > 0 for allow in (True, False)] == [True, False]


def test_path_longer_than_cap_of_navfn_is_not_found():
    """The walk ends after 4 max(H, W) points, although the flood reached the end of the way."""
    costmap = np.zeros((200, 200), dtype=np.uint8)
    costmap[:, 66], costmap[:, 132] = 254, 254
    costmap[190:198, 66], costmap[2:10, 132] = 0, 0
    assert potential(costmap, (165, 190))[10, 33] < UNREACHED
    assert len(path(costmap, (33, 10), (165, 190))) == 0
    assert len(path(costmap, (33, 10), (100, 100))) > 0
