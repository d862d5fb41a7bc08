"""A YAML file as data with positions."""

import re
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from table import each_row

from vastflow.producers.campaign_file.document import Document, read_document
from vastflow.sim.model.faults import FileError, Got


def read(folder: Path, content: str | bytes) -> Document:
    file = folder / "c.vast"
    file.write_bytes(content.encode() if isinstance(content, str) else content)
    return read_document(file)


def fatal(folder: Path, content: str | bytes) -> str:
    """The error's message, without the folder."""
    with pytest.raises(FileError) as caught:
        read(folder, content)
    return str(caught.value).replace(f"{folder}/", "")


def test_keys_and_values_have_line_and_column_from_one(tmp_path: Path) -> None:
    document = read(tmp_path, "execution:\n  runs: 5\nconfiguration:\n- name: a\n")
    assert document.keys["execution", "runs"] == (2, 3)
    assert document.values["execution", "runs"] == (2, 9)
    assert document.values["configuration", 0, "name"] == (4, 9)
    assert read(tmp_path, "{büro: 1, b: 2}").keys[("b",)] == (1, 11)  # characters, not bytes


def test_location_with_elements_that_are_not_in_the_file_finds_the_nearest_place(tmp_path: Path) -> None:
    document = read(tmp_path, "a:\n  b:\n    c: 1\n")
    assert document.place(("a", "function-after", "b", "float", "c")) == (3, 8)
    assert document.place(("a", "b", "missing"), "key") == (2, 3)


def test_first_document_is_read(tmp_path: Path) -> None:
    assert read(tmp_path, "a: 1\n---\nb: [\n").data == {"a": 1}


def test_faults_of_a_document_have_place_and_message(golden, tmp_path: Path) -> None:
    def faults(text: str) -> list[str]:
        try:
            found = read(tmp_path, text).faults
        except FileError as error:
            found = error.faults
        return [str(fault).replace(f"{tmp_path}/c.vast:", "") for fault in found]

    golden("campaign_files", "document", faults)


def test_damaged_number_is_a_fault_wherever_its_alias_stands(tmp_path: Path) -> None:
    faults = read(tmp_path, "a: &x !!int zz\nb: *x\n").faults
    assert [(fault.place.line, fault.problem) for fault in faults] == [(1, Got("'zz'"))] * 2


def test_binary_file_is_one_fault(tmp_path: Path) -> None:
    assert fatal(tmp_path, "ok: 1\nä: \x01\n").startswith("c.vast:2:4: Not YAML: control characters are not allowed. ")
    assert fatal(tmp_path, b"ok: 1\na: \xff\n").startswith("c.vast:2:4: Byte ")


@each_row(
    ("name", "fault"),
    [("none.vast", r"none\.vast:1:1: No such file\. Expected a \.vast file\."), ("", "It is a folder")],
)
def test_path_of_no_file_is_a_fault(tmp_path: Path, name: str, fault: str) -> None:
    with pytest.raises(FileError, match=fault):
        read_document(tmp_path / name)


@each_row(
    ("text", "value"),
    [("1e3", 1000.0), ("-2.5E-2", -0.025), ("1.5e+3", 1500.0), ("'1e3'", "1e3"), ("2024-01-01", "2024-01-01")],
)
def test_numbers_with_an_exponent_are_numbers_and_dates_are_text(tmp_path: Path, text: str, value: Any) -> None:
    assert read(tmp_path, f"a: {text}").data == {"a": value}


@each_row(("text", "value"), [("012", 10), ("12:30", 750)])
def test_numbers_that_yaml_1_1_reads_oddly_come_with_a_warning(tmp_path: Path, text: str, value: int) -> None:
    document = read(tmp_path, f"a: {text}")
    assert document.data == {"a": value}
    assert [note.problem for note in document.notes] == [f"YAML 1.1 reads {text} as {value}"]


def test_keys_are_the_text_that_is_written(tmp_path: Path) -> None:
    assert read(tmp_path, "on: 1\n2: 2\n2024-01-01: 3\n").data == {"on": 1, "2": 2, "2024-01-01": 3}


def test_own_keys_override_merged_keys(tmp_path: Path) -> None:
    document = read(tmp_path, "base: &base {a: 1, b: 2}\nchild:\n  <<: *base\n  b: 3\n")
    assert document.data["child"] == {"b": 3, "a": 1}
    assert document.keys["child", "a"] == (1, 14)
    assert document.faults == ()


def test_aliases_that_grow_exponentially_are_a_fault(tmp_path: Path) -> None:
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]" for i in range(1, 9)]
    assert "Aliases grow" in fatal(tmp_path, "\n".join(lines))


def test_nesting_that_would_end_the_process_is_a_fault(tmp_path: Path) -> None:
    fault = fatal(tmp_path, "a: " + "[" * 200_000)
    assert re.match(r"c\.vast:1:10\d+: It is more than 100 levels deep", fault)  # PyYAML 6.0.4 stops at 1,000 by itself


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(content=st.binary(max_size=60) | st.text(alphabet="ab:-[]{}&*<!'\"\n\t #|>1.e%@?,", max_size=60))
def test_any_file_is_a_document_or_a_campaign_error(tmp_path: Path, content: str | bytes) -> None:
    try:
        document = read(tmp_path, content)
    except FileError as error:
        assert error.faults
    else:
        assert all(document.place(location) for location in document.keys)
