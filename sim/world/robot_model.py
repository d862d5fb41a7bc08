"""The robot's body, actuators, and laser scanner as values, without kernels: campaign files are read with it."""

import math
from dataclasses import dataclass
from typing import Final, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

Drive: TypeAlias = Literal["differential", "ackermann", "omni"]


@dataclass(frozen=True, slots=True)
class Robot:
    """A drive with plain limiters (Gazebo's DiffDrive and SpeedLimiter).

    Attributes:
        radius_m: Radius of the body with bumper; of a polygon the distance of its farthest vertex.
        vertices: (x, y) of a polygon in the robot's frame (m); none for a disc.
        drive: An omni drive moves to its sides within the same limits as ahead.
        min_turning_radius_m: Least turning radius of an Ackermann drive; others turn on the spot.
    """

    radius_m: float = 0.17
    mass_kg: float = 3.3
    max_speed_mps: float = 0.5
    max_acceleration_mps2: float = 2.0
    max_yaw_rate_radps: float = 2.0
    max_yaw_acceleration_radps2: float = 3.0
    vertices: tuple[tuple[float, float], ...] = ()
    drive: Drive = "differential"
    min_turning_radius_m: float = 0.0


MOST_BEAMS: Final = 4096


@dataclass(frozen=True, slots=True)
class Lidar:
    """The scanner of the minimal TurtleBot 4 model (Nav2's simulation, RPLIDAR).

    Attributes:
        mount_xyt: Pose on the robot (m, m, rad).
        sweeps: True if beams are measured one after the other in a turn of one period, counter-clockwise.
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
        """Angle of the last beam."""
        return self.angle_min_rad + self.angle_increment_rad * (self.beams - 1)

    def directions(self) -> NDArray[np.float64]:
        """Return unit vectors (beams, 2) of the beams in the robot's frame."""
        from vastflow.sim.kernels.arrays import cos_sins  # campaign files are read without kernels

        bearings_rad = self.mount_xyt[2] + self.angle_min_rad + self.angle_increment_rad * np.arange(self.beams)
        return np.column_stack(cos_sins(bearings_rad))


TURTLEBOT_4: Final = Robot()
TURTLEBOT_4_LIDAR: Final = Lidar()
TURTLEBOT_4_RADIUS_M: Final = 0.22
"""`robot_radius` of Nav2's default file: larger than the TurtleBot 4 that it is for."""
