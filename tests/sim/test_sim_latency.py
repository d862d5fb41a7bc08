"""Latency: scans, odometry and commands that come late, by how much, and that a run without latency knows none."""

import math

import numpy as np
import pytest
from table import each_row

from vastflow.sim.kernels.streams import LATENCY, streams_of
from vastflow.sim.loop.closed_loop import ClosedLoop
from vastflow.sim.model.obstacle import Obstacle
from vastflow.sim.model.pose import Pose
from vastflow.sim.model.scenario import Mission
from vastflow.sim.model.shape import Box
from vastflow.sim.nav2.costmaps.costmap import MARKED
from vastflow.sim.nav2.navigator.prepared import prepare
from vastflow.sim.nav2.parameter_files.chosen import parameters_of
from vastflow.sim.world.occupancy import OccupancyMap
from vastflow.sim.world.robot_model import Lidar, Robot
from vastflow.sim.world.world import World

WALL_X_M = 13.5
GOAL = Pose(11.0, 2.0, 0.0)


@pytest.fixture(scope="module")
def loop():
    """A loop of a robot at (1, 2) that goes 10 m along x to a wall."""
    floor = np.zeros((80, 280), dtype=np.int8)
    floor[[0, -1]], floor[:, [0, -1]] = 100, 100
    floor[:, int(WALL_X_M / 0.05) :] = 100

    def make(goal=GOAL, lidar=None, seed=3, **latency):
        lidar = lidar or Lidar()
        system = {f"robot.latency.{name}": value for name, value in latency.items()}
        parameters = parameters_of({"controller": "rpp", **system})
        prepared = prepare(World(OccupancyMap(floor, 0.05, (0.0, 0.0))), lidar, parameters)
        made = ClosedLoop(prepared, parameters, lidar, Robot(), Pose(1.0, 2.0, 0.0), (), (1, 2, seed), 60.0)
        made.localize(Pose(1.0, 2.0, 0.0))
        if goal:
            made.navigate(Mission("navigate_to_pose", (goal,)))
        return made

    return make


def recorded(loop):
    loop.advance()
    loop.conclude()
    m = loop.stack.m[0]
    return loop.stack.rows[: int(m["rows"])].tobytes(), loop.status


def cruising(loop, ticks=80):
    """The memory of a loop whose robot drives on at full speed after so many ticks."""
    loop.advance(ticks)
    m = loop.stack.m[0]
    assert m["true_v"] == pytest.approx(0.5, abs=0.01)
    return m


def test_run_without_latency_equals_zero_latency(loop):
    ideal, late = loop(), loop()
    late.stack.p["late"] = 1
    assert ideal.stack.p[0]["late"] == 0
    assert recorded(late) == recorded(ideal) == recorded(loop(preset="ideal"))
    assert ideal.stack.m[0]["streams"][LATENCY] == streams_of((1, 2, 3))[LATENCY]


@each_row("preset", ["gazebo", "loaded"])
def test_latency_is_drawn_from_the_runs_seed(loop, preset):
    once, again, other, ideal = (
        recorded(loop(preset=p, seed=s)) for p, s in [(preset, 3)] * 2 + [(preset, 4), ("ideal", 3)]
    )
    assert once == again
    assert once[0] not in (other[0], ideal[0])


def test_delayed_scan_keeps_pose_and_ranges_of_capture(loop):
    m = cruising(loop(scan_age=0.3), 81)
    assert m["odom_x"] - m["scan_odom_x"] == pytest.approx(0.5 * 0.3 + 0.5 * 0.05, abs=0.005)  # a tick has passed since
    ahead = np.argmax(m["directions"][:360, 0])
    assert m["ranges"][ahead] == pytest.approx(WALL_X_M - (1.0 + m["scan_odom_x"] - 0.04), abs=0.03)


def test_costmap_marks_new_obstacle_after_scan_latency(loop):
    def marked_after_ticks(scan_age):
        made = loop(goal=None, scan_age=scan_age)
        made.advance(40)
        made.spawn(Obstacle("box", Box(0.4, 0.4), Pose(2.0, 2.0, 0.0)), False)
        before = (made.stack.local.layer == MARKED).sum()
        while (made.stack.local.layer == MARKED).sum() <= before:
            made.advance(made.tick + 1)
        return made.tick - 40

    assert [marked_after_ticks(scan_age) - marked_after_ticks(0.0) for scan_age in (0.2, 0.4)] == [4, 8]


def test_late_scan_corrects_odometry_where_the_scan_was_taken(loop):
    """The estimate stays right: AMCL moves its particles to the scan's odometry, and not to the newest."""
    errors_m = []
    made = loop(scan_age=0.4)
    made.advance(8)
    assert not made.localized
    for tick in range(60, 300, 10):
        made.advance(tick)
        errors_m.append(made.estimate.x_m - made.true_pose.x_m)
    assert abs(np.mean(errors_m)) < 0.1  # 0.2 m behind, if it did


def test_odometry_is_as_late_as_its_age_and_scans_wait_for_it(loop):
    made, ages_s = loop(odometry_rate=30.0), set()
    for tick in range(80, 120):
        m = cruising(made, tick)
        ages_s.add(round((m["counted_x"] - m["odom_x"]) / 0.5, 2))
    assert min(ages_s) >= 0.0 and max(ages_s) <= 0.034 + 0.005 and len(ages_s) > 1
    m = cruising(loop(tf_age=0.2), 81)
    assert m["counted_x"] - m["odom_x"] == pytest.approx(0.5 * 0.2, abs=0.002)
    assert m["scan_odom_x"] <= m["odom_x"] + 1e-9


def test_delayed_odometry_is_monotonic(loop):
    made, seen_m = loop(tf_age=0.02, tf_jitter=0.1), []
    for tick in range(60, 160):
        made.advance(tick)
        seen_m.append(float(made.stack.m[0]["odom_x"]))
    assert min(np.diff(seen_m)) >= 0.0
    assert max(np.diff(seen_m)) > 2 * 0.5 * 0.05  # and catches up


def first_sent(loop):
    """The first tick with a command, and the smoother's step then."""
    for tick in range(1, 60):
        loop.advance(tick)
        if loop.stack.m[0]["sent_v"] > 0.0:
            return tick, int(loop.stack.m[0]["smoother_step"])
    return None


@each_row(("controller_time", "ticks"), [(0.0, 0), (0.05, 1), (0.12, 3), (0.4, 8)])
def test_command_takes_effect_when_the_controller_has_computed_it(loop, controller_time, ticks):
    assert first_sent(loop(controller_time=controller_time))[0] - first_sent(loop())[0] == ticks


def test_slow_controller_commands_at_reduced_rate(loop):
    made, ordered = loop(controller_time=0.12), set()
    for tick in range(20, 80):
        made.advance(tick)
        ordered.add(int(made.stack.m[0]["command_tick"]))
    assert set(np.diff(sorted(ordered))) == {3}


def test_missed_cycles_repeat_last_command(loop):
    made, ordered, sent = loop(missed_cycles=0.5), [], []
    for tick in range(60, 160):
        m = cruising(made, tick)
        ordered.append(int(m["command_tick"]))
        sent.append(float(m["sent_v"]))
    assert 30 < len(set(ordered)) < 70
    assert min(sent) == pytest.approx(0.5, abs=0.01)


def test_smoother_out_of_step_sends_a_command_within_the_tick(loop):
    """A command of 20 ms reaches a later smoother in the same tick, else in the next."""
    in_step, _ = first_sent(loop(controller_time=0.02))
    free = [first_sent(loop(controller_time=0.02, seed=seed, smoother_in_step=False)) for seed in range(8)]
    assert {step for _, step in free} > {0}
    assert all(in_step - tick == (1 if step >= 2 else 0) for tick, step in free)


def test_spinning_sweep_is_corrected_by_rotation(loop):
    """At 1 rad/s a sweep of 0.1 s is distorted by 0.1 rad from its first beam to its last."""
    made = loop(goal=None, lidar=Lidar(sweeps=True))
    for tick in range(1, 62):
        made.command(0.0, 1.0)
        made.advance(tick)
    m = made.stack.m[0]
    assert m["true_w"] == pytest.approx(1.0, abs=0.01)
    bearings_rad = math.pi / 2 + Lidar().angle_increment_rad * np.arange(360)
    yaw_rad = float(m["scan_odom_yaw"]) + 0.1 * np.arange(360) * Lidar().angle_increment_rad / (2 * math.pi)
    truth_m = _to_walls(yaw_rad, bearings_rad)
    assert np.median(np.abs(m["ranges"][:360] - truth_m)) < 0.01
    at_once_m = _to_walls(np.full(360, float(m["scan_odom_yaw"])), bearings_rad)
    assert np.median(np.abs(m["ranges"][300:360] - at_once_m[300:360])) > 0.03


def _to_walls(yaw_rad, bearings_rad):
    """Ranges to the walls from a robot that turned on the spot at (1, 2)."""
    x_m, y_m = 1.0 - 0.04 * np.cos(yaw_rad), 2.0 - 0.04 * np.sin(yaw_rad)
    c, s = np.cos(yaw_rad + bearings_rad), np.sin(yaw_rad + bearings_rad)
    return np.minimum(np.where(c > 0, WALL_X_M - x_m, 0.05 - x_m) / c, np.where(s > 0, 3.95 - y_m, 0.05 - y_m) / s)


def test_standing_robots_sweep_is_a_scan_taken_at_once(loop):
    sweeping, still = (loop(goal=None, lidar=Lidar(sweeps=sweeps)) for sweeps in (True, False))
    for made in (sweeping, still):
        made.advance(20)
    np.testing.assert_allclose(sweeping.stack.m[0]["ranges"][:360], still.stack.m[0]["ranges"][:360], atol=1e-9)
