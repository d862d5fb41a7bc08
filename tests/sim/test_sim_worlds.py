"""Worlds from files of their own: circles and Gazebo's SDF."""

import csv
import gzip
import math

import numpy as np
import pytest
from outside import SHARED
from scipy import ndimage
from synthetic import walled_room, write_map
from table import each_row

from vastflow.sim.model.pose import Pose
from vastflow.sim.model.recording import si
from vastflow.sim.model.shape import Box, Disc, Polygon
from vastflow.sim.nav2.navigator.prepared import prepare
from vastflow.sim.nav2.parameters.stack import NavParameters
from vastflow.sim.reading.checked import checked_digest
from vastflow.sim.run import run
from vastflow.sim.world.bodies import HIGHEST_M, LOWEST_M, Body, distances_to, walls_of
from vastflow.sim.world.difference import WorldDifference
from vastflow.sim.world.environment import world_of
from vastflow.sim.world.map_file import load_map
from vastflow.sim.world.occupancy import FREE, UNKNOWN, OccupancyMap
from vastflow.sim.world.readers.body_list import BODIES
from vastflow.sim.world.readers.circles import Circles
from vastflow.sim.world.readers.conformance import check_world_reader
from vastflow.sim.world.readers.reader import WorldError
from vastflow.sim.world.readers.registry import files_of_world, read_file
from vastflow.sim.world.readers.sdf import Sdf
from vastflow.sim.world.robot_model import Lidar
from vastflow.sim.world.world import World, map_content, read_grid, read_world, world_content

BOX = "<box><size>2 1 1</size></box>"
EMPTY = OccupancyMap(np.full((80, 80), FREE, dtype=np.int8), 0.05, (-2.0, -2.0))


def collision(geometry=BOX, pose=""):
    return f"<collision name='c'>{pose}<geometry>{geometry}</geometry></collision>"


def model(inner, pose="", name="m"):
    return f"<model name='{name}'>{pose}<static>1</static>{inner}</model>"


def link(inner, pose=""):
    return f"<link name='l'>{pose}{inner}</link>"


def pose(text, more=""):
    return f"<pose {more}>{text}</pose>"


@pytest.fixture
def sdf(tmp_path):
    """Read a world of models."""

    def read(models, name="w.sdf"):
        (tmp_path / name).write_text(f"<?xml version='1.0'?><sdf version='1.9'><world name='w'>{models}</world></sdf>")
        return read_file(tmp_path / name)

    return read


def corners(body):
    return sorted((round(x, 6) + 0.0, round(y, 6) + 0.0) for x, y in body.outline.exterior.coords[:-1])


R = math.sqrt(0.5)
NESTED = {
    "model, link, and collision each move along x": (
        model(link(collision(pose=pose("0.25 0 0.5 0 0 0")), pose("0.5 0 0 0 0 0")), pose("1 0 0 0 0 0")),
        [(0.75, -0.5), (0.75, 0.5), (2.75, -0.5), (2.75, 0.5)],
    ),
    "a quarter turn of the model turns the link's offset": (
        model(link(collision(pose=pose("0 0 0.5 0 0 0")), pose("2 0 0 0 0 0")), pose("0 0 0 0 0 1.5707963267948966")),
        [(-0.5, 1.0), (-0.5, 3.0), (0.5, 1.0), (0.5, 3.0)],
    ),
    "turns of model and link add up": (
        model(link(collision(), pose("0 0 0.5 0 0 45", "degrees='true'")), pose("1 1 0 0 0 45", "degrees='1'")),
        [(0.5, 0.0), (0.5, 2.0), (1.5, 0.0), (1.5, 2.0)],
    ),
    "a model in a model": (
        model(model(link(collision()), pose("0 1 0.5 0 0 1.5707963267948966"), "inner"), pose("1 0 0 0 0 0")),
        [(0.5, 0.0), (0.5, 2.0), (1.5, 0.0), (1.5, 2.0)],
    ),
    "a box that lies on its side has its height along the floor": (
        # Rolled by 90° about x its y (1 m) stands up, and its z (1 m) lies along -y.
        model(link(collision("<box><size>2 0.2 3</size></box>"), pose("0 0 0 1.5707963267948966 0 0"))),
        [(-1.0, -1.5), (-1.0, 1.5), (1.0, -1.5), (1.0, 1.5)],
    ),
}


@each_row("models, expected", [*NESTED.values()])
def test_nested_poses_place_box_as_by_hand(sdf, models, expected):
    (body,) = sdf(models)
    assert corners(body) == [pytest.approx(point, abs=1e-6) for point in expected]


def test_pitched_box_is_cut_at_heights_of_robot(sdf):
    # A plate 2 m long that rises by 45° from the floor at x = 0: between the heights it is at those x, and its thickness adds to both.
    plate = model(link(collision("<box><size>2 1 0.02</size></box>"), pose("0.7071 0 0.7071 0 -0.7853981633974483 0")))
    (body,) = sdf(plate)
    x0, y0, x1, y1 = body.outline.bounds
    half = 0.02 * R / 2 * 2
    assert (x0, x1) == pytest.approx((LOWEST_M - half, HIGHEST_M + half), abs=2e-3)
    assert (y0, y1) == pytest.approx((-0.5, 0.5))


@each_row(
    "geometry, height_m, expected",
    [
        ("<cylinder><radius>0.3</radius><length>1</length></cylinder>", 0.5, Disc(0.3)),
        ("<sphere><radius>0.5</radius></sphere>", 0.7, Disc(0.4)),
        ("<sphere><radius>0.3</radius></sphere>", 0.3, Disc(0.3)),
        (
            "<polyline><height>1</height><point>0 0</point><point>1 0</point><point>0 1</point></polyline>",
            0.0,
            Polygon(((0.0, 0.0), (1.0, 0.0), (0.0, 1.0))),
        ),
    ],
)
def test_upright_shape_keeps_its_own(sdf, geometry, height_m, expected):
    (body,) = sdf(model(link(collision(geometry, pose(f"1 2 {height_m} 0 0 0.5")))))
    assert (body.pose.x_m, body.pose.y_m) == (1.0, 2.0)
    match body.shape, expected:
        case Disc(found_m), Disc(expected_m):
            assert found_m == pytest.approx(expected_m)
        case found, other:
            assert found == other and body.pose.yaw_rad == pytest.approx(0.5)


@each_row("height_m", [HIGHEST_M + 0.51, LOWEST_M - 0.51])  # a lamp above, and a mat below
def test_shape_off_heights_of_robot_is_left_out(sdf, height_m):
    there = model(link(collision(pose=pose("0 0 0.5 0 0 0"))), name="there")
    bodies = sdf(there + model(link(collision(pose=pose(f"0 0 {height_m} 0 0 0")))))
    assert [body.name for body in bodies] == ["there::l::c"]


def test_floor_and_visuals_are_left_out(sdf):
    floor = model(link(collision("<plane><normal>0 0 1</normal><size>9 9</size></plane>")), name="floor")
    seen = f"<visual name='v'><geometry>{BOX}</geometry></visual>"
    assert len(sdf(floor + model(link(seen + collision())))) == 1


def test_included_model_stands_at_pose_of_include(tmp_path, sdf):
    (tmp_path / "models" / "crate").mkdir(parents=True)
    inner = model(link(collision(pose=pose("0 0 0.5 0 0 0"))), pose("9 9 0 0 0 0"), "crate")
    (tmp_path / "models" / "crate" / "model.sdf").write_text(f"<sdf version='1.6'>{inner}</sdf>")
    include = "<include><uri>model://crate</uri><name>a crate</name><pose>1 0 0 0 0 0</pose></include>"
    (body,) = sdf(include)
    assert (body.name, body.pose.x_m, body.pose.y_m) == ("a crate::l::c", 1.0, 0.0)
    assert [file.name for file in files_of_world(tmp_path / "w.sdf")] == ["w.sdf", "model.sdf"]


def test_sun_and_ground_plane_of_gazebo_need_no_file(tmp_path, sdf):
    uris = ("model://sun", "model://ground_plane", "https://fuel.gazebosim.org/1.0/OpenRobotics/models/Ground Plane/")
    bodies = sdf("".join(f"<include><uri>{uri}</uri></include>" for uri in uris) + model(link(collision())))
    assert ([body.name for body in bodies], files_of_world(tmp_path / "w.sdf")) == (["m::l::c"], [tmp_path / "w.sdf"])


def test_saved_state_moves_models_of_world_and_includes(tmp_path, sdf):
    (tmp_path / "crate.sdf").write_text(
        f"<sdf version='1.6'>{model(link(collision()), pose('9 9 0 0 0 0'), 'crate')}</sdf>"
    )
    moved = "".join(
        f"<model name='{name}'>{pose(f'{x} 2 0 0 0 1')}<scale>1 1 1</scale></model>"
        for name, x in (("m", 3), ("crate", 5), ("gone", 7))
    )
    world = model(link(collision()), pose("1 0 0 0 0 0")) + "<include><uri>crate.sdf</uri></include>"
    places = [(body.pose.x_m, body.pose.y_m, body.pose.yaw_rad) for body in sdf(world)]
    assert places == [(1.0, 0.0, 0.0), (9.0, 9.0, 0.0)]
    places = [
        (body.pose.x_m, body.pose.y_m, body.pose.yaw_rad)
        for body in sdf(f"{world}<state world_name='w'>{moved}</state>")
    ]
    assert places == [(3.0, 2.0, 1.0), (5.0, 2.0, 1.0)]


def test_included_file_lies_at_most_one_folder_above_world(tmp_path):
    inner = f"<sdf version='1.6'>{model(link(collision()))}</sdf>"
    for folder in ("outside", "package/worlds", "package/models"):
        (tmp_path / folder).mkdir(parents=True)
        (tmp_path / folder / "crate.sdf").write_text(inner)
    world = tmp_path / "package" / "worlds" / "w.world"
    for uri, is_found in (
        ("model://crate.sdf", True),
        ("../models/crate.sdf", True),
        ("../../outside/crate.sdf", False),
    ):
        world.write_text(f"<sdf version='1.6'><world name='w'><include><uri>{uri}</uri></include></world></sdf>")
        if is_found:
            assert len(read_file(world)) == 1
        else:
            with pytest.raises(WorldError, match="There is no file"):
                read_file(world)


DEEP = "<!DOCTYPE sdf [<!ENTITY a 'aaaaaaaaaa'><!ENTITY b '&a;&a;&a;'>]><sdf version='1.6'>&b;</sdf>"
REFUSED = {
    "entities": (DEEP, "expected XML without a document type"),
    "no end": ("<sdf version='1.6'><world>", "expected XML, got no element found"),
    "no SDF": ("<robot name='r'/>", "expected <sdf>, got <robot>"),
    "no number": (model(link(collision(pose=pose("nan 0 0 0 0 0")))), "m::l::c: pose: expected 6 numbers of 10000"),
    "five numbers": (model(link(collision(pose=pose("0 0 0 0 0")))), "m::l::c: pose: expected 6 numbers"),
    "too far": (model(link(collision(pose=pose("1e9 0 0 0 0 0")))), "m::l::c: pose: expected 6 numbers"),
    "no size": (model(link(collision("<box/>"))), "m::l::c: size: expected 3 numbers"),
    "negative": (model(link(collision("<box><size>1 -1 1</size></box>"))), "size: expected more than 0, got -1"),
    "mesh": (model(link(collision("<mesh><uri>a.dae</uri></mesh>"))), "m::l::c: There is no file 'a.dae'"),
    "unknown shape": (model(link(collision("<heightmap/>"))), "got <heightmap>"),
    "a wall of a plane": (model(link(collision("<plane><normal>1 0 0</normal></plane>"))), "expected a level plane"),
    "another frame": (model(link(collision(pose=pose("0 0 0 0 0 0", "relative_to='x'")))), "relative to 'x'"),
    "crossed": (
        model(link(collision("<polyline><height>1</height>" + "".join(f"<point>{p}</point>" for p in ("0 0", "1 1", "1 0", "0 1")) + "</polyline>"))),
        "that does not cross itself",
    ),
    "scaled": (
        model(link(collision())) + "<state world_name='w'><model name='m'><scale>2 1 1</scale></model></state>",
        "m: expected a scale of 1 1 1 in <state>, got '2 1 1'",
    ),
    "population": ("<population name='p'/>" + model(link(collision())), "models one by one, got a <population>"),
    "nothing there": (model(link("")), "has no body that a robot could meet"),
    "missing include": ("<include><uri>model://gone</uri></include>", "There is no file 'gone'"),
    "from elsewhere": ("<include><uri>https://x.y/z</uri></include>", "expected the uri of a local file"),
    "itself": ("<include><uri>w.sdf</uri></include>", "8 files and models in one another"),
}  # fmt: skip


@each_row("text, message", [*REFUSED.values()])
def test_unusable_world_is_one_sentence(tmp_path, text, message):
    whole = (
        text
        if text.startswith(("<!", "<sdf", "<robot"))
        else f"<sdf version='1.6'><world name='w'>{text}</world></sdf>"
    )
    (tmp_path / "w.sdf").write_text(whole)
    with pytest.raises(WorldError, match=r"w\.sdf") as error:
        read_file(tmp_path / "w.sdf")
    assert message in str(error.value) and "\n" not in str(error.value)


def test_world_of_too_many_bodies_is_refused(monkeypatch, sdf):
    monkeypatch.setattr("vastflow.sim.world.readers.sdf.MOST_BODIES", 5)
    with pytest.raises(WorldError, match="expected 5 bodies at most"):
        sdf(model(link(collision() * 6)))


HOSTILE = [
    ("<model name='m'>" * 100_000 + "</model>" * 100_000, "8 files and models in one another at most"),
    ("<model name='m'/>" * 1_000_000, "has no body that a robot could meet"),
    ("<include><uri>empty.sdf</uri></include>" * 20_000, "10,000 includes and meshes at most"),
]


@each_row("text, message", HOSTILE)
def test_hostile_world_is_one_sentence(tmp_path, text, message):
    (tmp_path / "empty.sdf").write_text("<sdf version='1.6'/>")
    (tmp_path / "w.sdf").write_text(f"<sdf version='1.6'><world name='w'>{text}</world></sdf>")
    with pytest.raises(WorldError, match=r"w\.sdf") as error:
        read_file(tmp_path / "w.sdf")
    assert message in str(error.value) and len(str(error.value)) < 300


@pytest.mark.parametrize("named", ["<include><uri>empty.sdf</uri></include>", "<mesh><uri>empty.sdf</uri></mesh>"])
def test_files_of_hostile_world_are_bounded(tmp_path, named):
    (tmp_path / "empty.sdf").write_text("<sdf version='1.6'/>")
    (tmp_path / "w.sdf").write_text(f"<sdf version='1.6'><collision>{named * 20_000}</collision></sdf>")
    with pytest.raises(WorldError, match=r"w\.sdf: expected 10,000 includes and meshes at most, got more"):
        files_of_world(tmp_path / "w.sdf")


def test_world_of_more_bodies_than_allowed_is_refused(sdf):
    with pytest.raises(WorldError, match=r"100,000 bodies at most"):
        sdf(model(link(collision("<sphere><radius>1</radius></sphere>") * 150_000)))


def test_circles_are_read_with_and_without_names(tmp_path):
    for text in ("x,y,radius\n1,2,0.5\n\n-1,0,0.25\n", "1,2,0.5\n-1,0,0.25\n"):
        (tmp_path / "c.csv").write_text(text)
        bodies = read_file(tmp_path / "c.csv")
        assert [(body.pose.x_m, body.pose.y_m, body.shape) for body in bodies] == [
            (1, 2, Disc(0.5)),
            (-1, 0, Disc(0.25)),
        ]


@each_row(
    "text, message",
    [
        ("1,2\n", "c.csv:1: expected three numbers x, y, radius"),
        ("1,2,0.5\n1,2,nan\n", "c.csv:2: expected a circle within 10000 m"),
        ("1,2,0\n", "of a radius above 0, got '1,2,0'"),
        ("x,y,radius\n", "has no body"),
    ],
)
def test_wrong_circle_is_named_by_its_line(tmp_path, text, message):
    (tmp_path / "c.csv").write_text(text)
    with pytest.raises(WorldError, match=message):
        read_file(tmp_path / "c.csv")


@each_row("reader", [Circles, Sdf])
def test_readers_keep_their_promises(tmp_path, reader):
    (tmp_path / "a.csv").write_text("0,0,1\n")
    (tmp_path / "a.sdf").write_text(f"<sdf version='1.6'>{model(link(collision()))}</sdf>")
    check_world_reader(reader, tmp_path / f"a{reader.suffixes[0]}")


def test_world_of_unknown_kind_names_kinds_there_are(tmp_path):
    with pytest.raises(
        WorldError,
        match=r"no reader of this kind of world\. Expected \.bodies\.json, \.csv, \.sdf, \.world, \.yaml, \.yml",
    ):
        world_content(tmp_path / "hall.dwg")


def test_changed_world_is_told(tmp_path):
    file = tmp_path / "c.csv"
    file.write_text("0,0,1\n")
    content = world_content(file)
    assert read_world(content).bodies
    file.write_text("0,0,2\n")
    read_world.cache_clear()
    with pytest.raises(WorldError, match="changed since the campaign was read"):
        read_world(content)


@each_row(
    "shape, area_m2",
    [
        (Box(1.0, 0.5), 0.5),
        (Disc(0.5), math.pi / 4),
        (Polygon(((0.0, 0.0), (1.0, 0.0), (0.0, 1.0))), 0.5),
        (Box(1.0, 0.01), 0.025),  # a wall thinner than a cell is one cell thick
    ],
)
def test_walls_cover_area_of_body(shape, area_m2):
    walls = walls_of([Body("b", shape, Pose(0.0131, 0.0092, 0.0))], EMPTY)
    assert walls.resolution_m == 0.025
    assert walls.occupied.sum() * 0.025**2 == pytest.approx(area_m2, rel=0.06)


def test_outline_of_turned_body_is_turned_counterclockwise():
    triangle = Polygon(((0.0, 0.0), (1.0, 0.0), (0.0, 0.5)))
    assert corners(Body("b", triangle, Pose(1.0, 2.0, math.pi / 2))) == [(0.5, 2.0), (1.0, 2.0), (1.0, 3.0)]


@each_row("shape", [Disc(0.4), Box(0.8, 0.3), Polygon(((-0.3, -0.3), (0.3, -0.3), (0.3, 0.3), (-0.3, 0.3)))])
def test_walls_stand_where_body_does(shape):
    walls = walls_of([Body("b", shape, Pose(0.6, -0.9, 0.0))], EMPTY)
    rows, columns = np.nonzero(walls.occupied)
    assert (columns.mean() * 0.025 - 1.9875, rows.mean() * 0.025 - 1.9875) == pytest.approx((0.6, -0.9), abs=0.01)


def test_walls_of_turned_map_are_on_its_grid():
    turned = OccupancyMap(EMPTY.cells, 0.05, (-2.0, -2.0), math.pi / 8)
    x_m, y_m = turned.frame.to_map(0.6, -0.9)
    walls = walls_of([Body("b", Disc(0.3), Pose(x_m, y_m, 0.0))], turned)
    upright = walls_of([Body("b", Disc(0.3), Pose(0.6, -0.9, 0.0))], EMPTY)
    assert (walls.occupied ^ upright.occupied).sum() <= 4


def test_turned_thin_wall_has_no_gap():
    walls = walls_of([Body("b", Box(3.0, 0.001), Pose(0.0, 0.0, 0.4))], EMPTY)
    assert ndimage.label(walls.occupied, np.ones((3, 3)))[1] == 1


def test_robot_drives_round_wall_that_only_its_world_has(tmp_path, scenario):
    (tmp_path / "wall.csv").write_text("".join(f"3.0,{y / 10},0.1\n" for y in range(5, 16)))
    given = scenario(goal_pose={"x": 3.8, "y": 1.0}, start_pose={"x": 0.8, "y": 1.0}, controller="rpp")
    world = scenario(
        goal_pose={"x": 3.8, "y": 1.0},
        start_pose={"x": 0.8, "y": 1.0},
        controller="rpp",
        world=world_content(tmp_path / "wall.csv"),
    )
    assert checked_digest(given) != checked_digest(world)
    straight, round_it = (si(run(each, 0).columns["y_mm"]).max() for each in (given, world))
    assert straight < 1.2 and round_it > 1.6


def test_body_off_map_is_no_wall():
    assert not walls_of([Body("b", Disc(0.5), Pose(50.0, 0.0, 0.0))], EMPTY).occupied.any()


@pytest.mark.parametrize("yaw_rad", [0.0, 0.3])
def test_world_ends_at_border_of_map_for_beams_motion_and_clearances(tmp_path, yaw_rad):
    known = write_map(tmp_path, np.zeros((80, 80), np.int8))
    known.write_text(known.read_text().replace("[0.0, 0.0, 0.0]", f"[0.0, 0.0, {yaw_rad}]"))
    grid = load_map(known)
    bodies = [
        Body(name, shape, Pose(*grid.frame.to_map(*at), yaw_rad))
        for name, shape, at in [
            ("beyond", Box(0.5, 3.0), (4.30, 2.0)),
            ("across", Box(1.0, 1.0), (2.0, -0.4)),
            ("disc", Disc(0.3), (0.5, 4.1)),
            ("whole", Disc(0.3), (0.5, 1.0)),
        ]
    ]
    file = tmp_path / "w.bodies.json"
    file.write_bytes(BODIES.dump_json(tuple(bodies), exclude_defaults=True))
    world = world_of({"map_file": map_content(known), "world": world_content(file)})
    assert [body.name for body in world.bodies] == ["across", "disc", "whole"]
    assert world.bodies[2] == bodies[3]
    east = [grid.frame.to_map(3.9, 2.0)]
    assert distances_to(world.bodies, np.array(east))[0] > 1.0
    box, disc, _ = (body.outline.area for body in world.bodies)
    assert box == pytest.approx(0.1, abs=1e-6) and disc < math.pi * 0.09 / 2
    index = prepare(world, Lidar(), NavParameters()).walls
    assert len(index.rectangles) == 3 and index.rectangles[:2].min() > -1e-6 and index.rectangles[:2].max() < 4.0 + 1e-6


def test_maze_of_mrpb_has_walls_of_its_map():
    folder = SHARED / "upstream" / "mrpb"
    if not folder.is_dir():
        pytest.skip(
            "the worlds of MRPB are not beside the repository: https://github.com/NKU-MobFly-Robotics/local-planning-benchmark"
        )
    occupancy = load_map(folder / "maze" / "map.yaml")
    walls = walls_of(read_file(folder / "maze.world"), occupancy)
    fold = round(occupancy.resolution_m / walls.resolution_m)
    rows, columns = occupancy.shape
    world = walls.occupied.reshape(rows, fold, columns, fold).any(axis=(1, 3))
    for a, b in ((occupancy.occupied, world), (world, occupancy.occupied)):
        assert a.any() and not (a & ~ndimage.binary_dilation(b, np.ones((3, 3)))).any()
    alone = read_world(world_content(folder / "maze.world")).walls
    at = np.floor(alone.in_cells(walls.centers_of(np.argwhere(walls.occupied)))).astype(np.int64)
    assert ndimage.binary_dilation(alone.occupied, np.ones((3, 3)))[tuple(at.T)].all()


@each_row("number", ["0", "150", "299"])
def test_cylinders_of_barn_are_walls_of_world_without_map(tmp_path, number):
    folder = SHARED / "upstream" / "barn"
    if not folder.is_dir():
        pytest.skip("the worlds of BARN are not beside the repository: https://www.cs.utexas.edu/~xiao/BARN/BARN.html")
    with gzip.open(folder / "barn-cylinders.csv.gz", "rt") as file:
        posts = [(row["x"], row["y"]) for row in csv.DictReader(file) if row["world"] == number]
    (tmp_path / "barn.csv").write_text("x,y,radius\n" + "".join(f"{x},{y},0.075\n" for x, y in posts))
    world = read_world(world_content(tmp_path / "barn.csv"))
    assert len(world.bodies) == len(posts) > 100 and world.map is None
    assert all(world.walls.occupied[world.walls.cell_of(float(x), float(y))] for x, y in posts)


def test_world_without_map_has_grid_around_its_bodies(tmp_path):
    (tmp_path / "c.csv").write_text("1.01,2.0,0.5\n4.0,2.0,0.5\n")
    content = world_content(tmp_path / "c.csv")
    world = read_world(content)
    assert (world.map, world.digest, world.source, len(world.bodies)) == (None, content.digest, content, 2)
    assert world.bounds_m == pytest.approx((-1.5, -0.5, 6.5, 4.5), abs=0.02)
    assert world.walls.occupied.sum() * 0.025**2 == pytest.approx(2 * math.pi * 0.25, rel=0.02)
    assert world.ground is world.walls and world.walls.occupied[world.walls.cell_of(1.01, 2.0)]
    (tmp_path / "c.csv").write_text("0,0,0.5\n900,900,0.5\n")
    with pytest.raises(WorldError, match=r"c\.csv: expected at most 64,000,000 cells .* got 1,3\d\d,\d{3},\d{3} cells"):
        _ = read_world(world_content(tmp_path / "c.csv")).walls


def test_map_of_another_grid_is_world_of_walls(tmp_path):
    cells = walled_room(2.0, 2.0)
    known = map_content(write_map(tmp_path / "known", cells))
    cells[20, 20:30] = 100
    file = write_map(tmp_path / "real", np.repeat(np.repeat(cells, 2, 0), 2, 1)[4:, :-6])
    file.write_text(file.read_text().replace("0.05", "0.025").replace("[0.0, 0.0,", "[0.0, 0.1,"))
    real = world_content(file)
    world = world_of({"map_file": known, "world": real})
    walls = world.walls
    assert (world.map.digest, walls.shape, walls.origin_xy_m, world.source) == (
        known.digest,
        (80, 80),
        (0.0, 0.0),
        real,
    )
    assert (walls.cells[:4] == UNKNOWN).all() and (walls.cells[:, -6:] == UNKNOWN).all()
    assert np.array_equal(walls.cells[4:, :-6], read_grid(real).cells) and world.ground is world.map
    assert walls.occupied[walls.cell_of(1.01, 1.01)] and not walls.occupied[walls.cell_of(0.99, 1.01)]
    assert len({world.digest, known.digest, real.digest}) == 3
    assert World(world.map, WorldDifference(1, 0.1)).digest not in (world.digest, known.digest)
    assert world_of({"map_file": known, "world": known}).map is world.map
    alone = world_of({"world": real})
    assert alone.map is None and alone.walls is read_grid(real)
