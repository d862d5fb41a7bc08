"""Rules of Regulated Pure Pursuit; `test_sim_nav2_conformance` has its commands beside Nav2's answers."""

import math

import alone
import numpy as np
import pytest
from alone import CELLS, Alone, walls
from table import each_row

from vastflow.sim.nav2.parameters.rpp import RppParameters

CORNER, CENTER = (0.0, 0.0), (1.512, 1.493)
DEFAULT = RppParameters()


def straight(bearing=0.0, start=CENTER, length_m=1.4):
    return alone.straight(length_m, bearing, start)


def command(plan, costs=None, yaw=0.0, twist=(0.5, 0.0), parameters=DEFAULT, controller=None, end_yaw=0.0):
    controller = controller or Alone(parameters, CORNER)
    return controller.command(plan, costs, (*CENTER, yaw), twist, (*plan[-1], end_yaw))[:3]


@each_row(
    ("values", "lookahead_m"),
    [
        ({}, 0.6),
        ({"lookahead_dist": 0.4}, 0.4),
        ({"use_velocity_scaled_lookahead_dist": True, "lookahead_time": 1.5}, 0.45),
        ({"use_fixed_curvature_lookahead": True, "curvature_lookahead_dist": 0.5}, 0.5),
    ],
)
def test_curvature_is_that_of_the_arc_to_the_carrot(values, lookahead_m):
    _, v, w = command(straight(0.3), twist=(0.3, 0.0), parameters=DEFAULT.with_values(**values))
    assert w / v == pytest.approx(2.0 * math.sin(0.3) / lookahead_m)


def test_reversing_looks_no_farther_than_the_goal_at_a_turn_in_place():
    turn = np.linspace(0.0, math.pi, 16)
    around = np.array(CENTER) + [0.4, 0.1] + 0.1 * np.column_stack([np.sin(turn), -np.cos(turn)])
    back = np.array(CENTER) + np.column_stack([np.arange(0.38, 0.19, -0.02), np.full(10, 0.2)])
    hook = np.vstack([straight(length_m=0.4), around, back])
    reversing = DEFAULT.with_values(allow_reversing=True, use_rotate_to_heading=False)
    turning = np.vstack([hook, hook[-1:]])
    assert command(hook, parameters=reversing)[2] > 0.5
    assert command(turning, parameters=reversing)[2] == pytest.approx(0.0, abs=1e-9)


def test_robot_drives_a_bow_towards_a_plan_behind_without_rotation():
    valid, v, w = command(straight(2.0), parameters=DEFAULT.with_values(use_rotate_to_heading=False))
    assert (valid, v) == (True, pytest.approx(0.25))
    assert w == pytest.approx(0.25 * 2.0 * math.sin(2.0) / 0.6)


def test_robot_backs_towards_a_plan_behind_if_it_may_reverse():
    valid, v, w = command(straight(math.pi), parameters=DEFAULT.with_values(allow_reversing=True))
    assert (valid, v, w) == (True, pytest.approx(-0.5), pytest.approx(0.0, abs=1e-9))


def test_carrot_is_no_farther_than_the_cusp_if_it_may_reverse():
    there = straight(0.3, length_m=0.4)
    plan = np.concatenate([there, straight(2.5, start=there[-1])[1:]])
    _, v, w = command(plan, parameters=DEFAULT.with_values(allow_reversing=True))
    assert w / v == pytest.approx(2.0 * math.sin(0.3) / 0.375, rel=1e-3)


def test_reached_goal_holds_until_a_reset_in_a_controller_with_state():
    controller = Alone(DEFAULT, CORNER)
    command(straight(length_m=0.1), controller=controller)
    assert command(straight(), controller=controller, end_yaw=1.0)[1] == 0.0
    controller.reset()
    assert command(straight(), controller=controller, end_yaw=1.0)[1] == pytest.approx(0.5)
    controller = Alone(DEFAULT.with_values(stateful=False), CORNER)
    assert command(straight(length_m=0.1), controller=controller)[1] == 0.0
    assert command(straight(), controller=controller)[1] == pytest.approx(0.5)


def test_rpp_ignores_wall_beyond_one_second():
    # The last step within a second is at 0.45 m, where the outline reaches 2.192 m, and the wall begins at 2.2 m.
    brisk = DEFAULT.with_values(cost_scaling_dist=0.1)
    assert command(straight(), walls((0, CELLS, 44, 46)), parameters=brisk) == (True, pytest.approx(0.5), 0.0)
    assert not command(straight(), walls((0, CELLS, 43, 46)), parameters=brisk)[0]


def test_rpp_drives_into_wall_without_collision_detection():
    blind = DEFAULT.with_values(use_collision_detection=False)
    assert command(straight(), walls((0, CELLS, 42, 44)), parameters=blind)[0]
