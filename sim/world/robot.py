"""A drive's motion: what its actuators make of a command, and the arc that follows."""

import math
from typing import Any

from vastflow.sim.kernels.numeric import njit


@njit
def limited(command: float, previous: float, limit: float, acceleration: float, dt_s: float) -> float:
    """A command after the actuator's acceleration limit (relative to the last limited one) and speed limit."""
    step = acceleration * dt_s
    return min(max(min(max(command, previous - step), previous + step), -limit), limit)


@njit
def steered(v_mps: float, w_radps: float, min_turning_radius_m: float) -> float:
    """The yaw rate of an Ackermann drive, whose arcs are no tighter than its least radius: none while it stands."""
    most = abs(v_mps) / min_turning_radius_m
    return min(max(w_radps, -most), most)


@njit
def arc(x_m: float, y_m: float, yaw_rad: float, v_mps: float, w_radps: float, dt_s: float) -> Any:
    """Pose (x, y, yaw) after `dt_s` on a circle arc at constant speeds, exact."""
    turn = w_radps * dt_s
    chord = v_mps * dt_s if abs(turn) < 1e-06 else v_mps * dt_s * math.sin(0.5 * turn) / (0.5 * turn)
    middle = yaw_rad + 0.5 * turn
    return x_m + chord * math.cos(middle), y_m + chord * math.sin(middle), yaw_rad + turn


@njit
def moved(x_m: float, y_m: float, yaw_rad: float, v_mps: float, w_radps: float, vy_mps: float, dt_s: float) -> Any:
    """As `arc`, of a body that moves to its left as well (m/s)."""
    end_x_m, end_y_m, end_yaw_rad = arc(x_m, y_m, yaw_rad, v_mps, w_radps, dt_s)
    if vy_mps != 0.0:
        end_x_m, end_y_m, _ = arc(end_x_m, end_y_m, yaw_rad + 0.5 * math.pi, vy_mps, w_radps, dt_s)
    return end_x_m, end_y_m, end_yaw_rad


@njit
def wrapped(angle_rad: float) -> float:
    """The angle in [-π, π)."""
    return (angle_rad + math.pi) % (2.0 * math.pi) - math.pi
