"""Files that others write, read within limits."""

import io
import os
import pickle
import socket
import struct
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image
from table import each_row

from vastflow.sim.model import parquet
from vastflow.sim.model.blocks import read_rows
from vastflow.sim.model.digest import file_digest
from vastflow.sim.model.files import (
    Missing,
    Unreadable,
    files_below,
    json_value,
    read_json,
    read_text,
    yaml_value,
)
from vastflow.sim.model.parquet import open_table
from vastflow.sim.scenario.programs.actions import set_yaml_value
from vastflow.sim.world.map_file import read_picture


def put(folder: Path, content: bytes, name: str = "file") -> Path:
    (folder / name).write_bytes(content)
    return folder / name


@each_row(
    ("place", "message"),
    [
        ("pipe", "It is a pipe. Expected a .vast file"),
        (".", "It is a folder. Expected a .vast file"),
        ("socket", "It is a socket. Expected a .vast file"),
        ("to_null", "It is a device. Expected a .vast file"),
        *((place, r"No such file\. Expected a \.vast file") for place in ("none", "dangling")),
        *((place, "can't be read: .* Expected a .vast file") for place in ("circle", "a" * 300, "nul\0")),
        ("large", "expected at most 16,777,216, got 1,099,511,627,776 bytes"),
    ],
)
def test_read_text_refuses_irregular_file_at_once(tmp_path, monkeypatch, place, message):
    monkeypatch.chdir(tmp_path)
    os.mkfifo("pipe")
    for link, target in (("to_null", "/dev/null"), ("dangling", "nowhere"), ("circle", "circle")):
        Path(link).symlink_to(target)
    with open("large", "wb") as file:
        file.truncate(2**40)  # with holes: it takes no room
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind("socket")
        with pytest.raises(Unreadable, match=message) as caught:
            read_text(place, "a .vast file")
    assert isinstance(caught.value, Missing) == message.startswith("No such")


def test_file_that_may_not_be_read_is_refused(tmp_path):
    put(tmp_path, b"").chmod(0)
    is_root = os.geteuid() == 0
    if is_root:  # who may read every file
        os.seteuid(65534)
    try:
        with pytest.raises(Unreadable, match="can't be read: Permission denied"):
            read_text(tmp_path / "file")
    finally:
        if is_root:
            os.seteuid(0)


def test_text_is_read_without_byte_order_mark_and_reports_place_of_wrong_byte(tmp_path):
    assert read_text(put(tmp_path, b"\xef\xbb\xbfa\n")) == "a\n"
    with pytest.raises(Unreadable, match=r"Byte 0xff is not UTF-8\.") as caught:
        read_text(put(tmp_path, b"a\n\xc3\xa4\xff"))
    assert pickle.loads(pickle.dumps(caught.value)).place == (2, 2)


def doubling(form):
    return "a0: &a0 [1]\nb0: &b0 {b: 1}\n" + "".join(form.format(k, k - 1) for k in range(1, 60))


@each_row(
    ("text", "message"),
    [
        *((opening * 100_000, "more than 100 levels deep. Use fewer levels") for opening in ("[", "{a: ", "- ", "? ")),
        (
            doubling("a{0}: &a{0} [*a{1}, *a{1}]\n"),
            "Aliases grow to more than 500,000 values or 100 levels",
        ),
        (doubling("b{0}: &b{0} {{<<: [*b{1}, *b{1}]}}\n"), "Aliases grow"),
        ("[" + "[]," * 600_000 + "]", "more than 500,000 values"),
        *((text, "got an alias inside of what it stands for") for text in ("&a {<<: *a}", "&a {b: {c: [*a]}}")),
    ],
)
def test_yaml_beyond_limits_is_refused(text, message):
    with pytest.raises(Unreadable, match=message):
        yaml_value(text)


TAGGED = (
    "!!python/object/apply:os.system [true]",
    "!!timestamp x",
    "!!int x",
    "!!bool x",
    "!!binary ä",
    "!!omap {a: b}",
)
UNTAGGED = (
    "2024-13-45",
    "=: !!float =",
    "0x_",
    "1" * 5000,
    "? [a]\n: b",
    "a: \x00",
    '"\\ud800"',
    "a: b: c",
    "*a",
    "{<<: 1}",
)


@each_row("text", [*TAGGED, *UNTAGGED])
def test_yaml_without_a_plain_value_is_refused(text):
    with pytest.raises(Unreadable, match="Not YAML: "):
        yaml_value(text)


def test_yaml_is_read_up_to_its_first_document():
    assert yaml_value("a: 1\n---\n[") == {"a": 1}
    assert yaml_value("") is None


@given(st.recursive(st.none() | st.booleans() | st.text("a:-[]{}&*!%@ \n#'\"|>?,<"), st.lists))
def test_yaml_gives_value_or_error_for_any_text(value):
    text = str(value)
    try:
        yaml_value(text)
    except Unreadable as error:
        assert 1 <= error.place[0] <= text.count("\n") + 2


@each_row(("content", "message"), [(None, "No such file"), (b"a: [", "Not YAML: "), (b"\xff", "not UTF-8")])
def test_set_yaml_value_has_the_same_limits(tmp_path, content, message):
    if content is not None:
        put(tmp_path, content)
    with pytest.raises(ValueError, match=f"file': .*{message}"):
        set_yaml_value(tmp_path / "file", tmp_path / "new", "a.b", "1", "int", True)


@each_row(
    ("text", "message"),
    [
        ("[" * 100_000, "more than 100 levels deep"),
        ("1" * 5000, "not JSON: Exceeds the limit"),
        ("[" + "1," * 5_000_001 + "1]", "more than 5,000,000 values"),
        ('{"a": }', "It is not JSON: Expecting value"),
        (b"\xff", "not JSON: 'utf-8' codec"),
    ],
)
def test_json_that_cannot_be_read_is_refused(text, message):
    with pytest.raises(Unreadable, match=message):
        json_value(text)


def test_fault_of_a_json_file_has_its_name_and_place(tmp_path):
    with pytest.raises(Unreadable, match=r"metadata\.json:2:1: It is not JSON: Expecting value"):
        read_json(put(tmp_path, b"[\n,", "metadata.json"))
    with pytest.raises(Missing, match=r"gone\.json: No such file"):
        read_json(tmp_path / "gone.json")


def encoded(kind: str, picture: Image.Image | None = None, **options) -> bytes:
    found = io.BytesIO()
    (picture or Image.new("L", (4, 3), 254)).save(found, kind, **options)
    return found.getvalue()


BOMB = encoded("PNG", Image.new("1", (14_000, 14_000)))


@each_row(
    ("content", "message"),
    [
        *(
            (encoded(kind), "a picture in PGM, PNG, BMP, GIF, JPEG, or TIFF, got another format")
            for kind in ("TGA", "PCX")
        ),
        (encoded("JPEG", Image.new("CMYK", (4, 3))), "expected gray, RGB, or a palette, got colors in CMYK"),
        (b"P5 10000 9000 255\n", "expected at most 25,000,000 pixels, got 10,000 × 9,000"),
        (b"P5 1000000 1000000 255\n", "expected at most 25,000,000 pixels, got more"),
        (BOMB, "at most 25,000,000"),
        (
            encoded("PNG", save_all=True, append_images=[Image.new("L", (4, 3), 0)]),
            "single picture, got several frames",
        ),
    ],
)
def test_map_image_of_wrong_format_or_size_is_refused(tmp_path, content, message):
    assert len(BOMB) < 100_000
    with pytest.raises(Unreadable, match=message):
        read_picture(put(tmp_path, content, "map.png"))


@each_row(
    "content",
    [
        encoded("PNG")[:-20],
        encoded("BMP")[:60],
        encoded("PPM")[:-1],
        b"P2 2 2 255 1 2 x 4",
        b"P5 0 0 255\n",
        b"P5 -1 4 255\n1234",
        b"P5 2 2 70000\n" + bytes(8),
        b"BM" + struct.pack("<IHHI", 60, 0, 0, 54) + struct.pack("<IiiHH", 40, -4, 2**31 - 1, 1, 24) + bytes(30),
    ],
)
def test_damaged_picture_is_refused(tmp_path, content):
    with pytest.raises(Unreadable, match=r"picture|pixels"):
        read_picture(put(tmp_path, content))


@pytest.mark.timeout(30)
def test_digest_and_table_of_a_pipe_are_refused_at_once(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for read in (file_digest, open_table, read_rows):
        with pytest.raises(Unreadable, match="It is a pipe"):
            read(tmp_path / "pipe")


def test_table_of_more_values_than_fit_is_refused(tmp_path, monkeypatch):
    pq.write_table(pa.table({"a": [0] * 1000, "b": [0] * 1000}), tmp_path / "file")
    assert open_table(tmp_path / "file").metadata.num_rows == 1000
    monkeypatch.setattr(parquet, "MOST_CELLS", 1999)
    for source in (tmp_path / "file", (tmp_path / "file").read_bytes()):
        with pytest.raises(Unreadable, match="expected at most 1,999, got 2,000 values"):
            open_table(source)


def test_files_below_a_folder_are_those_that_no_link_leads_out_to(tmp_path):
    (tmp_path / "in").mkdir()
    put(tmp_path, b"secret", "out")
    for name in ("a", "b"):
        put(tmp_path / "in", b"", name)
    for link, target in (("own", "a"), ("led", "../out"), ("loop", "loop"), ("none", "nowhere"), ("dev", "/dev/zero")):
        (tmp_path / "in" / link).symlink_to(target)
    os.mkfifo(tmp_path / "in" / "pipe")
    assert [file.name for file in files_below(tmp_path / "in")] == ["a", "b", "own"]
