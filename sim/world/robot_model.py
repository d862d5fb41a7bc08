"""The robot's body and actuators: the minimal TurtleBot 4 model of Nav2's simulation."""

from dataclasses import dataclass
from typing import Literal, TypeAlias

Drive: TypeAlias = Literal["differential", "ackermann", "omni"]


@dataclass(frozen=True, slots=True)
class Robot:
    """A drive with plain limiters (Gazebo's DiffDrive and SpeedLimiter).

    Attributes:
        radius_m: Body with bumper, as physics sees it; of a polygon the distance of its farthest vertex.
        vertices: (x, y) of a polygon in the robot's frame (m); none for a disc.
        drive: An omni drive moves to its sides as well, within the same limits as ahead.
        min_turning_radius_m: Of an Ackermann drive, whose yaw rate is at most its speed divided by this; others turn on the spot.
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
