"""Areas of the collision monitor: what is left of a command with scan points in them."""

import math

import numpy as np
import pytest
from table import each_row

from vastflow.sim.kernels.numeric import njit
from vastflow.sim.model.polygon import MOST_VERTICES
from vastflow.sim.nav2.navigator.collision_monitor import ZONE, zone_rows, zoned
from vastflow.sim.nav2.navigator.state import MEMORY
from vastflow.sim.nav2.parameters.servers import MOST_ZONES, MonitorZone

AHEAD = ((1.0, 0.3), (1.0, -0.3), (0.2, -0.3), (0.2, 0.3))


@njit
def left_of(parameters, memory, v_mps, w_radps):
    return zoned(parameters[0], memory[0], v_mps, w_radps, 0.0)


def left(zones, points, v_mps=0.5, w_radps=0.0, moved=(0.0, 0.0, 0.0)):
    """The factor of a command with these points in the robot's frame at the scan, the robot having moved since."""
    dtype = [
        ("zone_count", np.float64),
        ("zones", np.float64, (MOST_ZONES, len(ZONE))),
        ("zone_points", np.float64, (MOST_ZONES, MOST_VERTICES, 2)),
    ]
    parameters, memory = np.array([(len(zones), *zone_rows(zones))], dtype=dtype), np.zeros(1, dtype=MEMORY)
    memory["near"] = len(points)
    memory["near_points"][0, :, : len(points)] = np.array(points).reshape(-1, 2).T
    memory["odom_x"], memory["odom_y"], memory["odom_yaw"] = moved
    return left_of(parameters, memory, v_mps, w_radps)


def zone(action, **values):
    return MonitorZone(action=action, **{"vertices": AHEAD, "min_points": 2, **values})


def test_area_acts_when_it_has_its_points_and_not_before():
    stop = zone("stop")
    assert left([stop], [(0.9, 0.0)]) == 1.0
    assert left([stop], [(0.9, 0.0), (0.9, 0.2)]) == 0.0
    assert left([stop], [(0.9, 0.0), (0.9, 0.4)]) == 1.0


def test_circle_is_round_the_robots_center():
    ring = zone("stop", vertices=(), radius=0.5, min_points=1)
    assert left([ring], [(-0.3, -0.3)]) == 0.0
    assert left([ring], [(-0.4, -0.4)]) == 1.0


def test_points_stay_where_they_were_while_the_robot_moves_and_turns():
    stop = zone("stop", min_points=1)
    assert left([stop], [(1.3, 0.0)]) == 1.0
    assert left([stop], [(1.3, 0.0)], moved=(0.5, 0.0, 0.0)) == 0.0
    assert left([stop], [(0.0, 0.8)], moved=(0.0, 0.0, math.pi / 2)) == 0.0


def test_area_slows_down_by_its_ratio_and_the_smallest_command_counts():
    inside = [(0.5, 0.0), (0.5, 0.1)]
    assert left([zone("slowdown", slowdown_ratio=0.4)], inside) == 0.4
    assert left([zone("slowdown", slowdown_ratio=0.4), zone("slowdown", slowdown_ratio=0.7)], inside) == 0.4
    assert left([zone("slowdown", slowdown_ratio=0.4), zone("stop")], inside) == 0.0


@each_row(
    ("v_mps", "w_radps", "expected"),
    [(0.5, 0.0, 0.4), (0.1, 0.0, 1.0), (0.0, 2.0, 0.25), (0.5, 2.0, 0.25), (0.0, 0.0, 1.0)],
)
def test_limit_holds_both_velocities_by_one_factor(v_mps, w_radps, expected):
    limit = zone("limit", linear_limit=0.2, angular_limit=0.5)
    assert left([limit], [(0.5, 0.0), (0.5, 0.1)], v_mps, w_radps) == pytest.approx(expected)


def test_area_of_its_own_approaches_by_the_time_to_collision():
    near = zone("approach", time_before_collision=2.0, min_points=1)
    assert left([near], [(1.52, 0.0)]) == pytest.approx(0.5)  # 0.52 m at 0.5 m/s: inside at the 11th step
    assert left([near], [(1.52, 0.0)], v_mps=0.1) == 1.0
