"""Octile lengths, against scikit-image's minimum-cost path and by hand."""

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from skimage.graph import MCP_Geometric
from table import each_row

from vastflow.sim.world.occupancy import OccupancyMap
from vastflow.sim.world.octile import descend, distance_field, inflated_free, passable, shortest_path, whole_cells

GRIDS = st.tuples(st.integers(1, 14), st.integers(1, 14)).flatmap(
    lambda shape: arrays(np.bool_, shape, elements=st.sampled_from([True, True, False]))
)


@given(GRIDS, st.data(), st.floats(0.0, 12.0))
@example(np.random.default_rng(3).random((240, 300)) > 0.02, None, 90.0)
@settings(max_examples=60, deadline=None)
def test_field_is_that_of_a_minimum_cost_path_within_its_limit(free, data, limit):
    source = tuple(data.draw(st.integers(0, n - 1)) if data else n // 2 for n in free.shape)
    field = distance_field(free, *source)
    np.testing.assert_array_equal(distance_field(free, *source, limit), np.where(field <= limit, field, np.inf))
    if not free[source]:
        assert not np.isfinite(field).any()
        return
    expected, _ = MCP_Geometric(np.where(free, 1.0, -1.0), fully_connected=True).find_costs([source])
    np.testing.assert_allclose(field, expected, rtol=1e-6)


@given(GRIDS, st.data())
@settings(max_examples=60, deadline=None)
def test_descent_is_connected_free_and_as_long_as_the_field(free, data):
    source = tuple(data.draw(st.integers(0, n - 1)) for n in free.shape)
    field = distance_field(free, *source)
    reached = np.argwhere(np.isfinite(field))
    if len(reached) == 0:
        return
    cell = tuple(reached[data.draw(st.integers(0, len(reached) - 1))])
    way = descend(field, *cell)
    steps = np.abs(np.diff(way, axis=0))
    assert tuple(way[0]) == cell
    assert tuple(way[-1]) == source
    assert steps.size == 0 or (steps.max() == 1 and steps.sum(axis=1).min() >= 1)
    assert free[tuple(way.T)].all()
    assert np.hypot(*steps.T).sum() == pytest.approx(field[cell], rel=1e-6)


def test_source_outside_the_grid_reaches_nothing_and_unreached_cell_has_no_descent():
    for source in ((-1, 0), (0, 3), (2, 0)):
        assert not np.isfinite(distance_field(np.ones((2, 3), dtype=np.bool_), *source)).any()
    field = distance_field(np.array([[True, False, True]]), 0, 0)
    with pytest.raises(ValueError, match=r"cell \(0, 2\) is not reached by the field"):
        descend(field, 0, 2)


@given(GRIDS, st.floats(0.0, 5.0))
@settings(max_examples=60, deadline=None)
def test_cell_is_passable_exactly_when_every_cell_within_the_radius_is_free(free, radius_cells):
    found = inflated_free(free, radius_cells)
    blocked = np.argwhere(~np.pad(free, 1, constant_values=False)) - 1
    for cell in np.ndindex(free.shape):
        nearest = np.hypot(*(blocked - cell).T).min()
        if abs(nearest - radius_cells) > 1e-9:
            assert found[cell] == (nearest > radius_cells)


def test_unknown_cells_are_not_passable(drawn):
    assert passable(drawn("..?", "...", "..."), 0.0).tolist() == [[True] * 3, [True] * 3, [True, True, False]]


@given(GRIDS, st.integers(0, 300), st.sampled_from([20, 50, 100]))
@settings(max_examples=60, deadline=None)
def test_robot_fits_where_all_disc_cells_are_free(free, radius_mm, resolution_mm):
    """Version 1's test of a start or goal, read plainly: all cells of a disc of ceil(radius / resolution) cells."""
    cells = np.where(free, 0, 100).astype(np.int8)
    found = passable(OccupancyMap(cells, resolution_mm / 1000, (0.0, 0.0)), radius_mm / 1000)
    whole = -(-radius_mm // resolution_mm)
    disc = [(i, j) for i in range(-whole, whole + 1) for j in range(-whole, whole + 1) if i * i + j * j <= whole**2]
    inside = np.pad(free, whole, constant_values=False)
    for row, column in np.ndindex(free.shape):
        assert found[row, column] == all(inside[row + whole + i, column + whole + j] for i, j in disc)


@given(st.integers(0, 2000), st.sampled_from([10, 20, 50, 100]))
def test_radius_takes_whole_cells_and_no_cell_for_the_rounding_of_numbers(radius_mm, resolution_mm):
    assert whole_cells(radius_mm / 1000, resolution_mm / 1000) == -(-radius_mm // resolution_mm)


def test_path_through_several_stops_is_the_sum_of_its_legs(drawn):
    occupancy = drawn(".......", ".......", ".......", resolution_m=0.5)
    stops = np.array([(0.25, 0.25), (3.25, 0.25), (2.25, 1.25)])
    points, length_m = shortest_path(occupancy, occupancy.free, stops)
    assert length_m == pytest.approx(0.5 * (6 + 2 * math.sqrt(2)))
    assert np.hypot(*np.diff(points, axis=0).T).sum() == pytest.approx(length_m)
    np.testing.assert_allclose(points[[0, 6, -1]], stops)
    assert len(points) == 9  # a stop is no two points


@each_row("start_and_goal_x_m", [(0.02, 0.17), (0.02, 0.12), (0.02, 9.0), (-0.01, 0.02)])
def test_shortest_path_to_unreachable_stop_is_none(drawn, start_and_goal_x_m):
    occupancy = drawn("..#.")
    assert shortest_path(occupancy, occupancy.free, np.array([(x, 0.02) for x in start_and_goal_x_m])) is None
