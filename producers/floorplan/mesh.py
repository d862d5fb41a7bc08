"""The building as one watertight mesh: walls with their openings cut, columns and dividers."""

import itertools
import math
from collections.abc import Iterable, Sequence
from operator import itemgetter
from typing import Final

import numpy as np
import shapely
from manifold3d import CrossSection, FillRule, Manifold, OpType  # type: ignore[import-not-found, unused-ignore]
from numpy.typing import NDArray
from scipy import sparse

from vastflow.producers.floorplan.building import Building, Hole, SolidBlock, Wall
from vastflow.producers.floorplan.geometry import signed_area

MARGIN_M: Final = 0.05
"""Length of a cut beyond both faces of its walls."""

GRIDS_M: Final = (2e-6, 1e-5, 5e-5)
"""Corners are moved to a grid where solids meet, so that faces that touch but for rounding noise are one face. STL has
single precision, where walls may touch in a way that no grid but another one makes a closed mesh of."""

SEAM_M: Final = 1e-4
"""Overlap of a solid with a taller one that it touches."""

APART_M: Final = 2e-5
"""Distance between corners that touch without being one, such as those of two walls with a common edge."""

LEAST_REACH_M2: Final = 1e-6

STL_FACE: Final = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attributes", "<u2")])

Solid = Wall | SolidBlock


def mesh_of(building: Building) -> NDArray[np.float32]:
    """Triangles (N, 3, 3) of everything solid, corners counter-clockwise seen from outside (m).

    Every edge belongs to two triangles, which run along it in opposite directions. Neighboring walls are fused; rooms
    have no floor and no ceiling.
    """
    for grid_m in GRIDS_M:
        triangles = _triangles_of(_solid_of(building, grid_m))
        if is_closed(triangles):
            break
    return triangles


def volume_of(triangles: NDArray[np.float32]) -> float:
    """Volume (m³) that closed triangles enclose."""
    corners = triangles.astype(np.float64)
    return float(np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6.0)


def is_closed(triangles: NDArray[np.float32]) -> bool:
    """Whether every edge belongs to two triangles, which run along it in opposite directions; corners are places."""
    _, place = np.unique(triangles.reshape(-1, 3), axis=0, return_inverse=True)
    ends = place.reshape(-1, 3).astype(np.int64)
    start, end = ends.ravel(), np.roll(ends, -1, axis=1).ravel()
    edges, back = np.sort(start * len(place) + end), np.sort(end * len(place) + start)
    return bool((np.diff(edges) > 0).all() and (edges == back).all() and (start != end).all())


def _solid_of(building: Building, grid_m: float) -> Manifold:
    """Everything solid in the building, as one.

    An opening cuts the walls it names. All of them are cut at once, out of all that is solid but what is in the way of
    an opening and not to be cut by it; that is cut on its own and added afterwards.
    """
    solids: list[Solid] = [*building.walls, *building.obstacles]
    outlines = [shapely.Polygon(solid.outline) for solid in solids]
    cuts = [_cut(hole) for hole in building.holes]
    spared = _in_the_way(building.holes, solids, outlines)
    joined = [(solids[k].height_m, outline) for k, outline in enumerate(outlines) if k not in spared]
    parts = [_without(_fused(joined, grid_m), cuts)]
    for k in sorted(spared):
        own = [cut for cut, hole in zip(cuts, building.holes, strict=True) if solids[k].name in hole.walls]
        wider = shapely.buffer(outlines[k], grid_m, join_style="mitre")
        parts.append(_without(_prism(wider, solids[k].height_m), own))
    return Manifold.batch_boolean(parts, OpType.Add)


def _triangles_of(solid: Manifold) -> NDArray[np.float32]:
    mesh = solid.to_mesh()
    corners = np.array(mesh.vert_properties, dtype=np.float32)[:, :3]
    faces = _without_points(corners, np.asarray(mesh.tri_verts))
    _draw_apart(corners, faces)
    return np.asarray(corners[faces])


def stl(triangles: NDArray[np.float32]) -> bytes:
    """A binary STL file."""
    faces = np.zeros(len(triangles), dtype=STL_FACE)
    faces["corners"] = triangles
    normals = _normals(triangles)
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    faces["normal"] = np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0)
    return b"".ljust(80, b" ") + np.uint32(len(faces)).tobytes() + faces.tobytes()


def _in_the_way(holes: Sequence[Hole], solids: Sequence[Solid], outlines: Sequence[shapely.Polygon]) -> set[int]:
    """Return the solids that a cut would reach without naming them."""
    if not holes:
        return set()
    reaches = [shapely.Polygon(hole.footprint(*hole.reach, MARGIN_M)) for hole in holes]
    pairs = shapely.STRtree(outlines).query(reaches, predicate="intersects").T.tolist()
    return {
        k
        for j, k in pairs
        if solids[k].name not in holes[j].walls and shapely.intersection(reaches[j], outlines[k]).area > LEAST_REACH_M2
    }


def _fused(solids: Iterable[tuple[float, shapely.Polygon]], grid_m: float) -> Manifold:
    """The union of heights and outlines that all stand on the floor.

    What is of one height is joined as one outline; what touches something taller goes a seam's width into it.
    """
    prisms: list[Manifold] = []
    taller: list[shapely.Geometry] = []
    by_height = itemgetter(0)
    for height_m, level in itertools.groupby(sorted(solids, key=by_height, reverse=True), key=by_height):
        outline = shapely.union_all([polygon for _, polygon in level], grid_size=grid_m)
        seams = shapely.buffer(shapely.get_parts(outline), SEAM_M, join_style="mitre")
        pairs = shapely.STRtree(taller).query(seams, predicate="intersects").T.tolist()
        if pairs:
            met = [shapely.intersection(seams[j], taller[k]) for j, k in pairs]
            prisms.append(_prism(shapely.union_all([outline, *met], grid_size=grid_m), height_m))
        else:
            prisms.append(_prism(outline, height_m))
        taller += shapely.get_parts(outline).tolist()
    return Manifold.batch_boolean(prisms, OpType.Add)


def _prism(outline: shapely.Geometry, height_m: float) -> Manifold:
    rings = []
    for polygon in shapely.get_parts(outline).tolist():
        if isinstance(polygon, shapely.Polygon):
            rings += [np.array(ring.coords)[:-1] for ring in (polygon.exterior, *polygon.interiors)]
    return Manifold.extrude(CrossSection(rings, FillRule.EvenOdd), height_m)


def _without(solid: Manifold, cuts: Sequence[Manifold]) -> Manifold:
    return Manifold.batch_boolean([solid, *cuts], OpType.Subtract) if cuts else solid


def _cut(hole: Hole) -> Manifold:
    """Return the solid that an opening takes away: its shape from the x–z plane, through its walls, in the world."""
    corners = hole.shape if signed_area(hole.shape) > 0.0 else hole.shape[::-1]
    # Turned by +90° about x, the extrusion's y becomes z and its z becomes -y.
    upright = Manifold.extrude(CrossSection([np.array(corners)]), hole.depth_m + 2 * MARGIN_M).rotate((90.0, 0.0, 0.0))
    placed = upright.translate((0.0, hole.depth_m + MARGIN_M, 0.0))
    x_m, y_m, yaw_rad = hole.frame
    return placed.rotate((0.0, 0.0, math.degrees(yaw_rad))).translate((x_m, y_m, 0.0))


def _without_points(corners: NDArray[np.float32], faces: NDArray[np.uint32]) -> NDArray[np.uint32]:
    """The faces that are left where edges as long as nothing, in single precision, become one corner each."""
    edges = np.concatenate([faces[:, [k, (k + 1) % 3]] for k in range(3)])
    start, end = edges[(corners[edges[:, 0]] == corners[edges[:, 1]]).all(axis=1)].T
    if not len(start):
        return faces
    links = sparse.coo_array((np.ones(len(start), dtype=np.int8), (start, end)), shape=(len(corners),) * 2)
    _, group = sparse.csgraph.connected_components(links, directed=False)
    _, representative = np.unique(group, return_index=True)
    merged = representative[group[faces]].astype(faces.dtype)
    a, b, c = merged.T
    return np.asarray(merged[(a != b) & (b != c) & (c != a)])


def _draw_apart(corners: NDArray[np.float32], faces: NDArray[np.uint32]) -> None:
    """Separate coincident corners by moving each slightly into its solid, in place.

    In an STL file a corner is its place, so that two walls that touch along an edge would share it, and with it four
    faces.
    """
    _, first, count = np.unique(corners, axis=0, return_inverse=True, return_counts=True)
    together = np.flatnonzero(count[first.ravel()] > 1)
    if not len(together):
        return
    inward = np.zeros(corners.shape, dtype=np.float64)
    normals = _normals(corners[faces])
    for k in range(3):
        np.subtract.at(inward, faces[:, k], normals)
    lengths = np.linalg.norm(inward[together], axis=1, keepdims=True)
    step = np.divide(inward[together], lengths, out=np.zeros_like(inward[together]), where=lengths > 0)
    corners[together] += (APART_M * step).astype(np.float32)


def _normals(triangles: NDArray[np.float32]) -> NDArray[np.float64]:
    """Normal (N, 3) of each triangle; its length is twice the area."""
    exact = triangles.astype(np.float64)
    return np.asarray(np.cross(exact[:, 1] - exact[:, 0], exact[:, 2] - exact[:, 0]))
