"""Poses in the plane."""

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
