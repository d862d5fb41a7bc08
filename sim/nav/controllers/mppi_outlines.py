"""CostCritic's collisions of the robot's outline (nav2_mppi_controller, `consider_footprint`)."""

import math
from typing import Any

from vastflow.sim.kernels.numeric import inner
from vastflow.sim.nav.controllers.controller import ControllerInput
from vastflow.sim.nav.controllers.mppi_critics import COLLISION, Frame
from vastflow.sim.nav.controllers.mppi_samples import ROW, STEP, Space
from vastflow.sim.nav.footprint import outline_hits
from vastflow.sim.nav.window import Window, cost_at


@inner
def judge_outlines(
    space: Space,
    first: int,
    points: int,
    stride: int,
    frame: Frame,
    given: ControllerInput,
    motion: Any,
    circumscribed_cost: float,
    weight: float,
    crash: float,
) -> None:
    """Let those samples of a group collide whose outline does at one of `points` points of the track, `stride` steps apart.

    Args:
        motion: The heading at the track's first point (rad), and the time between two (s).
        circumscribed_cost: The least cost of a center whose outline is looked at; in free space none is.
        weight, crash: As of `judge_cells`, which has judged the centers.
    """
    window, outline, least_cost = given.window, given.outline, max(circumscribed_cost, 1.0)
    for lane in range(ROW):
        collides = space.touched[first + lane] >= COLLISION
        yaw_rad = motion[0]
        for p in range(points):
            if collides:
                break
            k = p * stride
            x_m = frame.left_m + space.track[k * STEP + lane] * frame.resolution_m
            y_m = frame.bottom_m + space.track[k * STEP + ROW + lane] * frame.resolution_m
            collides = cost_at(window, x_m, y_m) >= least_cost and (
                _leaves(window, outline, x_m, y_m, yaw_rad) or outline_hits(window, outline, x_m, y_m, yaw_rad)
            )
            if collides:
                space.costs[first + lane] += crash - space.touched[first + lane] * weight
                space.touched[first + lane] = COLLISION
            elif p < points - 1:
                for t in range(k, k + stride):
                    yaw_rad += space.turns[t * ROW + lane] * motion[1]


@inner
def _leaves(window: Window, outline: Any, x_m: float, y_m: float, yaw_rad: float) -> bool:
    """Whether a vertex lies outside the window, which Nav2 takes for a collision."""
    rows, columns = window.costs.shape
    width_m, height_m = columns * window.place[2], rows * window.place[2]
    x, y = x_m - window.place[0], y_m - window.place[1]
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    for k in range(outline.shape[0]):
        vertex_x, vertex_y = x + (c * outline[k, 0] - s * outline[k, 1]), y + (s * outline[k, 0] + c * outline[k, 1])
        if not (0.0 <= vertex_x < width_m and 0.0 <= vertex_y < height_m):
            return True
    return False
