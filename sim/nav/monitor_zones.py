"""The collision monitor's zones as arrays, for its kernels."""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vastflow.sim.nav.parameters.servers import MOST_ZONES, MonitorZone
from vastflow.sim.nav.polygon import MOST_VERTICES

STOP, SLOWDOWN, LIMIT, APPROACH = range(4)
_ACTIONS: Final = ("stop", "slowdown", "limit", "approach")

ZONE: Final = (
    "action",
    "vertices",
    "radius_m",
    "reach_m",
    "min_points",
    "ratio",
    "v_mps",
    "w_radps",
    "ahead_s",
    "step_s",
)
"""Columns of a zone's row; `ahead_s` is 0 but for an approach, and of a circle `vertices` is 0."""


def zones_reach_m(zones: Sequence[MonitorZone], fastest_mps: float, scan_period_s: float) -> float:
    """How far from the robot at a scan a point may lie that comes into a zone before the next scan; 0 without zones."""
    rows = [dict(zip(ZONE, row, strict=True)) for row in zone_rows(zones)[0][: len(zones)].tolist()]
    slack_s = scan_period_s + 0.1
    return max((row["reach_m"] + fastest_mps * (row["ahead_s"] + slack_s) + 0.1 for row in rows), default=0.0)


def zone_rows(zones: Sequence[MonitorZone]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(MOST_ZONES, Z) of `ZONE` and (MOST_ZONES, MOST_VERTICES, 2) in the robot's frame (m), zeros behind the last."""
    rows, points = np.zeros((MOST_ZONES, len(ZONE))), np.zeros((MOST_ZONES, MOST_VERTICES, 2))
    for k, zone in enumerate(zones):
        reach_m = max((math.hypot(x_m, y_m) for x_m, y_m in zone.vertices), default=zone.radius)
        ahead_s = zone.time_before_collision if zone.action == "approach" else 0.0
        rows[k] = (
            *(_ACTIONS.index(zone.action), len(zone.vertices), zone.radius, reach_m, zone.min_points),
            *(zone.slowdown_ratio, zone.linear_limit, zone.angular_limit, ahead_s, zone.simulation_time_step),
        )
        if zone.vertices:
            points[k, : len(zone.vertices)] = zone.vertices
    return rows, points
