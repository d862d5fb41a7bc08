"""The costmaps: what a scan clears and marks, the rolling window, inflation, and the Denoise layer."""

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy import ndimage
from shapely import Point, Polygon
from table import each_row

from vastflow.sim.kernels.numeric import njit
from vastflow.sim.kernels.record import record_of
from vastflow.sim.nav2.costmaps.costmap import (
    MARKED,
    SEEN_FREE,
    UNSEEN,
    clear_line,
    clear_polygon,
    denoised,
    merge_window,
    observe,
    remove_small_groups,
    roll,
)
from vastflow.sim.nav2.costmaps.inflation import UNKNOWN, cost_stamp, inflate, inflation_of
from vastflow.sim.nav2.costmaps.outline import inscribed_radius_m, padded_outline
from vastflow.sim.nav2.parameter_files.chosen import parameters_of
from vastflow.sim.nav2.parameters.costmap import DenoiseLayer, ObstacleLayer

RESOLUTION_M = 0.05
PARAMETERS = (RESOLUTION_M, 0.225498, 0.70, 3.0)
GLOBAL, LOCAL = 0, 2
"""Cells before the end of a beam at which clearing stops."""


@njit
def rolled(layer, shift_columns, shift_rows, entering):
    roll(layer, np.empty_like(layer), shift_columns, shift_rows, entering)


@njit
def polygon_cleared(layer, outline, x, y, yaw):
    clear_polygon(layer, (0.0, 0.0, 0.05), outline, x, y, yaw)


@njit
def merged_into(static, static_costs, layer, stamp, column, row, reach, costs):
    return merge_window(static, static_costs, layer, stamp, column, row, reach, costs)


def merged(static, layer, column, row, reach, costs):
    stamp = cost_stamp(*PARAMETERS)
    return merged_into(static, inflation_of(static, stamp), layer, stamp, column, row, reach, costs)


@njit
def observed(parameters, layer, sensor, directions, ranges):
    observe(parameters[0], layer, (0.0, 0.0, 0.05), sensor, directions, ranges, 0.164, 20.0)


def seen(ranges, short=GLOBAL, layer=None, yaw=0.0, at=(2.025, 2.025)):
    """A layer of 80 × 160 cells after one scan from `at` whose beams all look ahead."""
    layer = np.zeros((80, 160), dtype=np.uint8) if layer is None else layer
    ranges, directions = np.asarray(ranges, dtype=np.float64), np.tile([1.0, 0.0], (len(ranges), 1))
    observed(record_of(ObstacleLayer(short_clearing_cells=short)), layer, (*at, yaw), directions, ranges)
    return layer


ROW, COLUMN = 40, 40
"""The cell of the default sensor; a beam along x passes the cells right of it."""


def test_beam_clears_up_to_its_end_and_marks_there():
    row = seen([2.0])[ROW]
    assert (row[COLUMN : COLUMN + 40] == SEEN_FREE).all()
    assert row[COLUMN + 40] == MARKED
    assert (row[:COLUMN] == UNSEEN).all() and (row[COLUMN + 41 :] == UNSEEN).all()


def test_stale_mark_remains_only_in_local_layer():
    for short, left in ((LOCAL, MARKED), (GLOBAL, SEEN_FREE)):
        layer = seen([1.95], short)
        assert seen([2.0], short, layer)[ROW, COLUMN + 39] == left


@each_row(("range_m", "layer", "cleared"), [(2.7, MARKED, 55), (3.9, UNSEEN, 61)])
def test_clearing_ends_at_its_range_beyond_that_of_marking(range_m, layer, cleared):
    row = seen([range_m], GLOBAL, np.full((80, 160), layer, dtype=np.uint8))[ROW]
    assert (row[COLUMN : COLUMN + cleared] == SEEN_FREE).all()
    assert (row[COLUMN + cleared :] == layer).all()


@each_row(("range_m", "mark"), [(2.45, True), (2.5, True), (2.55, False)])
def test_marking_ends_at_its_range(range_m, mark):
    assert (seen([range_m]) == MARKED).any() == mark


@each_row("range_m", [math.inf, math.nan, 0.1, 20.0, -0.3])
@each_row("short", [GLOBAL, LOCAL])
def test_beam_without_a_valid_return_neither_marks_nor_clears(range_m, short):
    layer = np.full((80, 160), MARKED, dtype=np.uint8)
    assert (seen([range_m], short, layer) == MARKED).all()


def test_marks_are_made_after_all_clearing():
    assert (seen([1.0, 2.0])[ROW, COLUMN + 20 : COLUMN + 41 : 20] == MARKED).all()


def test_end_beyond_the_grid_clears_up_to_the_border_and_sensor_beyond_nothing():
    layer = seen([2.4], yaw=math.pi / 2)
    assert (layer[ROW:, COLUMN] == SEEN_FREE).all()
    assert not (layer == MARKED).any()
    assert (seen([1.0], at=(-0.1, 2.0)) == UNSEEN).all()


@given(*[st.integers(0, 29)] * 2, *[st.integers(-60, 90)] * 2, st.integers(0, 2))
@settings(deadline=None)
def test_line_leaving_layer_clears_like_whole_line(col0, row0, col1, row1, short):
    layer, wide = np.zeros((30, 30), dtype=np.uint8), np.zeros((160, 160), dtype=np.uint8)
    clear_line(layer, col0, row0, col1, row1, short)
    clear_line(wide, col0 + 65, row0 + 65, col1 + 65, row1 + 65, short)
    np.testing.assert_array_equal(layer, wide[65:95, 65:95])


@given(*[st.integers(0, 29)] * 4, st.integers(0, 4))
@settings(deadline=None)
def test_cleared_line_is_connected_and_ends_where_it_should(col0, row0, col1, row1, short):
    layer = np.zeros((30, 30), dtype=np.uint8)
    clear_line(layer, col0, row0, col1, row1, short)
    cells = np.argwhere(layer == SEEN_FREE)
    length = max(abs(col1 - col0), abs(row1 - row0)) + 1 - short
    assert len(cells) == max(length, 0)
    if len(cells) == 0:
        return
    along = np.abs(cells - (row0, col0)).max(axis=1)
    cells = cells[np.argsort(along)]
    assert tuple(cells[0]) == (row0, col0)
    assert (np.abs(np.diff(cells, axis=0)).max(axis=1, initial=0) <= 1).all()
    # No cell lies farther than half a cell from the line.
    direction = np.array([row1 - row0, col1 - col0], dtype=float)
    if direction.any():
        off = (cells - (row0, col0)) @ np.array([-direction[1], direction[0]]) / np.abs(direction).max()
        assert np.abs(off).max() <= 0.5 + 1e-9
    if short == 0:
        assert layer[row1, col1] == SEEN_FREE


@given(
    arrays(np.uint8, (12, 15), elements=st.sampled_from([UNSEEN, SEEN_FREE, MARKED])),
    st.integers(-17, 17),
    st.integers(-17, 17),
    st.sampled_from([UNSEEN, UNKNOWN]),
)
@settings(deadline=None)
def test_rolled_window_keeps_overlap_and_fills_rest(layer, shift_columns, shift_rows, entering):
    before = layer.copy()
    rolled(layer, shift_columns, shift_rows, entering)
    wide = np.pad(before, 17, constant_values=entering)
    np.testing.assert_array_equal(layer, wide[17 + shift_rows :, 17 + shift_columns :][:12, :15])


@given(st.floats(0.3, 0.7), st.floats(0.3, 0.7), st.floats(-3.2, 3.2), st.floats(0.1, 0.24))
@settings(deadline=None)
def test_cells_under_robot_outline_are_cleared(x, y, yaw, radius_m):
    outline = padded_outline(radius_m, 0.01)
    layer = np.full((20, 20), MARKED, dtype=np.uint8)
    polygon_cleared(layer, outline, x, y, yaw)
    c, s = math.cos(yaw), math.sin(yaw)
    footprint = Polygon(outline @ np.array([[c, s], [-s, c]]) + (x, y))
    for row, column in np.ndindex(layer.shape):
        center = Point((column + 0.5) * RESOLUTION_M, (row + 0.5) * RESOLUTION_M)
        if footprint.contains(center) and footprint.exterior.distance(center) > 0.03:
            assert layer[row, column] == SEEN_FREE
        # Half a cell off the line, by which Bresenham's cells stray, and half a cell from there to the center.
        if footprint.distance(center) > RESOLUTION_M:
            assert layer[row, column] == MARKED
    for vertex_x, vertex_y in footprint.exterior.coords:
        assert layer[int(vertex_y / RESOLUTION_M), int(vertex_x / RESOLUTION_M)] == SEEN_FREE


@given(
    arrays(np.uint8, (50, 60), elements=st.sampled_from([0] * 40 + [254, 255])),
    arrays(np.uint8, (50, 60), elements=st.sampled_from([UNSEEN] * 20 + [SEEN_FREE] * 20 + [MARKED])),
)
@settings(max_examples=50, deadline=None)
def test_merged_costmap_is_the_greater_of_both_layers_inflated(static, layer):
    costs = np.zeros_like(static)
    merged(static, layer, 30, 25, 60, costs)
    master = np.where((static == 254) | (layer == MARKED), 254, static)
    master = np.where((master == 255) & (layer == SEEN_FREE), 0, master).astype(np.uint8)
    np.testing.assert_array_equal(costs, inflate(master, *PARAMETERS))


def test_merge_uses_window_and_border_cells():
    static = np.zeros((50, 60), dtype=np.uint8)
    static[25, 41] = 254
    costs = np.full_like(static, 7)
    window = merged(static, np.zeros_like(static), 30, 25, 10, costs)
    assert window == (15, 36, 20, 41)
    assert costs[25, 40] == 253  # beside a wall that is not in the window
    outside = np.ones(static.shape, dtype=bool)
    outside[15:36, 20:41] = False
    assert (costs[outside] == 7).all()


@njit
def removed(q, lethal, scratch):
    remove_small_groups(q[0], lethal, scratch)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10_000), st.integers(0, 9), st.sampled_from([4, 8]))
def test_groups_of_fewer_cells_go_and_all_others_stay(seed, size, connectivity):
    lethal = np.random.default_rng(seed).random((25, 30)) < 0.25
    labels, _ = ndimage.label(lethal, np.ones((3, 3)) if connectivity == 8 else None)
    sizes = np.bincount(labels.ravel())[labels]
    layer = DenoiseLayer(minimal_group_size=size, group_connectivity_type=connectivity)
    cells = lethal.astype(np.uint8)
    removed(record_of(layer), cells, np.zeros_like(cells))
    assert np.array_equal(cells != 0, lethal & (sizes >= size))
    static = np.where(lethal, 254, 255).astype(np.uint8)
    assert np.array_equal(denoised(static, layer), np.where(lethal & (sizes < size), 0, static))


def test_robot_with_the_layer_drives_ten_meters_straight_past_a_speck(over_a_floor):
    cells = np.zeros((80, 280), dtype=bool)
    cells[48, 120] = True
    stack, both = parameters_of({"controller": "rpp"}), ("local_costmap", "global_costmap")
    layer = DenoiseLayer(minimal_group_size=6)
    denoising = stack.with_values(**{name: getattr(stack, name).with_values(denoise_layer=layer) for name in both})
    found = [over_a_floor(each, cells=cells) for each in (denoising, stack)]
    assert [each.run.outcome for each in found] == ["succeeded", "succeeded"]
    aside = [np.abs(each.columns["y_mm"] - 2000).max() for each in found]
    assert aside[0] < 150 < aside[1]


JAZZY = (0.05, inscribed_radius_m(padded_outline(0.22, 0.01)), 0.70, 3.0)


def by_formula(costmap, resolution_m, inscribed_m, radius_m, k):
    """Inflation by the distance of every cell to the nearest lethal one."""
    lethal = costmap == 254
    if not lethal.any():
        return costmap.copy()
    cells = ndimage.distance_transform_edt(~lethal)
    cost = np.minimum(np.floor(252 * np.exp(-k * (cells * resolution_m - inscribed_m))), 252)
    cost = np.where(cells * resolution_m <= inscribed_m, 253, cost)
    cost = np.where(cells > math.ceil(radius_m / resolution_m), 0, cost)
    cost = np.where(lethal, 254, cost)
    return np.where((costmap == 255) & (cost < 253), 255, cost).astype(np.uint8)


@given(
    st.tuples(st.integers(1, 40), st.integers(1, 40)).flatmap(
        lambda shape: arrays(np.uint8, shape, elements=st.sampled_from([0] * 20 + [254, 254, 255]))
    ),
    st.sampled_from([JAZZY, (0.06, 0.181353, 0.45, 4.0), (0.05, 0.225498, 0.1, 3.0), (0.05, 0.225498, 0.0, 10.0)]),
)
@settings(max_examples=60, deadline=None)
def test_cells_have_the_cost_of_the_formula(costmap, parameters):
    np.testing.assert_array_equal(inflate(costmap, *parameters), by_formula(costmap, *parameters))


def test_inflation_gives_costs_of_turtlebot_parameters():
    stamp = cost_stamp(0.06, 0.181353, 0.45, 4.0)
    assert stamp[8, 8:].tolist()[:9] == [254, 253, 253, 253, 199, 156, 123, 97, 76]
