"""Dubins' and Reeds–Shepp's shortest curves: they end where they should, and none is longer than it must be."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from table import each_row

from vastflow.sim.nav2.planners.curves import pose_on, shortest

LENGTHS = st.floats(-8.0, 8.0)
ANGLES = st.floats(-math.pi, math.pi)


def apart(one, other):
    return abs(math.remainder(one - other, 2.0 * math.pi))


@settings(max_examples=400, deadline=None)
@given(LENGTHS, LENGTHS, ANGLES, st.booleans())
def test_curve_ends_at_the_pose_it_is_for(x, y, heading, reverses):
    curve = shortest(x, y, heading, reverses)
    end_x, end_y, end_heading, _ = pose_on(curve, curve[0])
    assert math.hypot(end_x - x, end_y - y) < 1e-6
    assert apart(end_heading, heading) < 1e-6


@settings(max_examples=200, deadline=None)
@given(LENGTHS, LENGTHS, ANGLES)
def test_curve_is_no_shorter_than_a_line_and_no_longer_by_reversing(x, y, heading):
    forward, either = shortest(x, y, heading, False)[0], shortest(x, y, heading, True)[0]
    assert math.hypot(x, y) - 1e-9 <= either <= forward + 1e-9


@settings(max_examples=100, deadline=None)
@given(LENGTHS, LENGTHS, ANGLES, st.booleans())
def test_nowhere_on_a_curve_is_a_turn_tighter_than_the_radius(x, y, heading, reverses):
    curve = shortest(x, y, heading, reverses)
    step = 0.01
    poses = np.array([pose_on(curve, along)[:3] for along in np.arange(0.0, curve[0] + step, step)])
    turned = np.abs(np.remainder(np.diff(poses[:, 2]) + math.pi, 2.0 * math.pi) - math.pi)
    assert (turned <= step + 1e-9).all()
    assert (np.hypot(*np.diff(poses[:, :2], axis=0).T) <= step + 1e-9).all()


@each_row(
    ("pose", "dubins", "reeds_shepp"),
    [
        ((5.0, 0.0, 0.0), 5.0, 5.0),
        ((1.0, 1.0, math.pi / 2), math.pi / 2, math.pi / 2),
        ((0.0, 2.0, math.pi), math.pi, math.pi),
        ((0.0, 0.0, math.pi), 7.0 * math.pi / 3.0, math.pi),
    ],
)
def test_lengths_that_geometry_gives(pose, dubins, reeds_shepp):
    assert shortest(*pose, True)[0] == pytest.approx(reeds_shepp)
    assert shortest(*pose, False)[0] == pytest.approx(dubins)
