"""Controllers in a closed loop with a robot that does what it is told."""

import math

import numpy as np
import pytest
from alone import Alone, straight
from table import each_row

from vastflow.sim.nav2.parameter_files.chosen import parameters_of
from vastflow.sim.nav2.parameters.dwb import DwbParameters
from vastflow.sim.nav2.parameters.mppi import (
    CostParameters,
    MppiParameters,
    ObstaclesParameters,
    TwirlingParameters,
    VelocityDeadbandParameters,
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


LOPSIDED = np.array([[0.3, 0.42], [0.3, -0.2], [-0.3, -0.2], [-0.3, 0.42]])
POSTS = [(3.025, 0.425), (5.025, 0.425), (7.025, 0.425)]


def posts_hit(rows):
    """Count the posts of one cell of 0.05 m that the lopsided robot had under it."""
    ahead, aside = np.zeros((2, len(rows), len(POSTS)))
    for k, (px, py) in enumerate(POSTS):
        dx, dy = px - rows[:, 0], py - 0.015 - rows[:, 1]
        c, s = np.cos(rows[:, 2]), np.sin(rows[:, 2])
        ahead[:, k], aside[:, k] = c * dx + s * dy, c * dy - s * dx
    return int(((np.abs(ahead) < 0.3) & (aside > -0.2) & (aside < 0.42)).any(axis=0).sum())


def test_dwb_drives_lopsided_robot_past_posts_with_obstacle_footprint():
    """The robot reaches 0.42 m to its left and 0.2 m to its right; BaseObstacle knows its center alone."""
    outlined = DWB.with_values(
        BaseObstacle=DWB.BaseObstacle.with_values(enabled=False),
        ObstacleFootprint=DWB.ObstacleFootprint.with_values(enabled=True, scale=0.02),
    )

    def lethal(x, y):
        return np.any([(np.abs(x - px) < 0.02) & (np.abs(y - py) < 0.02) for px, py in POSTS], axis=0)

    for parameters, hit in ((outlined, 0), (DWB, 3)):
        rows = Alone(parameters, outline=LOPSIDED, inscribed_m=0.2).drive(straight(10.0), START, 60.0, lethal=lethal)
        assert len(rows) < 20 * 60
        assert posts_hit(rows) == hit


def test_mppi_turns_slower_with_the_twirling_critic():
    critic = TwirlingParameters(enabled=True, cost_weight=20.0)
    drives = [
        Alone(each).drive(straight(10.0), (0.0, 0.5, 0.5), 40.0)
        for each in (MPPI.with_values(TwirlingCritic=critic), MPPI)
    ]
    assert [len(rows) < 20 * 40 for rows in drives] == [True, True]
    fastest, fastest_by_default = (np.abs(np.diff(rows[:, 2])).max() for rows in drives)
    assert fastest < 0.75 * fastest_by_default


def test_mppi_keeps_the_speed_of_its_dead_band():
    critic = VelocityDeadbandParameters(enabled=True, deadband_velocities=(0.45, 0.0, 0.0))
    drives = [
        Alone(each).drive(straight(10.0), START, 26.0)
        for each in (MPPI.with_values(VelocityDeadbandCritic=critic), MPPI)
    ]
    assert [len(rows) < 20 * 26 for rows in drives] == [True, True]
    slowest, slowest_by_default = (rows[-20:, 4].min() for rows in drives)
    assert slowest > 0.43
    assert slowest_by_default < 0.4


def test_mppi_backs_along_a_path_exactly_behind():
    """Either turn is as good as the other, so their mean is none: as with Nav2, it reverses."""
    rows = Alone(MPPI).drive(straight(10.0), (1.0, 0.0, math.pi), 8.0)
    assert -0.35 <= rows[-1, 4] < -0.1
    assert rows[-1, 0] > 2.0


def test_mppi_keeps_off_walls_by_the_weight_of_obstacles_critic(over_a_floor):
    cells = np.zeros((80, 280), dtype=bool)
    cells[43:80, 120:160] = True
    stack, nearest = parameters_of({"controller": "mppi"}), []
    # A plan close to the wall leaves the distance to the critic.
    close = stack.global_costmap.inflation_layer.with_values(inflation_radius=0.25)
    stack = stack.with_values(global_costmap=stack.global_costmap.with_values(inflation_layer=close))
    for weight in (0.0, 30.0):
        critic = ObstaclesParameters(
            enabled=True, inflation_radius=0.7, cost_scaling_factor=3.0, repulsion_weight=weight
        )
        parameters = MPPI.with_values(CostCritic=CostParameters(enabled=False), ObstaclesCritic=critic)
        found = over_a_floor(stack.with_values(controller=parameters), cells=cells)
        assert found.run.outcome == "succeeded"
        assert not any(event.kind == "contact" for event in found.run.events)
        beside = (found.columns["x_mm"] > 6000) & (found.columns["x_mm"] < 8000)
        nearest.append(2.15 - found.columns["y_mm"][beside].max() / 1000)
    assert nearest[1] > nearest[0] + 0.05
