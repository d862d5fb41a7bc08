"""Obstacles that stand in a scenario and are not on the robot's map."""

import math
from dataclasses import dataclass, replace
from typing import Final, Literal, TypeAlias

from shapely.affinity import rotate, translate
from shapely.geometry import Point, Polygon, box

from vastflow.sim.maps.grid_frame import GridFrame
from vastflow.sim.pose import Pose

Shape: TypeAlias = Literal["box", "cylinder"]

MASS_KG: Final = 5.0
FRICTION: Final = 0.4
"""Of an obstacle that appears, where its arguments give none: a carton that the robot can just push."""


@dataclass(frozen=True, slots=True)
class Trigger:
    """What makes an obstacle appear: the robot's true position within `distance_m` of a point, and `delay_s` after that."""

    x_m: float
    y_m: float
    distance_m: float
    delay_s: float = 0.0


@dataclass(frozen=True, slots=True)
class Obstacle:
    """A box or cylinder; one without a trigger stands from the start and is fixed, one with a trigger appears and can be pushed.

    Attributes:
        length_m: Extent along its own x (a cylinder's diameter).
        width_m: Extent along its own y (a cylinder's diameter).
        mass_kg, friction: Of one that appears; friction with the floor.
    """

    name: str
    shape: Shape
    pose: Pose
    length_m: float
    width_m: float
    trigger: Trigger | None = None
    mass_kg: float = MASS_KG
    friction: float = FRICTION

    @property
    def circumradius_m(self) -> float:
        """Greatest distance from the center to the outline in the plane (paper: center to corner)."""
        return self.length_m / 2 if self.shape == "cylinder" else math.hypot(self.length_m, self.width_m) / 2

    @property
    def mean_radius_m(self) -> float:
        """Mean distance of its floor area's points from the center: the lever of friction against turning."""
        if self.shape == "cylinder":
            return self.length_m / 3
        a, b = self.length_m / 2, self.width_m / 2
        d = math.hypot(a, b)
        return d / 3 + a * a / (6 * b) * math.log((b + d) / a) + b * b / (6 * a) * math.log((a + d) / b)

    @property
    def size_class(self) -> str:
        """Name shared by obstacles of one shape and size, such as `box 0.5 x 0.5 m`."""
        if self.shape == "cylinder":
            return f"cylinder {self.length_m:g} m"
        return f"box {self.length_m:g} x {self.width_m:g} m"

    def in_grid(self, frame: GridFrame) -> "Obstacle":
        """The same obstacle in the frame of a map's grid."""
        if frame.yaw_rad == 0.0:
            return self
        trigger = self.trigger
        if trigger is not None:
            x_m, y_m = frame.to_grid(trigger.x_m, trigger.y_m)
            trigger = replace(trigger, x_m=x_m, y_m=y_m)
        return replace(self, pose=frame.pose_to_grid(self.pose), trigger=trigger)

    def footprint(self) -> Polygon:
        """Outline in the map frame (m); a cylinder is a 64-gon round its circle."""
        if self.shape == "cylinder":
            return Point(self.pose.x_m, self.pose.y_m).buffer(self.length_m / 2, quad_segs=16)
        outline = box(-self.length_m / 2, -self.width_m / 2, self.length_m / 2, self.width_m / 2)
        turned = rotate(outline, self.pose.yaw_rad, origin=(0, 0), use_radians=True)
        return translate(turned, self.pose.x_m, self.pose.y_m)
