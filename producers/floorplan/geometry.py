"""Geometry in the plane: closed outlines, frames of spaces and walls, and the area of thick walls."""

import itertools
import math
from collections.abc import Iterable
from typing import Final, NamedTuple, TypeAlias

import shapely

from vastflow.sim.model.elementary import atan2, cos, cos_sin, dist
from vastflow.sim.model.faults import Complaint, Got

Point: TypeAlias = tuple[float, float]
Outline: TypeAlias = tuple[Point, ...]
"""Corners in order, the last joined to the first."""

SMALLEST_M: Final = 0.001
"""No size is smaller: nothing in a building is, and meshes of less fall apart in single precision."""

CIRCLE_CORNERS: Final = 64

SHARPEST: Final = 1.0 + cos(math.radians(179.0))
"""1 + cosine of the turn at a corner of 1°: the mitre of walls that meet at less leads nowhere."""


def rectangle(width_m: float, length_m: float) -> Outline:
    """A rectangle about the origin, clockwise from the top left."""
    x, y = width_m / 2, length_m / 2
    return (-x, y), (x, y), (x, -y), (-x, -y)


def circle(radius_m: float) -> Outline:
    """A circle about the origin as a polygon with its corners on it, clockwise from the top."""
    turns = (2 * math.pi * k / CIRCLE_CORNERS for k in range(CIRCLE_CORNERS))
    return tuple((radius_m * s, radius_m * c) for c, s in map(cos_sin, turns))


def signed_area(outline: Outline) -> float:
    """Area (m²), negative where the corners run clockwise."""
    return math.fsum(x0 * y1 - x1 * y0 for (x0, y0), (x1, y1) in edges(outline)) / 2


def edges(outline: Outline) -> tuple[tuple[Point, Point], ...]:
    """Edge i from corner i to the next, the last to the first."""
    return tuple(itertools.pairwise((*outline, outline[0])))


def clipped(outline: Outline, low: float, high: float) -> Outline:
    """Return the part of an outline with `low` <= x <= `high`, which may be empty."""
    for bound, side in ((low, 1.0), (high, -1.0)):
        kept: list[Point] = []
        for (x0, y0), (x1, y1) in edges(outline) if outline else ():
            inside, ends_inside = side * (x0 - bound) >= 0.0, side * (x1 - bound) >= 0.0
            if inside:
                kept.append((x0, y0))
            if inside != ends_inside:
                kept.append((bound, y0 + (y1 - y0) * (bound - x0) / (x1 - x0)))
        outline = tuple(kept)
    return outline


def outline_fault(outline: Outline) -> Complaint | None:
    """Return the problem of a polygon and the expected form; None if it encloses one area."""
    if len(outline) < 3:
        return Got(f"a Polygon with {len(outline)} corners"), "three corners or more"
    for k, ((x, y), end) in enumerate(edges(outline)):
        if dist((x, y), end) < SMALLEST_M:
            what = f"corners {k} and {(k + 1) % len(outline)} of the Polygon are both at ({x:g}, {y:g})"
            return what, "move them apart"
    polygon = shapely.Polygon(outline)
    if not polygon.is_valid:
        reason, _, at = shapely.is_valid_reason(polygon).partition("[")
        place = " near ({:g}, {:g})".format(*map(float, at.rstrip("]").split())) if at else ""
        crosses = "crosses itself" if "intersection" in reason else "touches itself"
        return f"the Polygon's outline {crosses}{place}", "list the corners in order round one area"
    if polygon.area < SMALLEST_M * SMALLEST_M:
        return f"the Polygon's corners enclose only {polygon.area:.3g} m²", "they must enclose an area"
    return None


DECIMALS: Final = 9
"""Decimals of a coordinate in the world (m)."""


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
        c, s = cos_sin(self.yaw_rad)
        return Transform(-c * self.x_m - s * self.y_m, s * self.x_m - c * self.y_m, -self.yaw_rad)

    def apply(self, point: Point) -> Point:
        """A point of the inner frame in the outer one."""
        (x, y), (c, s) = point, cos_sin(self.yaw_rad)
        return self.x_m + c * x - s * y, self.y_m + s * x + c * y

    def outline(self, points: Iterable[Point]) -> Outline:
        """An outline of the inner frame in the outer one, to the nanometer: what touches, touches exactly."""
        # + 0.0 turns -0.0 into 0.0
        return tuple((round(x, DECIMALS) + 0.0, round(y, DECIMALS) + 0.0) for x, y in map(self.apply, points))


IDENTITY: Final = Transform(0.0, 0.0, 0.0)


def wall_frame(outline: Outline, wall: int) -> Transform:
    """Return a wall's frame in its space's: origin in the middle of the edge, x along it."""
    (x0, y0), (x1, y1) = outline[wall], outline[(wall + 1) % len(outline)]
    return Transform((x0 + x1) / 2, (y0 + y1) / 2, atan2(y1 - y0, x1 - x0))


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
    normals = []
    for start, end in edges(outline):
        length = dist(start, end)
        normals.append(((start[1] - end[1]) / length, (end[0] - start[0]) / length))
    return normals
