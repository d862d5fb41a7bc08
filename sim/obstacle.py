"""Obstacles that stand in a scenario and are not on the robot's map."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal, TypeAlias

from shapely.affinity import rotate, translate
from shapely.geometry import Point, Polygon, box

from vastflow.sim.digest import Value
from vastflow.sim.pose import Pose, pose_of

Shape: TypeAlias = Literal["box", "cylinder"]

DEFAULT_SIZE_M: Final = 0.5
"""Edge or diameter where the model's arguments give none (the models' own default)."""

ARGUMENTS: Final[Mapping[Shape, tuple[str, ...]]] = {
    "box": ("width", "length", "height", "box_width", "box_length", "box_height"),
    "cylinder": ("diameter", "radius", "width", "length", "height"),
}
"""Sizes that a model takes; heights, and a cylinder's length, which is one, are no part of the plane."""


@dataclass(frozen=True, slots=True)
class Obstacle:
    """A fixed box or cylinder.

    Attributes:
        length_m: Extent along its own x (a cylinder's diameter).
        width_m: Extent along its own y (a cylinder's diameter).
    """

    name: str
    shape: Shape
    pose: Pose
    length_m: float
    width_m: float

    @property
    def circumradius_m(self) -> float:
        """Greatest distance from the centre to the outline in the plane (paper: centre to corner)."""
        return self.length_m / 2 if self.shape == "cylinder" else math.hypot(self.length_m, self.width_m) / 2

    @property
    def size_class(self) -> str:
        """Name shared by obstacles of one shape and size, such as `box 0.5 x 0.5 m`."""
        if self.shape == "cylinder":
            return f"cylinder {self.length_m:g} m"
        return f"box {self.length_m:g} x {self.width_m:g} m"

    def footprint(self) -> Polygon:
        """Outline in the map frame (m); a cylinder is a 64-gon round its circle."""
        if self.shape == "cylinder":
            return Point(self.pose.x_m, self.pose.y_m).buffer(self.length_m / 2, quad_segs=16)
        outline = box(-self.length_m / 2, -self.width_m / 2, self.length_m / 2, self.width_m / 2)
        turned = rotate(outline, self.pose.yaw_rad, origin=(0, 0), use_radians=True)
        return translate(turned, self.pose.x_m, self.pose.y_m)


def obstacles_of(environment: Mapping[str, Value]) -> tuple[Obstacle, ...]:
    """Every obstacle in the environment dimension: entries with a `spawn_pose` of any list-valued key, in key order.

    Raises:
        ValueError: an entry whose pose or size can't be read.
    """
    return tuple(
        obstacle_of(entry, f"{key}[{i}]")
        for key in sorted(environment)
        for i, entry in enumerate(_entries(environment[key]))
    )


def obstacle_of(entry: Mapping[str, Value], where: str = "obstacle") -> Obstacle:
    """Read `{entity_name, model, spawn_pose, xacro_arguments}` (vast format).

    The shape follows from the model's file name, the size from its arguments, one of `ARGUMENTS`
    (`width:=0.5, length:=0.5`).

    Raises:
        ValueError: a pose or a size that can't be read, or an argument that the model does not have.
    """
    model = str(entry.get("model") or "box")
    shape: Shape = "cylinder" if "cylinder" in model.rsplit("/", 1)[-1].lower() else "box"
    sizes = _arguments(str(entry.get("xacro_arguments") or ""), shape, where)
    pose = pose_of(entry["spawn_pose"], f"{where}.spawn_pose")
    name = str(entry.get("entity_name") or where)
    if shape == "cylinder":
        diameter_m = sizes.get("diameter", 2 * sizes.get("radius", sizes.get("width", DEFAULT_SIZE_M) / 2))
        return Obstacle(name, shape, pose, diameter_m, diameter_m)
    width_m = sizes.get("width", sizes.get("box_width", DEFAULT_SIZE_M))
    length_m = sizes.get("length", sizes.get("box_length", width_m))
    return Obstacle(name, shape, pose, length_m, width_m)


def _entries(value: Value) -> Iterator[Mapping[str, Value]]:
    if isinstance(value, Sequence) and not isinstance(value, str):
        yield from (entry for entry in value if isinstance(entry, Mapping) and "spawn_pose" in entry)


def _arguments(text: str, shape: Shape, where: str) -> dict[str, float]:
    sizes: dict[str, float] = {}
    for part in filter(None, (part.strip() for part in text.replace(",", " ").split())):
        key, found, number = part.partition(":=")
        try:
            sizes[key] = float(number)
        except ValueError:
            found = ""
        if not found or not sizes[key] > 0 or not math.isfinite(sizes[key]):
            raise ValueError(f"{where}: found argument {part!r}; a size is written like width:=0.5, greater than 0 m")
        if key not in ARGUMENTS[shape]:
            raise ValueError(f"{where}: a {shape} has no argument {key!r}; it has {', '.join(ARGUMENTS[shape])}")
    return sizes
