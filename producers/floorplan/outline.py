"""Closed outlines in the plane: shapes, and what is wrong with one."""

import itertools
import math
from typing import Final

import shapely

from vastflow.producers.floorplan.plan import Outline, Point

SMALLEST_M: Final = 0.001
"""No size is smaller: nothing in a building is, and meshes of less fall apart in single precision."""

CIRCLE_CORNERS: Final = 64

SHARPEST: Final = 1.0 + math.cos(math.radians(179.0))
"""1 + cosine of the turn at a corner of 1°: the mitre of walls that meet at less leads nowhere."""


def rectangle(width_m: float, length_m: float) -> Outline:
    """A rectangle about the origin, clockwise from the top left."""
    x, y = width_m / 2, length_m / 2
    return (-x, y), (x, y), (x, -y), (-x, -y)


def circle(radius_m: float) -> Outline:
    """A circle about the origin as a polygon with its corners on it, clockwise from the top."""
    turns = (2 * math.pi * k / CIRCLE_CORNERS for k in range(CIRCLE_CORNERS))
    return tuple((radius_m * math.sin(turn), radius_m * math.cos(turn)) for turn in turns)


def signed_area(outline: Outline) -> float:
    """Area (m²), negative where the corners run clockwise."""
    pairs = itertools.pairwise((*outline, outline[0]))
    return sum(x0 * y1 - x1 * y0 for (x0, y0), (x1, y1) in pairs) / 2


def edges(outline: Outline) -> tuple[tuple[Point, Point], ...]:
    """Edge i from corner i to the next, the last to the first."""
    return tuple(itertools.pairwise((*outline, outline[0])))


def clipped(outline: Outline, low: float, high: float) -> Outline:
    """The part of an outline with `low` <= x <= `high`, its corners in the same order; empty where there is none."""
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


def outline_fault(outline: Outline) -> tuple[str, str] | None:
    """What is wrong with a polygon and what would be right; None where it encloses one area."""
    if len(outline) < 3:
        return f"found a Polygon with {len(outline)} corners", "three corners or more"
    for k, (start, end) in enumerate(edges(outline)):
        if math.dist(start, end) < SMALLEST_M:
            what = f"corners {k} and {(k + 1) % len(outline)} of the Polygon are both at {_at(*start)}"
            return what, "corners that are apart"
    polygon = shapely.Polygon(outline)
    if not polygon.is_valid:
        reason, _, at = shapely.is_valid_reason(polygon).partition("[")
        place = f" near {_at(*map(float, at.rstrip(']').split()))}" if at else ""
        crosses = "crosses itself" if "intersection" in reason else "touches itself"
        return f"the Polygon's outline {crosses}{place}", "corners in order round one area"
    if polygon.area < SMALLEST_M**2:
        return f"the Polygon's corners enclose {polygon.area:.3g} m²", "corners that enclose an area"
    return None


def _at(x: float, y: float) -> str:
    return f"({x:g}, {y:g})"
