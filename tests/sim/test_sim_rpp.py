"""Regulated Pure Pursuit beside a plain reading of it, and the rules that has not.

`test_sim_nav2_conformance` has it beside Nav2's answers.
"""

import math

import alone
import numpy as np
import pytest
from alone import CELLS, INSCRIBED_M, OUTLINE, RESOLUTION_M, Alone, walls
from hypothesis import given, settings
from hypothesis import strategies as st

from vastflow.sim.kernels.numeric import njit
from vastflow.sim.nav2.costmaps.outline import circumscribed_radius_m
from vastflow.sim.nav2.costmaps.window import Window, outline_hits
from vastflow.sim.nav2.parameters.rpp import RppParameters

CORNER, CENTER = (0.0, 0.0), (1.512, 1.493)
DEFAULT = RppParameters()


@njit
def hits(window, outline, x, y, yaw):
    return outline_hits(window, outline, x, y, yaw)


def straight(bearing=0.0, start=CENTER, length_m=1.4):
    return alone.straight(length_m, bearing, start)


def command(plan, costs=None, yaw=0.0, twist=(0.5, 0.0), parameters=DEFAULT, controller=None, end_yaw=0.0):
    controller = controller or Alone(parameters, CORNER)
    return controller.command(plan, costs, (*CENTER, yaw), twist, (*plan[-1], end_yaw))[:3]


def plain_carrot(points, lookahead):
    """Carrot in the robot's frame, from points in it."""
    far = [k for k, (x, y) in enumerate(points) if math.hypot(x, y) >= lookahead]
    if not far:
        return points[-1]
    if far[0] == 0:
        return points[0]
    (x1, y1), (x2, y2) = points[far[0] - 1], points[far[0]]
    dx, dy, cross = x2 - x1, y2 - y1, x1 * y2 - x2 * y1
    square, side = dx * dx + dy * dy, math.copysign(1.0, math.hypot(x2, y2) - math.hypot(x1, y1))
    root = math.sqrt(lookahead**2 * square - cross**2)
    return (cross * dy + side * dx * root) / square, (-cross * dx + side * dy * root) / square


def plain_command(p, costs, pose, twist, plan, end_yaw, at_goal_m):
    x0, y0, yaw = pose
    c, s = math.cos(yaw), math.sin(yaw)
    points = [(c * (x - x0) + s * (y - y0), -s * (x - x0) + c * (y - y0)) for x, y in plan]
    lookahead = p.lookahead_dist
    if p.use_velocity_scaled_lookahead_dist:
        lookahead = np.clip(abs(twist[0]) * p.lookahead_time, p.min_lookahead_dist, p.max_lookahead_dist)
    carrot = plain_carrot(points, lookahead)
    carrot_m = math.hypot(*carrot)
    bend = plain_carrot(points, p.curvature_lookahead_dist) if p.use_fixed_curvature_lookahead else carrot
    bearing = math.atan2(bend[1], bend[0])
    at_goal = carrot_m < at_goal_m
    if at_goal or abs(bearing) > p.rotate_to_heading_min_angle:
        angle = (end_yaw - yaw + math.pi) % (2 * math.pi) - math.pi if at_goal else bearing
        sign = 1.0 if angle > 0.0 else -1.0
        w = np.clip(sign * p.rotate_to_heading_angular_vel, twist[1] - 0.16, twist[1] + 0.16)
        stopping = math.sqrt(2 * p.max_angular_accel * abs(angle))
        v, w = 0.0, sign * stopping if abs(w) > stopping else w
    else:
        square = bend[0] ** 2 + bend[1] ** 2
        curvature = 2 * bend[1] / square if square > 0.001 else 0.0
        v = p.desired_linear_vel
        if abs(curvature) > 1.0 / p.regulated_linear_scaling_min_radius:
            v = p.desired_linear_vel / abs(curvature) / p.regulated_linear_scaling_min_radius
        cost = int(costs[math.floor(y0 / RESOLUTION_M), math.floor(x0 / RESOLUTION_M)])
        if cost > 0:
            clearance = INSCRIBED_M - math.log(cost / 253) / p.inflation_cost_scaling_factor
            if clearance < p.cost_scaling_dist:
                v = min(v, p.desired_linear_vel * p.cost_scaling_gain * clearance / p.cost_scaling_dist)
        v = max(v, p.regulated_linear_scaling_min_speed)
        if np.hypot(*np.diff(plan, axis=0).T).sum() < p.approach_velocity_scaling_dist:
            scale = math.hypot(*points[-1]) / p.approach_velocity_scaling_dist
            v = min(v, max(v * scale, p.min_approach_linear_velocity))
        v = min(v, p.desired_linear_vel)
        w = v * curvature
    return (False, 0.0, 0.0) if plain_collision(p, costs, pose, v, w, carrot_m) else (True, v, w)


def plain_collision(p, costs, pose, v, w, carrot_m):
    window = Window(costs, np.array([*CORNER, RESOLUTION_M]))
    if hits(window, OUTLINE, *pose):
        return True
    if abs(v) < 0.01 and abs(w) > 0.01:
        dt = 2 * math.sin(RESOLUTION_M / 2 / circumscribed_radius_m(OUTLINE)) / abs(w)
    else:
        dt = RESOLUTION_M / abs(v) if v != 0.0 else math.inf
    x, y, yaw = pose
    for _ in range(math.ceil(p.max_allowed_time_to_collision_up_to_carrot / dt) - 1):
        x, y, yaw = x + dt * v * math.cos(yaw), y + dt * v * math.sin(yaw), yaw + dt * w
        if math.dist((x, y), pose[:2]) > carrot_m:
            return False
        if hits(window, OUTLINE, x, y, yaw):
            return True
    return False


VARIANTS = [
    DEFAULT.with_values(use_velocity_scaled_lookahead_dist=True, use_fixed_curvature_lookahead=True),
    DEFAULT.with_values(desired_linear_vel=0.3, lookahead_dist=0.35, rotate_to_heading_min_angle=1.4),
]


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    yaw=st.floats(-3.1, 3.1),
    end_yaw=st.floats(-3.1, 3.1),
    v=st.floats(0.0, 0.5),
    w=st.floats(-1.8, 1.8),
    points=st.integers(2, 57),
    parameters=st.sampled_from(VARIANTS),
)
def test_command_is_that_of_the_plain_reading(seed, yaw, end_yaw, v, w, points, parameters):
    rng = np.random.default_rng(seed)
    heading = yaw + rng.normal(0.0, 0.6) + np.cumsum(rng.normal(0.0, 0.1, points))
    # A spacing of which no multiple is a threshold: there rounding decides.
    steps = 0.0247 * np.column_stack([np.cos(heading), np.sin(heading)])
    plan = np.array(CENTER) + rng.normal(0.0, 0.03, 2) + np.cumsum(steps, axis=0)
    costs = walls(*((r, r + 3, c, c + 3) for r, c in rng.integers(0, 57, (2, 2))))
    expected = plain_command(parameters, costs, (*CENTER, yaw), (v, w), plan, end_yaw, 0.25)
    got = command(plan, costs, yaw, (v, w), parameters, end_yaw=end_yaw)
    assert got == pytest.approx(expected, abs=1e-9)


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


def test_reached_goal_holds_until_a_reset():
    controller = Alone(DEFAULT, CORNER)
    command(straight(length_m=0.1), controller=controller)
    assert command(straight(), controller=controller, end_yaw=1.0)[1] == 0.0
    controller.reset()
    assert command(straight(), controller=controller, end_yaw=1.0)[1] == pytest.approx(0.5)


def test_controller_without_state_forgets_at_once_that_it_was_at_the_goal():
    controller = Alone(DEFAULT.with_values(stateful=False), CORNER)
    assert command(straight(length_m=0.1), controller=controller)[1] == 0.0
    assert command(straight(), controller=controller)[1] == pytest.approx(0.5)


def test_rpp_ignores_wall_beyond_one_second():
    # The last step within a second is at 0.45 m, where the outline reaches 2.192 m, and the wall begins at 2.2 m.
    brisk = DEFAULT.with_values(cost_scaling_dist=0.1)
    assert command(straight(), walls((0, CELLS, 44, 46)), parameters=brisk) == (True, pytest.approx(0.5), 0.0)
    assert not command(straight(), walls((0, CELLS, 43, 46)), parameters=brisk)[0]


def test_turns_in_place_are_checked_in_steps_of_a_cell():
    costs, found = np.zeros((CELLS, CELLS), dtype=np.uint8), []
    for row, column in np.add(np.argwhere(np.ones((11, 11))), [24, 25]):
        costs[row, column] = 254
        found.append(command(straight(3.0), costs, twist=(0.0, 1.7))[0])
        expected = not plain_collision(DEFAULT, costs, (*CENTER, 0.0), 0.0, 1.8, 0.6)
        assert found[-1] == expected, (row, column)
        costs[row, column] = 0
    assert 20 < found.count(False) < 60


def test_rpp_drives_into_wall_without_collision_detection():
    blind = DEFAULT.with_values(use_collision_detection=False)
    assert command(straight(), walls((0, CELLS, 42, 44)), parameters=blind)[0]
