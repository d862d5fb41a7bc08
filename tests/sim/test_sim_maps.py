"""Maps, read as Nav2's map_server reads them."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image

from vastflow.sim.maps import MapError, OccupancyMap, load_map, map_content

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
    """Write a YAML file with `changes` (None leaves a key out) beside `map.pgm` of the given grey values."""

    def write(grey=((254, 0), (205, 254)), **changes):
        if grey is not None:
            Image.fromarray(np.array(grey, dtype=np.uint8)).save(tmp_path / "map.pgm")
        header = {key: value for key, value in {**HEADER, **changes}.items() if value is not None}
        (tmp_path / "map.yaml").write_text("".join(f"{key}: {value}\n" for key, value in header.items()))
        return tmp_path / "map.yaml"

    return write


def cells(path):
    return load_map(path).cells.tolist()


def test_the_last_row_of_the_picture_is_the_lowest_row_of_the_grid(write):
    assert cells(write([[254, 254], [0, 205]])) == [[100, -1], [0, 0]]


def test_a_cell_s_corner_lies_at_the_origin(write):
    occupancy = load_map(write())
    assert occupancy.origin_xy_m == (-1.0, -2.0)
    assert occupancy.cell_of(-1.0 + 1e-9, -2.0 + 1e-9) == (0, 0)
    assert occupancy.cell_of(-0.96, -1.94) == (1, 0)
    assert occupancy.cell_of(-1.01, -2.01) == (-1, -1)
    assert occupancy.centre_of(1, 0) == pytest.approx((-0.975, -1.925))


def test_an_origin_may_leave_its_yaw_out(write):
    assert load_map(write(origin="[1, 2]")).origin_xy_m == (1.0, 2.0)


@pytest.mark.parametrize(("free_thresh", "cell"), [(0.196, -1), (0.25, 0)])
def test_grey_205_is_unknown_to_the_old_threshold_and_free_to_the_new_one(write, free_thresh, cell):
    assert cells(write([[205]], free_thresh=free_thresh)) == [[cell]]


def test_thresholds_default_to_those_of_map_server(write):
    assert cells(write([[205, 89, 90]], free_thresh=None, occupied_thresh=None)) == [[0, 100, -1]]


@given(
    free=st.integers(0, 254), span=st.integers(1, 255), negate=st.booleans(), mode=st.sampled_from(["trinary", "scale"])
)
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_every_grey_value_is_read_by_the_formula_of_map_server(write, free, span, negate, mode):
    free_thresh, occupied_thresh = free / 255, min(free + span, 255) / 255 + 1e-6
    path = write(
        [list(range(256))], mode=mode, negate=int(negate), free_thresh=free_thresh, occupied_thresh=occupied_thresh
    )
    for grey, cell in enumerate(cells(path)[0]):
        p = grey / 255 if negate else (255 - grey) / 255
        if p >= occupied_thresh:
            assert cell == 100
        elif p <= free_thresh:
            assert cell == 0
        elif mode == "trinary":
            assert cell == -1
        else:
            assert cell == round(100 * (p - free_thresh) / (occupied_thresh - free_thresh))


@pytest.mark.parametrize("negate", [1, "true"])
def test_a_negated_map_is_occupied_where_it_is_bright(write, negate):
    assert cells(write([[0, 255]], negate=negate)) == [[0, 100]]


def test_raw_takes_values_to_100_as_they_are_and_the_rest_as_unknown(write):
    assert cells(write([[0, 1, 50, 100, 101, 255]], mode="raw")) == [[0, 1, 50, 100, -1, -1]]


def test_a_cell_between_the_thresholds_is_neither_wall_nor_free(write):
    occupancy = load_map(write([[150]], mode="scale"))
    assert 0 < occupancy.cells[0, 0] < 100
    assert not occupancy.occupied.any()
    assert not occupancy.free.any()


@pytest.mark.parametrize("mode", ["trinary", "scale"])
def test_a_transparent_pixel_is_unknown(write, tmp_path, mode):
    pixels = np.array([[[0, 0, 0, 255], [0, 0, 0, 254], [255, 255, 255, 255], [255, 255, 255, 0]]], dtype=np.uint8)
    Image.fromarray(pixels, "RGBA").save(tmp_path / "map.png")
    assert cells(write(None, image="map.png", mode=mode)) == [[100, -1, 0, -1]]


def test_grey_with_alpha_is_read_as_grey(write, tmp_path):
    pixels = np.array([[[0, 255], [254, 255], [0, 7]]], dtype=np.uint8)
    Image.fromarray(pixels, "LA").save(tmp_path / "map.png")
    assert cells(write(None, image="map.png")) == [[100, 0, -1]]


def test_sixteen_bits_a_pixel_are_as_good_as_eight(write, tmp_path):
    Image.fromarray(np.array([[0, 205, 254, 255]], dtype=np.uint16) * 257).save(tmp_path / "map.png")
    assert cells(write(None, image="map.png")) == [[100, -1, 0, 0]]


def test_a_pgm_of_sixteen_bits_a_pixel_is_as_good_as_one_of_eight(write, tmp_path):
    values = (np.array([0, 205, 254, 255]) * 257).astype(">u2")
    (tmp_path / "map.pgm").write_bytes(b"P5\n4 1\n65535\n" + values.tobytes())
    assert cells(write(None)) == [[100, -1, 0, 0]]


def test_colour_is_read_as_the_mean_of_its_channels(write, tmp_path):
    Image.fromarray(np.array([[[255, 255, 0], [10, 20, 30]]], dtype=np.uint8), "RGB").save(tmp_path / "map.png")
    assert cells(write(None, image="map.png", mode="raw")) == [[-1, 20]]


def test_a_palette_is_read_by_its_colours(write, tmp_path):
    Image.fromarray(np.array([[0, 254, 205]], dtype=np.uint8)).convert("P").save(tmp_path / "map.png")
    assert cells(write(None, image="map.png")) == [[100, 0, -1]]


def test_black_and_white_of_one_bit_a_pixel_are_wall_and_free(write, tmp_path):
    Image.fromarray(np.array([[0, 255]], dtype=np.uint8)).convert("1").save(tmp_path / "map.png")
    assert cells(write(None, image="map.png")) == [[100, 0]]


@pytest.mark.parametrize(
    "header",
    [
        b"P5\n# made by hand\n2 2\n255\n",
        b"P5 # a comment\n2 # wide\n2 # high\n255\n",
        b"P5 2 2 255 ",
    ],
)
def test_the_header_of_a_pgm_may_hold_comments_and_any_white_space(write, tmp_path, header):
    (tmp_path / "map.pgm").write_bytes(header + bytes([254, 0, 205, 254]))
    assert cells(write(None)) == [[-1, 0], [0, 100]]


def test_text_pgm_is_read(write, tmp_path):
    (tmp_path / "map.pgm").write_text("P2\n# text\n2 1\n255\n0 254\n")
    assert cells(write(None)) == [[100, 0]]


def test_keys_that_map_server_does_not_know_are_passed_over(write):
    assert cells(write([[254]], laser_height=0.7)) == [[0]]


def test_numbers_may_be_written_with_an_exponent(write):
    assert load_map(write(resolution="5e-2")).resolution_m == 0.05


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"image": None}, "no key 'image'; a map has image, resolution and origin"),
        ({"resolution": None}, "no key 'resolution'"),
        ({"origin": None}, "no key 'origin'"),
        ({"image": "none.pgm"}, "image: no file '.*none.pgm'; the picture lies relative to the YAML file"),
        ({"image": "map.yaml"}, "map.yaml' is not a PGM, PNG or BMP picture"),
        ({"origin": "[0, 0, 0.5]"}, "origin: found yaw 0.5; 0, turn the picture instead"),
        ({"origin": "[0]"}, r"origin: found \[0\]; \[x, y, yaw\]"),
        ({"origin": "[0, .nan, 0]"}, r"origin: found \[0, nan, 0\]"),
        ({"origin": "here"}, "origin: found 'here'"),
        ({"resolution": 0}, "resolution: found 0.0; metres per cell, greater than 0"),
        ({"resolution": -0.05}, "greater than 0"),
        ({"resolution": "fine"}, "resolution: found 'fine'; a number"),
        ({"resolution": ".inf"}, "resolution: found inf; a number"),
        ({"free_thresh": "true"}, "free_thresh: found True; a number"),
        ({"negate": 2}, "negate: found 2; 0 or 1"),
        ({"mode": "binary"}, "mode: found 'binary'; trinary, scale or raw"),
    ],
)
def test_a_map_that_is_wrong_is_refused_with_what_would_be_right(write, changes, message):
    path = write(**changes)
    with pytest.raises(MapError, match=message) as caught:
        load_map(path)
    assert str(caught.value).startswith(f"{path}: ")


def test_a_map_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(MapError, match=r"none\.yaml: no such file; a map is a map_server YAML file"):
        load_map(tmp_path / "none.yaml")


@pytest.mark.parametrize(("text", "message"), [("a: [", "not YAML"), ("- 1\n", "found list; a map is a mapping")])
def test_a_file_that_is_no_mapping_is_refused(tmp_path, text, message):
    (tmp_path / "map.yaml").write_text(text)
    with pytest.raises(MapError, match=message):
        load_map(tmp_path / "map.yaml")


def test_a_picture_that_is_cut_off_is_refused(write, tmp_path):
    (tmp_path / "map.pgm").write_bytes(b"P5\n20 20\n255\n" + bytes(7))
    with pytest.raises(MapError, match=r"map\.pgm' is not a PGM, PNG or BMP picture"):
        load_map(write(None))


def test_the_digest_is_pinned(write):
    assert load_map(write()).digest == "e13fb87f6a8a8d8ef06d30c38294b2189289ec7cb0ff8690228e606f069c8594"


def test_the_digest_is_of_the_grid_and_not_of_the_files(write, tmp_path):
    first = map_content(write())
    Image.fromarray(np.array([[255, 1], [205, 254]], dtype=np.uint8)).save(tmp_path / "other.png")
    assert map_content(write(None, image="other.png")) == first


@pytest.mark.parametrize(
    "changes", [{"grey": [[254, 0], [254, 254]]}, {"resolution": 0.1}, {"origin": "[-1.0, -2.5, 0.0]"}]
)
def test_another_grid_or_frame_has_another_digest(write, changes):
    first = map_content(write())
    assert map_content(write(**changes)) != first


def test_shapes_of_equal_size_have_different_digests():
    flat, tall = (OccupancyMap(np.zeros(shape, dtype=np.int8), 0.05, (0.0, 0.0)) for shape in ((1, 4), (4, 1)))
    assert flat.digest != tall.digest
