"""Meshes of SDF collisions: STL and OBJ, cut at a robot's heights."""

import math
import struct

import numpy as np
import pytest
import shapely
from table import each_row

from vastflow.sim.world.bodies import walls_of
from vastflow.sim.world.occupancy import OccupancyMap
from vastflow.sim.world.readers.reader import WorldError
from vastflow.sim.world.readers.registry import files_of_world, read_file

SDF = (
    "<sdf version='1.9'><world name='w'><model name='shelf'><pose>{pose}</pose><link name='l'><collision name='c'><geometry>"
    "<mesh><uri>{uri}</uri>{more}</mesh></geometry></collision></link></model></world></sdf>"
)
FACES = [(0, 2, 1), (0, 3, 2), (4, 5, 6), (4, 6, 7), *((k, (k + 1) % 4, (k + 1) % 4 + 4) for k in range(4))]
FACES += [(k, (k + 1) % 4 + 4, k + 4) for k in range(4)]
"""Twelve triangles of a box, counter-clockwise from outside."""


def box(width, depth, height, bottom=0.0, inside_out=False):
    """Triangles (12, 3, 3) of a box about the origin."""
    x, y = width / 2, depth / 2
    base = [(-x, -y), (x, -y), (x, y), (-x, y)]
    points = np.array([(*xy, z) for z in (bottom, bottom + height) for xy in base])
    triangles = points[np.array(FACES)]
    return triangles[:, ::-1] if inside_out else triangles


def stl(triangles):
    rows = b"".join(struct.pack("<12fH", 0, 0, 0, *each.ravel(), 0) for each in triangles)
    return b"solid x".ljust(80) + struct.pack("<I", len(triangles)) + rows


def text_stl(triangles):
    facets = [
        "facet normal 0 0 0\nouter loop\n" + "".join(f"vertex {x} {y} {z}\n" for x, y, z in each) for each in triangles
    ]
    return ("solid x\n" + "endloop\nendfacet\n".join([*facets, ""]) + "endsolid\n").encode()


def obj(triangles):
    vertices = "".join(f"v {x} {y} {z}\n" for each in triangles for x, y, z in each)
    return (
        f"# a box\n{vertices}" + "".join(f"f {k}//1 {k + 1}//1 {k + 2}//1\n" for k in range(1, 3 * len(triangles), 3))
    ).encode()


def quads(triangles):
    """The four sides of a box as faces of four corners, named from the last vertex."""
    x, y, z = np.abs(triangles).reshape(-1, 3).max(axis=0)
    corners = [(-x, -y), (x, -y), (x, y), (-x, y)]
    text = "".join(f"v {a} {b} {c}\n" for c in (0.0, z) for a, b in corners)
    return (text + "".join(f"f {k - 8} {(k + 1) % 4 - 8} {(k + 1) % 4 - 4} {k - 4}\n" for k in range(4))).encode()


@pytest.fixture
def mesh(tmp_path):
    """A function that reads a world of one mesh."""

    def read(content, name="a.stl", pose="0 0 0 0 0 0", more=""):
        (tmp_path / "w.sdf").write_text(SDF.format(pose=pose, uri=name, more=more))
        (tmp_path / name).write_bytes(content)
        return read_file(tmp_path / "w.sdf")

    return read


def solid(bodies):
    return shapely.union_all([body.outline for body in bodies])


@each_row("write, name", [(stl, "a.stl"), (text_stl, "a.STL"), (obj, "a.obj"), (quads, "a.obj")])
def test_mesh_of_box_is_its_outline(mesh, write, name):
    (body,) = mesh(write(box(2.0, 1.0, 0.5)), name)
    assert body.outline.equals(shapely.box(-1.0, -0.5, 1.0, 0.5))
    assert (body.name, body.bottom_m, body.top_m) == ("shelf::l::c", 0.0, 0.5)


def test_mesh_is_scaled_and_stands_at_its_pose(mesh):
    found = solid(
        mesh(stl(box(200.0, 100.0, 50.0)), pose="3 4 0 0 0 1.5707963267948966", more="<scale>0.01 0.01 0.01</scale>")
    )
    assert found.bounds == pytest.approx((2.5, 3.0, 3.5, 5.0), abs=1e-9) and found.area == pytest.approx(2.0)


def test_mesh_that_lies_on_its_side_is_cut_there(mesh):
    """A column of 2 m lies on the floor."""
    found = solid(mesh(stl(box(0.3, 0.3, 2.0)), pose="0 0 0.15 1.5707963267948966 0 0"))
    assert found.bounds == pytest.approx((-0.15, -2.0, 0.15, 0.0), abs=1e-6)


@each_row("bottom, height, stands", [(0.41, 1.0, False), (-1.0, 1.02, False), (0.2, 0.05, True), (0.3, 1.0, True)])
def test_mesh_stands_in_the_way_between_heights(mesh, bottom, height, stands):
    triangles = np.concatenate([box(1.0, 1.0, height, bottom), box(1.0, 1.0, 0.5) + np.array([5.0, 0.0, 0.0])])
    assert len(mesh(stl(triangles))) == 1 + stands


@each_row("inside_out", [False, True])
def test_room_within_walls_of_mesh_is_free(mesh, inside_out):
    """Walls of 0.5 m around a room of 3 m by 2 m, whose inner side faces the room."""
    walls = np.concatenate([box(4.0, 3.0, 5.0), box(3.0, 2.0, 0.4, inside_out=True)])
    found = solid(mesh(stl(walls[:, ::-1] if inside_out else walls)))
    assert found.area == pytest.approx(12.0 - 6.0) and not found.contains(shapely.Point(0.3, 0.3))


def test_walls_around_room_of_mesh_have_no_gap_on_any_grid(mesh):
    """The cut through the room runs along the centers of a row of cells."""
    bodies = mesh(
        stl(np.concatenate([box(4.0, 3.0, 5.0), box(3.0, 2.0, 1.0, inside_out=True)])), pose="0 0.0125 0 0 0 0"
    )
    walls = walls_of(bodies, OccupancyMap(np.zeros((200, 200), dtype=np.int8), 0.025, (-2.5, -2.5)))
    assert walls.occupied.sum() * 0.025**2 == pytest.approx(6.0, rel=0.03)
    assert walls.occupied[
        walls.cell_of(0.0, 0.0125)[0], walls.cell_of(-1.9, 0.0)[1] : walls.cell_of(-1.6, 0.0)[1]
    ].all()


def test_solids_of_mesh_that_overlap_are_solid_where_they_do(mesh):
    found = solid(mesh(stl(np.concatenate([box(2.0, 1.0, 1.0), box(1.0, 2.0, 1.0)]))))
    assert found.area == pytest.approx(3.0) and found.contains(shapely.Point(0.0, 0.0))


def test_surface_that_encloses_nothing_is_thin_wall(mesh):
    sheet = box(2.0, 1.0, 1.0)[[4, 8]]  # one side
    found = solid(mesh(stl(sheet)))
    assert found.bounds == pytest.approx((-1.0, -0.5005, 1.0, -0.4995)) and found.area == pytest.approx(0.002)


def test_world_lists_files_of_collision_meshes_but_not_of_visuals(tmp_path, mesh):
    mesh(stl(box(1, 1, 1)))
    text = (tmp_path / "w.sdf").read_text()
    seen = "<visual name='v'><geometry><mesh><uri>gone.dae</uri></mesh></geometry></visual>"
    (tmp_path / "w.sdf").write_text(text.replace("<collision", f"{seen}<collision", 1))
    assert files_of_world(tmp_path / "w.sdf") == [tmp_path / "w.sdf", tmp_path / "a.stl"]
    assert len(read_file(tmp_path / "w.sdf")) == 1


WHOLE = stl(box(1, 1, 1))
WRONG = {
    "COLLADA": (
        b"<COLLADA/>",
        "a.dae",
        "",
        r"w\.sdf: shelf::l::c: a\.dae: This kind of mesh can't be read. Expected \.stl or \.obj",
    ),
    "cut short": (WHOLE[:-1], "a.stl", "", "damaged or empty mesh"),
    "too many announced": (WHOLE[:80] + b"\xff" * 4 + WHOLE[84:], "a.stl", "", "damaged or empty mesh"),
    "nothing": (b"", "a.stl", "", "damaged or empty mesh"),
    "not a number": (stl(box(math.nan, 1, 1)), "a.stl", "", "damaged or empty mesh"),
    "far": (stl(box(1e6, 1, 1)), "a.stl", "", "within 10000 of the origin"),
    "text": (b"solid x\nvertex 1 2\n", "a.stl", "", "damaged or empty mesh"),
    "no such vertex": (b"v 0 0 0\nv 1 0 0\nv 0 0 1\nf 1 2 4\n", "a.obj", "", "damaged or empty mesh"),
    "vertex 0": (b"v 0 0 0\nv 1 0 0\nv 0 0 1\nf 1 2 0\n", "a.obj", "", "damaged or empty mesh"),
    "no number": (b"v 0 0 0\nv 1 0 0\nv 0 x 1\nf 1 2 3\n", "a.obj", "", "damaged or empty mesh"),
    "no faces": (b"v 0 0 0\n", "a.obj", "", "damaged or empty mesh"),
    "scale": (WHOLE, "a.stl", "<scale>1 1</scale>", "scale: expected 3 numbers"),
    "submesh": (WHOLE, "a.stl", "<submesh><name>x</name></submesh>", r"expected a whole mesh, got a submesh of a\.stl"),
}


@each_row("content, name, more, message", [*WRONG.values()])
def test_unusable_mesh_is_one_sentence_with_its_model(mesh, content, name, more, message):
    with pytest.raises(WorldError, match=message) as error:
        mesh(content, name, more=more)
    assert "w.sdf: shelf::l::c: " in str(error.value) and "\n" not in str(error.value)


def test_missing_mesh_is_named_with_its_model(mesh, tmp_path):
    mesh(WHOLE)
    (tmp_path / "a.stl").unlink()
    with pytest.raises(WorldError, match=r"shelf::l::c: There is no file 'a\.stl'"):
        read_file(tmp_path / "w.sdf")


@pytest.mark.timeout(60)
def test_mesh_of_too_many_triangles_is_refused(mesh, monkeypatch, tmp_path):
    strips = np.tile(box(0.01, 0.01, 1.0), (2000, 1, 1)) + np.repeat(np.arange(2000) * 0.02, 12)[:, None, None] * (
        1,
        0,
        0,
    )
    assert len(mesh(stl(strips[:1200]))) == 100
    with pytest.raises(WorldError, match=r"a\.stl: expected at most 5,000 triangles at a height, got 16,000"):
        mesh(stl(strips))
    monkeypatch.setattr("vastflow.sim.world.readers.sdf.MOST_TRIANGLES", 1000)
    assert len(mesh(stl(strips[:600]))) == 50
    text = (tmp_path / "w.sdf").read_text()
    collision = text[text.index("<collision") : text.index("</link>")]
    (tmp_path / "w.sdf").write_text(text.replace(collision, 2 * collision))
    with pytest.raises(WorldError, match=r"a\.stl: expected 1,000 triangles of all meshes at most, got more"):
        read_file(tmp_path / "w.sdf")
