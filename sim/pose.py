"""Poses in the plane, and how configuration values write them."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final

from vastflow.sim.digest import Value

MOST_YAW_RAD: Final = 6.2832
_POSITION: Final = ("x", "y", "z")
_ORIENTATION: Final = ("roll", "pitch", "yaw")


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

    `z`, `roll` and `pitch` may be there and are not read.

    Raises:
        ValueError: anything else, such as `theta` or a quaternion, naming `where`.
    """
    if isinstance(value, Mapping):
        if unknown := next(_unknown(value), None):
            raise ValueError(f"{where}: found {unknown!r}; a pose has x, y and yaw, in meters and radians")
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


def written_pose_of(value: Value, where: str = "pose") -> Pose:
    """`pose_of` a value that a person wrote.

    Raises:
        ValueError: see there; or a yaw of more than one turn, which is one in degrees.
    """
    pose = pose_of(value, where)
    if abs(pose.yaw_rad) > MOST_YAW_RAD:
        raise ValueError(f"{where}: found yaw {pose.yaw_rad:g}; radians, one turn ({MOST_YAW_RAD:g}) at most")
    return pose


def _unknown(value: Mapping[str, Value]) -> Iterator[str]:
    """What is in a pose and would be read over: `orientation: {z, w}` is a heading too."""
    members = {"position": _POSITION, "orientation": _ORIENTATION}
    for key, inner in value.items():
        if key in members and isinstance(inner, Mapping):
            yield from (f"{key}.{name}" for name in inner if name not in members[key])
        elif key not in (*_POSITION, *_ORIENTATION, *members):
            yield key


def _number(value: Value) -> float | None:
    """A number, also one that is written as a text; None for anything else."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return None
    try:
        number = float(value)
    except ValueError:
        return None
    return number if math.isfinite(number) else None
