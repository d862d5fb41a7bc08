"""DWB and Regulated Pure Pursuit in a closed loop with a robot that does what it is told."""

import math

import numpy as np
import pytest

from vastflow.sim.kernels.numeric import njit
from vastflow.sim.kernels.record import record_of
from vastflow.sim.nav2.controllers import dwb, rpp
from vastflow.sim.nav2.controllers.controller import ControllerInput
from vastflow.sim.nav2.costmaps.inflation import inflate
from vastflow.sim.nav2.costmaps.outline import padded_outline
from vastflow.sim.nav2.costmaps.window import Window
from vastflow.sim.nav2.parameters.dwb import DwbParameters
from vastflow.sim.nav2.parameters.rpp import RppParameters
from vastflow.sim.world.motion import arc

CELLS = 60
RESOLUTION_M = 0.05
OUTLINE = padded_outline(0.22, 0.01)
INSCRIBED_M = 0.22549849971227903
DWB = DwbParameters().with_values(max_vel_x=0.5, max_speed_xy=0.5)


@njit
def dwb_command(records, memory, window, outline, inscribed, pose, twist, plan, n, end_yaw, goal):
    situation = ControllerInput(window, outline, inscribed, pose, twist, plan[:n], end_yaw, goal, 0.05, 0.0)
    return dwb.compute_velocity(records[0], memory, situation)[:3]


@njit
def rpp_command(records, memory, window, outline, inscribed, pose, twist, plan, n, end_yaw, goal):
    situation = ControllerInput(window, outline, inscribed, pose, twist, plan[:n], end_yaw, goal, 0.05, 0.0)
    return rpp.compute_velocity(records[0], memory, situation)


def dwb_controller(parameters=DWB):
    return dwb_command, record_of(parameters), dwb.new_memory(parameters, CELLS, CELLS)


def rpp_controller():
    return rpp_command, record_of(RppParameters()), rpp.new_memory(0.25)


CONTROLLERS = pytest.mark.parametrize("controller", [dwb_controller, rpp_controller])


def window_at(x, y, lethal, inscribed_m=INSCRIBED_M):
    """The rolling window round a position: cells whose center (x, y) `lethal` says are so, inflated."""
    corner = [(math.floor(v / RESOLUTION_M) - CELLS // 2) * RESOLUTION_M for v in (x, y)]
    centers = (np.arange(CELLS) + 0.5) * RESOLUTION_M
    xs, ys = np.meshgrid(corner[0] + centers, corner[1] + centers)
    costs = np.where(lethal(xs, ys), 254, 0).astype(np.uint8)
    return Window(inflate(costs, RESOLUTION_M, inscribed_m, 0.55, 3.0), np.array([*corner, RESOLUTION_M]))


def drive(
    controller,
    path,
    goal_yaw,
    pose,
    seconds,
    lethal=lambda x, y: np.zeros(x.shape, dtype=bool),
    outline=OUTLINE,
    inscribed_m=INSCRIBED_M,
):
    """Rows (x, y, yaw, valid, v, ω) at 20 Hz, until the goal checker of Nav2's defaults is content."""
    command, records, memory = controller
    rows, twist, goal = [], (0.0, 0.0), (*path[-1], goal_yaw)
    for k in range(int(seconds * 20)):
        if k % 4 == 0:
            window = window_at(pose[0], pose[1], lethal, inscribed_m)
        nearest = int(np.argmin(np.hypot(*(path - pose[:2]).T)))
        near = np.hypot(*(path[nearest:] - pose[:2]).T) < 1.4
        n = int(np.argmin(near)) if not near.all() else len(near)
        end_yaw = goal_yaw if nearest + n == len(path) else 0.0
        valid, v, w = command(
            records, memory, window, outline, inscribed_m, pose, twist, path[nearest:], n, end_yaw, goal
        )
        rows.append((*pose, valid, v, w))
        twist = (v, w)
        pose = arc(*pose, v, w, 0.05)
        away_rad = abs((goal_yaw - pose[2] + math.pi) % (2 * math.pi) - math.pi)
        if math.dist(pose[:2], path[-1]) <= 0.25 and away_rad <= 0.25:
            break
    return np.array(rows, dtype=float)


def line(length_m):
    return np.column_stack([np.arange(0.0, length_m, 0.025), np.zeros(round(length_m / 0.025))])


def bend():
    """Three meters along x, a quarter circle of 0.6 m to the left, two meters along y."""
    turn = np.arange(0.0, np.pi / 2, 0.025 / 0.6)
    curve = np.column_stack([3.0 + 0.6 * np.sin(turn), 0.6 - 0.6 * np.cos(turn)])
    return np.concatenate([line(3.0), curve, line(2.0)[:, ::-1] + [3.6, 0.6]])


@CONTROLLERS
def test_ten_meters_straight_are_driven_at_full_speed_and_close_to_the_line(controller):
    rows = drive(controller(), line(10.0), 0.0, (0.0, 0.03, 0.05), 40.0)
    assert len(rows) < 20 * 26
    assert np.abs(rows[40:, 1]).max() < 0.05
    assert np.median(rows[:, 4]) == pytest.approx(0.5)


def test_dwb_drives_at_humbles_own_speed():
    rows = drive(dwb_controller(DwbParameters()), line(3.0), 0.0, (0.0, 0.0, 0.0), 40.0)
    # Of samples that end in the same cells the slowest comes first, so the mean is a little below the limit.
    assert rows[:, 4].max() == pytest.approx(0.26)
    assert 0.23 < rows[20:-20, 4].mean() < 0.26


@CONTROLLERS
def test_bend_is_followed_to_the_goal_and_its_heading(controller):
    path = bend()
    rows = drive(controller(), path, math.pi / 2, (0.0, 0.0, 0.0), 60.0)
    away = np.hypot(rows[:, None, 0] - path[:, 0], rows[:, None, 1] - path[:, 1]).min(axis=1)
    assert len(rows) < 20 * 60
    assert away.max() < 0.2


@CONTROLLERS
def test_robot_at_the_goal_turns_to_a_heading_behind_it(controller):
    rows = drive(controller(), line(2.0), 3.0, (0.0, 0.0, 0.0), 30.0)
    assert len(rows) < 20 * 30
    assert rows[-1, 4] == 0.0


LOPSIDED = np.array([[0.3, 0.42], [0.3, -0.2], [-0.3, -0.2], [-0.3, 0.42]])
POSTS = [(3.025, 0.425), (5.025, 0.425), (7.025, 0.425)]


def posts(x, y):
    return np.any([(np.abs(x - px) < 0.02) & (np.abs(y - py) < 0.02) for px, py in POSTS], axis=0)


def run_over(rows):
    """Count the posts of one cell of 0.05 m that the lopsided robot had under it."""
    ahead, aside = np.zeros((2, len(rows), len(POSTS)))
    for k, (px, py) in enumerate(POSTS):
        dx, dy = px - rows[:, 0], py - 0.015 - rows[:, 1]
        c, s = np.cos(rows[:, 2]), np.sin(rows[:, 2])
        ahead[:, k], aside[:, k] = c * dx + s * dy, c * dy - s * dx
    return int(((np.abs(ahead) < 0.3) & (aside > -0.2) & (aside < 0.42)).any(axis=0).sum())


def test_lopsided_robot_drives_ten_meters_past_posts_with_obstacle_footprint():
    """The robot reaches 0.42 m to its left and 0.2 m to its right; BaseObstacle knows its center alone."""
    outlined = DWB.with_values(
        BaseObstacle=DWB.BaseObstacle.with_values(enabled=False),
        ObstacleFootprint=DWB.ObstacleFootprint.with_values(enabled=True, scale=0.02),
    )
    found = [
        drive(dwb_controller(each), line(10.0), 0.0, (0.0, 0.0, 0.0), 60.0, posts, LOPSIDED, 0.2)
        for each in (outlined, DWB)
    ]
    assert [len(each) < 20 * 60 for each in found] == [True, True]
    assert [run_over(each) for each in found] == [0, 3]


def test_rpp_has_no_valid_command_before_a_wall_across_the_plan():
    rows = drive(rpp_controller(), line(6.0), 0.0, (0.0, 0.0, 0.0), 20.0, lambda x, y: (x > 3.0) & (x < 3.2))
    assert not rows[-1, 3]
    assert 3.0 - 0.24 - 0.55 < rows[-1, 0] < 3.0 - 0.24


def test_dwb_does_not_touch_a_wall_across_the_plan():
    rows = drive(dwb_controller(), line(6.0), 0.0, (0.0, 0.0, 0.0), 20.0, lambda x, y: (x > 3.0) & (x < 3.2))
    assert 2.0 < rows[:, 0].max() < 3.0 - INSCRIBED_M


@CONTROLLERS
def test_post_close_beside_the_plan_is_passed(controller):
    post = (2.0, 0.3)
    rows = drive(
        controller(), line(4.0), 0.0, (0.0, 0.0, 0.0), 30.0, lambda x, y: np.hypot(x - post[0], y - post[1]) < 0.05
    )
    assert rows[:, 3].all()
    assert len(rows) < 20 * 30
    assert rows[:, 0].max() > 3.7
