"""Polygons in Nav2's text, such as a costmap's `footprint`."""

import re
from typing import Final, TypeAlias

import numpy as np
import shapely
from numpy.typing import NDArray

from vastflow.sim.model.elementary import hypots

Vertices: TypeAlias = tuple[tuple[float, float], ...]
"""x, y in the robot's frame (m), in the order of the text; repeated ones, such as the first at the end, count once."""

MOST_VERTICES: Final = 32
FARTHEST_M: Final = 10.0
"""Greatest x or y of a vertex: the greatest `robot_radius`."""
_FORM: Final = (
    'text with the x, y of three or more vertices within 10 m, such as "[[0.35, 0.25], [0.35, -0.25], [-0.35, 0.0]]"'
)
_LONGEST: Final = 4_000


def vertices_of(footprint: str) -> Vertices:
    """Return the vertices of a footprint; none for `""` and `"[]"`, which leave the robot a disc.

    Raises:
        ValueError: says what the footprint must be.
    """
    if footprint.strip() in ("", "[]"):
        return ()
    vertices = area_of(footprint)
    polygon = shapely.Polygon(vertices)
    if not polygon.is_valid:
        raise ValueError("a polygon whose edges do not cross or touch each other")
    if not polygon.contains(shapely.Point(0.0, 0.0)):
        raise ValueError("a polygon round the robot's origin (0, 0), from which Nav2 measures its radii")
    return vertices


def area_of(text: str) -> Vertices:
    """Return the vertices of an area near the robot; raise a `ValueError` that names the expected form."""
    vertices = _read(text)
    if len(vertices) > MOST_VERTICES:
        raise ValueError(f"a polygon of {MOST_VERTICES} vertices at most, and not of {len(vertices)}")
    if shapely.Polygon(vertices).convex_hull.area < 1e-6:
        raise ValueError("a polygon with an area, in which a robot has room")
    return vertices


def _read(footprint: str) -> Vertices:
    if len(footprint) > _LONGEST:
        raise ValueError(_FORM)
    vertices = points_of(footprint)
    if not all(abs(part) <= FARTHEST_M for vertex in vertices for part in vertex):
        raise ValueError(_FORM)
    apart = tuple(own for own, after in zip(vertices, [*vertices[1:], vertices[0]], strict=True) if own != after)
    if len(apart) < 3:
        raise ValueError(_FORM)
    return apart


def points_of(text: str) -> list[tuple[float, float]]:
    """Return three or more points as Nav2 parses them, with or without commas; raise a `ValueError` where it fails."""
    rows: list[list[float]] = []
    depth = 0
    for token in re.findall(r"[\[\]]|[^ 	,\[\]]+", text):
        depth += {"[": 1, "]": -1}.get(token, 0)
        if token == "[" and depth == 2:
            rows.append([])
        elif token not in "[]" and depth == 2:
            try:
                rows[-1].append(float(token))
            except ValueError:
                raise ValueError(_FORM) from None
        elif token not in "[]" or not 0 <= depth <= 2:
            raise ValueError(_FORM)
    if depth != 0 or len(rows) < 3 or any(len(row) != 2 for row in rows):
        raise ValueError(_FORM)
    return [(x, y) for x, y in rows]


def as_array(vertices: Vertices) -> NDArray[np.float64]:
    return np.array(vertices, dtype=np.float64).reshape(-1, 2)


def circumscribed_radius_m(outline: NDArray[np.float64]) -> float:
    """Radius of the smallest circle round the center that holds the outline (0.234142 m for 0.22 and 0.01 m)."""
    return float(np.max(hypots(outline[:, 0], outline[:, 1])))
