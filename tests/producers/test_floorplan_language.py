"""The text of the FloorPlan DSL: accepted files, and the faults of others."""

import re

import pytest
from floor_plans import DOOR, EXAMPLE, ROOM, built
from table import each_row

from vastflow.producers.floorplan.files import read_plan_file
from vastflow.producers.floorplan.rendering import picture_of
from vastflow.sim.model.faults import FileError

SECOND = "Space b: shape: Rectangle width=2.0 m, length=2.0 m location: {location}\n"
POST = "Column c: shape: Rectangle width=0.4 m, length=0.4 m height: 2.0 m location: {location}\n"


def room(text, name="a"):
    (found,) = [each for each in built(text).rooms if each.name == name]
    return found.outline


def complaints(text):
    with pytest.raises(FileError) as caught:
        built(text)
    return str(caught.value).splitlines()


def changed(old, new, text=ROOM):
    assert text.count(old) >= 1
    return text.replace(old, new, 1)


# Accepted


@each_row(
    "text",
    [
        " ".join(line.partition("//")[0] for line in EXAMPLE.splitlines()),
        re.sub(r"\s*:\s*", ":", ROOM),
        re.sub(r"\s*:\s*", "  :\n ", ROOM),
        ROOM.replace("4.0 m", "4e0").replace("3.0 m", "+3."),
        ROOM.replace("\n", "\r\n"),
        changed("wrt: world of: this", "of: this wrt: world"),
        changed("of: this", "of: this translation: rotation:"),
        changed("of: this", "of: this rotation: z: 30 deg translation: y: 1.0 m, x: 2.0 m"),
        ROOM + "// and nothing more",
    ],
)
def test_language_model_is_accepted_in_any_layout(text):
    assert built(text).rooms


def test_parts_may_be_in_any_order():
    head, defaults, space = ROOM.splitlines(keepends=True)
    second = SECOND.format(location="wrt: a of: this translation: x: 9.0 m")
    text = head + DOOR.replace("1.0 m,", "wide,") + second + space + "var wide = 1.2 m\n" + defaults
    assert built(text).holes[0].section(1.0) == ((-0.6, 0.6),)
    assert room(text, "b")[0][0] == 8


@each_row("name", ["Space", "from", "world"])
def test_space_may_have_the_name_of_a_keyword_or_of_the_world(name):
    text = ROOM.replace("Space a", f"Space {name}").replace("of: this", "of: this translation: x: 5.0 m")
    assert room(text, name)[0] == (3, 1.5)


def test_floor_plan_variable_is_length_or_angle():
    text = changed("width=4.0 m", "width=w").replace("0.2 m", "t") + "var w = 5 m var t = 0.1 m var turn = 90 deg"
    text = text.replace("of: this", "of: this translation: x: -w rotation: z: -turn")
    assert room(text)[0] == (-3.5, 2.5)


def test_angle_without_a_unit_is_in_radians_and_a_length_in_meters():
    assert room(changed("of: this", "of: this translation: x: 1 rotation: z: 3.141592653589793"))[0] == (3, -1.5)


def test_space_overrides_wall_defaults():
    head, _, space = ROOM.splitlines(keepends=True)
    for text, values in (
        (ROOM.rstrip() + " walls: height: 4.0 m", (0.2, 4.0)),
        (head + space + "walls: thickness: 0.1 m height: 2.0 m", (0.1, 2.0)),
    ):
        assert {(wall.thickness_m, wall.height_m) for wall in built(text).walls} == {values}


def test_polygons_last_point_may_repeat_the_first():
    text = changed("Rectangle width=4.0 m, length=3.0 m", "Polygon points:[(0,0), (0,2), (2,0), (0.0 m, 0.0 m)]")
    assert room(text) == ((0, 0), (0, 2), (2, 0))


def test_circular_space_and_a_circular_column_are_polygons_on_their_circle():
    plan = built(changed("Rectangle width=4.0 m, length=3.0 m", "Circle radius=2.0 m") + POST.format(
        location="wrt: a").replace("Rectangle width=0.4 m, length=0.4 m", "Circle radius=0.3 m"))  # fmt: skip
    assert len(plan.walls) == len(plan.rooms[0].outline) == len(plan.obstacles[0].outline) >= 32
    assert plan.rooms[0].outline[0] == (0, 2)


def test_feature_location_ignores_order_of_parts():
    plan = built(ROOM + POST.format(location="rotation: z: 0 deg translation: x: 1.0 m wrt: a.walls[1]"))
    assert plan.obstacles[0].outline[2] == pytest.approx((1.8, -1.2))
    (post,) = built(ROOM + POST.format(location="wrt: a translation: x: 1.0 m")).obstacles
    assert (post.name, post.kind, post.outline[0]) == ("c", "Column", (0.8, 0.2))


# Refused, each with one message


def test_faults_of_a_floor_plan_have_place_and_message(golden):
    golden("floor_plans", "plan", complaints)


def test_notes_on_a_floor_plan_have_place_and_message(golden):
    golden("floor_plans", "notes", lambda text: list(map(str, built(text).notes)))


@each_row(
    "location",
    [
        "translation: x: 0.5 m, y: 0.0 m, z: 1.0 m rotation: y: 0.0 deg",
        "translation: y: 0, z: 1.0 m, x: 0.5 m rotation: x: 0.0 deg, y: 0, z: 0 rad",
        "translation: x: 0.5 m, y: -none, z: 1.0 m",
    ],
)
def test_opening_accepts_zero_on_other_axes(location):
    plain = built(ROOM + DOOR.replace("z: 1.0 m", "x: 0.5 m, z: 1.0 m"))
    said = built(ROOM + DOOR.replace("translation: z: 1.0 m", location) + "var none = 0.0 m")
    assert said.holes == plain.holes
    assert said.notes == ()


def test_space_and_feature_accept_zero_on_other_axes():
    moved = "translation: x: 1.0 m, y: 2.0 m, z: 0.0 m rotation: x: 0.0 deg, y: 0.0 deg, z: 30.0 deg"
    text = changed("of: this", f"of: this {moved}") + POST.format(location=f"wrt: a {moved}")
    said = built(text)
    plain = built(text.replace(", z: 0.0 m", "").replace("x: 0.0 deg, y: 0.0 deg, ", ""))
    assert (said.walls, said.obstacles) == (plain.walls, plain.obstacles)


def test_door_as_wide_as_wall_is_allowed():
    plan = built(ROOM + DOOR.replace("1.0 m,", "4.0 m,"))
    assert plan.holes[0].section(1.0) == ((-2.0, 2.0),)
    assert plan.notes == ()


@each_row(
    ("old", "new", "sections"),
    [
        ("1.0 m,", "4.5 m,", [(-2.0, 2.0)]),
        ("z: 1.0", "x: 1.6 m, z: 1.0", [(1.1, 2.0)]),
        ("z: 1.0", "x: -1.9 m, z: 1.0", [(-2.0, -1.4)]),
        ("z: 1.0", "z: 1.6", [(-0.5, 0.5)]),
        ("z: 1.0", "x: 9.0 m, z: 1.0", []),
        ("z: 1.0", "z: 3.6", []),
        ("z: 1.0", "z: -1.0", []),
    ],
)
def test_opening_is_cut_to_its_wall(old, new, sections):
    found = [hole.section(1.0)[0] for hole in built(ROOM + DOOR.replace(old, new)).holes]
    assert found == [pytest.approx(each) for each in sections]


def test_long_chain_of_spaces_is_placed_in_any_order():
    size = "shape: Rectangle width=1 m, length=2 m"
    spaces = [f"Space s{k}: {size} location: wrt: s{k + 1} of: this translation: x: 1 m\n" for k in range(999)]
    assert room(ROOM.replace("Space a", "Space s999") + "".join(spaces), "s0")[0] == (998.5, 1)


def test_missing_or_binary_file_is_a_fault_with_place(tmp_path):
    with pytest.raises(FileError, match=r"none.fpm:1:1: No such file\. Expected a floor plan"):
        read_plan_file(tmp_path / "none.fpm")
    (tmp_path / "binary.fpm").write_bytes(b"Floor plan: p\nSpace \xff")
    with pytest.raises(FileError, match=r"binary.fpm:2:7: Byte 0xff is not UTF-8\."):
        read_plan_file(tmp_path / "binary.fpm")
    with pytest.raises(FileError, match="It is a folder"):
        read_plan_file(tmp_path)


def test_picture_shows_two_rooms_in_one_place():
    plan = built(ROOM + ROOM.partition("\n")[2].partition("\n")[2].replace("Space a", "Space b"))
    assert picture_of(plan).startswith(b"\x89PNG")
