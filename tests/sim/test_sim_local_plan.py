"""The local plan: what of the global path the controller gets to see."""

import math

import numpy as np
import pytest
from table import each_row

from vastflow.sim.kernels.numeric import njit
from vastflow.sim.kernels.record import record_of
from vastflow.sim.nav2.controllers.controller import PlanCut
from vastflow.sim.nav2.controllers.local_plan import local_plan, renew
from vastflow.sim.nav2.costmaps.window import Window
from vastflow.sim.nav2.navigator.state import AHEAD_POINTS, MEMORY


@njit
def cut(parameters, memory, window, path, out):
    return local_plan(parameters[0], memory[0], window, path, out)


@njit
def renewed(parameters, memory, path):
    renew(parameters[0], memory[0], path)


class Follower:
    """A robot with a path in the map frame and a window of 3 m in the odom frame."""

    def __init__(self, path, x_m=0.0, y_m=0.0, map_odom=(0.0, 0.0, 0.0), goal_yaw_rad=0.0, cut=None, ahead_m=1.7):
        self.path = np.zeros((len(path), 3))
        self.path[:, :2], self.path[-1, 2] = path, goal_yaw_rad
        plan_cut = record_of(cut or PlanCut(search_m=1.5, ahead_m=ahead_m, in_window=True))
        self.parameters = np.zeros(1, dtype=np.dtype([("plan_cut", plan_cut.dtype)], align=True))
        self.parameters["plan_cut"] = plan_cut
        self.memory = np.zeros(1, dtype=MEMORY)
        m = self.memory[0]
        m["path_n"] = len(self.path)
        renewed(self.parameters, self.memory, self.path)
        m["map_odom_x"], m["map_odom_y"], m["map_odom_yaw"] = map_odom
        self.out = np.zeros((AHEAD_POINTS, 3))
        self.move(x_m, y_m)

    def move(self, x_m, y_m):
        m = self.memory[0]
        m["x"], m["y"] = x_m, y_m
        c, s = math.cos(m["map_odom_yaw"]), math.sin(m["map_odom_yaw"])
        dx, dy = x_m - m["map_odom_x"], y_m - m["map_odom_y"]
        corner = np.floor(np.array([c * dx + s * dy, c * dy - s * dx]) / 0.05) * 0.05 - 1.5
        self.window = Window(np.zeros((60, 60), dtype=np.uint8), np.array([*corner, 0.05]))

    def plan(self):
        n, end_yaw_rad = cut(self.parameters, self.memory, self.window, self.path, self.out)
        return self.out[:n, :2].copy(), end_yaw_rad


def straight(length_m=5.0):
    """A path along x with NavFn's spacing."""
    return [(x, 0.0) for x in np.arange(0.0, length_m + 1e-9, 0.025)]


def test_local_plan_begins_at_nearest_point_and_ends_a_prune_distance_ahead():
    plan, _ = Follower(straight(), x_m=1.01, y_m=0.2, ahead_m=1.0).plan()
    np.testing.assert_allclose(plan[0], (1.0, 0.0))
    np.testing.assert_allclose(plan[-1], (2.0, 0.0), atol=0.026)


def test_local_plan_ends_where_path_leaves_window():
    away_and_back = [(0.0, y) for y in np.arange(0, 2.0, 0.025)] + [(0.1, y) for y in np.arange(2.0, 0, -0.025)]
    plan, _ = Follower(away_and_back, ahead_m=10.0).plan()
    assert (plan[:, 0] == 0.0).all()
    np.testing.assert_allclose(plan[-1], (0.0, 1.475), atol=0.026)


def test_passed_path_points_are_dropped():
    follower = Follower(straight(), x_m=1.0)
    follower.plan()
    follower.move(0.5, 0.0)
    plan, _ = follower.plan()
    np.testing.assert_allclose(plan[0], (1.0, 0.0))


def test_nearest_point_is_sought_on_the_first_segment_only():
    """A path that crosses itself: the branch ahead wins over one that lies nearer but farther along."""
    up, back = [(2.0, y) for y in np.arange(0.025, 1.0, 0.025)], [(x, 1.0) for x in np.arange(2, 0, -0.025)]
    plan, _ = Follower(straight(2.0) + up + back, x_m=0.5, y_m=0.9).plan()
    np.testing.assert_allclose(plan[0], (0.5, 0.0))


def test_plan_is_given_in_the_odom_frame():
    plan, _ = Follower(straight(), x_m=1.0, map_odom=(1.0, 0.0, math.pi / 2)).plan()
    np.testing.assert_allclose(plan[0], (0.0, 0.0), atol=1e-12)
    np.testing.assert_allclose(plan[4], (0.0, -0.1), atol=1e-12)


@each_row(("length_m", "end_yaw_rad"), [(1.0, 0.7), (4.0, -0.3)])
def test_local_plan_ends_with_goal_heading_only_at_goal(length_m, end_yaw_rad):
    """Every other pose of NavFn has the map's heading, which localization has turned by 0.3 rad in odom."""
    _, found_rad = Follower(straight(length_m), map_odom=(0.0, 0.0, 0.3), goal_yaw_rad=1.0).plan()
    assert found_rad == pytest.approx(end_yaw_rad)


def test_cut_by_distance_keeps_the_path_behind_the_robot_that_is_near():
    """DWB's: from the first point nearer than one distance to the first farther than another, wherever the robot is between."""
    plan, _ = Follower(straight(), x_m=2.0, cut=PlanCut(search_m=3.0, within_m=0.501, around_m=0.801)).plan()
    np.testing.assert_allclose(plan[[0, -1]], [(1.5, 0.0), (2.8, 0.0)], atol=1e-9)


def test_cut_begins_where_the_search_ends_if_no_point_is_near():
    far = Follower(straight(), y_m=1.0, cut=PlanCut(search_m=0.5, within_m=0.9, around_m=3.0))
    np.testing.assert_allclose(far.plan()[0][0], (0.525, 0.0))


@each_row(("two_points", "count"), [(True, 2), (False, 1)])
def test_robot_past_the_end_of_its_path_may_keep_a_second_point(two_points, count):
    cut = PlanCut(search_m=1.5, two_points=two_points, around_m=1.5)
    assert len(Follower(straight(1.0), x_m=1.1, cut=cut).plan()[0]) == count


def test_plan_begins_with_the_last_of_equally_near_points():
    twice = [(0.0, 0.0), (1.0, 0.0), (1.0, 0.0), (1.2, 0.0)]
    assert len(Follower(twice, x_m=1.0).plan()[0]) == 2


TO_INVERSION = PlanCut(search_m=5.0, in_window=True, to_inversion=True, inversion_xy_m=0.2, inversion_yaw_rad=0.4)
THERE_AND_BACK = [(x, 0.0) for x in np.arange(0.0, 0.9, 0.05)] + [(x, 0.1) for x in np.arange(0.8, -0.4, -0.05)]
CUSP = (0.85, 0.0)


def test_local_plan_ends_at_first_reversal_when_constrained():
    robot = Follower(THERE_AND_BACK, cut=TO_INVERSION)
    robot.path[17, 2] = 0.3
    plan, yaw_rad = robot.plan()
    np.testing.assert_allclose(plan[-1], CUSP)
    assert (len(plan), yaw_rad) == (18, pytest.approx(0.3))
    plan, _ = Follower(THERE_AND_BACK, cut=PlanCut(search_m=5.0, in_window=True)).plan()
    assert len(plan) == len(THERE_AND_BACK)


@each_row(("x_m", "yaw_rad", "goes_on"), [(0.7, 0.3, True), (0.6, 0.3, False), (0.7, 0.5, False)])
def test_next_segment_follows_once_the_robot_is_at_the_reversal(x_m, yaw_rad, goes_on):
    robot = Follower(THERE_AND_BACK, x_m=x_m, cut=TO_INVERSION)
    robot.memory[0]["yaw"] = yaw_rad
    before, _ = robot.plan()
    np.testing.assert_allclose(before[-1], CUSP)
    after, _ = robot.plan()
    np.testing.assert_allclose(after[-1], THERE_AND_BACK[-1] if goes_on else CUSP)
