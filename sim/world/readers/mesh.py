"""Meshes of collisions: STL and OBJ files, cut level at a height."""

import itertools
from collections.abc import Iterator
from pathlib import Path
from typing import Final, TypeAlias

import numpy as np
import shapely
from numpy.typing import NDArray

from vastflow.sim.model.files import read_bytes
from vastflow.sim.model.pose import DECIMALS
from vastflow.sim.world.readers.reader import FARTHEST_M, WorldError

MOST_BYTES: Final = 64 * 2**20
MOST_CUTS: Final = 5_000
"""Maximum number of triangles at a height."""
HALF_SHEET_M: Final = 0.0005
"""Half the thickness of a surface that encloses nothing."""
_STL: Final = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_HEAD_BYTES: Final = 84

Triangles: TypeAlias = NDArray[np.float64]
"""(N, 3, 3): x, y, z of three corners, counter-clockwise as seen from outside."""


def read_mesh(path: Path) -> Triangles:
    """Read the triangles of a mesh in its own units; faces of more corners become fans.

    Raises:
        WorldError: another kind of file, or a damaged one; without its name.
        Unreadable: it can't be read at all.
    """
    if (read := _READERS.get(path.suffix.lower())) is None:
        raise WorldError(f"This kind of mesh can't be read. Expected {' or '.join(_READERS)}.")
    content = read_bytes(path, "a mesh", MOST_BYTES)
    try:
        found = read(content)
    except (ValueError, IndexError, OverflowError):
        found = np.empty((0, 3, 3))
    if not len(found) or not np.all(np.abs(found) <= FARTHEST_M):
        raise WorldError(f"expected triangles within {FARTHEST_M:g} of the origin, got a damaged or empty mesh")
    return found


def _stl(content: bytes) -> Triangles:
    count = int.from_bytes(content[80:_HEAD_BYTES], "little")
    if len(content) == _HEAD_BYTES + count * _STL.itemsize:  # binary ones may begin with the word of text, solid
        return np.frombuffer(content, _STL, count, _HEAD_BYTES)["corners"].astype(np.float64)
    words = content.split()
    corners = [words[k + 1 : k + 4] for k, word in enumerate(words) if word == b"vertex"]
    return np.array(corners, dtype=np.float64).reshape(-1, 3, 3)


def _obj(content: bytes) -> Triangles:
    vertices: list[list[bytes]] = []
    faces: list[tuple[int, int, int]] = []
    for line in content.splitlines():
        match line.split():
            case [b"v", x, y, z, *_]:
                vertices.append([x, y, z])
            case [b"f", *corners]:
                numbers = [int(corner.partition(b"/")[0]) for corner in corners]
                if 0 in numbers or max(map(abs, numbers)) > len(vertices):
                    raise ValueError(line)
                first, *others = (n - 1 if n > 0 else len(vertices) + n for n in numbers)
                faces += [(first, *edge) for edge in itertools.pairwise(others)]
    return np.array(vertices, dtype=np.float64)[np.array(faces, dtype=np.int64).reshape(-1, 3)]


_READERS: Final = {".stl": _stl, ".obj": _obj}


def cut(triangles: Triangles, height_m: float) -> Iterator[shapely.Polygon]:
    """Yield what of a mesh is solid at a height; a surface that encloses nothing is a thin sheet.

    Raises:
        ValueError: too many triangles.
    """
    edges = _edges(triangles, height_m)
    if len(edges) > MOST_CUTS:
        raise ValueError(f"expected at most {MOST_CUTS:,} triangles at a height, got {len(edges):,}")
    faces, *lines = shapely.polygonize_full(shapely.linestrings(edges))
    yield from (face for face in faces.geoms if _turns(edges, face.representative_point()))
    yield from (
        line.buffer(HALF_SHEET_M, cap_style="flat", join_style="mitre") for each in lines for line in each.geoms
    )


def _edges(triangles: Triangles, height_m: float) -> NDArray[np.float64]:
    """Return edges (M, 2, 2) of triangles at a height, all with what is solid on the same side."""
    above = triangles[:, :, 2] > height_m
    crossing = above.any(axis=1) & ~above.all(axis=1)
    crossed, above = triangles[crossing], above[crossing]
    # The first corner is to be alone on its side.
    is_up = above.sum(axis=1) == 1
    alone = np.where(is_up, above.argmax(axis=1), above.argmin(axis=1))
    corners = np.take_along_axis(crossed, ((alone[:, None] + np.arange(3)) % 3)[:, :, None], axis=1)
    first, others, up = np.repeat(corners[:, :1], 2, axis=1), corners[:, 1:], is_up[:, None, None]
    low, high = np.where(up, others, first), np.where(up, first, others)  # triangles beside each other have equal ends
    share = (height_m - low[:, :, 2:]) / (high[:, :, 2:] - low[:, :, 2:])
    ends = np.round(low[:, :, :2] + share * (high[:, :, :2] - low[:, :, :2]), DECIMALS)
    edges = np.where(up, ends, ends[:, ::-1])
    return np.unique(edges[(edges[:, 0] != edges[:, 1]).any(axis=1)], axis=0)


def _turns(edges: NDArray[np.float64], point: shapely.Point) -> int:
    """Return the winding number of edges around a point: 0 outside of what is solid and in its holes."""
    (x0, y0), (x1, y1) = edges[:, 0].T, edges[:, 1].T
    left = (x1 - x0) * (point.y - y0) - (y1 - y0) * (point.x - x0)
    up, down = (y0 <= point.y) & (point.y < y1), (y1 <= point.y) & (point.y < y0)
    return int((up & (left > 0.0)).sum()) - int((down & (left < 0.0)).sum())


def without_holes(face: shapely.Polygon) -> Iterator[shapely.Polygon]:
    """Yield pieces of a polygon, which is cut through each hole; pieces overlap, so that no cell is between them."""
    if not face.interiors:
        yield face
        return
    x0, y0, x1, y1 = face.bounds
    middle = face.interiors[0].centroid.y
    for half in (shapely.box(x0, y0, x1, middle + HALF_SHEET_M), shapely.box(x0, middle - HALF_SHEET_M, x1, y1)):
        for part in shapely.get_parts(face.intersection(half)):
            if part.area > 0.0:
                yield from without_holes(part)
