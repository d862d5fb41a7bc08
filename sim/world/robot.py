"""The robot's body and actuators: the minimal TurtleBot 4 model of Nav2's simulation."""

import math
from dataclasses import dataclass
from typing import Any

from vastflow.sim.kernels.numeric import njit


@dataclass(frozen=True, slots=True)
class Robot:
    """A differential drive with plain limiters (Gazebo's DiffDrive and SpeedLimiter).

    Attributes:
        radius_m: Body with bumper, as physics sees it; of a polygon the distance of its farthest vertex.
        vertices: (x, y) of a polygon in the robot's frame (m); none for a disc.
    """

    radius_m: float = 0.17
    mass_kg: float = 3.3
    max_speed_mps: float = 0.5
    max_acceleration_mps2: float = 2.0
    max_yaw_rate_radps: float = 2.0
    max_yaw_acceleration_radps2: float = 3.0
    vertices: tuple[tuple[float, float], ...] = ()


@njit
def limited(command: float, previous: float, limit: float, acceleration: float, dt_s: float) -> float:
    """A command after the actuator's acceleration limit (relative to the last limited one) and speed limit."""
    step = acceleration * dt_s
    return min(max(min(max(command, previous - step), previous + step), -limit), limit)


@njit
def arc(x_m: float, y_m: float, yaw_rad: float, v_mps: float, w_radps: float, dt_s: float) -> Any:
    """Pose (x, y, yaw) after `dt_s` on a circle arc at constant speeds, exact."""
    turn = w_radps * dt_s
    chord = v_mps * dt_s if abs(turn) < 1e-06 else v_mps * dt_s * math.sin(0.5 * turn) / (0.5 * turn)
    middle = yaw_rad + 0.5 * turn
    return x_m + chord * math.cos(middle), y_m + chord * math.sin(middle), yaw_rad + turn


@njit
def wrapped(angle_rad: float) -> float:
    """The angle in [-π, π)."""
    return (angle_rad + math.pi) % (2.0 * math.pi) - math.pi
