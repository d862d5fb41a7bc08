import os
import re

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
from hypothesis import given
from hypothesis import strategies as st
from table import each_row

from vastflow.sim.model.tables import TableFault, read_table
from vastflow.sim.scenario.programs import outputs
from vastflow.sim.scenario.programs.outputs import read_outputs, stamps


def csv(text):
    return read_table("x.csv", text.encode())


def test_columns_of_a_csv_have_the_types_of_their_values():
    columns, notes = csv("n,x,yes,who\n1,2.5,true,a\n2,3.5,false,bc\n")
    assert {name: values.dtype.kind for name, values in columns.items()} == {"n": "i", "x": "f", "yes": "b", "who": "U"}
    assert columns["n"].tolist() == [1, 2]
    assert columns["yes"].tolist() == [True, False]
    assert columns["who"].tolist() == ["a", "bc"]
    assert notes == ()


def test_value_that_is_not_there_is_no_number():
    columns, _ = csv("n,x,yes,who\n1,,true,a\n,2.5,,\n")
    np.testing.assert_array_equal(columns["n"], [1.0, np.nan])
    np.testing.assert_array_equal(columns["x"], [np.nan, 2.5])
    np.testing.assert_array_equal(columns["yes"], [1.0, np.nan])
    assert columns["who"].tolist() == ["a", ""]


def test_moments_are_seconds():
    columns, _ = csv("when,at\n1970-01-01T00:01:00,00:00:30\n")
    assert (columns["when"].tolist(), columns["at"].tolist()) == ([60.0], [30.0])


def test_type_follows_from_all_rows_of_a_long_file():
    columns, _ = csv("x\n" + "1\n" * 600_000 + "0.5\n")
    assert columns["x"].dtype == np.float64
    assert columns["x"][-1] == 0.5


def test_header_alone_is_a_table_without_rows():
    columns, _ = csv("a,b\n")
    assert {name: values.shape for name, values in columns.items()} == {"a": (0,), "b": (0,)}


def test_second_column_of_one_name_is_left_out():
    columns, notes = csv("a,a\n1,2\n")
    assert columns["a"].tolist() == [1]
    assert notes == ("a second column 'a' is left out",)


@each_row("text", ["", "a,b\n1\n", "a,b\n1,2,3\n"])
def test_broken_csv_is_no_table(text):
    with pytest.raises(TableFault, match="not a table: "):
        csv(text)


@given(st.binary(max_size=200))
def test_whatever_stands_in_a_file_it_is_a_table_or_a_fault(content):
    for name in ("x.csv", "x.parquet"):
        try:
            columns, _ = read_table(name, content)
        except TableFault:
            continue
        assert len({len(values) for values in columns.values()}) <= 1


def test_parquet_gives_the_same_columns(tmp_path):
    table = pa.table(
        {"n": pa.array([1], pa.uint8()), "x": pa.array([0.5], pa.float32()), "yes": [True], "who": ["a"], "list": [[1]]}
    )
    pa.parquet.write_table(table, tmp_path / "x.parquet")
    columns, notes = read_table("x.parquet", (tmp_path / "x.parquet").read_bytes())
    assert {name: (values.dtype.kind, values.tolist()) for name, values in columns.items()} == {
        "n": ("i", [1]),
        "x": ("f", [0.5]),
        "yes": ("b", [True]),
        "who": ("U", ["a"]),
    }
    assert notes == ("column 'list' is left out: no numbers, truth values or text but list<element: int64>",)


def test_only_what_is_new_or_changed_was_written_by_the_run(tmp_path):
    for name in ("same.txt", "changed.txt", "gone.txt"):
        (tmp_path / name).write_text("before")
    before = stamps(tmp_path)
    (tmp_path / "changed.txt").write_text("after!")
    (tmp_path / "gone.txt").unlink()
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub/new.csv").write_text("a\n1\n")
    found = read_outputs(tmp_path, before)
    assert dict(found.files) == {"changed.txt": b"after!"}
    assert list(found.tables) == ["sub/new"]


def test_broken_table_is_noted_and_kept_as_a_file(tmp_path):
    (tmp_path / "good.csv").write_text("a\n1\n")
    (tmp_path / "bad.csv").write_text("a,b\n1\n")
    found = read_outputs(tmp_path, {})
    assert list(found.tables) == ["good"]
    assert dict(found.files) == {"bad.csv": b"a,b\n1\n"}
    (note,) = found.notes
    assert re.fullmatch(r"bad\.csv: not a table: .*Expected 2 columns, got 1.*", note)


def test_two_tables_of_one_stem_are_both_there(tmp_path):
    (tmp_path / "x.csv").write_text("a\n1\n")
    pa.parquet.write_table(pa.table({"a": [2]}), tmp_path / "x.parquet")
    found = read_outputs(tmp_path, {})
    assert {name: columns["a"].tolist() for name, columns in found.tables.items()} == {"x": [1], "x.parquet": [2]}


def test_what_is_too_large_is_listed(tmp_path, monkeypatch):
    monkeypatch.setattr(outputs, "MAX_FILE_BYTES", 3 << 20)
    monkeypatch.setattr(outputs, "MAX_RUN_BYTES", 4 << 20)
    for name, size in (("a", 3 << 20), ("b", (3 << 20) + 1), ("c", 2 << 20), ("d", 1)):
        (tmp_path / name).write_bytes(bytes(size))
    found = read_outputs(tmp_path, {})
    assert list(found.files) == ["a", "d"]
    assert [(left.path, left.size_bytes, left.why) for left in found.left_out] == [
        ("b", (3 << 20) + 1, "larger than 3 MiB"),
        ("c", 2 << 20, "the run's 4 MiB are full"),
    ]


def test_links_out_of_the_folder_are_not_followed(tmp_path):
    (tmp_path / "secret").mkdir()
    (tmp_path / "secret/key").write_text("secret")
    folder = tmp_path / "run"
    folder.mkdir()
    (folder / "data").write_text("x")
    for name, target in (
        ("file", "../secret/key"),
        ("folder", "../secret"),
        ("broken", "nowhere"),
        ("inside", "data"),
        ("loop", "loop"),
    ):
        (folder / name).symlink_to(target)
    found = read_outputs(folder, {})
    assert dict(found.files) == {"data": b"x", "inside": b"x"}
    assert [left.path for left in found.left_out] == ["broken", "file", "folder", "loop"]


def test_pipe_is_not_read(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    (left,) = read_outputs(tmp_path, {}).left_out
    assert (left.path, left.why) == ("pipe", "not a file but a device, pipe or socket")


def test_name_that_is_no_text_can_be_written_down(tmp_path):
    with open(os.fsencode(tmp_path) + b"/\xff", "w") as file:
        file.write("x")
    assert list(read_outputs(tmp_path, {}).files) == ["\\xff"]


def test_folder_that_can_not_be_listed_is_noted(tmp_path):
    assert read_outputs(tmp_path / "gone", {}).notes == (".: No such file or directory",)
