import os
import re

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
from hypothesis import given
from hypothesis import strategies as st
from table import each_row

from vastflow.sim.model import archive
from vastflow.sim.model.archive import read_foreign_table
from vastflow.sim.model.files import Unreadable
from vastflow.sim.model.recording import Outputs
from vastflow.sim.scenario.programs import outputs
from vastflow.sim.scenario.programs.outputs import read_outputs, stamps


def csv(text):
    return read_foreign_table("x.csv", text.encode())


NAN = float("nan")


@each_row(
    ("text", "columns", "notes"),
    [
        (
            "n,x,yes,who\n1,2.5,true,a\n2,3.5,false,bc\n",
            {"n": [1, 2], "x": [2.5, 3.5], "yes": [True, False], "who": ["a", "bc"]},
            (),
        ),
        ("n,x\n1,\n,2.5\n", {"n": [1.0, NAN], "x": [NAN, 2.5]}, ()),
        ("yes,who\ntrue,a\n,\n", {"yes": [1.0, NAN], "who": ["a", ""]}, ()),
        ("when,at\n1970-01-01T00:01:00,00:00:30\n", {"when": [60.0], "at": [30.0]}, ()),
        ("a,b\n", {"a": [], "b": []}, ()),
        ("a,a\n1,2\n", {"a": [1]}, ("a second column 'a' is left out",)),
    ],
)
def test_columns_of_a_csv_have_the_types_of_their_values(text, columns, notes):
    found, said = csv(text)
    assert (list(found), said) == (list(columns), notes)
    for name, values in columns.items():
        np.testing.assert_array_equal(found[name], values)
        assert not values or found[name].dtype.kind == np.array(values).dtype.kind


def test_type_follows_from_all_rows_of_a_long_file():
    columns, _ = csv("x\n" + "1\n" * 600_000 + "0.5\n")
    assert columns["x"].dtype == np.float64
    assert columns["x"][-1] == 0.5


@each_row("text", ["", "a,b\n1\n", "a,b\n1,2,3\n"])
def test_broken_csv_is_no_table(text):
    with pytest.raises(ValueError, match="not a table: "):
        csv(text)


@given(st.binary(max_size=200))
def test_any_csv_is_a_table_or_a_fault(content):
    for name in ("x.csv", "x.parquet"):
        try:
            columns, _ = read_foreign_table(name, content)
        except ValueError:
            continue
        assert len({len(values) for values in columns.values()}) <= 1


def test_parquet_gives_the_same_columns(tmp_path):
    table = pa.table(
        {"n": pa.array([1], pa.uint8()), "x": pa.array([0.5], pa.float32()), "yes": [True], "who": ["a"], "list": [[1]]}
    )
    pa.parquet.write_table(table, tmp_path / "x.parquet")
    columns, notes = read_foreign_table("x.parquet", (tmp_path / "x.parquet").read_bytes())
    found = [(name, values.dtype.kind, values.tolist()) for name, values in columns.items()]
    assert found == [("n", "i", [1]), ("x", "f", [0.5]), ("yes", "b", [True]), ("who", "U", ["a"])]
    assert notes == ("column 'list' is left out: no numbers, truth values or text but list<element: int64>",)


def test_outputs_are_new_or_changed_files(tmp_path):
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


def test_tables_of_one_stem_are_both_kept(tmp_path):
    (tmp_path / "x.csv").write_text("a\n1\n")
    pa.parquet.write_table(pa.table({"a": [2]}), tmp_path / "x.parquet")
    found = read_outputs(tmp_path, {})
    assert {name: columns["a"].tolist() for name, columns in found.tables.items()} == {"x": [1], "x.parquet": [2]}


def test_file_that_is_too_large_is_listed(tmp_path, monkeypatch):
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
    targets = {"file": "../secret/key", "folder": "../secret", "broken": "nowhere", "inside": "data", "loop": "loop"}
    for name, target in targets.items():
        (folder / name).symlink_to(target)
    found = read_outputs(folder, {})
    assert dict(found.files) == {"data": b"x", "inside": b"x"}
    assert [left.path for left in found.left_out] == ["broken", "file", "folder", "loop"]


def test_pipe_or_name_without_text_is_noted(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    with open(os.fsencode(tmp_path) + b"/\xff", "w") as file:
        file.write("x")
    found = read_outputs(tmp_path, {})
    assert list(found.files) == ["\\xff"]
    (left,) = found.left_out
    assert (left.path, left.why) == ("pipe", "not a file but a device, pipe or socket")
    assert read_outputs(tmp_path / "gone", {}).notes == (".: No such file or directory",)


def test_archive_that_unpacks_to_more_than_outputs_have_is_refused(monkeypatch):
    content = archive.write_outputs({0: Outputs({}, {"log.txt": b"0" * 5000})})
    assert archive.read_outputs(content)[0].files == {"log.txt": b"0" * 5000}
    monkeypatch.setattr(archive, "MOST_OUTPUTS_BYTES", 4999)
    with pytest.raises(Unreadable, match="expected at most 4,999, got 5,000 bytes of outputs when unpacked"):
        archive.read_outputs(content)
