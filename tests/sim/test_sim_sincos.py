"""Sine and cosine by polynomials, against libm."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vastflow.sim.kernels.numeric import njit
from vastflow.sim.kernels.sincos import rounded, sincos


@njit
def both(angle_rad):
    return sincos(angle_rad)


@njit
def whole(number):
    return rounded(number)


@given(st.floats(-6000.0, 6000.0))
def test_sine_and_cosine_are_those_of_libm(angle_rad):
    assert both(angle_rad) == pytest.approx((math.sin(angle_rad), math.cos(angle_rad)), abs=2e-12)


@given(st.floats(-1e12, 1e12))
def test_rounding_gives_the_nearest_whole_number(number):
    assert whole(number) == round(number)
