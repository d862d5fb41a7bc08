"""Shapes of bodies in the plane, in frames of their own: obstacles', a world's bodies', and movers'."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, TypeAlias

import shapely

from vastflow.sim.model.elementary import cos_sin, hypot, log
from vastflow.sim.model.pose import DECIMALS, Pose

Vertices: TypeAlias = tuple[tuple[float, float], ...]

_CIRCLE: Final = tuple((x, -y) for x, y in (cos_sin(k * math.pi / 32) for k in range(64)))
_SQUARE: Final = ((1, -1), (1, 1), (-1, 1), (-1, -1))
"""Corners of a rectangle of 2 × 2 m."""


@dataclass(frozen=True, slots=True)
class Disc:
    """A disc about a body's pose."""

    radius_m: float

    @property
    def circumradius_m(self) -> float:
        """Greatest distance from the center to the outline."""
        return self.radius_m

    @property
    def mean_radius_m(self) -> float:
        """Mean distance of the area's points from the center: the lever arm of friction."""
        return 2 * self.radius_m / 3

    @property
    def vertices_m(self) -> Vertices:
        """Outline in the body's frame: a 64-gon in its circle."""
        return tuple((self.radius_m * x, self.radius_m * y) for x, y in _CIRCLE)

    def __str__(self) -> str:
        return f"cylinder {2 * self.radius_m:g} m"


@dataclass(frozen=True, slots=True)
class Box:
    """A rectangle about a body's pose: `length_m` along its x, `width_m` along its y."""

    length_m: float
    width_m: float

    @property
    def circumradius_m(self) -> float:
        """Greatest distance from the center to the outline."""
        return hypot(self.length_m, self.width_m) / 2

    @property
    def mean_radius_m(self) -> float:
        """Mean distance of the area's points from the center: the lever arm of friction."""
        a, b = self.length_m / 2, self.width_m / 2
        d = hypot(a, b)
        return d / 3 + a * a / (6 * b) * log((b + d) / a) + b * b / (6 * a) * log((a + d) / b)

    @property
    def vertices_m(self) -> Vertices:
        """Corners in the body's frame."""
        return tuple((self.length_m / 2 * x, self.width_m / 2 * y) for x, y in _SQUARE)

    def __str__(self) -> str:
        return f"box {self.length_m:g} x {self.width_m:g} m"


@dataclass(frozen=True, slots=True)
class Polygon:
    """A polygon in a body's frame.

    Attributes:
        vertices_m: Three (x, y) or more, without a repeated first one.
    """

    vertices_m: Vertices


Shape: TypeAlias = Disc | Box | Polygon


def outline_at(shape: Shape, pose: Pose) -> shapely.Polygon:
    """Return the outline of a shape at a pose (m)."""
    c, s = (1.0, 0.0) if isinstance(shape, Disc) else cos_sin(pose.yaw_rad)
    return shapely.Polygon([(pose.x_m + (c * x - s * y), pose.y_m + (s * x + c * y)) for x, y in shape.vertices_m])


def polygons_about(x_m: float, y_m: float, outline: shapely.Polygon) -> Iterator[Polygon]:
    """Yield an outline about a place, rounded to `DECIMALS`: in valid parts, or nothing if it has no area then."""
    rounded = shapely.Polygon(
        [(round(x - x_m, DECIMALS), round(y - y_m, DECIMALS)) for x, y in outline.exterior.coords]
    )
    if not rounded.is_valid:
        rounded = shapely.make_valid(rounded, method="structure", keep_collapsed=False)
    for part in shapely.get_parts(rounded):
        if part.area > 0.0:
            yield Polygon(tuple(part.exterior.coords[:-1]))
