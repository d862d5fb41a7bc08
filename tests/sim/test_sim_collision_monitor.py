"""The collision monitor: what the newest scan does to a command, noise or none."""

import math

import numpy as np
import pytest
from table import each_row

from vastflow.sim.kernels.numeric import njit
from vastflow.sim.kernels.record import record_dtype, record_row
from vastflow.sim.nav2.costmaps.outline import circumscribed_radius_m, inscribed_radius_m, padded_outline
from vastflow.sim.nav2.navigator.collision_monitor import approach, gather_near_points
from vastflow.sim.nav2.navigator.state import MEMORY
from vastflow.sim.nav2.parameters.servers import CollisionMonitor, VelocitySmoother
from vastflow.sim.world.robot_model import Lidar

OUTLINE = padded_outline(0.22, 0.01)


@njit
def gathered(parameters, memory):
    gather_near_points(parameters[0], memory[0])


@njit
def factor_of(parameters, memory, v_mps, w_radps):
    return approach(parameters[0], memory[0], v_mps, w_radps, 0.0)


def records(ranges, **monitor):
    """Parameter and memory records of a robot that has just seen `ranges` (360,)."""
    groups = {"velocity_smoother": VelocitySmoother(), "collision_monitor": CollisionMonitor(**monitor)}
    extra = {
        "inscribed_radius": inscribed_radius_m(OUTLINE),
        "circumscribed_radius": circumscribed_radius_m(OUTLINE),
        "range_min": 0.164,
        "range_max": 20.0,
        "mount_x": -0.04,
        "mount_y": 0.0,
        "scan_ticks": 2,
        "zones_reach": 0.0,
    }
    dtype = [(name, record_dtype(group)) for name, group in groups.items()] + [(name, np.float64) for name in extra]
    parameters = np.array([(*map(record_row, groups.values()), *extra.values())], dtype=dtype)
    memory = np.zeros(1, dtype=MEMORY)
    memory["beams"] = 360
    memory["ranges"][:, :360], memory["directions"][:, :360] = ranges, Lidar().directions()
    memory["vertices"], memory["outline"][:, : len(OUTLINE)] = len(OUTLINE), OUTLINE
    gathered(parameters, memory)
    return parameters, memory


def factor(ranges, v_mps, w_radps=0.0, moved=(0.0, 0.0, 0.0), **monitor):
    """What is left of a command after the scan, the robot having moved since by odometry."""
    parameters, memory = records(ranges, **monitor)
    memory["odom_x"], memory["odom_y"], memory["odom_yaw"] = moved
    return factor_of(parameters, memory, v_mps, w_radps)


def wall_ahead(distance_m):
    """Ranges to a wall across the robot's way, `distance_m` before its center; nothing else is seen."""
    directions = Lidar().directions()
    with np.errstate(divide="ignore"):
        ranges = (distance_m + 0.04) / directions[:, 0]
    return np.where((ranges > 0) & (ranges < 3.0), ranges, np.inf)


def walls_beside(distance_m, other_m=math.inf, noise_m=0.0, rng=None):
    """Ranges between two walls along the robot's way."""
    directions = Lidar().directions()
    with np.errstate(divide="ignore", invalid="ignore"):
        left, right = distance_m / directions[:, 1], -other_m / directions[:, 1]
    ranges = np.where(directions[:, 1] > 1e-9, left, np.where(directions[:, 1] < -1e-9, right, np.inf))
    ranges = np.where(ranges < 20.0, ranges, np.inf)
    return ranges + (rng.normal(0.0, noise_m, 360) if noise_m else 0.0)


def test_command_into_the_open_is_left_alone():
    assert factor(np.full(360, np.inf), 0.5) == 1.0


def test_wall_beyond_the_time_to_collision_is_left_alone():
    assert factor(wall_ahead(0.9), 0.5) == 1.0


def test_command_towards_a_wall_is_scaled_by_the_time_to_the_collision():
    """At 0.5 m/s the outline (0.23 m) comes within a wall at 0.6 m in the eighth step of 0.1 s: label 0.7 s."""
    assert factor(wall_ahead(0.6), 0.5) == pytest.approx(0.7 / 1.2)


def test_factor_falls_as_the_wall_comes_near():
    found = [factor(wall_ahead(distance), 0.5) for distance in (0.8, 0.6, 0.45, 0.3)]
    assert found == sorted(found, reverse=True)
    assert found[0] > found[-1]


def test_backing_away_from_a_wall_is_free():
    assert factor(wall_ahead(0.3), -0.15) == 1.0


def test_turning_beside_a_wall_is_free():
    assert factor(walls_beside(0.26), 0.0, 1.0) == 1.0


def test_six_points_inside_the_footprint_freeze_every_command():
    ranges = np.full(360, np.inf)
    ranges[100:106] = 0.18
    for v_mps, w_radps in ((0.5, 0.0), (-0.15, 0.0), (0.0, 1.0)):
        assert factor(ranges, v_mps, w_radps) == 0.0


def test_five_points_inside_the_footprint_freeze_nothing():
    ranges = np.full(360, np.inf)
    ranges[100:105] = 0.18
    assert factor(ranges, 0.5) == 1.0


def test_points_nearer_than_the_scanner_sees_do_not_count():
    ranges = np.full(360, np.inf)
    ranges[100:140] = 0.16
    assert factor(ranges, 0.5) == 1.0


def test_points_stay_where_they_were_while_the_robot_moves_on():
    assert factor(wall_ahead(0.9), 0.5, moved=(0.3, 0.0, 0.0)) == pytest.approx(factor(wall_ahead(0.6), 0.5))
    assert factor(wall_ahead(0.6), 0.5, moved=(0.0, 0.0, math.pi)) == 1.0


def test_without_a_monitor_nothing_is_stopped():
    assert factor(wall_ahead(0.25), 0.5, enabled=False) == 1.0


def test_footprint_is_the_padded_polygon_and_not_a_circle():
    """Straight ahead its vertex is at 0.23 m; points at 0.232 m lie outside there and inside half way to its next but one."""
    inside = np.full(360, np.inf)
    assert np.isclose(circumscribed_radius_m(OUTLINE), 0.234142, atol=1e-6)
    parameters, memory = records(inside, min_points=1)
    for angle_rad, expected in ((0.0, 1.0), (math.pi / 4, 0.0)):
        memory["near"] = 1
        memory["near_points"][0, :, 0] = 0.232 * math.cos(angle_rad), 0.232 * math.sin(angle_rad)
        assert factor_of(parameters, memory, 0.0, 0.0) == expected


@each_row(
    ("noise_m", "half_width_m", "both", "one"),
    [
        (0.1, 0.25, 1.00, None),
        (0.1, 0.30, 1.00, 0.93),
        (0.1, 0.40, 0.08, None),
        (0.1, 0.50, 0.00, None),
        (0.05, 0.25, 1.00, None),
        (0.05, 0.30, 0.48, 0.06),
        (0.05, 0.40, 0.00, None),
    ],
)
def test_noise_freezes_a_robot_between_walls_as_often_as_nav2(noise_m, half_width_m, both, one):
    """Chances per scan that were measured on Nav2's own monitor, within five points."""
    rng = np.random.default_rng(5)
    for other_m, expected in ((half_width_m, both), (math.inf, one)):
        if expected is not None:
            frozen = [factor(walls_beside(half_width_m, other_m, noise_m, rng), 0.1) == 0.0 for _ in range(400)]
            assert np.mean(frozen) == pytest.approx(expected, abs=0.05)


def test_without_noise_a_robot_between_walls_of_half_a_meter_is_never_frozen():
    assert factor(walls_beside(0.25, 0.25), 0.1) == 1.0
