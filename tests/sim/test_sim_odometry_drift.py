"""Drift of odometry: it grows as stated, its twist stays the wheels', AMCL with matching alphas corrects it."""

import functools
import math

import numpy as np
import pytest
from table import each_row

from vastflow.sim.loop.closed_loop import ClosedLoop
from vastflow.sim.model.pose import Pose
from vastflow.sim.model.scenario import Mission
from vastflow.sim.nav2.navigator.prepared import prepare
from vastflow.sim.nav2.parameter_files.chosen import parameters_of
from vastflow.sim.nav2.system.robot import robot_facts, robot_of
from vastflow.sim.world.occupancy import OccupancyMap
from vastflow.sim.world.robot_model import Lidar
from vastflow.sim.world.world import World

WAY_M = 17.0
RUNS = 120
OMNI = {
    "FollowPath.motion_model": "Omni",
    "robot_model_type": "nav2_amcl::OmniMotionModel",
    "max_velocity": [0.5, 0.5, 2.0],
    "min_velocity": [-0.5, -0.5, -2.0],
    "max_accel": [2.5, 2.5, 3.2],
    "max_decel": [-2.5, -2.5, -3.2],
}


@pytest.fixture(scope="module")
def loop():
    """A loop of a robot at (1, 2) on a floor of 20 m × 4 m with pillars."""
    floor = np.zeros((80, 400), dtype=np.int8)
    floor[[0, -1]], floor[:, [0, -1]] = 100, 100
    floor[:12, 60::80], floor[-12:, 20::80] = 100, 100

    @functools.cache
    def prepared_of(parameters):
        return prepare(World(OccupancyMap(floor, 0.05, (0.0, 0.0))), Lidar(), parameters)

    def make(seed, **system):
        parameters = parameters_of({"controller": "rpp", "velocity_timeout": 100.0, **system})
        prepared, start, robot = prepared_of(parameters), Pose(1.0, 2.0, 0.0), robot_of(parameters)
        return ClosedLoop(prepared, parameters, Lidar(), robot, start, (), (1, 2, seed), 120.0)

    return make


def odometry(stack):
    m = stack.m[0]
    return np.array([m["odom_x"], m["odom_y"], m["odom_yaw"]])


def driven(made, v=0.0, w=0.0, vy=0.0, seconds=34.0):
    """Odometry's pose after a command of so many seconds, without a stack."""
    made.command(v, w, vy)
    made.advance(made.tick + round(seconds / 0.05))
    return odometry(made.stack)


def drifts(loop, command, noise):
    """Odometry's errors (N, 3) of runs beside the run without noise, and what that one drove (m) and turned (rad)."""
    exact = driven(loop(0, **{key: value for key, value in noise.items() if "odometry" not in key}), **command)
    errors = np.array([driven(loop(seed, **noise), **command) for seed in range(RUNS)]) - exact
    return errors, exact


@each_row(
    ("name", "command", "axis", "amount"),
    [
        ("translation_std_per_meter", {"v": 0.5}, 0, "way"),
        ("rotation_std_per_meter", {"v": 0.5}, 2, "way"),
        ("translation_std_per_radian", {"w": 1.0}, "place", "turn"),
        ("rotation_std_per_radian", {"w": 1.0}, 2, "turn"),
    ],
)
def test_odometry_drifts_by_stated_deviation_times_root_of_distance(loop, name, command, axis, amount):
    """A deviation that is estimated from 120 runs is within 20 % in over 99 of 100 tests."""
    k = 0.02
    errors, exact = drifts(loop, command, {f"robot.odometry.{name}": k})
    total = abs(exact[0]) if amount == "way" else 34.0 - 0.33
    # Of a turning robot every direction has half of the variance.
    found = math.hypot(*errors[:, :2].std(axis=0)) if axis == "place" else errors[:, axis].std()
    assert total == pytest.approx(WAY_M if amount == "way" else 33.7, abs=0.2)
    assert found == pytest.approx(k * math.sqrt(total), rel=0.2)
    if axis != "place":
        assert abs(errors[:, axis].mean()) < 4.0 * k * math.sqrt(total / RUNS)


def test_omni_robot_drifts_as_much_along_a_diagonal_and_across_it(loop):
    k, diagonal = 0.02, {"v": 0.3, "vy": 0.04, "seconds": 30.0}
    errors, exact = drifts(
        loop, diagonal, {**OMNI, "controller": "mppi", "robot.odometry.translation_std_per_meter": k}
    )
    assert exact[1] > 1.0
    assert errors[:, :2].std(axis=0) == pytest.approx(np.full(2, k * math.hypot(*exact[:2]) ** 0.5), rel=0.2)


def test_white_noise_of_a_tenth_is_a_fifth_of_a_percent(loop):
    """It is new in every step of 10 ms: 0.1 · √(17 m · 5 mm) are 0.029 m."""
    errors, exact = drifts(loop, {"v": 0.5}, {"odometry_noise_std_deviation": 0.1})
    assert errors[:, 0].std() / exact[0] == pytest.approx(0.0018, rel=0.25)


def test_drift_leaves_the_twist_and_a_standing_robot_alone(loop):
    noise = {f"robot.odometry.{name}": 0.5 for name in ("translation_std_per_meter", "rotation_std_per_radian")}
    made = loop(1, **noise)
    assert driven(made, v=0.3, seconds=5.0)[0] != pytest.approx(1.5, abs=0.02)
    assert made.stack.m[0]["odom_v"] == pytest.approx(0.3, abs=1e-9)
    standing = driven(made, seconds=3.0)
    assert np.array_equal(driven(made, seconds=3.0), standing)


def test_amcl_with_matching_alphas_corrects_the_drift(loop):
    """AMCL's variance is alpha times a distance squared, ours k² times it: equal at 0.25 m.

    Its yaw has the variance of alpha2 twice, before and after the way.
    """
    k_m, k_rad = 0.1, 0.1
    noise = {"robot.odometry.translation_std_per_meter": k_m, "robot.odometry.rotation_std_per_meter": k_rad}
    alphas = {"alpha3": k_m**2 / 0.25, "alpha2": k_rad**2 / 0.5, "alpha1": 0.2, "alpha4": 0.2}
    estimated_m, counted_m = [], []
    for seed in range(6):
        made = loop(seed, **noise, **alphas)
        made.localize(Pose(1.0, 2.0, 0.0))
        made.navigate(Mission("navigate_to_pose", (Pose(18.0, 2.0, 0.0),)))
        made.advance()
        x, y, _ = odometry(made.stack)
        true, estimate = made.true_pose, made.estimate
        counted_m.append(math.hypot(1.0 + x - true.x_m, 2.0 + y - true.y_m))
        estimated_m.append(math.hypot(estimate.x_m - true.x_m, estimate.y_m - true.y_m))
        assert abs(true.x_m - 18.0) < 0.6
    assert np.mean(counted_m) > 1.0
    assert np.max(estimated_m) < 0.4


def test_report_states_the_drift_of_a_robot():
    facts = robot_facts(parameters_of({"robot.odometry.rotation_std_per_meter": 0.02}))
    assert "odometry's rotation std per meter 0.02 rad" in map(str, facts)
