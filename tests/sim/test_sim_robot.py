"""The robot's actuators and the arcs it drives."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vastflow.sim.world.motion import arc, limited, wrapped

SPEEDS = st.floats(-3.0, 3.0)


@given(SPEEDS, SPEEDS, st.floats(0.1, 2.0), st.floats(0.1, 5.0), st.floats(0.001, 0.1))
@settings(deadline=None)
def test_limited_command_keeps_both_limits_and_is_as_near_to_the_command_as_they_allow(
    command, previous, limit, acceleration, dt_s
):
    previous = min(max(previous, -limit), limit)
    found = limited(command, previous, limit, acceleration, dt_s)
    assert abs(found) <= limit
    assert abs(found - previous) <= acceleration * dt_s + 1e-12
    within = min(max(command, -limit), limit)
    assert found == pytest.approx(within) or abs(found - previous) == pytest.approx(acceleration * dt_s)
    assert min(previous, within) - 1e-12 <= found <= max(previous, within) + 1e-12


@given(st.floats(-9, 9), st.floats(-9, 9), st.floats(-4, 4), SPEEDS, SPEEDS, st.floats(0.001, 1.0))
@settings(deadline=None)
def test_arc_is_the_formula_of_the_circle(x, y, yaw, v, w, dt_s):
    new_x, new_y, new_yaw = arc(x, y, yaw, v, w, dt_s)
    assert new_yaw == pytest.approx(yaw + w * dt_s)
    if abs(w) > 1e-3:
        assert new_x == pytest.approx(x + v / w * (math.sin(yaw + w * dt_s) - math.sin(yaw)), abs=1e-9)
        assert new_y == pytest.approx(y - v / w * (math.cos(yaw + w * dt_s) - math.cos(yaw)), abs=1e-9)


@given(st.floats(-4, 4), SPEEDS, SPEEDS)
@settings(deadline=None)
def test_many_short_arcs_are_one_long_arc(yaw, v, w):
    pose = (0.0, 0.0, yaw)
    for _ in range(20):
        pose = arc(*pose, v, w, 0.05)
    assert pose == pytest.approx(arc(0.0, 0.0, yaw, v, w, 1.0), abs=1e-9)


def test_without_turning_the_arc_is_a_straight_line():
    assert arc(1.0, 2.0, math.pi / 2, 0.5, 0.0, 2.0) == pytest.approx((1.0, 3.0, math.pi / 2))


@given(st.floats(-50, 50))
@settings(deadline=None)
def test_wrapped_angle_is_the_same_direction_between_minus_pi_and_pi(angle):
    found = wrapped(angle)
    assert -math.pi <= found < math.pi
    assert math.cos(found - angle) == pytest.approx(1.0)
