"""The social force model of pedestrians.

Helbing and Molnár (Physical Review E 51 (1995) 4282): a force drives each to its desired velocity, others keep it off people and walls,
and none walks faster than 1.3 times its desired speed. The force between people is that of Moussaïd and others (Proceedings of the Royal
Society B 276 (2009) 2755), measured on 40 people who met or passed in a corridor, with their values, those of relaxation and walls among
them. Accelerations are for a unit mass.
"""

import math
from typing import Any, Final, NamedTuple

import numpy as np

from vastflow.sim.kernels.numeric import inner, njit
from vastflow.sim.model.rates import TICK_S
from vastflow.sim.world.obstacle_rows import DISC, SHAPE
from vastflow.sim.world.skip_table import WALL, SkipTable, free_square

RELAXATION_S: Final = 0.54
STRENGTH_MPS2: Final = 4.5
RANGE: Final = 0.35
"""Range of the interaction as a share of the length of its vector."""
ANGULAR: Final = 2.0
ANGULAR_BRAKING: Final = 3.0
"""Reach of turning away, and of slowing down, in angles."""
VELOCITY_WEIGHT: Final = 2.0
"""Weight of the relative velocity beside the direction of the other."""
BIAS: Final = 0.005
"""Preference of the right-hand side, which decides for two who meet head-on."""
WALL_MPS2: Final = 3.0
WALL_RANGE_M: Final = 0.1
WALL_REACH_M: Final = 1.0
"""Distance from the rim beyond which walls are not felt: the force is 1e-4 m/s² there."""
FASTEST: Final = 1.3
"""Greatest speed as a multiple of the desired one."""
REACHED_M: Final = 0.3
"""Distance at which a waypoint is reached."""
_TURNING_MPS: Final = 0.1
"""Speed above which a person looks where it walks."""


class People(NamedTuple):
    """The people of a run, in the frame of the map's grid.

    Attributes:
        xy_m, v_mps: (M, 2) place and velocity.
        yaw_rad: (M,) direction of the body.
        target: (M,) int64 index into `points` of the waypoint that each walks to.
        points: (K, 2) waypoints of all, in the order in which they are walked to.
        ends: (M, 2) int64 first and last of each one's points.
        cyclic: (M,) bool, whether the first follows the last.
        speed_mps: (M,) desired speeds.
        radius_m: (M,)
        avoids: (M,) bool, whether they avoid the robot.
    """

    xy_m: Any
    v_mps: Any
    yaw_rad: Any
    target: Any
    points: Any
    ends: Any
    cyclic: Any
    speed_mps: Any
    radius_m: Any
    avoids: Any


class Walls(NamedTuple):
    """Walls and standing obstacles, which people keep off.

    Attributes:
        skips, resolution_m, origin_x_m, origin_y_m: The map's table, the edge of its cells, and its corner.
        obstacles: (K, 7), see `vastflow.sim.world.obstacle_rows`.
    """

    skips: SkipTable
    resolution_m: float
    origin_x_m: float
    origin_y_m: float
    obstacles: Any


@njit
def interaction(dx_m: float, dy_m: float, dvx_mps: float, dvy_mps: float, bias: float) -> tuple[float, float]:
    """Return the acceleration (x, y) of a person by another, who feels the opposite.

    Args:
        dx_m, dy_m: From the person to the other.
        dvx_mps, dvy_mps: Its velocity relative to the other's.
    """
    d = math.sqrt(dx_m * dx_m + dy_m * dy_m)
    if d == 0.0:
        return 0.0, 0.0
    ex, ey = dx_m / d, dy_m / d
    ix, iy = VELOCITY_WEIGHT * dvx_mps + ex, VELOCITY_WEIGHT * dvy_mps + ey
    length = math.sqrt(ix * ix + iy * iy)
    if length < 1e-6:
        return 0.0, 0.0
    tx, ty = ix / length, iy / length
    reach_m = RANGE * length
    angle = math.atan2(tx * ey - ty * ex, tx * ex + ty * ey) + bias * reach_m
    near = STRENGTH_MPS2 * math.exp(-d / reach_m)
    braking = ANGULAR_BRAKING * reach_m * angle
    turning = ANGULAR * reach_m * angle
    brakes = near * math.exp(-braking * braking)
    turns = near * math.exp(-turning * turning)
    if angle <= 0.0:
        turns = -turns if angle < 0.0 else 0.0
    # Turns are to the right of the interaction, (ty, -tx), where the other is on its left.
    return -brakes * tx + turns * ty, -brakes * ty - turns * tx


@njit
def walk(people: People, walls: Walls, robot: Any, bias: float, out: Any) -> None:
    """Let people walk tick by tick, and write x, y, yaw (T, M, 3) after each.

    Args:
        robot: (4,) its place and velocity, the same in all ticks.
    """
    xy, v = people.xy_m, people.v_mps
    count = xy.shape[0]
    push, off = np.empty((count, 2)), np.empty((count, 3))
    for tick in range(out.shape[0]):
        for i in range(count):
            push[i, 0], push[i, 1] = _own(people, walls, i, off[i])
        for i in range(count):
            for j in range(i + 1, count):
                x, y = interaction(xy[j, 0] - xy[i, 0], xy[j, 1] - xy[i, 1], v[i, 0] - v[j, 0], v[i, 1] - v[j, 1], bias)
                push[i, 0] += x
                push[i, 1] += y
                push[j, 0] -= x
                push[j, 1] -= y
            if people.avoids[i]:
                x, y = interaction(
                    robot[0] - xy[i, 0], robot[1] - xy[i, 1], v[i, 0] - robot[2], v[i, 1] - robot[3], bias
                )
                push[i, 0] += x
                push[i, 1] += y
        for i in range(count):
            vx, vy = v[i, 0] + push[i, 0] * TICK_S, v[i, 1] + push[i, 1] * TICK_S
            speed, most = math.sqrt(vx * vx + vy * vy), FASTEST * people.speed_mps[i]
            if speed > most:
                vx, vy = vx * most / speed, vy * most / speed
            # The force alone lets people walk into a wall that they meet at full speed.
            beyond = vx * off[i, 0] + vy * off[i, 1] - max(off[i, 2], 0.0) / TICK_S
            if beyond > 0.0:
                vx, vy = vx - beyond * off[i, 0], vy - beyond * off[i, 1]
            v[i, 0], v[i, 1] = vx, vy
            xy[i, 0] += vx * TICK_S
            xy[i, 1] += vy * TICK_S
            if speed > _TURNING_MPS:
                people.yaw_rad[i] = math.atan2(vy, vx)
            out[tick, i, 0], out[tick, i, 1], out[tick, i, 2] = xy[i, 0], xy[i, 1], people.yaw_rad[i]


@inner
def _own(people: People, walls: Walls, i: int, off: Any) -> tuple[float, float]:
    """Return the acceleration of a person toward its waypoint and off the nearest wall.

    Write the direction of that wall and the gap to it (3,), infinite without one.
    """
    x, y, at = people.xy_m[i, 0], people.xy_m[i, 1], people.target[i]
    dx, dy = people.points[at, 0] - x, people.points[at, 1] - y
    away = math.sqrt(dx * dx + dy * dy)
    if away < REACHED_M and (people.cyclic[i] or at < people.ends[i, 1]):
        people.target[i] = at = people.ends[i, 0] if at == people.ends[i, 1] else at + 1
        dx, dy = people.points[at, 0] - x, people.points[at, 1] - y
        away = math.sqrt(dx * dx + dy * dy)
    speed = people.speed_mps[i] / away if away >= REACHED_M else 0.0
    px = (speed * dx - people.v_mps[i, 0]) / RELAXATION_S
    py = (speed * dy - people.v_mps[i, 1]) / RELAXATION_S
    wx, wy = _to_wall(walls, x, y, WALL_REACH_M + people.radius_m[i])
    d = math.sqrt(wx * wx + wy * wy)
    off[0], off[1], off[2] = 0.0, 0.0, math.inf
    if 0.0 < d < math.inf:
        off[0], off[1], off[2] = wx / d, wy / d, d - people.radius_m[i]
        near = WALL_MPS2 * math.exp(-off[2] / WALL_RANGE_M)
        px -= near * off[0]
        py -= near * off[1]
    return px, py


@inner
def _to_wall(walls: Walls, x_m: float, y_m: float, reach_m: float) -> tuple[float, float]:
    """Return the vector to the nearest wall or obstacle within a reach; infinite without one."""
    skips, edge = walls.skips, walls.resolution_m
    best, best_x, best_y = reach_m * reach_m, math.inf, math.inf
    x, y, reach = (x_m - walls.origin_x_m) / edge, (y_m - walls.origin_y_m) / edge, reach_m / edge
    if free_square(skips, x, y) < reach:
        for r in range(max(math.floor(y - reach), 0), min(math.floor(y + reach) + 1, skips.rows - 2)):
            dy = (r - y if y < r else min(r + 1.0 - y, 0.0)) * edge
            if dy * dy >= best:
                continue
            for c in range(max(math.floor(x - reach), 0), min(math.floor(x + reach) + 1, skips.columns - 2)):
                if skips.cells[(r + 1) * skips.columns + c + 1] == WALL:
                    dx = (c - x if x < c else min(c + 1.0 - x, 0.0)) * edge
                    if dx * dx + dy * dy < best:
                        best, best_x, best_y = dx * dx + dy * dy, dx, dy
    for k in range(walls.obstacles.shape[0]):
        row = walls.obstacles[k]
        dx, dy, c, s = row[0] - x_m, row[1] - y_m, row[2], row[3]
        if row[SHAPE] == DISC:
            away = math.sqrt(dx * dx + dy * dy)
            share = max(1.0 - row[4] / away, 0.0) if away > 0.0 else 0.0
            dx, dy = share * dx, share * dy
        else:
            # In the box's own axes: from the person to its nearest point.
            ahead, left = dx * c + dy * s, dy * c - dx * s
            ahead -= min(max(ahead, -row[4]), row[4])
            left -= min(max(left, -row[5]), row[5])
            dx, dy = ahead * c - left * s, ahead * s + left * c
        if dx * dx + dy * dy < best:
            best, best_x, best_y = dx * dx + dy * dy, dx, dy
    return best_x, best_y
