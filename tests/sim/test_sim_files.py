"""Files that others write, read within limits."""

import io
import os
import pickle
import socket
import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image
from table import each_row

from vastflow.sim.model import files
from vastflow.sim.model.files import Missing, Unreadable, json_value, read_json, read_picture, read_text, yaml_value
from vastflow.sim.scenario.programs.actions import set_yaml_value
from vastflow.sim.world.map_file import MapError, load_map


def put(folder: Path, content: bytes, name: str = "file") -> Path:
    (folder / name).write_bytes(content)
    return folder / name


# Regular files only


def test_pipe_that_nobody_writes_to_is_refused_at_once(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(Unreadable, match=r"can't be read: it is a pipe; a text file"):
        read_text(tmp_path / "pipe")


@pytest.mark.parametrize(
    ("place", "found"), [("/dev/zero", "a device"), (".", "a folder"), ("socket", "a socket"), ("to_null", "a device")]
)
def test_what_is_no_regular_file_is_refused(tmp_path, monkeypatch, place, found):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "to_null").symlink_to("/dev/null")
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind("socket")
        with pytest.raises(Unreadable, match=f"can't be read: it is {found}; "):
            read_text(place)


@each_row("name", ["none", "dangling"])
def test_file_that_is_not_there_is_missing(tmp_path, name):
    (tmp_path / "dangling").symlink_to("nowhere")
    with pytest.raises(Missing, match=r"no such file; the path of a \.vast file"):
        read_text(tmp_path / name, "a .vast file")


@each_row("name", ["circle", "a" * 300, "nul\0"])
def test_path_that_leads_nowhere_is_refused(tmp_path, name):
    (tmp_path / "circle").symlink_to("circle")
    with pytest.raises(Unreadable, match="can't be read: "):
        read_text(tmp_path / name)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read every file")
def test_file_that_may_not_be_read_is_refused(tmp_path):
    put(tmp_path, b"").chmod(0)
    with pytest.raises(Unreadable, match="can't be read: Permission denied"):
        read_text(tmp_path / "file")


def test_file_that_is_too_large_is_refused_before_it_is_read(tmp_path):
    with open(tmp_path / "file", "wb") as file:
        file.truncate(2**40)  # with holes: it takes no room
    with pytest.raises(Unreadable, match="expected at most 16,777,216, got 1,099,511,627,776 bytes"):
        read_text(tmp_path / "file")


def test_byte_order_mark_is_no_part_of_a_text(tmp_path):
    assert read_text(put(tmp_path, b"\xef\xbb\xbfa\n")) == "a\n"


def test_byte_that_is_no_utf_8_has_a_place(tmp_path):
    with pytest.raises(Unreadable, match="byte 0xff is not UTF-8; a text in UTF-8") as caught:
        read_text(put(tmp_path, b"a\n\xc3\xa4\xff"))
    assert caught.value.place == (2, 2)


def test_error_can_be_sent_to_another_process():
    error = pickle.loads(pickle.dumps(Missing("this", "that", (2, 3))))
    assert (type(error), str(error), error.place) == (Missing, "this; that", (2, 3))


# YAML


@each_row("opening", ["[", "{a: ", "- ", "? "])
def test_yaml_that_is_deeper_than_parsers_recurse_is_refused(opening):
    with pytest.raises(Unreadable, match="more than 100 levels deep; fewer levels"):
        yaml_value(opening * 100_000)


def test_map_s_yaml_of_100_000_levels_is_refused(tmp_path):
    with pytest.raises(MapError, match=r"map\.yaml:1:\d+: more than 100 levels deep"):
        load_map(put(tmp_path, b"image: " + b"[" * 100_000, "map.yaml"))


def test_aliases_that_grow_exponentially_are_refused():
    doubling = "".join(f"a{k}: &a{k} [*a{k - 1}, *a{k - 1}]\n" for k in range(1, 60))
    with pytest.raises(Unreadable, match="aliases that grow to more than 500,000 values or 100 levels; fewer aliases"):
        yaml_value(f"a0: &a0 [1]\n{doubling}")


def test_merge_keys_that_grow_exponentially_are_refused():
    doubling = "".join(f"a{k}: &a{k} {{<<: [*a{k - 1}, *a{k - 1}]}}\n" for k in range(1, 60))
    with pytest.raises(Unreadable, match="aliases that grow"):
        yaml_value(f"a0: &a0 {{b: 1}}\n{doubling}")


def test_yaml_of_too_many_values_is_refused_before_any_is_kept():
    with pytest.raises(Unreadable, match="more than 500,000 values"):
        yaml_value("[" + "[]," * 600_000 + "]")


@each_row("text", ["&a [*a]", "&a {<<: *a}", "&a {b: {c: [*a]}}"])
def test_alias_inside_of_what_it_stands_for_is_refused(text):
    with pytest.raises(Unreadable, match="got an alias inside of what it stands for"):
        yaml_value(text)


@each_row(
    "text",
    [
        "!!python/object/apply:os.system [true]",
        "2024-13-45",
        "!!timestamp x",
        "!!int x",
        "!!float x",
        "!!bool x",
        "!!binary ä",
        "0x_",
        "1" * 5000,
        "? [a]\n: b",
        "!!set [a]",
        "!!omap {a: b}",
        "a: \x00",
        '"\\ud800"',
        "a: b: c",
        "*a",
        "{<<: 1}",
        "=: !!float =",
    ],
)
def test_yaml_without_a_plain_value_is_refused(text):
    with pytest.raises(Unreadable, match="not YAML: "):
        yaml_value(text)


def test_only_the_first_document_of_a_text_is_looked_at():
    assert yaml_value("a: 1\n---\n[") == {"a": 1}
    assert yaml_value("") is None


@given(st.recursive(st.none() | st.booleans() | st.text("a:-[]{}&*!%@ \n#'\"|>?,<"), st.lists))
def test_whatever_the_text_a_value_comes_or_a_refusal(value):
    text = str(value)
    try:
        yaml_value(text)
    except Unreadable as error:
        assert 1 <= error.place[0] <= text.count("\n") + 2


@each_row(("content", "message"), [(None, "no such file; "), (b"a: [", "not YAML: "), (b"\xff", "not UTF-8")])
def test_yaml_file_in_which_a_value_is_to_be_set_is_read_with_the_same_limits(tmp_path, content, message):
    if content is not None:
        put(tmp_path, content)
    with pytest.raises(ValueError, match=f"file': .*{message}"):
        set_yaml_value(tmp_path / "file", tmp_path / "new", "a.b", "1", "int", True)


# JSON


@each_row(
    ("text", "message"),
    [
        ("[" * 100_000, "more than 100 levels deep"),
        ("[" * 101 + "]" * 101, "more than 100 levels deep"),
        ("1" * 5000, "not JSON: Exceeds the limit"),
        ("[" + "1," * 5_000_001 + "1]", "more than 5,000,000 values"),
        ('{"a": }', "not JSON: Expecting value; a JSON text"),
        (b"\xff", "not JSON: 'utf-8' codec"),
    ],
)
def test_json_that_cannot_be_read_is_refused(text, message):
    with pytest.raises(Unreadable, match=message):
        json_value(text)


def test_json_as_deep_as_may_be_is_read():
    assert json_value("[" * 100 + "]" * 100) == eval("[" * 100 + "]" * 100)


def test_what_is_wrong_with_a_json_file_has_its_name_and_place(tmp_path):
    with pytest.raises(Unreadable, match=r"metadata\.json:2:1: not JSON: Expecting value; a JSON text"):
        read_json(put(tmp_path, b"[\n,", "metadata.json"))
    with pytest.raises(Missing, match=r"gone\.json: no such file"):
        read_json(tmp_path / "gone.json")


# Pictures


def encoded(kind: str, picture: Image.Image | None = None, **options) -> bytes:
    found = io.BytesIO()
    (picture or Image.new("L", (4, 3), 254)).save(found, kind, **options)
    return found.getvalue()


@each_row("kind", ["PPM", "PNG", "BMP"])
def test_formats_of_maps_are_read(tmp_path, kind):
    assert read_picture(put(tmp_path, encoded(kind))).size == (4, 3)


@each_row("kind", ["GIF", "TIFF", "JPEG", "PCX", "TGA"])
def test_other_formats_are_refused_whatever_the_file_is_called(tmp_path, kind):
    with pytest.raises(Unreadable, match="no picture in PGM, PNG or BMP; one of these formats"):
        read_picture(put(tmp_path, encoded(kind), "map.png"))


def test_picture_of_more_pixels_than_memory_has_room_for_is_refused_by_its_header(tmp_path):
    for content, found in (
        (b"P5 10000 9000 255\n", "10,000 × 9,000 pixels"),
        (b"P5 1000000 1000000 255\n", "a picture of more pixels"),
    ):
        with pytest.raises(Unreadable, match=f"expected at most 25,000,000, got {found}"):
            read_picture(put(tmp_path, content))


def test_small_file_of_many_pixels_is_refused(tmp_path):
    bomb = encoded("PNG", Image.new("1", (14_000, 14_000)))
    assert len(bomb) < 100_000
    with pytest.raises(Unreadable, match="at most 25,000,000"):
        read_picture(put(tmp_path, bomb))


def test_picture_that_moves_is_refused(tmp_path):
    moving = encoded("PNG", save_all=True, append_images=[Image.new("L", (4, 3), 0)])
    with pytest.raises(Unreadable, match="expected a single picture, got a picture that moves"):
        read_picture(put(tmp_path, moving))


@each_row(
    "content",
    [
        encoded("PNG")[:-20],
        encoded("BMP")[:60],
        encoded("PPM")[:-1],
        b"P2 2 2 255 1 2 x 4",
        b"P2 2 2 255 1 2 300 4",
        b"P5 0 0 255\n",
        b"P5 -1 4 255\n1234",
        b"P5 2 2 70000\n" + bytes(8),
        b"BM" + struct.pack("<IHHI", 60, 0, 0, 54) + struct.pack("<IiiHH", 40, -4, 2**31 - 1, 1, 24) + bytes(30),
    ],
)
def test_damaged_picture_is_refused(tmp_path, content):
    with pytest.raises(Unreadable, match="picture"):
        read_picture(put(tmp_path, content))


def test_sixteen_bits_a_pixel_are_read(tmp_path):
    picture = Image.fromarray(np.array([[0, 65535]], dtype=np.uint16))
    assert np.asarray(read_picture(put(tmp_path, encoded("PNG", picture)))).tolist() == [[0, 65535]]


def test_limits_leave_room_for_a_building_of_250_m():
    assert files.MOST_PIXELS >= (250 / 0.05) ** 2
