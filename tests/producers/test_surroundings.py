"""Surroundings of a path, on maps that are drawn here."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from skimage.morphology import medial_axis
from table import each_row

from vastflow.producers.places.clearance import clearance_of, narrowest_passage_cells, turning_rad

LENGTH = 120


def straight(one, other):
    """Cells from one to the other, each next to the one before."""
    n = max(abs(other[0] - one[0]), abs(other[1] - one[1]))
    return np.rint(np.linspace(one, other, n + 1)).astype(np.int64)


def corridor(width, angle_rad, length=LENGTH):
    """Free cells within half a width of a line through the middle, and cells along that line."""
    rows, columns = np.mgrid[0:length, 0:length] - (length - 1) / 2
    off = np.abs(rows * math.cos(angle_rad) - columns * math.sin(angle_rad))
    middle = (length - 1) / 2
    reach = 0.3 * length * np.array([math.sin(angle_rad), math.cos(angle_rad)])
    ends = np.rint(middle - reach).astype(int), np.rint(middle + reach).astype(int)
    return off < width / 2, straight(*ends)


@given(width=st.integers(4, 60), offset=st.floats(-0.8, 0.8))
@settings(max_examples=40, deadline=None)
def test_corridor_width_is_independent_of_path_offset(width, offset):
    free = np.zeros((100, LENGTH), dtype=bool)
    free[20 : 20 + width] = True
    row = 20 + round((width - 1) / 2 * (1 + offset))
    assert narrowest_passage_cells(clearance_of(free), straight((row, 25), (row, 95))) == pytest.approx(width, abs=0.1)


@given(width=st.integers(8, 40), angle_rad=st.floats(0.0, math.pi))
@settings(max_examples=60, deadline=None)
def test_turned_corridor_has_its_width_to_a_cell_and_a_half(width, angle_rad):
    free, path = corridor(width, angle_rad)
    assert narrowest_passage_cells(clearance_of(free), path) == pytest.approx(width, abs=1.5)


@given(gap=st.integers(4, 30), edge=st.integers(5, 25))
@settings(max_examples=40, deadline=None)
def test_clearance_between_box_and_wall_is_the_gap(gap, edge):
    free = np.zeros((90, LENGTH), dtype=bool)
    free[10:80, 2:-2] = True
    free[10 + gap : 10 + gap + edge, 50 : 50 + edge] = False
    row = 10 + gap // 2
    assert narrowest_passage_cells(clearance_of(free), straight((row, 20), (row, 100))) == pytest.approx(gap, abs=0.1)


@each_row("thickness", [1, 2, 6])
@each_row("width", [8, 17])
def test_door_in_thin_wall_counts(thickness, width):
    free = np.zeros((90, LENGTH), dtype=bool)
    free[5:85, 5:-5] = True
    free[:, 60 : 60 + thickness] = False
    free[40 : 40 + width, 60 : 60 + thickness] = True
    path = np.concatenate([straight((15, 20), (42, 58)), straight((42, 59), (42, 70)), straight((43, 71), (70, 100))])
    assert narrowest_passage_cells(clearance_of(free), path) == pytest.approx(width, abs=0.5)


def test_corner_of_a_room_is_no_passage():
    free = np.zeros((90, 70), dtype=bool)
    free[5:85, 5:65] = True
    path = straight((8, 8), (35, 35))
    assert narrowest_passage_cells(clearance_of(free), path) >= 60 - 1


@given(seed=st.integers(0, 10_000))
@settings(max_examples=25, deadline=None)
def test_medial_axis_bounds_passages_from_below(seed):
    """scikit-image's medial axis: twice its least distance to a wall bounds every passage from below."""
    rng = np.random.default_rng(seed)
    free = np.zeros((80, LENGTH), dtype=bool)
    free[3:77, 3:-3] = True
    for _ in range(6):
        row, column = rng.integers(10, 60), rng.integers(20, 90)
        free[row : row + rng.integers(4, 15), column : column + rng.integers(4, 15)] = False
    path = straight((40, 8), (40, 110))
    path = path[free[path[:, 0], path[:, 1]]]
    found = narrowest_passage_cells(clearance_of(free), path)
    skeleton, distance = medial_axis(free, return_distance=True, rng=1)
    assert found is None or found >= 2 * distance[skeleton].min() - 2


def test_straight_path_has_no_turns_on_grid():
    free = np.ones((60, 120), dtype=bool)
    path = np.concatenate([straight((5, 5), (25, 25)), straight((25, 26), (25, 100))])
    assert turning_rad(path, free) == 0.0


@given(around=st.integers(1, 3))
@settings(max_examples=3, deadline=None)
def test_right_angles_are_quarter_turns(around):
    free = np.zeros((60 + 60 * around, 90), dtype=bool)
    legs, at = [], (10, 10)
    for k in range(2 * around + 1):
        to = (at[0], 80 if at[1] == 10 else 10) if k % 2 == 0 else (at[0] + 50, at[1])
        legs.append(straight(at, to) if not legs else straight(at, to)[1:])
        at = to
    path = np.concatenate(legs)
    for row, column in path:
        free[row - 1 : row + 2, column - 1 : column + 2] = True
    assert turning_rad(path, free) == pytest.approx(around * math.pi, abs=0.35)
