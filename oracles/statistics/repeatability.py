"""Accuracy and repeatability of the poses in which runs of one configuration end."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from vastflow.oracles.statistics.intervals import Floats
from vastflow.sim.model.elementary import hypot, hypots

LEAST_ENDS: Final = 10
"""Fewest ends of which a spread is given; ISO 9283 measures a pose 30 times."""


@dataclass(frozen=True, slots=True)
class Repeatability:
    """Pose accuracy and repeatability by the formulas of ISO 9283, in the plane.

    Attributes:
        ends: Number of reached poses.
        accuracy_m: AP, distance of their barycenter from the commanded position.
        repeatability_m: RP, mean and three standard deviations (n - 1) of the distances from the barycenter.
        yaw_accuracy_rad, yaw_repeatability_rad: Absolute mean, and three standard deviations, of the yaw's error.
    """

    ends: int
    accuracy_m: float
    repeatability_m: float
    yaw_accuracy_rad: float
    yaw_repeatability_rad: float


def repeatability_of(x_m: Floats, y_m: Floats, yaw_rad: Floats) -> Repeatability | None:
    """Return accuracy and repeatability of final poses; None for too few.

    Args:
        x_m, y_m, yaw_rad: (N,) as seen from the commanded pose, NaN where it was not reached.
    """
    reached = np.isfinite(x_m) & np.isfinite(y_m) & np.isfinite(yaw_rad)
    if (ends := int(reached.sum())) < LEAST_ENDS:
        return None
    x_m, y_m, yaw_rad = x_m[reached], y_m[reached], yaw_rad[reached]
    mean_x_m, mean_y_m, mean_yaw_rad = (math.fsum(values) / ends for values in (x_m, y_m, yaw_rad))
    apart_m = hypots(x_m - mean_x_m, y_m - mean_y_m)
    return Repeatability(
        ends,
        hypot(mean_x_m, mean_y_m),
        math.fsum(apart_m) / ends + 3 * float(apart_m.std(ddof=1)),
        abs(mean_yaw_rad),
        3 * float(yaw_rad.std(ddof=1)),
    )
