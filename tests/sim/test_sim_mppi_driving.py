"""Tests of the driving of a robot with MPPI."""

import math

import numpy as np

from vastflow.sim.kernels.numeric import njit
from vastflow.sim.kernels.record import record_of
from vastflow.sim.nav2.controllers import mppi
from vastflow.sim.nav2.controllers.controller import ControllerInput
from vastflow.sim.nav2.costmaps.outline import padded_outline
from vastflow.sim.nav2.costmaps.window import Window
from vastflow.sim.nav2.parameter_files.chosen import parameters_of
from vastflow.sim.nav2.parameters.mppi import (
    CostParameters,
    MppiParameters,
    ObstaclesParameters,
    TwirlingParameters,
    VelocityDeadbandParameters,
)
from vastflow.sim.world.motion import arc

PARAMETERS = MppiParameters()
OUTLINE = padded_outline(0.22, 0.01)


@njit
def command_of(record, memory, window, outline, pose, twist, plan, goal):
    situation = ControllerInput(window, outline, 0.2255, pose, twist, plan, 0.0, goal, 0.05, 0.0)
    return mppi.compute_velocity(record[0], memory, situation)[:3]


def driven(parameters, pose=(0.0, 0.0, 0.0), length_m=10.0, seconds=20.0):
    """Drive a unicycle without limits along x; return its track (N, 4) of x, y, yaw, and v."""
    memory = mppi.new_memory(parameters, np.array([7], dtype=np.uint64), goal_tolerance_m=0.25)
    record, x = record_of(parameters), np.arange(0.0, length_m, 0.025)
    path = np.column_stack([x, np.zeros(len(x))])
    twist, track = (0.0, 0.0), []
    goal = (length_m, 0.0, 0.0)
    for _ in range(int(seconds / 0.05)):
        begin = int(np.argmin(np.hypot(*(path - pose[:2]).T)))
        ahead = path[begin : begin + 68]
        place = np.array([math.floor(pose[0] / 0.05) * 0.05 - 1.5, math.floor(pose[1] / 0.05) * 0.05 - 1.5, 0.05])
        win = Window(np.zeros((60, 60), dtype=np.uint8), place)
        ahead = ahead[np.abs(ahead[:, 0] - pose[0]) < 1.45]
        _, v, w = command_of(record, memory, win, OUTLINE, pose, twist, ahead.copy(), goal)
        pose, twist = arc(*pose, v, w, 0.05), (v, w)
        track.append((*pose, v))
        if math.hypot(pose[0] - length_m, pose[1]) < 0.2:
            break
    return np.array(track)


def test_robot_on_a_straight_path_reaches_its_speed_and_keeps_to_it():
    track = driven(PARAMETERS)
    assert 0.45 <= track[60:200, 3].mean() <= 0.5
    assert np.abs(track[:, 1]).max() < 0.1


def test_robot_with_the_twirling_critic_drives_ten_meters_and_turns_slower():
    critics = {"TwirlingCritic": TwirlingParameters(enabled=True, cost_weight=20.0)}
    tracks = [driven(PARAMETERS.with_values(**each), (0.0, 0.5, 0.5), seconds=40.0) for each in (critics, {})]
    assert [abs(each[-1, 0] - 10.0) < 0.25 for each in tracks] == [True, True]
    fastest, fastest_by_default = (np.abs(np.diff(each[:, 2])).max() for each in tracks)
    assert fastest < 0.75 * fastest_by_default


def test_weights_of_obstacles_critic_set_the_distance_to_a_wall(over_a_floor):
    cells = np.zeros((80, 280), dtype=bool)
    cells[43:80, 120:160] = True
    stack, nearest = parameters_of({"controller": "mppi"}), []
    # A plan close to the wall leaves the distance to the critic.
    close = stack.global_costmap.inflation_layer.with_values(inflation_radius=0.25)
    stack = stack.with_values(global_costmap=stack.global_costmap.with_values(inflation_layer=close))
    for weight in (0.0, 30.0):
        critics = {
            "CostCritic": CostParameters(enabled=False),
            "ObstaclesCritic": ObstaclesParameters(
                enabled=True, inflation_radius=0.7, cost_scaling_factor=3.0, repulsion_weight=weight
            ),
        }
        found = over_a_floor(stack.with_values(controller=PARAMETERS.with_values(**critics)), cells=cells)
        assert found.run.outcome == "succeeded"
        assert not any(event.kind == "contact" for event in found.run.events)
        beside = (found.columns["x_mm"] > 6000) & (found.columns["x_mm"] < 8000)
        nearest.append(2.15 - found.columns["y_mm"][beside].max() / 1000)
    assert nearest[1] > nearest[0] + 0.05


def test_robot_with_a_dead_band_drives_ten_meters_and_ends_no_slower():
    never_slow = VelocityDeadbandParameters(enabled=True, deadband_velocities=(0.45, 0.0, 0.0))
    critics = {"VelocityDeadbandCritic": never_slow}
    tracks = [driven(PARAMETERS.with_values(**each), seconds=26.0) for each in (critics, {})]
    assert [abs(each[-1, 0] - 10.0) < 0.25 for each in tracks] == [True, True]
    slowest, slowest_by_default = (each[-20:, 3].min() for each in tracks)
    assert slowest > 0.45
    assert slowest_by_default < 0.3


def test_robot_backs_along_a_path_that_lies_exactly_behind_it():
    """Either turn is as good as the other, so their mean is none: as with Nav2, it reverses."""
    track = driven(PARAMETERS, pose=(1.0, 0.0, math.pi), seconds=8.0)
    assert -0.35 <= track[-1, 3] < -0.1
    assert track[-1, 0] > 2.0
