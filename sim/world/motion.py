"""The motion of the robot's body: actuators, arcs, and contacts.

A body moves on exact arcs while no wall and no obstacle comes within a millimeter of it at the end of any physics step, which is when
the engine would find a contact; otherwise the engine makes the step.
"""

import math
from typing import Any, Final, NamedTuple

import numpy as np

from vastflow.sim.kernels.numeric import inner, njit
from vastflow.sim.world.obstacle_rows import DISC, SHAPE
from vastflow.sim.world.skip_table import WALL, SkipTable, free_square


@njit
def limited(command: float, previous: float, limit: float, acceleration: float, dt_s: float) -> float:
    """Limit a command's acceleration (relative to the last limited one) and speed."""
    step = acceleration * dt_s
    return min(max(min(max(command, previous - step), previous + step), -limit), limit)


@njit
def steered(v_mps: float, w_radps: float, min_turning_radius_m: float) -> float:
    """Limit the yaw rate of an Ackermann drive by its least turning radius."""
    most = abs(v_mps) / min_turning_radius_m
    return min(max(w_radps, -most), most)


@njit
def arc(x_m: float, y_m: float, yaw_rad: float, v_mps: float, w_radps: float, dt_s: float) -> Any:
    """Return the exact pose (x, y, yaw) after `dt_s` at constant speeds."""
    turn = w_radps * dt_s
    chord = v_mps * dt_s if abs(turn) < 1e-06 else v_mps * dt_s * math.sin(0.5 * turn) / (0.5 * turn)
    middle = yaw_rad + 0.5 * turn
    return x_m + chord * math.cos(middle), y_m + chord * math.sin(middle), yaw_rad + turn


@njit
def chord_mps(v_mps: float, w_radps: float, vy_mps: float, yaw_rad: float, dt_s: float) -> Any:
    """Return the velocity (x, y) along the chord of the arc that begins at `yaw_rad`."""
    half_turn = 0.5 * w_radps * dt_s
    per_arc = math.sin(half_turn) / half_turn if abs(half_turn) > 1e-6 else 1.0
    c, s = math.cos(yaw_rad + half_turn), math.sin(yaw_rad + half_turn)
    return v_mps * per_arc * c - vy_mps * per_arc * s, v_mps * per_arc * s + vy_mps * per_arc * c


@njit
def moved(x_m: float, y_m: float, yaw_rad: float, v_mps: float, w_radps: float, vy_mps: float, dt_s: float) -> Any:
    """Return `arc` of a body that moves to its left as well (m/s)."""
    end_x_m, end_y_m, end_yaw_rad = arc(x_m, y_m, yaw_rad, v_mps, w_radps, dt_s)
    if vy_mps != 0.0:
        end_x_m, end_y_m, _ = arc(end_x_m, end_y_m, yaw_rad + 0.5 * math.pi, vy_mps, w_radps, dt_s)
    return end_x_m, end_y_m, end_yaw_rad


@njit
def wrapped(angle_rad: float) -> float:
    """Return the angle in [-π, π)."""
    return (angle_rad + math.pi) % (2.0 * math.pi) - math.pi


MARGIN_M: Final = 0.001
FREE, TOUCHING, MOVING = 0, 1, 2
"""State of the engine: no contact; a robot in contact with things at rest; things in motion."""


class Body(NamedTuple):
    """The robot's body, and the obstacles that stand or appear in the world.

    Attributes:
        pose: (3,) float64 true x, y, yaw; kernels and the engine move it in turn.
        radius_m: Radius of its disc, or of one that holds its polygon: near anything the engine looks closer.
        obstacles: (K, 7) float64, see `vastflow.sim.world.obstacle_rows`.
        triggers: (K, 5) float64 x, y of each obstacle's trigger point, the distance from it within which the robot triggers the
            obstacle, the ticks from then until it appears, and the tick at which it does. The distance is negative for one that
            was triggered or never will be, the tick infinite until it is triggered and once it has appeared.
        movers: (T, M, 3) float64 x, y, yaw at each tick of the first M obstacles, which move.
    """

    pose: Any
    radius_m: float
    obstacles: Any
    triggers: Any
    movers: Any


@inner
def due(body: Body, tick: int) -> int:
    """Trigger the obstacles near the robot and return the first that appears at this tick, or -1."""
    for k in range(body.triggers.shape[0]):
        dx, dy = body.triggers[k, 0] - body.pose[0], body.triggers[k, 1] - body.pose[1]
        reach = body.triggers[k, 2]
        if reach >= 0.0 and dx * dx + dy * dy <= reach * reach:
            body.triggers[k, 2] = -1.0
            body.triggers[k, 4] = tick + body.triggers[k, 3]
        if body.triggers[k, 4] <= tick:
            return k
    return -1


@inner
def place_movers(body: Body, tick: int, share: float) -> None:
    """Place the movers where they are at a share of the way from a tick to the next."""
    for k in range(body.movers.shape[1]):
        here, row = body.movers[tick, k], body.obstacles[k]
        x, y, yaw = here[0], here[1], here[2]
        if share > 0.0:
            there = body.movers[tick + 1, k]
            x, y = x + share * (there[0] - x), y + share * (there[1] - y)
            yaw += share * wrapped(there[2] - yaw)
        row[0], row[1], row[2], row[3] = x, y, math.cos(yaw), math.sin(yaw)


@njit
def move_freely(
    skips: SkipTable,
    resolution_m: float,
    origin_x_m: float,
    origin_y_m: float,
    body: Body,
    velocities: Any,
    dt_s: float,
    hold: int,
    tick: int,
) -> bool:
    """Move the body by (speed, yaw rate, speed to the left) a step; False where the engine has to.

    Args:
        hold: FREE, TOUCHING or MOVING. A robot in contact moves freely only while it stands still and no mover comes to it.
        tick: The tick that it is moved in.
    """
    if hold == MOVING or (hold == TOUCHING and np.any(velocities)):
        return False
    near = body.obstacles.shape[0] if hold == FREE else body.movers.shape[1]
    x, y, yaw = body.pose[0], body.pose[1], body.pose[2]
    column, row = (x - origin_x_m) / resolution_m, (y - origin_y_m) / resolution_m
    reach_m = body.radius_m + MARGIN_M
    driven_m = 0.0
    for k in range(velocities.shape[0]):
        driven_m += (abs(velocities[k, 0]) + abs(velocities[k, 2])) * dt_s
    near_walls = hold == FREE and free_square(skips, column, row) * resolution_m < reach_m + driven_m
    for k in range(velocities.shape[0]):
        x, y, yaw = moved(x, y, yaw, velocities[k, 0], velocities[k, 1], velocities[k, 2], dt_s)
        if near_walls:
            column, row = (x - origin_x_m) / resolution_m, (y - origin_y_m) / resolution_m
            if _meets_wall(skips, column, row, reach_m / resolution_m):
                return False
        place_movers(body, tick, (k + 1) / velocities.shape[0])
        for o in range(near):
            if _meets(body.obstacles[o], x, y, reach_m):
                return False
    if hold == FREE:
        body.pose[0], body.pose[1], body.pose[2] = x, y, yaw
    return True


@inner
def _meets_wall(skips: SkipTable, x: float, y: float, radius: float) -> bool:
    """True if a disc on the map, all in cells, touches an occupied cell."""
    rows, columns = skips.rows - 2, skips.columns - 2
    # Octant 0 has the cells as they lie, rows first.
    for r in range(max(math.floor(y - radius), 0), min(math.floor(y + radius) + 1, rows)):
        dy = max(max(r - y, y - r - 1.0), 0.0)
        for c in range(max(math.floor(x - radius), 0), min(math.floor(x + radius) + 1, columns)):
            dx = max(max(c - x, x - c - 1.0), 0.0)
            if dx * dx + dy * dy <= radius * radius and skips.cells[(r + 1) * skips.columns + c + 1] == WALL:
                return True
    return False


@inner
def _meets(obstacle: Any, x_m: float, y_m: float, radius_m: float) -> bool:
    dx, dy = x_m - obstacle[0], y_m - obstacle[1]
    away = obstacle[4] + obstacle[5] + radius_m
    if not (abs(dx) <= away and abs(dy) <= away):
        return False
    if obstacle[SHAPE] == DISC:
        return bool(dx * dx + dy * dy <= away * away)
    c, s = obstacle[2], obstacle[3]
    px = max(abs(dx * c + dy * s) - obstacle[4], 0.0)
    py = max(abs(dy * c - dx * s) - obstacle[5], 0.0)
    return bool(px * px + py * py <= radius_m * radius_m)
