"""Values as the records that kernels read, and sine and cosine by polynomials beside libm."""

import math
from dataclasses import dataclass, field

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vastflow.sim.kernels.numeric import njit
from vastflow.sim.kernels.record import record_of
from vastflow.sim.kernels.sincos import rounded, sincos


@dataclass(frozen=True, slots=True)
class Critic:
    cost_weight: float = 3.81
    enabled: bool = True


@dataclass(frozen=True, slots=True)
class Controller:
    time_steps: int = 56
    max_velocity: tuple[float, float, float] = (0.5, 0.0, 2.0)
    CostCritic: Critic = field(default_factory=Critic)


@njit
def read(record):
    q = record[0]
    return q.time_steps, q.max_velocity[2], q.CostCritic.cost_weight, q.CostCritic.enabled


def test_kernel_reads_numbers_lists_and_groups_by_name():
    record = record_of(Controller())
    assert read(record) == (56, 2.0, 3.81, 1)
    assert [record.dtype["time_steps"], record.dtype["CostCritic"]["enabled"]] == [np.int64, np.int64]
    assert record.dtype["CostCritic"]["cost_weight"] == np.float64


@njit
def both(angle_rad):
    return sincos(angle_rad)


@njit
def whole(number):
    return rounded(number)


@given(st.floats(-6000.0, 6000.0))
def test_sine_and_cosine_match_libm(angle_rad):
    assert both(angle_rad) == pytest.approx((math.sin(angle_rad), math.cos(angle_rad)), abs=2e-12)


@given(st.floats(-1e12, 1e12))
def test_rounding_gives_the_nearest_whole_number(number):
    assert whole(number) == round(number)
