"""Floor plans as meshes: closed, of the right volume, open where the openings are."""

import math
from collections import Counter

import numpy as np
import pytest
import shapely
from floor_plans import EXAMPLE, FLOOR_PLANS, ROOM, built
from hypothesis import given, settings
from hypothesis import strategies as st
from table import each_row

from vastflow.producers.floorplan.mesh import is_closed, mesh_of, stl, volume_of

RING_M2 = 4.4 * 3.4 - 4.0 * 3.0


def written(text):
    """The triangles (N, 3, 3) of the STL file of a plan, as another program reads them."""
    content = stl(mesh_of(built(text)))
    count = int.from_bytes(content[80:84], "little")
    assert len(content) == 84 + 50 * count
    records = np.frombuffer(content[84:], dtype=np.uint8).reshape(count, 50)
    return records[:, 12:48].copy().view("<f4").reshape(count, 3, 3)


def is_watertight(triangles):
    """Whether every edge belongs to two triangles, which run along it in opposite directions."""
    corners = [[tuple(corner) for corner in triangle] for triangle in triangles.tolist()]
    edges = Counter((t[k], t[(k + 1) % 3]) for t in corners for k in range(3))
    return all(count == 1 and edges[end, start] == 1 for (start, end), count in edges.items())


def volume(triangles):
    corners = triangles.astype(np.float64)
    return float(np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6)


def test_example_is_one_watertight_solid_of_the_documented_measures():
    triangles = written(EXAMPLE)
    assert is_watertight(triangles)
    walls = (6.4 * 2.4 - 6 * 2 + 3.6 * 2.6 - 3 * 2) * 2.5
    rest = 0.4 * 0.4 * 2 + 1 * 0.1 * 0.5 - 0.9 * 2 * 0.5 - 1 * 1 * 0.2
    assert volume(triangles) == pytest.approx(walls + rest, abs=2e-4)
    corners = triangles.reshape(-1, 3)
    assert corners.min(axis=0) == pytest.approx((-2.2, 0.45, 0), abs=1e-6)
    assert corners.max(axis=0) == pytest.approx((7.8, 3.2, 2.5), abs=1e-6)


@each_row("file", sorted(FLOOR_PLANS.glob("*.fpm")))
def test_mesh_of_every_plan_of_ours_is_watertight(file):
    assert is_watertight(written(file.read_text()))


@each_row(
    ("shape", "location", "hole_m2"),
    [
        ("Rectangle width=1.0 m, height=2.0 m", "translation: z: 1.0 m", 2.0),
        ("Rectangle width=1.0 m, height=2.0 m", "translation: z: 0.0 m", 1.0),
        ("Rectangle width=1.0 m, height=1.0 m", "translation: z: 1.2 m rotation: y: 45 deg", 1.0),
        ("Polygon points:[(-0.5, 1.0), (0.5, 1.0), (0.0, 2.0)]", "", 0.5),
        ("Circle radius=0.5 m", "translation: z: 1.2 m", math.pi / 4),
    ],
)
@each_row("kind", ["Entryway", "Window"])
def test_opening_of_any_shape_is_cut_out_of_its_wall(kind, shape, location, hole_m2):
    triangles = written(ROOM + f"{kind} d: shape: {shape} location: in: a.walls[1] {location}")
    assert is_watertight(triangles)
    assert volume(triangles) == pytest.approx(RING_M2 * 2.5 - hole_m2 * 0.2, abs=5e-4)


@each_row(
    ("side_m", "at", "more_m3"),
    [(0.5, "a", 0.25), (0.2, "a.walls[0]", 0.02)],  # one half in a wall counts once
)
def test_column_is_solid_up_to_its_height(side_m, at, more_m3):
    post = f"Column c: shape: Rectangle width={side_m} m, length={side_m} m height: 1.0 m location: wrt: {at}\n"
    assert volume(written(ROOM + post)) == pytest.approx(RING_M2 * 2.5 + more_m3, abs=1e-4)


def test_mesh_is_closed_only_where_every_edge_has_two_triangles():
    triangles = mesh_of(built(EXAMPLE))
    assert is_closed(triangles)
    assert not is_closed(triangles[1:])
    assert not is_closed(np.concatenate([triangles, triangles[:1]]))
    assert not is_closed(np.concatenate([triangles[1:], triangles[:1, ::-1]]))
    assert volume_of(triangles) == pytest.approx(volume(triangles))


def test_solids_touching_along_edge_are_closed():
    posts = "".join(
        f"Column c{int(2 * x)}{int(2 * y) + 1}: shape: Rectangle width=0.5 m, length=0.5 m height: {h} m location: wrt: a translation: x: {x} m, y: {y} m\n"
        for x, y, h in ((0, 0, 1.0), (0.5, 0.5, 1.0), (1.0, 0.0, 0.5), (0.5, -0.5, 2.0))
    )
    triangles = written(ROOM + posts)
    assert is_watertight(triangles)
    assert volume(triangles) == pytest.approx(RING_M2 * 2.5 + 0.25 * 4.5, abs=3e-4)


@settings(max_examples=40, deadline=None)
@given(
    st.floats(-3.2, 3.2), st.sampled_from(range(4)), st.sampled_from(range(4)), st.floats(-2.5, 2.5),
    st.floats(0.05, 0.5), st.floats(0.05, 0.5), st.sampled_from([1.8, 2.5, 3.0]),
)  # fmt: skip
def test_adjacent_spaces_form_one_watertight_solid(turn, theirs, own, shift, thick, thin, height):
    text = ROOM.strip() + f" rotation: z: {turn!r} walls: thickness: {thick!r} m\n"
    text += (
        f"Space b: shape: Rectangle width=2.5 m, length=2.0 m location: wrt: a.walls[{theirs}] of: this.walls[{own}] "
    )
    text += f"translation: x: {shift!r} m spaced walls: thickness: {thin!r} m height: {height} m\n"
    text += "Entryway d: shape: Rectangle width=0.8 m, height=2 m "
    text += f"location: in: b.walls[{own}] and a.walls[{theirs}] translation: z: 1 m"
    plan = built(text)
    triangles = written(text)
    assert is_watertight(triangles)
    solid = sum(shapely.Polygon(wall.outline).area * wall.height_m for wall in plan.walls)
    door = shapely.Polygon(plan.holes[0].outline)
    cut = sum(
        shapely.intersection(door, shapely.Polygon(wall.outline)).area * min(2.0, wall.height_m)
        for wall in plan.walls
        if wall.name in plan.holes[0].walls
    )
    assert volume(triangles) == pytest.approx(solid - cut, abs=5e-4)
