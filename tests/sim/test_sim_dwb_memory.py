"""What DWB remembers from one command to the next: turns that it reversed, and a goal that it reached."""

import math

import numpy as np
import pytest
from table import each_row

from vastflow.sim.kernels.numeric import njit
from vastflow.sim.kernels.record import record_of
from vastflow.sim.nav2.controllers import dwb
from vastflow.sim.nav2.controllers.controller import ControllerInput
from vastflow.sim.nav2.costmaps.outline import padded_outline
from vastflow.sim.nav2.costmaps.window import Window
from vastflow.sim.nav2.parameters.dwb import DwbParameters

CELLS = 60
RESOLUTION_M = 0.05
OUTLINE = padded_outline(0.22, 0.01)
CENTER = (1.512, 1.493)
HUMBLE = DwbParameters()


@njit
def commanded(records, memory, window, outline, pose, twist, plan, n, goal):
    situation = ControllerInput(window, outline, 0.2255, pose, twist, plan[:n], 0.0, goal, 0.05, 0.0)
    return dwb.compute_velocity(records[0], memory, situation)[:3]


@njit
def renewed(memory):
    dwb.reset(memory)


def window():
    """Nothing in the way."""
    return Window(np.zeros((CELLS, CELLS), dtype=np.uint8), np.array([0.0, 0.0, RESOLUTION_M]))


def straight(bearing=0.0):
    s = np.arange(0.0, 1.45, 0.025)
    return np.column_stack([CENTER[0] + s * math.cos(bearing), CENTER[1] + s * math.sin(bearing)])


def chosen(parameters, w, pose, twist, plan, goal, memory):
    return commanded(record_of(parameters), memory, w, OUTLINE, pose, twist, plan, len(plan), goal)


def test_that_the_goal_was_reached_holds_until_a_reset():
    memory = dwb.new_memory(HUMBLE, CELLS, CELLS)
    near = (CENTER[0] + 0.1, CENTER[1], 1.5)
    far = (CENTER[0] + 3.0, CENTER[1], 1.5)
    chosen(HUMBLE, window(), (*CENTER, 0.0), (0.0, 0.0), straight(), near, memory)
    assert chosen(HUMBLE, window(), (*CENTER, 0.0), (0.0, 0.0), straight(), far, memory)[1] == 0.0
    renewed(memory)
    assert chosen(HUMBLE, window(), (*CENTER, 0.0), (0.0, 0.0), straight(), far, memory)[1] == pytest.approx(0.26)


def turning_about(memory, parameters, moved_m=0.0, turned_rad=0.0):
    """Turn left, then right as the plan flips, then see what comes when it flips back."""
    x, y = CENTER
    left, right = straight(2.0), straight(-2.0)
    commands = []
    for plan, pose in (
        (left, (x, y, 0.0)),
        (right, (x, y, 0.0)),
        (left, (x + moved_m, y, turned_rad)),
        (left, (x + moved_m, y, turned_rad)),
    ):
        goal = (*(plan[-1] + 3.0 * (plan[-1] - plan[0])), 0.0)
        commands.append(chosen(parameters, window(), pose, (0.0, 0.0), plan, goal, memory)[2])
    return commands


IN_PLACE = HUMBLE.with_values(max_vel_x=0.0)


def test_turn_that_was_reversed_is_not_reversed_again_on_the_spot():
    first, second, third, fourth = turning_about(dwb.new_memory(IN_PLACE, CELLS, CELLS), IN_PLACE)
    assert first > 0.0 > second
    assert third < 0.0
    assert fourth < 0.0


@each_row(("moved_m", "turned_rad"), [(0.06, 0.0), (0.0, -0.25)])
def test_once_moved_or_turned_the_robot_may_reverse_its_turn_again(moved_m, turned_rad):
    memory = dwb.new_memory(IN_PLACE, CELLS, CELLS)
    *_, third, fourth = turning_about(memory, IN_PLACE, moved_m, turned_rad)
    assert third < 0.0 < fourth


@each_row(("moved_m", "turned_rad"), [(0.04, 0.0), (0.0, -0.15)])
def test_smaller_move_does_not_lift_the_restriction(moved_m, turned_rad):
    *_, fourth = turning_about(dwb.new_memory(IN_PLACE, CELLS, CELLS), IN_PLACE, moved_m, turned_rad)
    assert fourth < 0.0


def test_without_oscillation_a_turn_may_be_reversed_at_once():
    free = IN_PLACE.with_values(Oscillation=HUMBLE.Oscillation.with_values(enabled=False))
    *_, third, fourth = turning_about(dwb.new_memory(free, CELLS, CELLS), free)
    assert third > 0.0
    assert fourth > 0.0


def test_yaw_rates_of_a_robot_that_drives_are_free():
    memory = dwb.new_memory(HUMBLE, CELLS, CELLS)
    goals = [(CENTER[0] + 3.0, CENTER[1] + y, 0.0) for y in (2.0, -2.0, 2.0)]
    plans = [straight(math.atan2(goal[1] - CENTER[1], 3.0)) for goal in goals]
    turns = [
        chosen(HUMBLE, window(), (*CENTER, 0.0), (0.26, 0.0), p, g, memory) for p, g in zip(plans, goals, strict=True)
    ]
    assert all(v > 0.05 for _, v, _ in turns)
    assert [math.copysign(1, w) for *_, w in turns] == [1, -1, 1]
