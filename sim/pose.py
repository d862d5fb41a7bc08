"""Poses in the plane, and how configuration values write them."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from vastflow.sim.digest import Value


@dataclass(frozen=True, slots=True)
class Pose:
    """A pose in the map frame: x forward of the origin, y to its left, yaw counter-clockwise (REP-103)."""

    x_m: float
    y_m: float
    yaw_rad: float = 0.0

    def value(self) -> dict[str, Value]:
        """The pose as a configuration value, in the shape of OpenSCENARIO's `pose_3d`."""
        return {"position": {"x": self.x_m, "y": self.y_m}, "orientation": {"yaw": self.yaw_rad}}


def pose_of(value: Value, where: str = "pose") -> Pose:
    """Read `{position: {x, y}, orientation: {yaw}}` or the short `{x, y, yaw}`; a missing yaw is 0.

    Raises:
        ValueError: anything else, naming `where`.
    """
    if isinstance(value, Mapping):
        position = value.get("position", value)
        orientation = value.get("orientation", value)
        if isinstance(position, Mapping) and isinstance(orientation, Mapping):
            numbers = [_number(each) for each in (position.get("x"), position.get("y"), orientation.get("yaw", 0.0))]
            x, y, yaw = numbers
            if x is not None and y is not None and yaw is not None:
                return Pose(x, y, yaw)
    raise ValueError(
        f"{where}: found {value!r}; a pose is {{x, y, yaw}} or {{position: {{x, y}}, orientation: {{yaw}}}}"
    )


def _number(value: Value) -> float | None:
    """A number, also one that is written as a text; None for anything else."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return None
    try:
        number = float(value)
    except ValueError:
        return None
    return number if math.isfinite(number) else None
