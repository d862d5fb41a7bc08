"""Poses in the plane, their form in configuration values, and the frame of a map's grid."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vastflow.sim.model.digest import Value
from vastflow.sim.model.elementary import cos_sin

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
        """Return the pose as a configuration value, in the shape of OpenSCENARIO's `pose_3d`."""
        return {"position": {"x": self.x_m, "y": self.y_m}, "orientation": {"yaw": self.yaw_rad}}


def placed(pose: Pose, frame: Pose) -> Pose:
    """Return a pose of a frame as it is seen where the frame's own pose is seen."""
    c, s = cos_sin(frame.yaw_rad)
    x_m, y_m = frame.x_m + c * pose.x_m - s * pose.y_m, frame.y_m + s * pose.x_m + c * pose.y_m
    return Pose(x_m, y_m, frame.yaw_rad + pose.yaw_rad)


def seen_from(pose: Pose, frame: Pose) -> Pose:
    """Return a pose in a frame whose own pose is given in the same frame as the pose."""
    x_m, y_m = pose.x_m - frame.x_m, pose.y_m - frame.y_m
    c, s = cos_sin(frame.yaw_rad)
    return Pose(c * x_m + s * y_m, c * y_m - s * x_m, pose.yaw_rad - frame.yaw_rad)


def placed_points(xy_m: NDArray[np.float64], frame: Pose) -> NDArray[np.float64]:
    """Return points (N, 2) of a frame as they are seen where its pose is seen."""
    (c, s), (x, y) = cos_sin(frame.yaw_rad), xy_m.T
    return np.column_stack([frame.x_m + (c * x - s * y), frame.y_m + (s * x + c * y)])


def pose_of(value: Value, where: str = "pose") -> Pose:
    """Read `{position: {x, y}, orientation: {yaw}}` or the short `{x, y, yaw}`; a missing yaw is 0.

    `z`, `roll` and `pitch` are ignored.

    Raises:
        ValueError: anything else, such as `theta` or a quaternion, naming `where`.
    """
    if isinstance(value, Mapping):
        if unknown := next(_unknown(value), None):
            raise ValueError(f"{where}: expected x, y and yaw, in meters and radians, got {unknown!r}")
        position = value.get("position", value)
        orientation = value.get("orientation", value)
        if isinstance(position, Mapping) and isinstance(orientation, Mapping):
            x, y, yaw = map(_number, (position.get("x"), position.get("y"), orientation.get("yaw", 0.0)))
            if x is not None and y is not None and yaw is not None:
                return Pose(x, y, yaw)
    raise ValueError(
        f"{where}: expected a pose, {{x, y, yaw}} or {{position: {{x, y}}, orientation: {{yaw}}}}, got {value!r}"
    )


def written_pose_of(value: Value, where: str = "pose") -> Pose:
    """Read a pose that a person wrote; a yaw of more than one turn, probably in degrees, raises `ValueError` too."""
    pose = pose_of(value, where)
    if abs(pose.yaw_rad) > MOST_YAW_RAD:
        raise ValueError(f"{where}: expected radians, one turn ({MOST_YAW_RAD:g}) at most, got yaw {pose.yaw_rad:g}")
    return pose


def _unknown(value: Mapping[str, Value]) -> Iterator[str]:
    """Yield the keys of a pose that are ignored, such as those of `orientation: {z, w}`."""
    members = {"position": _POSITION, "orientation": _ORIENTATION}
    for key, inner in value.items():
        if key in members and isinstance(inner, Mapping):
            yield from (f"{key}.{name}" for name in inner if name not in members[key])
        elif key not in (*_POSITION, *_ORIENTATION, *members):
            yield key


def _number(value: Value) -> float | None:
    """Return a finite number, also of a text; None for anything else."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return None
    try:
        number = float(value)
    except ValueError:
        return None
    return number if math.isfinite(number) else None


DECIMALS: Final = 9
"""Decimals of a position in a turned grid's frame, so that the border of two cells stays one."""


@dataclass(frozen=True, slots=True)
class GridFrame:
    """A grid's frame: the map's, turned counter-clockwise about the grid's lower left corner.

    A frame that is not turned returns every number unchanged.
    """

    corner_xy_m: tuple[float, float]
    yaw_rad: float = 0.0

    @property
    def turn(self) -> tuple[float, float]:
        """Cosine and sine of the turn from the grid to the map."""
        return cos_sin(self.yaw_rad)

    def to_grid(self, x_m: float, y_m: float) -> tuple[float, float]:
        """Return a position of the map in the grid's frame, to the nanometer."""
        if self.yaw_rad == 0.0:
            return x_m, y_m
        (ox, oy), (c, s) = self.corner_xy_m, self.turn
        dx, dy = x_m - ox, y_m - oy
        return round(ox + c * dx + s * dy, DECIMALS), round(oy - s * dx + c * dy, DECIMALS)

    def to_map(self, x_m: float, y_m: float) -> tuple[float, float]:
        """Return a position of the grid in the map's frame."""
        if self.yaw_rad == 0.0:
            return x_m, y_m
        (ox, oy), (c, s) = self.corner_xy_m, self.turn
        dx, dy = x_m - ox, y_m - oy
        return ox + c * dx - s * dy, oy + s * dx + c * dy

    def points_to_grid(self, xy_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return points (N, 2) of the map in the grid's frame, to the nanometer."""
        if self.yaw_rad == 0.0:
            return xy_m
        c, s = self.turn
        return np.round(self._turned(xy_m, c, -s), DECIMALS)

    def points_to_map(self, xy_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return points (N, 2) of the grid in the map's frame."""
        return xy_m if self.yaw_rad == 0.0 else self._turned(xy_m, *self.turn)

    def pose_to_grid(self, pose: Pose) -> Pose:
        """Return a pose of the map in the grid's frame."""
        if self.yaw_rad == 0.0:
            return pose
        return Pose(*self.to_grid(pose.x_m, pose.y_m), round(pose.yaw_rad - self.yaw_rad, DECIMALS))

    def pose_to_map(self, pose: Pose) -> Pose:
        """Return a pose of the grid in the map's frame."""
        if self.yaw_rad == 0.0:
            return pose
        return Pose(*self.to_map(pose.x_m, pose.y_m), pose.yaw_rad + self.yaw_rad)

    def covariance_to_grid(self, xx_m2: float, yy_m2: float) -> tuple[float, float, float]:
        """Return xx, xy and yy in the grid's frame of a covariance along the map's axes."""
        if self.yaw_rad == 0.0:
            return xx_m2, 0.0, yy_m2
        c, s = self.turn
        return c * c * xx_m2 + s * s * yy_m2, c * s * (yy_m2 - xx_m2), s * s * xx_m2 + c * c * yy_m2

    def covariance_to_map(self, xx_m2: float, xy_m2: float, yy_m2: float) -> tuple[float, float, float]:
        """Return xx, xy and yy in the map's frame of a covariance in the grid's."""
        if self.yaw_rad == 0.0:
            return xx_m2, xy_m2, yy_m2
        c, s = self.turn
        return (
            c * c * xx_m2 - 2.0 * c * s * xy_m2 + s * s * yy_m2,
            c * s * (xx_m2 - yy_m2) + (c * c - s * s) * xy_m2,
            s * s * xx_m2 + 2.0 * c * s * xy_m2 + c * c * yy_m2,
        )

    def _turned(self, xy_m: NDArray[np.float64], c: float, s: float) -> NDArray[np.float64]:
        x, y = (xy_m - self.corner_xy_m).T
        return np.column_stack([c * x - s * y, s * x + c * y]) + self.corner_xy_m
