"""The geometry of floor plans: the documented example, and what holds for every plan."""

import itertools
import json
import math

import numpy as np
import pytest
import shapely
from floor_plans import EXAMPLE, ROOM, built
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from table import each_row

from vastflow.producers.floorplan.geometry import (
    Transform,
    outline_fault,
    rectangle,
    signed_area,
    wall_frame,
    wall_outlines,
)
from vastflow.producers.floorplan.rendering import geometry_of


def geometry(text):
    return geometry_of(built(text))


@pytest.fixture(scope="module")
def example():
    return geometry(EXAMPLE)


# The documented example


@each_row(
    ("kind", "name", "corners"),
    [
        ("spaces", "corridor", [(-2, 3), (4, 3), (4, 1), (-2, 1)]),
        ("walls", "corridor-wall-1", [(4.2, 3.2), (4.2, 0.8), (4, 1), (4, 3)]),
        ("spaces", "study", [(4.5, 2.75), (7.5, 2.75), (7.5, 0.75), (4.5, 0.75)]),
        ("walls", "study-wall-3", [(4.2, 0.45), (4.2, 3.05), (4.5, 2.75), (4.5, 0.75)]),
        ("obstacles", "post", [(6.2268, 2.2232), (6.5732, 2.4232), (6.7732, 2.0768), (6.4268, 1.8768)]),
        ("obstacles", "rail", [(5.5, 1.8), (6.5, 1.8), (6.5, 1.7), (5.5, 1.7)]),
        ("openings", "door", [(4, 1.2), (4, 2.1), (4.5, 2.1), (4.5, 1.2)]),
        ("openings", "pane", [(1.5, 3.2), (2.5, 3.2), (2.5, 3), (1.5, 3)]),
    ],
)
def test_documented_example_has_the_documented_corners(example, kind, name, corners):
    found = example[kind][name]
    found = found if kind == "spaces" else found["polygon"]
    assert found == [pytest.approx(corner, abs=5e-5) for corner in corners]


def test_documented_example_is_json_with_the_documented_heights_and_walls(example):
    assert list(example["walls"]) == [f"{space}-wall-{k}" for space in ("corridor", "study") for k in range(4)]
    assert {wall["height"] for wall in example["walls"].values()} == {2.5}
    assert {name: (each["kind"], each["height"]) for name, each in example["obstacles"].items()} == {
        "post": ("column", 2.0),
        "rail": ("divider", 0.5),
    }
    door, pane = example["openings"]["door"], example["openings"]["pane"]
    keys = ("kind", "walls", "bottom", "top")
    assert [door[key] for key in keys] == ["entryway", ["study-wall-3", "corridor-wall-1"], 0.0, 2.0]
    assert [pane[key] for key in keys] == ["window", ["corridor-wall-0"], 1.0, 2.0]
    assert json.loads(json.dumps(example)) == example
    assert not {"-0.0", "4.199999999"} & set(json.dumps(example).replace("]", ",").split(","))


# Placing


@each_row(
    ("location", "first_corner"),
    [
        ("wrt: a of: this translation: x: 5 m", (4, 1)),
        ("wrt: a.walls[1] of: this", (3, 1)),  # one frame is a wall: no half turn, and x points down
        ("wrt: a.walls[1] of: this spaced", (3, 1)),
        ("wrt: world of: this.walls[1] translation: x: 1 m", (0, -2)),
        ("wrt: world of: this.walls[3]", (1, 0)),  # its left wall lies along the x axis of the world
        ("wrt: a.walls[0] of: this.walls[2]", (-1, 3.5)),
        ("wrt: a.walls[0] of: this.walls[2] spaced", (-1, 3.9)),
        ("wrt: a.walls[0] of: this.walls[2] translation: y: 1.0 m", (-1, 4.5)),
        ("wrt: a.walls[0] of: this.walls[2] not aligned", (1, -0.5)),
        ("wrt: a.walls[0] of: this translation: y: 1.0 m rotation: z: 90 deg", (-1, 1.5)),
    ],
)
def test_space_is_placed_by_its_frame_in_the_other_frame(location, first_corner):
    second = "Space b: shape: Rectangle width=2.0 m, length=2.0 m location: " + location
    assert geometry(ROOM + second)["spaces"]["b"][0] == pytest.approx(first_corner)


def test_equally_named_features_in_two_rooms_are_distinct():
    post = " features: Column c: shape: Circle radius=0.1 m height: 1 m location: wrt: this\n"
    names = geometry(ROOM.strip() + post + "\nSpace b" + ROOM.partition("Space a")[2].strip() + post)["obstacles"]
    assert list(names) == ["a.c", "b.c"]


meters = st.floats(-50, 50)
turns = st.floats(-7, 7)
transforms = st.builds(Transform, meters, meters, turns)


@given(transforms, transforms, st.tuples(meters, meters))
def test_transforms_compose_and_undo_each_other(outer, inner, point):
    assert outer.then(inner).apply(point) == pytest.approx(outer.apply(inner.apply(point)), abs=1e-9)
    assert outer.inverse().apply(outer.apply(point)) == pytest.approx(point, abs=1e-9)
    assert outer.then(outer.inverse()) == pytest.approx((0, 0, 0), abs=1e-9)


# Walls


@st.composite
def polygons(draw, convex=False):
    """Clockwise corners round the origin at increasing angles: a simple polygon, concave where the radii say so."""
    count = draw(st.integers(3, 9))
    angles = sorted(draw(st.lists(st.integers(0, 71), min_size=count, max_size=count, unique=True)))
    radii = [4.0] * count if convex else draw(st.lists(st.floats(1.5, 6), min_size=count, max_size=count))
    corners = [
        (r * math.cos(math.radians(5 * a)), r * math.sin(math.radians(5 * a)))
        for a, r in zip(angles, radii, strict=True)
    ]
    outline = tuple(reversed(corners))
    assume(outline_fault(outline) is None and signed_area(outline) < -0.5)
    return outline


def turns_deg(outline):
    """The angle at each corner, the smaller one."""
    corners = np.array(outline)
    (x0, y0), (x2, y2) = (np.roll(corners, by, axis=0).T - corners.T for by in (1, -1))
    return np.degrees(np.abs(np.arctan2(x0 * y2 - y0 * x2, x0 * x2 + y0 * y2)))


@given(polygons(convex=True), st.floats(0.05, 0.5))
def test_walls_round_a_convex_room_fill_its_mitred_offset(outline, thickness):
    assume(turns_deg(outline).min() > 10)
    floor = shapely.Polygon(outline)
    walls = shapely.union_all([shapely.Polygon(wall) for wall in wall_outlines(outline, thickness)])
    whole = floor.buffer(thickness, join_style="mitre", mitre_limit=100)
    assert walls.area == pytest.approx(whole.area - floor.area, rel=1e-6)
    assert walls.symmetric_difference(whole.difference(floor)).area < 1e-6


@given(polygons(), st.floats(0.05, 0.4))
@settings(max_examples=60)
def test_walls_leave_no_gap_round_a_room(outline, thickness):
    """Beside a notch of shorter walls a sliver of up to a hundred square centimeters can stay open.

    Long enough is a wall that is two thicknesses longer than what the mitres at its ends take of it.
    """
    assume(turns_deg(outline).min() > 5)
    taken = thickness / np.tan(np.radians(turns_deg(outline)) / 2)  # of a wall, by the mitre at each corner
    lengths = shapely.length(shapely.linestrings(list(itertools.pairwise((*outline, outline[0])))))
    assume((lengths - taken - np.roll(taken, -1)).min() > 2 * thickness)
    floor = shapely.Polygon(outline)
    walls = shapely.union_all([shapely.Polygon(wall) for wall in wall_outlines(outline, thickness)])
    ring = floor.buffer(0.98 * thickness).difference(floor)
    assert ring.difference(walls).area < 1e-6


@given(polygons(), st.floats(0.01, 2.0))
def test_walls_are_simple_polygons_along_the_floor(outline, thickness):
    assume(turns_deg(outline).min() > 1.5)
    for k, wall in enumerate(wall_outlines(outline, thickness)):
        assert shapely.Polygon(wall).is_valid
        assert wall[3] == outline[k]
        assert wall[2] == outline[(k + 1) % len(outline)]
        frame = wall_frame(outline, k)
        assert [frame.inverse().apply(corner)[1] for corner in wall[:2]] == pytest.approx([thickness] * 2, abs=1e-6)


def test_walls_in_one_line_meet_without_a_mitre():
    walls = wall_outlines(((-2, 1), (0, 1), (2, 1), (2, -1), (-2, -1)), 0.2)
    assert walls[0][1] == walls[1][0] == (0.0, 1.2)


def test_walls_of_a_counter_clockwise_room_eat_into_it():
    (wall, *_) = wall_outlines(tuple(reversed(rectangle(4, 3))), 0.2)
    assert shapely.Polygon(rectangle(4, 3)).contains(shapely.Polygon(wall).centroid)


def test_wall_ends_square_where_its_mitres_would_cross():
    notch = ((-3, 2), (-0.05, 2), (-0.05, 1), (0.05, 1), (0.05, 2), (3, 2), (3, -2), (-3, -2))
    bottom = wall_outlines(notch, 0.3)[2]
    assert bottom == (pytest.approx((-0.05, 1.3)), pytest.approx((0.05, 1.3)), (0.05, 1), (-0.05, 1))


@given(
    st.sampled_from(range(4)), st.sampled_from(range(4)), st.floats(-3, 3), turns,
    st.floats(0.05, 0.6), st.floats(0.05, 0.6),
)  # fmt: skip
def test_rooms_placed_wall_to_wall_and_spaced_have_touching_outer_faces(theirs, own, shift, turn, thick, thin):
    text = ROOM.strip() + f" rotation: z: {turn!r} walls: thickness: {thick!r} m\n"
    text += (
        f"Space b: shape: Rectangle width=2.5 m, length=1.5 m location: wrt: a.walls[{theirs}] of: this.walls[{own}]"
    )
    plan = built(text + f" translation: x: {shift!r} m spaced walls: thickness: {thin!r} m")
    walls = {wall.name: wall for wall in plan.walls}
    faced, placed = walls[f"a-wall-{theirs}"], walls[f"b-wall-{own}"]
    x_m, y_m, yaw_rad = faced.frame.inverse().then(placed.frame)
    assert (x_m, y_m) == pytest.approx((shift, thick + thin), abs=1e-9)
    assert math.cos(yaw_rad) == pytest.approx(-1.0)
    solid = [shapely.union_all([shapely.Polygon(w.outline) for w in plan.walls if w.name[0] == name]) for name in "ab"]
    assert shapely.intersection(*solid).area < 1e-6


# Openings


def hole(shape, location="translation: z: 1.0 m"):
    return built(f"{ROOM}Entryway d: shape: {shape} location: in: a.walls[0] {location}").holes[0]


def test_rectangle_is_open_over_its_width_from_its_bottom_to_its_top():
    door = hole("Rectangle width=1.0 m, height=2.0 m", "translation: x: 0.5 m, z: 1.2 m")
    assert [door.section(z) for z in (0.1, 0.2, 1.0, 2.2, 2.3)] == [(), ((0, 1),), ((0, 1),), ((0, 1),), ()]
    sunk = hole("Rectangle width=1.0 m, height=2.0 m", "translation: z: 0.0 m")
    assert (sunk.bottom_m, sunk.top_m) == (-1.0, 1.0)


def test_opening_turned_about_y_is_open_where_its_turned_shape_is():
    door = hole("Rectangle width=2.0 m, height=1.0 m", "translation: z: 1.0 m rotation: y: 90 deg")
    assert (door.bottom_m, door.top_m) == pytest.approx((0.0, 2.0))
    assert door.section(0.5)[0] == pytest.approx((-0.5, 0.5))
    corner = hole("Polygon points:[(0, 0), (0.2, 0), (0, 1)]", "translation: z: 1.0 m rotation: y: 90 deg")
    assert max(x for x, _ in corner.shape) == pytest.approx(1.0)  # z turns towards x


def test_circle_and_polygon_are_open_as_wide_as_at_that_height():
    round_one = hole("Circle radius=1.0 m")
    assert round_one.section(1.0)[0] == pytest.approx((-1, 1))
    assert round_one.section(1.6)[0] == pytest.approx((-0.8, 0.8), abs=0.01)
    twin_towers = hole(
        "Polygon points:[(-1, 0), (1, 0), (1, 2), (0.5, 2), (0.5, 0.5), (-0.5, 0.5), (-0.5, 2), (-1, 2)]", ""
    )
    assert twin_towers.section(1.0) == ((-1, -0.5), (0.5, 1))
