"""Gazebo worlds: the collisions of an SDF file's models, cut at the heights of a robot.

Read by http://sdformat.org/spec: models in models, links, collisions, each with a pose in its parent's frame; files that `include` names.
"""

import math
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import ClassVar, Final
from xml.etree.ElementTree import Element

import numpy as np
import shapely
from numpy.typing import NDArray

from vastflow.sim.model.elementary import atan2, cos_sin, dist
from vastflow.sim.model.files import Unreadable, is_file, is_inside, read_bytes, xml_root
from vastflow.sim.model.pose import DECIMALS, Pose
from vastflow.sim.model.shape import Box, Disc, Polygon, Shape, polygons_about
from vastflow.sim.world.bodies import HIGHEST_M, LOWEST_M, Body
from vastflow.sim.world.readers.mesh import Triangles, cut, read_mesh, without_holes
from vastflow.sim.world.readers.reader import FARTHEST_M, MOST_BODIES, WorldError

MOST_DEPTH: Final = 8
"""Maximum number of files and models that are in one another."""
MOST_INCLUDES: Final = 10_000
"""Maximum number of includes and meshes, as files that include each other often take forever."""
MOST_FILE_BYTES: Final = 64 * 2**20
NOTHING_STANDS: Final = {"sun", "ground_plane", "ground plane"}
"""Models of Gazebo's collections that nearly each world includes: a light, and a level floor."""
MOST_TRIANGLES: Final = 2_000_000
"""Maximum number of triangles of all meshes, each as often as it stands somewhere."""
SLICES_M: Final = tuple(0.03 + 0.02 * k for k in range(19))
"""Heights at which a mesh is cut: 0.03 m to 0.39 m."""
_UPRIGHT: Final = 1e-6

Transform = NDArray[np.float64]
"""(4, 4) from a frame to the world's."""


class Sdf:
    """Reader of SDF worlds and models: boxes, cylinders, spheres, planes, polylines, and meshes in STL and OBJ.

    What no robot meets at its heights is left out, such as the floor.
    """

    suffixes: ClassVar[tuple[str, ...]] = (".sdf", ".world")

    @staticmethod
    def read(path: Path) -> Iterator[Body]:
        for count, body in enumerate(_of_file(_File(path, _Tree(path.parent)), np.eye(4), "", 0)):
            if count >= MOST_BODIES:
                raise WorldError(f"{path}: expected {MOST_BODIES:,} bodies at most, got more")
            yield body

    @staticmethod
    def files(path: Path) -> list[Path]:
        found, known, tree = [path], {path}, _Tree(path.parent)
        meshes: dict[Path, None] = {}
        for each in found:  # grows
            file = _File(each, tree)
            standing = filter(_stands, _root(file).iter("include"))
            included = dict.fromkeys(_included(file, include, "include").path for include in standing)
            found += [one for one in included if one not in known]
            known.update(included)
            named = (mesh for collision in _root(file).iter("collision") for mesh in collision.iter("mesh"))
            meshes |= dict.fromkeys(_included(file, mesh, "mesh").path for mesh in named)
        return [*found, *meshes]


@dataclass
class _Tree:
    """The files of a world that were parsed.

    Attributes:
        folder: The world's, in which the models are that it includes.
        meshes: Triangles of each mesh.
        includes: Number of includes and meshes so far.
        triangles: Number of triangles so far.
    """

    folder: Path
    roots: dict[Path, Element] = field(default_factory=dict)
    meshes: dict[Path, Triangles] = field(default_factory=dict)
    includes: int = 0
    triangles: int = 0


@dataclass(frozen=True, slots=True)
class _File:
    path: Path
    tree: _Tree

    def error(self, what: str) -> WorldError:
        return WorldError(f"{self.path}: {what}")


def _root(file: _File) -> Element:
    """Parse a file once."""
    if file.path in file.tree.roots:
        return file.tree.roots[file.path]
    content = read_bytes(file.path, "an SDF file", MOST_FILE_BYTES)
    try:
        root = xml_root(content)
    except Unreadable as error:
        raise WorldError(f"{file.path}:{error.place[0]}:{error.place[1]}: {error}") from None
    if root.tag != "sdf":
        raise file.error(f"expected <sdf>, got <{root.tag}>")
    file.tree.roots[file.path] = root
    return root


def _of_file(file: _File, to_world: Transform, name: str, depth: int) -> Iterator[Body]:
    root = _root(file)
    for parent in (*root.findall("world"), root):
        if parent.find("population") is not None:
            raise file.error("expected models one by one, got a <population>")
        moved = {} if depth else dict(_moved_models(file, parent))
        yield from _models(file, parent, to_world, name, depth, moved, is_included=bool(depth))


def _moved_models(file: _File, world: Element) -> Iterator[tuple[str, Transform]]:
    """Yield names and poses of models that a saved world's first `<state>` moves, as Gazebo does when it loads one."""
    state = world.find("state")
    for model in () if state is None else state.findall("model"):
        name = model.get("name") or ""
        if _numbers(file, model.findtext("scale", "1 1 1"), 3, f"{name}: scale in <state>") != [1.0, 1.0, 1.0]:
            raise file.error(f"{name}: expected a scale of 1 1 1 in <state>, got {model.findtext('scale')!r}")
        if model.find("pose") is not None:
            yield name, _pose(file, model, name)


def _models(
    file: _File,
    parent: Element,
    to_world: Transform,
    above: str,
    depth: int,
    moved: Mapping[str, Transform] = MappingProxyType({}),
    is_included: bool = False,
) -> Iterator[Body]:
    if depth > MOST_DEPTH:
        raise file.error(f"expected {MOST_DEPTH} files and models in one another at most, got more")
    for model in parent.findall("model"):
        name = above if is_included and above else _joined(above, model)
        own = _product(to_world, moved[name]) if name in moved else _placed(file, model, to_world, name)
        for link in model.findall("link"):
            linked = _placed(file, link, own, name)
            for collision in link.findall("collision"):
                place = _joined(_joined(name, link), collision)
                yield from _bodies(file, collision, _placed(file, collision, linked, place), place)
        yield from _models(file, model, own, name, depth + 1)
    for include in filter(_stands, parent.findall("include")):
        name = _joined(above, include, include.findtext("name") or include.findtext("uri") or "include")
        included = _included(file, include, name)
        # The pose of an include takes the place of the model's own.
        model = _first_model(included)
        own_pose = moved.get(include.findtext("name") or model.get("name") or "")
        if own_pose is None and include.find("pose") is not None:
            own_pose = _pose(file, include, name)
        to_model = to_world if own_pose is None else _product(to_world, own_pose)
        if own_pose is not None:
            to_model = _product(to_model, _inverse(_pose(included, model, name)))
        yield from _of_file(included, to_model, name, depth + 1)


def _stands(include: Element) -> bool:
    return (include.findtext("uri") or "").strip().rstrip("/").rpartition("/")[2].lower() not in NOTHING_STANDS


def _joined(above: str, element: Element, name: str = "") -> str:
    name = name or element.get("name") or element.tag
    return f"{above}::{name}" if above else name


def _included(file: _File, include: Element, name: str) -> _File:
    """Return the file that an include or a mesh names: a file, or a folder of a model with `model.sdf`."""
    file.tree.includes += 1
    if file.tree.includes > MOST_INCLUDES:
        raise file.error(f"expected {MOST_INCLUDES:,} includes and meshes at most, got more")
    uri = (include.findtext("uri") or "").strip()
    inner = uri.removeprefix("file://").removeprefix("model://")
    if not inner or "://" in inner:
        raise file.error(f"{name}: expected the uri of a local file, got {uri!r}")
    own, home = file.tree.folder, file.tree.folder.parent
    for folder in (file.path.parent, own, own / "models", home / "models"):
        for path in (folder / inner, folder / inner / "model.sdf"):
            if is_file(path) and is_inside(path, os.path.realpath(home)):
                return _File(path, file.tree)
    raise file.error(f"{name}: There is no file {inner!r} beside the world, nor in a folder 'models' there or above.")


def _first_model(file: _File) -> Element:
    root = _root(file)
    found = (model for parent in (root, *root.findall("world")) for model in parent.findall("model"))
    return next(found, Element("model"))


def _product(a: Transform, b: Transform) -> Transform:
    # Not by `@`, whose sums differ in their last bits from host to host.
    return np.array(
        [[math.fsum(x * y for x, y in zip(row, column, strict=True)) for column in b.T.tolist()] for row in a.tolist()]
    )


def _inverse(pose: Transform) -> Transform:
    turned, moved = np.eye(4), np.eye(4)
    turned[:3, :3], moved[:3, 3] = pose[:3, :3].T, -pose[:3, 3]
    return _product(turned, moved)


def _numbers(file: _File, text: str | None, count: int, place: str) -> list[float]:
    words = (text or "").split()
    try:
        numbers = [float(word) for word in words]
    except ValueError:
        numbers = []
    if len(numbers) != count or not all(abs(number) <= FARTHEST_M for number in numbers):
        right = f"{count} numbers of {FARTHEST_M:g} at most" if count > 1 else f"a number of {FARTHEST_M:g} at most"
        raise file.error(f"{place}: expected {right}, got {(text or '').strip()!r}")
    return numbers


def _placed(file: _File, element: Element, parent: Transform, place: str) -> Transform:
    """Return the frame of an element in the world, by that of its parent."""
    return parent if element.find("pose") is None else _product(parent, _pose(file, element, place))


def _pose(file: _File, element: Element, place: str) -> Transform:
    """Return an element's pose in its parent: x, y, z (m), roll, pitch, yaw about fixed axes (rad)."""
    pose = element.find("pose")
    if pose is None or not (pose.text or "").strip():
        return np.eye(4)
    frame = pose.get("relative_to") or pose.get("frame")
    if frame and frame not in ("__model__", "world"):
        raise file.error(f"{place}: expected a pose in the frame of what it is part of, got one relative to {frame!r}")
    if pose.get("rotation_format", "euler_rpy") != "euler_rpy":
        raise file.error(f"{place}: expected roll, pitch, and yaw, got {pose.get('rotation_format')!r}")
    x, y, z, *angles = _numbers(file, pose.text, 6, f"{place}: pose")
    if pose.get("degrees") in ("true", "1"):
        angles = [math.radians(angle) for angle in angles]
    (cr, sr), (cp, sp), (cy, sy) = map(cos_sin, angles)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr, x],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr, y],
            [-sp, cp * sr, cp * cr, z],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )


def _bodies(file: _File, collision: Element, to_world: Transform, place: str) -> Iterator[Body]:
    geometry = collision.find("geometry")
    shape = None if geometry is None else next(iter(geometry), None)
    if shape is None or shape.tag == "empty":
        return
    if shape.tag == "plane":
        normal = _numbers(file, shape.findtext("normal", "0 0 1"), 3, f"{place}: normal")
        if abs(math.fsum(x * y for x, y in zip(to_world[2, :3], normal, strict=True))) < (1.0 - _UPRIGHT) * dist(
            normal, (0.0, 0.0, 0.0)
        ):
            raise file.error(f"{place}: expected a level plane, which is a floor, got one that is not")
        return
    if shape.tag == "mesh":
        yield from _of_mesh(file, shape, to_world, place)
        return
    yield from _cut(_solid(file, shape, place), to_world, place)


def _of_mesh(file: _File, shape: Element, to_world: Transform, place: str) -> Iterator[Body]:
    """Yield what of a mesh stands between a robot's heights, in pieces."""
    tree, path = file.tree, _included(file, shape, place).path
    if shape.find("submesh") is not None:
        raise file.error(f"{place}: expected a whole mesh, got a submesh of {path.name}")
    scale = np.array(_numbers(file, shape.findtext("scale", "1 1 1"), 3, f"{place}: scale"))
    try:
        if path not in tree.meshes:
            tree.meshes[path] = read_mesh(path)
        tree.triangles += len(tree.meshes[path])
        if tree.triangles > MOST_TRIANGLES:
            raise WorldError(f"expected {MOST_TRIANGLES:,} triangles of all meshes at most, got more")
        corners = _moved(to_world, tree.meshes[path].reshape(-1, 3) * scale).reshape(-1, 3, 3)
        whole = shapely.union_all([part for height_m in SLICES_M for part in cut(corners, height_m)])
    except ValueError as error:
        raise file.error(f"{place}: {path.name}: {error}") from None
    x_m, y_m = (round(part, DECIMALS) for part in to_world[:2, 3].tolist())
    low_m, high_m = (round(float(end), DECIMALS) for end in (corners[:, :, 2].min(), corners[:, :, 2].max()))
    for part in (piece for each in shapely.get_parts(whole) for piece in without_holes(each)):
        for polygon in polygons_about(x_m, y_m, part):
            yield Body(place, polygon, Pose(x_m, y_m, 0.0), low_m, high_m)


@dataclass(frozen=True, slots=True)
class _Solid:
    """An upright prism about its origin, or a ball.

    Attributes:
        flat: Its base in its own frame; of a ball, its disc.
        low_m, high_m: Heights of its ends.
    """

    flat: Shape
    low_m: float
    high_m: float
    is_ball: bool = False


def _solid(file: _File, shape: Element, place: str) -> _Solid:
    def positive(name: str, count: int = 1) -> list[float]:
        numbers = _numbers(file, shape.findtext(name), count, f"{place}: {name}")
        if min(numbers) <= 0.0:
            raise file.error(f"{place}: {name}: expected more than 0, got {min(numbers):g}")
        return numbers

    match shape.tag:
        case "box":
            length, width, height = positive("size", 3)
            return _Solid(Box(length, width), -height / 2, height / 2)
        case "cylinder":
            (radius,), (height,) = positive("radius"), positive("length")
            return _Solid(Disc(radius), -height / 2, height / 2)
        case "sphere":
            (radius,) = positive("radius")
            return _Solid(Disc(radius), -radius, radius, is_ball=True)
        case "polyline":
            (height,) = positive("height")
            points = [_numbers(file, point.text, 2, f"{place}: point") for point in shape.findall("point")]
            vertices = tuple((x, y) for x, y in points)
            if len(vertices) > 1 and vertices[0] == vertices[-1]:
                vertices = vertices[:-1]
            if len(vertices) < 3 or not shapely.Polygon(vertices).is_valid:
                raise file.error(f"{place}: expected a polyline of three points or more that does not cross itself")
            return _Solid(Polygon(vertices), 0.0, height)
        case other:
            raise file.error(f"{place}: expected a box, cylinder, sphere, plane, polyline, or mesh, got <{other}>")


def _cut(solid: _Solid, to_world: Transform, place: str) -> Iterator[Body]:
    """Yield the outline of a solid between a robot's heights; of a tilted one its hull."""
    x_m, y_m, z_m = (round(part, DECIMALS) for part in to_world[:3, 3].tolist())
    is_upright = abs(to_world[2, 2]) > 1.0 - _UPRIGHT
    if solid.is_ball or is_upright:
        up = 1.0 if solid.is_ball or to_world[2, 2] > 0.0 else -1.0
        low_m, high_m = sorted(round(z_m + up * end, DECIMALS) for end in (solid.low_m, solid.high_m))
        if high_m <= LOWEST_M or low_m >= HIGHEST_M:
            return
        flat = solid.flat
        if solid.is_ball and isinstance(flat, Disc):
            widest_m = min(max(z_m, LOWEST_M), HIGHEST_M)
            flat = Disc(math.sqrt((widest_m - low_m) * (high_m - widest_m)))
        elif up < 0.0 and isinstance(flat, Polygon):
            # Upside down is a half turn about x: y changes its sign.
            flat = Polygon(tuple((x, -y) for x, y in flat.vertices_m))
        yaw_rad = atan2(to_world[1, 0], to_world[0, 0])
        yield Body(place, flat, Pose(x_m, y_m, round(yaw_rad, DECIMALS)), low_m, high_m)
        return
    base = np.array(Body("", solid.flat, Pose(0.0, 0.0, 0.0)).outline.exterior.coords[:-1])
    rings = [np.column_stack([base, np.full(len(base), end)]) for end in (solid.low_m, solid.high_m)]
    low, high = (_moved(to_world, ring) for ring in rings)
    edges = [(ring, np.roll(ring, -1, axis=0)) for ring in (low, high)] + [(low, high)]
    points = np.concatenate([_within(a, b) for a, b in edges])
    if len(points) and (hull := shapely.MultiPoint(points[:, :2]).convex_hull).area > 0.0:
        low_m, high_m = round(float(points[:, 2].min()), DECIMALS), round(float(points[:, 2].max()), DECIMALS)
        for polygon in polygons_about(x_m, y_m, hull):
            yield Body(place, polygon, Pose(x_m, y_m, 0.0), low_m, high_m)


def _moved(to_world: Transform, points: NDArray[np.float64]) -> NDArray[np.float64]:
    x, y, z = points.T
    return np.column_stack([row[0] * x + row[1] * y + row[2] * z + row[3] for row in to_world[:3].tolist()])


def _within(begins: NDArray[np.float64], ends: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the ends (K, 3) of what of edges (N, 3) lies between the heights."""
    rise = ends[:, 2] - begins[:, 2]
    level = np.abs(rise) < _UPRIGHT
    safe = np.where(level, 1.0, rise)
    shares = np.sort(np.stack([(LOWEST_M - begins[:, 2]) / safe, (HIGHEST_M - begins[:, 2]) / safe]), axis=0)
    inside = (begins[:, 2] >= LOWEST_M) & (begins[:, 2] <= HIGHEST_M)
    first = np.where(level, np.where(inside, 0.0, 2.0), np.maximum(shares[0], 0.0))
    last = np.where(level, np.where(inside, 1.0, -1.0), np.minimum(shares[1], 1.0))
    kept = first <= last
    a, b = begins[kept], ends[kept]
    return np.concatenate([a + share[kept, None] * (b - a) for share in (first, last)])
