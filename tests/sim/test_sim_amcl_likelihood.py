"""AMCL's likelihood field: whose wall a cell belongs to, and what a beam that ends there weighs."""

import math
import zlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy import ndimage

from vastflow.sim.nav2.amcl.sensor import FRAME, UNREACHED, WIDTH, likelihood_cubed, squared_distances, usable_range_m
from vastflow.sim.nav2.parameters.amcl import AmclParameters


def walls(*rows):
    """(H, W) of rows of text, the top row first."""
    return np.array([[letter == "#" for letter in row] for row in rows[::-1]])


def nearest(occupied):
    return np.rint(ndimage.distance_transform_edt(~occupied) ** 2)


def table(occupied, **values):
    given = {"range_max_m": 20.0, "z_hit": 0.5, "z_rand": 0.5, "sigma_hit_m": 0.2, "likelihood_max_dist_m": 2.0}
    return likelihood_cubed(np.asarray(occupied), 0.05, **given | values)


def test_round_one_wall_distances_are_euclidean():
    occupied = np.zeros((50, 60), dtype=np.bool_)
    occupied[20, 30] = True
    np.testing.assert_array_equal(squared_distances(occupied, 100), nearest(occupied))
    assert squared_distances(occupied, 3)[20, 30:36].tolist() == [0, 1, 4, 9, UNREACHED, UNREACHED]


def test_cell_belongs_to_the_wall_that_touches_it_first():
    """The upper left cell is √8 from the right wall, but its lower neighbor belongs to the one below."""
    occupied = walls("....", "....", "..#.", "#...")
    expected = nearest(occupied)
    assert expected[3, 0] == 8
    expected[3, 0] = 9
    np.testing.assert_array_equal(squared_distances(occupied, 40), expected)


def test_wavefront_breaks_ties_as_std_priority_queue_does():
    """Pinned: the same wavefront on std::priority_queue, compiled by g++; 117 cells here are not the nearest wall's."""
    rows, columns = np.mgrid[:60, :90]
    occupied = (rows * 7919 + columns * 104729 + rows * columns * 31) % 97 < 2
    found = squared_distances(occupied, 40)
    assert (found != nearest(occupied)).sum() == 117
    assert found.sum() == 77832
    assert zlib.crc32(found.tobytes()) == 2545382306


@given(arrays(np.bool_, (7, 9), elements=st.integers(0, 5).map(lambda n: n == 0)))
@settings(deadline=None)
def test_distance_is_never_less_than_that_to_the_nearest_wall(occupied):
    found = squared_distances(occupied, 40)
    if not occupied.any():
        assert (found == UNREACHED).all()
        return
    rows, columns = np.nonzero(occupied)
    y, x = np.mgrid[:7, :9]
    every = (y[..., None] - rows) ** 2 + (x[..., None] - columns) ** 2
    assert (every == found[..., None]).any(axis=2).all()
    assert (found >= every.min(axis=2)).all()
    # An edge neighbor of a wall can't be reached later than by it.
    assert (found[every.min(axis=2) <= 1] == every.min(axis=2)[every.min(axis=2) <= 1]).all()


def test_cell_likelihood_follows_distance():
    occupied = np.zeros((3, 60), dtype=np.bool_)
    occupied[1, 5] = True
    found = table(occupied, dtype=np.float64)[FRAME + 1, FRAME + 5 :]
    for cells in (0, 1, 4, 39):
        expected = 0.5 * math.exp(-((0.05 * cells) ** 2) / (2 * 0.2**2)) + 0.5 / 20.0
        assert found[cells] == pytest.approx(expected**3, rel=1e-12)


@given(st.integers(1, 400), st.integers(1, 400))
@settings(deadline=None, max_examples=30)
def test_table_has_a_whole_frame_and_an_odd_multiple_of_its_width(rows, columns):
    shape = table(np.zeros((rows, columns), dtype=np.bool_)).shape
    assert shape[0] == rows + 2 * FRAME
    assert columns + 2 * FRAME <= shape[1] < columns + 2 * FRAME + 2 * WIDTH
    assert shape[1] // WIDTH % 2 == 1
    assert shape[1] % WIDTH == 0


def test_usable_range_is_the_narrower_of_scanner_s_and_parameters():
    wide, narrow = (0.164, 20.0), (0.5, 12.0)
    for asked, expected in (((-1.0, 100.0), wide), (narrow, narrow), ((0.1, -1.0), wide), ((0.0, 0.0), wide)):
        q = AmclParameters(laser_min_range=asked[0], laser_max_range=asked[1])
        assert usable_range_m(q, *wide) == expected
