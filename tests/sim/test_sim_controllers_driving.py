"""Controllers in a closed loop with a robot that does what it is told."""

import math

import numpy as np
import pytest
from alone import Alone, straight
from table import each_row

from vastflow.sim.nav2.parameters.dwb import DwbParameters
from vastflow.sim.nav2.parameters.mppi import (
    MppiParameters,
)
from vastflow.sim.nav2.parameters.rpp import RppParameters

MPPI, RPP = MppiParameters(), RppParameters()
DWB = DwbParameters(max_vel_x=0.5, max_speed_xy=0.5)
START = (0.0, 0.0, 0.0)


def bend():
    """Three meters along x, a quarter circle of 0.6 m to the left, two meters along y."""
    turn = np.arange(0.0, np.pi / 2, 0.025 / 0.6)
    curve = np.column_stack([3.0 + 0.6 * np.sin(turn), 0.6 - 0.6 * np.cos(turn)])
    return np.concatenate([straight(3.0), curve, straight(2.0)[:, ::-1] + [3.6, 0.6]])


@each_row(("parameters", "aside_m"), [(DWB, 0.05), (RPP, 0.05), (MPPI, 0.1)])
def test_controller_drives_straight_path_at_full_speed_close_to_the_line(parameters, aside_m):
    rows = Alone(parameters).drive(straight(10.0), (0.0, 0.03, 0.05), 26.0)
    assert len(rows) < 20 * 26
    assert np.abs(rows[40:, 1]).max() < aside_m
    assert np.median(rows[:, 4]) == pytest.approx(0.5, abs=0.02)


def test_dwb_drives_at_the_speed_of_humble():
    rows = Alone(DwbParameters()).drive(straight(3.0), START, 40.0)
    # Of samples that end in the same cells the slowest comes first, so the mean is a little below the limit.
    assert rows[:, 4].max() == pytest.approx(0.26)
    assert 0.23 < rows[20:-20, 4].mean() < 0.26


@each_row("parameters", [DWB, RPP])
def test_controller_follows_a_bend_to_the_goal_and_its_heading(parameters):
    path = bend()
    rows = Alone(parameters).drive(path, START, 60.0, math.pi / 2)
    away = np.hypot(rows[:, None, 0] - path[:, 0], rows[:, None, 1] - path[:, 1]).min(axis=1)
    assert len(rows) < 20 * 60
    assert away.max() < 0.2


@each_row("parameters", [DWB, RPP])
def test_controller_turns_at_the_goal_to_a_heading_behind(parameters):
    rows = Alone(parameters).drive(straight(2.0), START, 30.0, 3.0)
    assert len(rows) < 20 * 30
    assert rows[-1, 4] == 0.0


@each_row("parameters", [DWB, RPP])
def test_controller_passes_a_post_close_beside_the_path(parameters):
    rows = Alone(parameters).drive(straight(4.0), START, 30.0, lethal=lambda x, y: np.hypot(x - 2.0, y - 0.3) < 0.05)
    assert rows[:, 3].all()
    assert len(rows) < 20 * 30


def test_mppi_backs_along_a_path_exactly_behind():
    """Either turn is as good as the other, so their mean is none: as with Nav2, it reverses."""
    rows = Alone(MPPI).drive(straight(10.0), (1.0, 0.0, math.pi), 8.0)
    assert -0.35 <= rows[-1, 4] < -0.1
    assert rows[-1, 0] > 2.0
