"""Maps, read as Nav2's map_server reads them."""

import io
import math
import struct
import zlib
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from PIL import Image
from table import each_row

from vastflow.sim.world.map_file import free_unknown_cells, load_map
from vastflow.sim.world.readers.reader import WorldError
from vastflow.sim.world.world import map_content

HEADER = {
    "image": "map.pgm",
    "resolution": 0.05,
    "origin": "[-1.0, -2.0, 0.0]",
    "negate": 0,
    "occupied_thresh": 0.65,
    "free_thresh": 0.196,
}


@pytest.fixture
def write(tmp_path: Path):
    """Write a YAML file with `changes` (None leaves a key out) beside `map.pgm` of the given gray values."""

    def write(gray=((254, 0), (205, 254)), **changes):
        if gray is not None:
            Image.fromarray(np.array(gray, dtype=np.uint8)).save(tmp_path / "map.pgm")
        header = {key: value for key, value in {**HEADER, **changes}.items() if value is not None}
        (tmp_path / "map.yaml").write_text("".join(f"{key}: {value}\n" for key, value in header.items()))
        return tmp_path / "map.yaml"

    return write


def cells(path):
    return load_map(path).cells.tolist()


def test_map_origin_is_corner_of_first_cell(write):
    occupancy = load_map(write(resolution="5e-2", origin="[-1e0, -2]"))
    assert occupancy.origin_xy_m == (-1.0, -2.0)
    assert occupancy.cell_of(-1.0 + 1e-9, -2.0 + 1e-9) == (0, 0)
    assert occupancy.cell_of(-0.96, -1.94) == (1, 0)
    assert occupancy.cell_of(-1.01, -2.01) == (-1, -1)
    assert occupancy.center_of(1, 0) == pytest.approx((-0.975, -1.925))


def test_thresholds_default_to_those_of_map_server(write):
    assert cells(write([[205, 89, 90]], free_thresh=None, occupied_thresh=None)) == [[0, 100, -1]]


@each_row(
    ("changes", "expected"),
    [
        ({"free_thresh": 0.25}, 2),
        ({"free_thresh": 0.25, "mode": "scale"}, 2),
        ({}, 0),  # 0.196, below 1 - 205 / 255
        ({"free_thresh": 0.25, "mode": "raw"}, 0),
        ({"free_thresh": 0.25, "negate": 1}, 0),  # a wall
    ],
)
def test_free_unknown_cells_are_those_of_their_gray(write, changes, expected):
    assert free_unknown_cells(write([[0, 205, 254], [205, 204, 254]], **changes)) == expected


def by_map_server(gray, mode, negate, free_thresh, occupied_thresh):
    """A cell by the formula of Nav2's map_io, in single precision as there; one pixel at a time."""
    if mode == "raw":
        return gray if gray <= 100 else -1
    one, shade = np.float32(1.0), np.float32(gray) / np.float32(255.0)
    p = shade if negate else one - shade
    low, high = np.float32(free_thresh), np.float32(occupied_thresh)
    if p <= low:
        return 0
    if p >= high:
        return 100
    if mode == "trinary":
        return -1
    percent = (p - low) / np.float32(occupied_thresh - free_thresh) * np.float32(100.0)
    return math.floor(percent) + (1 if float(percent) - math.floor(percent) >= 0.5 else 0)


@given(
    free=st.integers(0, 98),
    span=st.integers(1, 99),
    negate=st.sampled_from([0, 1, "false", "true"]),
    mode=st.sampled_from(["trinary", "Trinary", "scale", "SCALE", "raw", "rAw"]),
)
@example(25, 40, 0, "scale")  # 37.5 % at gray 153, which is rounded up
@example(10, 80, 0, "SCALE")
@example(10, 80, "true", "rAw")
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_gray_values_are_read_by_the_formula_of_map_server(write, free, span, negate, mode):
    thresholds = {"free_thresh": free / 100, "occupied_thresh": min(free + span, 99) / 100}
    path, negated = write([list(range(256))], mode=mode, negate=negate, **thresholds), negate in (1, "true")
    assert cells(path) == [[by_map_server(gray, mode.lower(), negated, **thresholds) for gray in range(256)]]


def test_cell_between_the_thresholds_is_neither_wall_nor_free(write):
    occupancy = load_map(write([[150]], mode="scale"))
    assert 0 < occupancy.cells[0, 0] < 100
    assert not occupancy.occupied.any()
    assert not occupancy.free.any()


def encoded(pixels, dtype=np.uint8, mode=None, form="png", palette=False):
    found, picture = io.BytesIO(), Image.fromarray(np.array(pixels, dtype=dtype), mode)
    (picture.convert("P") if palette else picture).save(found, {"pgm": "ppm"}.get(form, form))
    return found.getvalue()


def bmp_32(alphas, height=1, masks=b""):
    """A white picture of one column, with alphas from its bottom, or from its top if `height` is -1."""
    pixels = b"".join(bytes([254, 254, 254, alpha]) for alpha in alphas)
    head = struct.pack("<IiiHHIIiiII", 40, 1, height * len(alphas), 1, 32, 3 if masks else 0, len(pixels), 0, 0, 0, 0)
    return b"BM" + struct.pack("<IHHI", 54 + len(masks + pixels), 0, 0, 54 + len(masks)) + head + masks + pixels


def bmp_16(levels):
    """A row of grays of 5 bits."""
    pixels = np.array([level * 0b10000100001 for level in levels], "<u2").tobytes()
    head = struct.pack("<IiiHHIIiiII", 40, len(levels), 1, 1, 16, 0, len(pixels), 0, 0, 0, 0)
    return b"BM" + struct.pack("<IHHI", 54 + len(pixels), 0, 0, 54) + head + pixels


def png(depth, kind, row, key):
    """A row of pixels, of which those of the key's color are transparent."""

    def chunk(name, content):
        return struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))

    head = struct.pack(">IIBBBBB", len(row) * 8 // depth // (3 if kind == 2 else 1), 1, depth, kind, 0, 0, 0)
    chunks = ((b"IHDR", head), (b"tRNS", struct.pack(f">{len(key)}H", *key)), (b"IDAT", zlib.compress(b"\0" + row)))
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunk(*each) for each in (*chunks, (b"IEND", b"")))


def dark_pgm(kind, white, *levels):
    """A picture of a row of levels, and of a second one as long as it has shades."""
    row = [*levels, *[white] * (white - len(levels))]
    size = f"{kind}\n{white} 2\n{white}\n".encode()
    text = " ".join(map(str, [*row, *row, "\n"])).encode()
    return size + (text if kind == "P2" else np.array(row * 2, ">u2" if white > 255 else "u1").tobytes())


MASKS = struct.pack("<III", 0xFF0000, 0xFF00, 0xFF)
GRAYS = [[0, 205, 254]]
OPAQUE = [[[0, 0, 0, 255], [0, 0, 0, 254], [255, 255, 255, 255], [255, 255, 255, 0]]]
PGM_16 = b"P5\n3 1\n65535\n" + (np.array(GRAYS) * 257).astype(">u2").tobytes()


@each_row(
    ("content", "changes", "expected"),
    [
        *((encoded(GRAYS, form=form), {}, [[100, -1, 0]]) for form in ("png", "bmp", "pgm")),
        (encoded(OPAQUE, mode="RGBA"), {"mode": "scale"}, [[100, -1, 0, -1]]),
        (encoded([[[50, 50, 50, 255], [50, 50, 50, 0]]], mode="RGBA"), {"mode": "raw"}, [[50, 50]]),
        (encoded([[[0, 255], [254, 255], [0, 7]]], mode="LA"), {}, [[100, 0, -1]]),
        (encoded(np.array(GRAYS) * 257, np.uint16), {}, [[100, -1, 0]]),
        (PGM_16, {}, [[100, -1, 0]]),
        (encoded([[[0, 0, 255], [255, 255, 0]]], mode="RGB"), {}, [[100, 0]]),
        (encoded([[False, True]], np.bool_), {}, [[100, 0]]),
        (encoded(GRAYS, palette=True), {}, [[100, -1, 0]]),
        (b"P5 # a comment\n2 # wide\n2 # high\n255\n\xfe\0\xcd\xfe", {}, [[-1, 0], [0, 100]]),
        (b"P5 2 2 255 \xfe\0\xcd\xfe", {}, [[-1, 0], [0, 100]]),
        (b"P2\n# text\n2 1\n255\n0 254\n", {}, [[100, 0]]),
        # White is 100: 80 is cut to 203 of 255, and shades of a binary file are brightened twice if there are as many pixels.
        (dark_pgm("P2", 100, 30, 80, 81), {"free_thresh": 0.202}, [[100, -1, 0, *[0] * 97]] * 2),
        (b"P5\n3 1\n100\n\x32\x1d\x51", {}, [[-1, 100, 0]]),
        (dark_pgm("P5", 100, 50, 29, 13), {}, [[0, -1, 100, *[0] * 97]] * 2),
        (dark_pgm("P5", 100, 2, 3), {"mode": "raw"}, [[12, 19, *[-1] * 98]] * 2),
        (dark_pgm("P5", 15, 1, 2, 4), {"mode": "raw"}, [[*[-1] * 15]] * 2),
        (dark_pgm("P5", 1000, 1, 5, 7), {}, [[100, 100, -1, *[0] * 997]] * 2),
        (dark_pgm("P2", 1000, 1, 5, 500), {}, [[100, 100, -1, *[0] * 997]] * 2),
        # A binary picture whose white is 1 has packed bits, of which 0 is white.
        (b"P5 8 2 1 \xa5\x0f" + bytes(14), {}, [[0] * 4 + [100] * 4, [100, 0, 100, 0, 0, 100, 0, 100]]),
        (b"P5\n#" + b"x" * 6000 + b"\n3 1\n255\n\0\xcd\xfe", {}, [[100, -1, 0]]),
        (b"P6 2 1 1000 " + np.array([98, 98, 99, 396, 396, 396], ">u2").tobytes(), {"mode": "raw"}, [[25, 100]]),
        (b"P3 2 1 1000 98 98 99 # gray\n396 396 396 ", {"mode": "raw"}, [[25, 100]]),
        (bmp_16([0, 12, 20, 31, 0, 12]), {"mode": "raw"}, [[0, 95, -1, -1, 0, 95]]),
        (bmp_16([0, 12, 20, 31, 0, 25]), {}, [[100, -1, -1, 0, 100, -1]]),
        *((encoded(GRAYS, form=form), {}, [[100, -1, 0]]) for form in ("gif", "tiff")),
        (encoded(np.array(GRAYS) * 257, np.uint16, form="tiff"), {}, [[100, -1, 0]]),
        (encoded(OPAQUE, mode="RGBA", form="tiff"), {}, [[100, -1, 0, -1]]),
        (encoded([[205] * 8] * 2, form="jpeg"), {}, [[-1] * 8] * 2),
        (png(2, 0, b"\x1b", [3]), {}, [[100, 100, -1, -1]]),
        (png(4, 0, b"\x0f\xf0", [15]), {}, [[100, -1, -1, 100]]),
        (png(8, 0, b"\0\xcd\xfe", [0]), {}, [[-1, -1, 0]]),
        (png(16, 0, b"\0\0\x20\0\xff\xff", [0x2000]), {}, [[100, -1, 0]]),
        (png(8, 2, b"\0\0\0\xff\xff\xff", [255, 255, 255]), {}, [[100, 0]]),  # a key but black is nobody's
        (png(8, 2, b"\0\0\0\xff\xff\xff", [0, 0, 0]), {}, [[-1, 0]]),
        (bmp_32([255, 254, 0, 255]), {}, [[0], [-1], [-1], [0]]),
        (bmp_32([255, 0, 0]), {}, [[0], [-1], [-1]]),
        (bmp_32([255, 0, 0], height=-1), {}, [[-1], [-1], [0]]),
        (bmp_32([0, 0], masks=MASKS), {}, [[0], [0]]),
    ],
)
def test_map_image_is_read_in_any_format_and_depth(write, tmp_path, content, changes, expected):
    (tmp_path / "floor").write_bytes(content)
    assert cells(write(None, image=tmp_path / "floor", **changes)) == expected  # by an absolute path


def luma(red, green, blue):
    """Gray as GraphicsMagick has it: Rec. 601 at 16 bits a channel, of which the upper 8 are kept."""
    return int(Fraction(257 * (299 * red + 587 * green + 114 * blue), 1000) + Fraction(1, 2)) // 257


@given(st.lists(st.tuples(*[st.integers(0, 255)] * 3), min_size=1, max_size=50))
@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_map_color_is_read_as_luma(write, tmp_path, colors):
    Image.fromarray(np.array([colors], dtype=np.uint8), "RGB").save(tmp_path / "map.png")
    grays = [luma(*color) for color in colors]
    assert cells(write(None, image="map.png", mode="raw")) == [[gray if gray <= 100 else -1 for gray in grays]]


def test_luma_is_that_of_graphicsmagick():
    """Values that `gm convert -type Grayscale` (1.3.40, 16 bits) gives."""
    colors = [(255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 0), (1, 2, 3), (99, 99, 98), (40, 90, 200)]
    assert [luma(*color) for color in colors] == [76, 149, 29, 225, 1, 98, 87]


FRAME = r"origin: expected \[x, y, yaw\] in meters and radians, got "


@each_row(
    ("changes", "message"),
    [
        *(({key: None}, f"and origin, got no '{key}'") for key in ("image", "resolution", "origin")),
        *(
            ({"resolution": value}, "resolution: expected a number, got ")
            for value in ("1" + "0" * 400, "fine", ".inf")
        ),
        *(({"resolution": value}, r"greater than 0: 0\.0001 to 100, got ") for value in (1e-300, 1e300, -0.05)),
        *(({"origin": value}, FRAME) for value in (f"[{'9' * 400}, 0]", "[0, 0, 0, 0]", "[0]", "[0, .nan, 0]", "here")),
        ({"origin": "[1.0e+300, 0]"}, r"origin: expected at most 10,000,000 m from zero, got \["),
        ({"origin": "[0, 0, 90]"}, r"origin: expected radians, one turn \(6.2832\) at most, got yaw 90"),
        ({"image": "none.pgm"}, "image: There is no file '.*none.pgm'. Its path is relative to the YAML file"),
        (
            {"image": "map.yaml"},
            "map.yaml': expected a picture in PGM, PNG, BMP, GIF, JPEG, or TIFF, got another format",
        ),
        ({"free_thresh": "true"}, "free_thresh: expected a number, got True"),
        ({"occupied_thresh": 65}, "occupied_thresh: expected a share of black, 0 to 1, got 65"),
        ({"free_thresh": -0.2}, r"free_thresh: expected a share of black, 0 to 1, got -0\.2"),
        ({"negate": "0\nresolution: 0.1"}, "resolution: expected one value, got 2"),
        ({"negate": 2}, "negate: expected 0 or 1, got 2"),
        ({"mode": "binary"}, "mode: expected trinary, scale or raw, got 'binary'"),
        ({"gray": None, "image": "cut.pgm"}, r"cut\.pgm': The picture is damaged: .*truncated"),
        (None, r"map\.yaml: No such file\. Expected a map_server YAML file"),
        ("a: [", "Not YAML"),
        ("- 1\n", "expected a mapping with image, resolution and origin, got list"),
    ],
)
def test_invalid_map_is_refused_with_expectation(write, changes, message):
    path = write(**(changes if isinstance(changes, dict) else {}))
    if isinstance(changes, str):
        path.write_text(changes)
    elif changes is None:
        path.unlink()
    (path.parent / "cut.pgm").write_bytes(b"P5\n20 20\n255\n" + bytes(7))
    with pytest.raises(WorldError, match=message) as caught:
        load_map(path)
    assert str(caught.value).startswith(f"{path}:")


def test_digest_is_of_the_grid_and_not_of_the_files(write, tmp_path):
    assert load_map(write()).digest == "e13fb87f6a8a8d8ef06d30c38294b2189289ec7cb0ff8690228e606f069c8594"
    first = map_content(write())
    Image.fromarray(np.array([[255, 1], [205, 254]], dtype=np.uint8)).save(tmp_path / "other.png")
    assert map_content(write(None, image="other.png", laser_height=0.7)) == first


def test_map_digest_depends_on_grid_and_frame(write):
    grids = ({"gray": [[254, 0], [254, 254]]}, {"gray": [[254, 0, 205, 254]]})
    frames = ({"resolution": 0.1}, {"origin": "[-1.0, -2.5]"}, {"origin": "[-1.0, -2.0, 0.1]"})
    assert len({map_content(write(**changes)) for changes in ({}, *grids, *frames)}) == 6


TALL = [[0, 254], [205, 0], [254, 254]]
"""3 rows of 2 cells, no two turns of it alike."""


def test_map_yaw_rotates_grid_about_origin(write):
    occupancy = load_map(write(TALL, origin="[1.0, 2.0, 0.3]"))
    assert occupancy.origin_xy_m == (1.0, 2.0)
    c, s = math.cos(0.3), math.sin(0.3)
    for row, column in ((0, 0), (2, 1), (-4, 7)):
        x, y = (column + 0.5) * 0.05, (row + 0.5) * 0.05
        center = occupancy.center_of(row, column)
        assert center == pytest.approx((1.0 + c * x - s * y, 2.0 + s * x + c * y), abs=1e-12)
        assert occupancy.cell_of(*center) == (row, column)


@each_row(
    ("yaw", "turned", "corner"),
    [
        (1.5708, np.rot90(TALL), (-0.15, 0.0)),
        (-3.1416, np.rot90(TALL, 2), (-0.1, -0.15)),
        (3 * math.pi / 2, np.rot90(TALL, 3), (0.0, -0.1)),
        (-math.pi / 2, np.rot90(TALL, 3), (0.0, -0.1)),
        (2 * math.pi, TALL, (0.0, 0.0)),
    ],
)
def test_map_turned_by_a_quarter_is_the_map_drawn_turned(write, yaw, turned, corner):
    found = load_map(write(TALL, origin=f"[1.0, -2.0, {yaw!r}]"))
    drawn = load_map(write(turned, origin=f"[{round(1.0 + corner[0], 6)}, {round(corner[1] - 2.0, 6)}, 0]"))
    assert found.yaw_rad == 0.0
    assert found.digest == drawn.digest


@given(st.floats(-6.28, 6.28), st.integers(0, 2), st.integers(0, 1))
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_places_turn_with_the_picture(write, yaw, row, column):
    plain = load_map(write(TALL, origin="[0.5, -1.5, 0]"))
    turned = load_map(write(None, origin=f"[0.5, -1.5, {yaw!r}]"))
    x, y = (column + 0.5) * 0.05, (row + 0.5) * 0.05
    c, s = math.cos(yaw), math.sin(yaw)
    place = 0.5 + c * x - s * y, -1.5 + s * x + c * y
    assert turned.cells[turned.cell_of(*place)] == plain.cells[row, column]
    assert abs(turned.yaw_rad) <= math.pi / 4 + 1e-12


def test_places_at_once_equal_places_one_by_one(write):
    occupancy = load_map(write(TALL, origin="[1.0, 2.0, -0.4]"))
    some = np.array([(0, 0), (2, 1), (-3, 5)])
    assert [tuple(center) for center in occupancy.centers_of(some)] == [occupancy.center_of(*cell) for cell in some]
    places = occupancy.centers_of(some)
    assert np.floor(occupancy.in_cells(places)).astype(int).tolist() == some.tolist()
