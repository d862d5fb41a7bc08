"""Walls as rectangles, and those near a place."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from vastflow.sim.world.occupancy import OccupancyMap
from vastflow.sim.world.physics import WallIndex, wall_rectangles

GRIDS = st.tuples(st.integers(1, 16), st.integers(1, 16)).flatmap(
    lambda shape: arrays(np.int8, shape, elements=st.sampled_from([0, 100, 100, -1]))
)


def covered(rectangles, shape):
    """The number of rectangles on each cell."""
    count = np.zeros(shape, dtype=int)
    for x0, y0, x1, y1 in np.rint(rectangles).astype(int).tolist():
        count[y0:y1, x0:x1] += 1
    return count


@given(GRIDS)
@settings(max_examples=60, deadline=None)
def test_rectangles_cover_reachable_wall_cells_once(cells):
    occupancy = OccupancyMap(cells, 1.0, (0.0, 0.0))
    framed = np.pad(occupancy.occupied, 1, constant_values=True)
    rows, columns = cells.shape
    buried = np.all([framed[r : r + rows, c : c + columns] for r in range(3) for c in range(3)], axis=0)
    rectangles = wall_rectangles(occupancy)
    np.testing.assert_array_equal(rectangles, np.rint(rectangles))
    np.testing.assert_array_equal(covered(rectangles, cells.shape), occupancy.occupied & ~buried)


def test_straight_wall_is_one_rectangle_in_meters():
    cells = np.zeros((10, 10), dtype=np.int8)
    cells[2:4, 1:9] = 100
    rectangles = wall_rectangles(OccupancyMap(cells, 0.5, (-1.0, 3.0)))
    np.testing.assert_allclose(rectangles, [(-0.5, 4.0, 3.5, 5.0)])


@given(GRIDS, st.floats(-3, 19), st.floats(-3, 19))
@settings(max_examples=60, deadline=None)
def test_walls_within_a_tile_are_among_those_around(cells, x, y):
    index = WallIndex(OccupancyMap(cells, 1.0, (0.0, 0.0)))
    around = index.around(index.tile_of(x, y))
    x0, y0, x1, y1 = index.rectangles.T
    away = np.hypot(np.maximum(np.maximum(x0 - x, x - x1), 0.0), np.maximum(np.maximum(y0 - y, y - y1), 0.0))
    assert set(np.flatnonzero(away < WallIndex.TILE_M)) <= set(around)
    assert around == sorted(set(around))
