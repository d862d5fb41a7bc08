"""Parameters of the robot itself: its body, actuators, laser scanner, and latency, as a campaign's section `robot` gives them.

What is not given follows from the Nav2 parameters or is the TurtleBot 4's, see `vastflow.sim.nav2.system.robot`.
"""

import functools
import math
from collections.abc import Mapping
from typing import Any, Final, Self

from pydantic import field_validator, model_validator

from vastflow.sim.model.parameter import ParameterGroup, ParameterLocation, parameter
from vastflow.sim.model.polygon import vertices_of
from vastflow.sim.world.robot_model import MOST_BEAMS, Drive

LATENCY_KEY: Final = "latency"
"""Name of the section below `robot`."""

ODOMETRY_KEY: Final = "odometry"
"""Name of the section of odometry's drift below `robot`."""

NOISE_PLACE: Final[ParameterLocation] = ("robot", "lidar", "noise")
"""Location of the parameters of the lidar's noise; `model` among them is its name."""

NOISE_MODEL_KEY: Final = "robot.lidar.noise.model"

PRESET_KEY: Final = "preset"
"""Key of the section with the preset that gives omitted values."""

OLDEST_S: Final = 0.5
"""Maximum age of a message; later ones count as this old, because Nav2's message filters drop much older ones."""

PHYSICS_HZ: Final = 100.0
"""Odometry at this rate is as new as the stack's tick."""


class Latency(ParameterGroup):
    """Ages and times in seconds, rates in Hz.

    An age is the least; a jitter is the mean of an exponentially distributed addition.

    Attributes:
        scan_age, scan_jitter: From the end of a scan to AMCL, costmaps, and collision monitor.
        odometry_rate: Rate of odometry's messages and its transform.
        tf_age, tf_jitter: From a sample of odometry to the stack.
        controller_time, controller_jitter: From the begin of a controller cycle to its command; while it computes, none begins.
        missed_cycles: Share of the controller's cycles that are left out; the last command stands.
        smoother_in_step: Whether the velocity smoother runs right after the controller's cycle begins; else at a phase drawn for the run.
    """

    scan_age: float = parameter(0.0, 0.0, OLDEST_S)
    scan_jitter: float = parameter(0.0, 0.0, OLDEST_S)
    odometry_rate: float = parameter(PHYSICS_HZ, 5.0, PHYSICS_HZ)
    tf_age: float = parameter(0.0, 0.0, OLDEST_S)
    tf_jitter: float = parameter(0.0, 0.0, OLDEST_S)
    controller_time: float = parameter(0.0, 0.0, OLDEST_S)
    controller_jitter: float = parameter(0.0, 0.0, OLDEST_S)
    missed_cycles: float = parameter(0.0, 0.0, 0.9)
    smoother_in_step: bool = parameter(True)


IDEAL: Final = Latency()


class OdometryDrift(ParameterGroup):
    """Drift of odometry's pose, after the noise of Nav2's motion models: its variance grows with what is driven and turned.

    After L meters and A radians, the distance has the standard deviation sqrt(a² L + b² A), and the yaw likewise. The twist is the wheels'.

    Attributes:
        translation_std_per_meter, translation_std_per_radian: Standard deviation of the distance after 1 m, and after a turn of 1 rad (m).
        rotation_std_per_meter, rotation_std_per_radian: Standard deviation of the yaw after 1 m, and after a turn of 1 rad (rad).
    """

    translation_std_per_meter: float = parameter(0.0, 0.0, 10.0)
    translation_std_per_radian: float = parameter(0.0, 0.0, 10.0)
    rotation_std_per_meter: float = parameter(0.0, 0.0, 10.0)
    rotation_std_per_radian: float = parameter(0.0, 0.0, 10.0)


PRESETS: Final[Mapping[str, Latency]] = {
    "ideal": IDEAL,
    "gazebo": Latency(
        scan_age=0.02,
        scan_jitter=0.01,
        odometry_rate=30.0,
        tf_age=0.005,
        tf_jitter=0.005,
        controller_time=0.007,
        controller_jitter=0.006,
        missed_cycles=0.01,
        smoother_in_step=False,
    ),
    "loaded": Latency(
        scan_age=0.12,
        scan_jitter=0.05,
        odometry_rate=20.0,
        tf_age=0.022,
        tf_jitter=0.02,
        controller_time=0.055,
        controller_jitter=0.06,
        missed_cycles=0.05,
        smoother_in_step=False,
    ),
}
"""Presets; `docs/the-simulator.md` has the sources of their numbers."""


ROBOT_KEY: Final = "robot"
"""First name of the keys of the system dimension that give these."""

NAMESPACE_KEY: Final = "robot.namespace"
"""Key that chooses one of several robots of a Nav2 parameter file."""

WHOLE_TURN_RAD: Final = 2.0 * math.pi + 1e-3
"""Files round a turn's angles up, as in 3.1416."""


class LidarParameters(ParameterGroup):
    """Laser scanner: meters, radians and Hz; `x`, `y` and `yaw` of its mount are in the robot's frame.

    Angles are counter-clockwise from the mount's yaw.
    """

    x: float | None = parameter(None, -10.0, 10.0)
    y: float | None = parameter(None, -10.0, 10.0)
    yaw: float | None = parameter(None, -7.0, 7.0)
    beams: int | None = parameter(None, 2, MOST_BEAMS)
    angle_min: float | None = parameter(None, -7.0, 7.0)
    angle_max: float | None = parameter(None, -7.0, 7.0)
    range_min: float | None = parameter(None, 0.0, 10.0)
    range_max: float | None = parameter(None, 0.2, 1000.0)
    rate: float | None = parameter(None, 1.0, 20.0)
    sweeps: bool | None = parameter(None)

    @model_validator(mode="after")
    def _limits_agree(self) -> Self:
        if (self.angle_min is None) != (self.angle_max is None):
            raise ValueError("angle_min and angle_max must be given together")
        low, high = self.angle_min, self.angle_max
        if low is not None and high is not None and not 0.0 < high - low <= WHOLE_TURN_RAD:
            raise ValueError(f"angle_max {high:g} must lie within a turn above angle_min {low:g}")
        if self.range_min is not None and self.range_max is not None and self.range_min >= self.range_max:
            raise ValueError(f"range_min {self.range_min:g} must be < range_max {self.range_max:g}")
        return self


class RobotParameters(ParameterGroup):
    """The robot's body and the limits of its actuators (m, kg, m/s, rad/s, and per second).

    Attributes:
        polygon: Vertices of the body in Nav2's text for a footprint.
    """

    radius: float | None = parameter(None, 0.01, 10.0)
    polygon: str | None = parameter(None)
    drive: Drive | None = parameter(None)
    min_turning_radius: float | None = parameter(None, 0.01, 100.0)
    mass: float | None = parameter(None, 0.1, 10_000.0)
    max_speed: float | None = parameter(None, 0.01, 100.0)
    max_acceleration: float | None = parameter(None, 0.01, 1000.0)
    max_yaw_rate: float | None = parameter(None, 0.01, 100.0)
    max_yaw_acceleration: float | None = parameter(None, 0.01, 1000.0)
    lidar: LidarParameters = LidarParameters()

    @field_validator("polygon", mode="before")
    @classmethod
    def _as_text(cls, polygon: Any) -> Any:
        """A list of vertices, as YAML has it, as Nav2's text."""
        if not isinstance(polygon, tuple | list):
            return polygon
        return str([list(item) if isinstance(item, tuple) else item for item in polygon])

    @field_validator("polygon")
    @classmethod
    def _has_an_area(cls, polygon: str | None) -> str | None:
        if polygon is not None and not vertices_of(polygon):
            raise ValueError("a polygon of three vertices or more")
        return polygon

    @model_validator(mode="after")
    def _agrees(self) -> Self:
        if self.radius is not None and self.polygon is not None:
            raise ValueError("radius and polygon are both given")
        if self.min_turning_radius is not None and self.drive not in (None, "ackermann"):
            raise ValueError(f"min_turning_radius is an ackermann drive's, and drive is {self.drive}")
        return self


@functools.cache
def robot_keys() -> Mapping[str, ParameterLocation]:
    """Every key of the system dimension that gives a quantity of the robot, to where it is read."""
    own = [(ROBOT_KEY, name) for name in (*RobotParameters.model_fields, "namespace") if name != "lidar"]
    lidar = ((ROBOT_KEY, "lidar", name) for name in LidarParameters.model_fields)
    latency = ((ROBOT_KEY, LATENCY_KEY, name) for name in (PRESET_KEY, *Latency.model_fields))
    odometry = ((ROBOT_KEY, ODOMETRY_KEY, name) for name in OdometryDrift.model_fields)
    every = [*own, *lidar, (*NOISE_PLACE, "model"), *latency, *odometry]
    return {".".join(path): path for path in every}
