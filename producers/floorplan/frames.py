"""Frames in the plane: how one lies in another, those of walls, and what walls of a thickness fill."""

import math
from collections.abc import Iterable
from typing import Final, NamedTuple

from vastflow.producers.floorplan.outline import SHARPEST, edges
from vastflow.producers.floorplan.plan import Outline, Point

DECIMALS: Final = 9
"""Of a coordinate in the world, in meters."""


class Transform(NamedTuple):
    """Turn by `yaw_rad` about z, then move by (x, y)."""

    x_m: float
    y_m: float
    yaw_rad: float

    def then(self, inner: "Transform") -> "Transform":
        """The transform of a frame that is placed by `inner` in the frame this one places."""
        x_m, y_m = self.apply((inner.x_m, inner.y_m))
        return Transform(x_m, y_m, self.yaw_rad + inner.yaw_rad)

    def inverse(self) -> "Transform":
        """What undoes it."""
        cos, sin = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        return Transform(-cos * self.x_m - sin * self.y_m, sin * self.x_m - cos * self.y_m, -self.yaw_rad)

    def apply(self, point: Point) -> Point:
        """A point of the inner frame in the outer one."""
        (x, y), cos, sin = point, math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        return self.x_m + cos * x - sin * y, self.y_m + sin * x + cos * y

    def outline(self, points: Iterable[Point]) -> Outline:
        """An outline of the inner frame in the outer one, to the nanometer: what touches, touches exactly."""
        cos, sin = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        placed = ((self.x_m + cos * x - sin * y, self.y_m + sin * x + cos * y) for x, y in points)
        # + 0.0 turns -0.0 into 0.0
        return tuple((round(x, DECIMALS) + 0.0, round(y, DECIMALS) + 0.0) for x, y in placed)


IDENTITY: Final = Transform(0.0, 0.0, 0.0)


def wall_frame(outline: Outline, wall: int) -> Transform:
    """Frame of a wall in its space's: origin in the middle of the edge, x along it, y to the left."""
    (x0, y0), (x1, y1) = outline[wall], outline[(wall + 1) % len(outline)]
    return Transform((x0 + x1) / 2, (y0 + y1) / 2, math.atan2(y1 - y0, x1 - x0))


def sharp_corner(outline: Outline) -> int | None:
    """The first corner too sharp for a mitre."""
    normals = _normals(outline)
    for i, (x, y) in enumerate(normals):
        if 1.0 + normals[i - 1][0] * x + normals[i - 1][1] * y < SHARPEST:
            return i
    return None


def wall_outlines(outline: Outline, thickness_m: float) -> tuple[Outline, ...]:
    """Outline of each wall round a floor, mitred where two meet: outer start, outer end, inner end, inner start.

    The outer corner at v between walls with left normals m and n is v + t (m + n) / (1 + m · n), where their outer
    faces meet; of walls in one line that is the plain offset. A wall shorter than its mitres (between two corners that
    turn away from it) ends square instead, for its mitres would cross.
    """
    normals = _normals(outline)
    outer: list[Point] = []
    for i, ((x, y), (nx, ny)) in enumerate(zip(outline, normals, strict=True)):
        mx, my = normals[i - 1]
        share = thickness_m / (1.0 + mx * nx + my * ny)
        outer.append((x + share * (mx + nx), y + share * (my + ny)))
    walls: list[Outline] = []
    for i, (start, end) in enumerate(edges(outline)):
        first, last = outer[i], outer[(i + 1) % len(outer)]
        along = (end[0] - start[0], end[1] - start[1])
        if (last[0] - first[0]) * along[0] + (last[1] - first[1]) * along[1] <= 0.0:
            nx, ny = normals[i]
            first = (start[0] + thickness_m * nx, start[1] + thickness_m * ny)
            last = (end[0] + thickness_m * nx, end[1] + thickness_m * ny)
        walls.append((first, last, end, start))
    return tuple(walls)


def _normals(outline: Outline) -> list[Point]:
    """Unit normal of each edge, to the left of its direction."""
    normals = []
    for start, end in edges(outline):
        length = math.dist(start, end)
        normals.append(((start[1] - end[1]) / length, (end[0] - start[0]) / length))
    return normals
