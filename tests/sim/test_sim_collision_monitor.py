"""The collision monitor: effect of the newest scan on a command, by the footprint and by areas of the file."""

import math

import numpy as np
import pytest
from table import each_row

from vastflow.sim.kernels.numeric import njit
from vastflow.sim.kernels.streams import streams_of
from vastflow.sim.model.pose import Pose
from vastflow.sim.nav2.navigator.collision_monitor import approach, gather_near_points, zoned
from vastflow.sim.nav2.navigator.prepared import prepare
from vastflow.sim.nav2.navigator.state import new_stack
from vastflow.sim.nav2.parameters.servers import CollisionMonitor, MonitorZone
from vastflow.sim.nav2.parameters.stack import NavParameters
from vastflow.sim.world.obstacle_rows import obstacle_rows
from vastflow.sim.world.occupancy import OccupancyMap
from vastflow.sim.world.robot_model import Lidar, Robot
from vastflow.sim.world.world import World

NOTHING = np.full(360, np.inf)
AHEAD = ((1.0, 0.3), (1.0, -0.3), (0.2, -0.3), (0.2, 0.3))


@njit
def gathered(parameters, memory):
    gather_near_points(parameters[0], memory[0])


@njit
def factors(parameters, memory, v_mps, w_radps):
    p, m = parameters[0], memory[0]
    return approach(p, m, v_mps, w_radps, 0.0), zoned(p, m, v_mps, w_radps, 0.0)


def records(ranges, zones=(), **monitor):
    """Parameter and memory records of a robot that has just seen `ranges` (360,)."""
    values = NavParameters(collision_monitor=CollisionMonitor(zones=tuple(zones), **monitor))
    floor = OccupancyMap(np.zeros((9, 9), dtype=np.int8), 0.05, (0.0, 0.0))
    made = prepare(World(floor), Lidar(), values), values, Lidar(), Robot(), Pose(0.0, 0.0), obstacle_rows(())
    stack = new_stack(*made, streams_of([1]), 1.0)
    stack.m["ranges"][:, :360] = ranges
    gathered(stack.p, stack.m)
    return stack.p, stack.m


def factor(ranges, v_mps, w_radps=0.0, moved=(0.0, 0.0, 0.0), **monitor):
    """Share of a command that the footprint leaves, after the robot moved by odometry since the scan."""
    parameters, memory = records(ranges, **monitor)
    memory["odom_x"], memory["odom_y"], memory["odom_yaw"] = moved
    return factors(parameters, memory, v_mps, w_radps)[0]


def left(zones, points, v_mps=0.5, w_radps=0.0, moved=(0.0, 0.0, 0.0)):
    """Share of a command that areas leave, with these points in the robot's frame at the scan."""
    parameters, memory = records(NOTHING, zones)
    memory["near"] = len(points)
    memory["near_points"][0, :, : len(points)] = np.transpose(points)
    memory["odom_x"], memory["odom_y"], memory["odom_yaw"] = moved
    return factors(parameters, memory, v_mps, w_radps)[1]


def wall_ahead(distance_m):
    """Ranges to a wall across the robot's way, `distance_m` before its center; nothing else is seen."""
    with np.errstate(divide="ignore"):
        ranges = (distance_m + 0.04) / Lidar().directions()[:, 0]
    return np.where((ranges > 0) & (ranges < 3.0), ranges, np.inf)


def walls_beside(distance_m, other_m=math.inf, noise_m=0.0, rng=None):
    """Ranges between two walls along the robot's way."""
    across = Lidar().directions()[:, 1]
    with np.errstate(divide="ignore"):
        ranges = np.where(across > 0.0, distance_m, -other_m) / across
    return np.where(ranges < 20.0, ranges, np.inf) + (rng.normal(0.0, noise_m, 360) if noise_m else 0.0)


def points_at(range_m, count):
    return np.where(np.arange(360) < count, range_m, np.inf)


@each_row(
    ("ranges", "v_mps", "w_radps", "expected"),
    [
        (NOTHING, 0.5, 0.0, 1.0),
        (wall_ahead(0.9), 0.5, 0.0, 1.0),
        # At 0.5 m/s the outline (0.23 m) meets a wall at 0.6 m in the eighth step of 0.1 s: label 0.7 s.
        (wall_ahead(0.6), 0.5, 0.0, 0.7 / 1.2),
        (wall_ahead(0.3), -0.15, 0.0, 1.0),
        (walls_beside(0.26), 0.0, 1.0, 1.0),
        (points_at(0.18, 6), -0.15, 0.0, 0.0),
        (points_at(0.18, 6), 0.0, 1.0, 0.0),
        (points_at(0.18, 5), 0.5, 0.0, 1.0),
        (points_at(0.16, 40), 0.5, 0.0, 1.0),  # nearer than the scanner sees
    ],
)
def test_command_is_scaled_by_time_to_collision_of_the_footprint(ranges, v_mps, w_radps, expected):
    assert factor(ranges, v_mps, w_radps) == pytest.approx(expected)


def test_points_keep_their_place_while_the_robot_moves_and_disabled_monitor_stops_nothing():
    assert factor(wall_ahead(0.9), 0.5, moved=(0.3, 0.0, 0.0)) == pytest.approx(factor(wall_ahead(0.6), 0.5))
    assert factor(wall_ahead(0.6), 0.5, moved=(0.0, 0.0, math.pi)) == 1.0
    assert factor(wall_ahead(0.25), 0.5, enabled=False) == 1.0


def test_footprint_is_the_padded_polygon():
    """At 0.232 m a point is outside straight ahead (vertex at 0.23 m), and inside at 45°."""
    parameters, memory = records(NOTHING, min_points=1)
    for angle_rad, expected in ((0.0, 1.0), (math.pi / 4, 0.0)):
        memory["near"] = 1
        memory["near_points"][0, :, 0] = 0.232 * math.cos(angle_rad), 0.232 * math.sin(angle_rad)
        assert factors(parameters, memory, 0.0, 0.0)[0] == expected


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
def test_noise_freezes_robot_as_often_as_in_nav2(noise_m, half_width_m, both, one):
    """Chances per scan that were measured on Nav2's own monitor, within five points."""
    rng = np.random.default_rng(5)
    for other_m, expected in ((half_width_m, both), (math.inf, one)):
        if expected is not None:
            frozen = [factor(walls_beside(half_width_m, other_m, noise_m, rng), 0.1) == 0.0 for _ in range(400)]
            assert np.mean(frozen) == pytest.approx(expected, abs=0.05)


def zone(action, **values):
    return MonitorZone(action=action, **{"vertices": AHEAD, "min_points": 2, **values})


INSIDE = [(0.5, 0.0), (0.5, 0.1)]
STOP, RING = zone("stop", min_points=1), zone("stop", vertices=(), radius=0.5, min_points=1)
SLOW, LIMIT = zone("slowdown", slowdown_ratio=0.4), zone("limit", linear_limit=0.2, angular_limit=0.5)
NEAR = zone("approach", time_before_collision=2.0, min_points=1)


@each_row(
    ("zones", "points", "changes", "expected"),
    [
        ([zone("stop")], [(0.9, 0.0), (0.9, 0.2)], {}, 0.0),
        ([zone("stop")], [(0.9, 0.0), (0.9, 0.4)], {}, 1.0),
        ([RING], [(-0.3, -0.3)], {}, 0.0),
        ([RING], [(-0.4, -0.4)], {}, 1.0),
        ([STOP], [(1.3, 0.0)], {}, 1.0),
        ([STOP], [(1.3, 0.0)], {"moved": (0.5, 0.0, 0.0)}, 0.0),
        ([STOP], [(0.0, 0.8)], {"moved": (0.0, 0.0, math.pi / 2)}, 0.0),
        ([SLOW], INSIDE, {}, 0.4),
        ([SLOW, zone("slowdown", slowdown_ratio=0.7)], INSIDE, {}, 0.4),
        ([SLOW, zone("stop")], INSIDE, {}, 0.0),
        ([LIMIT], INSIDE, {}, 0.4),
        ([LIMIT], INSIDE, {"v_mps": 0.1}, 1.0),
        ([LIMIT], INSIDE, {"w_radps": 2.0}, 0.25),
        ([LIMIT], INSIDE, {"v_mps": 0.0}, 1.0),
        ([NEAR], [(1.52, 0.0)], {}, 0.5),  # 0.52 m at 0.5 m/s: inside at the 11th step
        ([NEAR], [(1.52, 0.0)], {"v_mps": 0.1}, 1.0),
    ],
)
def test_areas_scale_a_command_by_their_points_and_actions(zones, points, changes, expected):
    assert left(zones, points, **changes) == pytest.approx(expected)
