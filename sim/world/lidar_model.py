"""The laser scanner as a value: its beams, its range, and where it is mounted. No kernel is here: campaign files are read with it."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

MOST_BEAMS: Final = 4096


@dataclass(frozen=True, slots=True)
class Lidar:
    """The scanner of the minimal TurtleBot 4 model (Nav2's simulation, RPLIDAR).

    Attributes:
        mount_xyt: Pose on the robot (m, m, rad).
        sweeps: Whether each beam has a time of its own in a turn of one period, counter-clockwise; else a scan is taken at once.
        range_min_m, range_max_m: Readings lie in [min, max); beyond there is no return (inf).
    """

    beams: int = 360
    angle_min_rad: float = 0.0
    angle_increment_rad: float = 6.28 / 359
    range_min_m: float = 0.164
    range_max_m: float = 20.0
    rate_hz: float = 10.0
    mount_xyt: tuple[float, float, float] = (-0.04, 0.0, math.pi / 2)
    sweeps: bool = False

    @property
    def angle_max_rad(self) -> float:
        """Of the last beam."""
        return self.angle_min_rad + self.angle_increment_rad * (self.beams - 1)

    def directions(self) -> NDArray[np.float64]:
        """(beams, 2) unit vectors of the beams in the robot's frame."""
        bearings_rad = self.mount_xyt[2] + self.angle_min_rad + self.angle_increment_rad * np.arange(self.beams)
        return np.column_stack([np.cos(bearings_rad), np.sin(bearings_rad)])
