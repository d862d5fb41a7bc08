"""Damaged campaign directories: a sentence with the file, never a traceback."""

import json

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from command_line import called
from whole_directory import ConfigurationResult, write_results

from vastflow.flows.results.past import newest_past, past_of
from vastflow.oracles.judgment.verdict import Verdict
from vastflow.oracles.results.unusable import UnusableDirectory
from vastflow.tasks.keys.source import installed_tree


@pytest.fixture
def directory(small_room, tmp_path):
    found = ConfigurationResult(verdicts=[Verdict("success", k, "pass") for k in range(2)])
    return write_results(small_room, tmp_path / "results", found, tree=installed_tree()).directory


DAMAGES = {
    "a list": b"[]",
    "an empty map": b"{}",
    "null": b"null",
    "no JSON": b"{",
    "counts that are none": json.dumps({"name": "n", "created": "now", "counts": 4, "asked": 5}).encode(),
}


@pytest.mark.parametrize("content", DAMAGES.values(), ids=DAMAGES)
@pytest.mark.parametrize("command", ["show", "export", "compare", "plan", "run"])
def test_commands_report_damaged_metadata(directory, tmp_path, monkeypatch, command, content):
    monkeypatch.setenv("VASTFLOW_STORE", str(tmp_path / "store"))
    (directory / "metadata.json").write_bytes(content)
    more = {"export": [tmp_path / "out"], "compare": [directory]}
    result = called(command, directory, *more.get(command, []))
    assert (result.exit_code, result.stdout) == (2, "")
    assert f"{directory}: damaged campaign directory" in result.stderr


def test_export_does_without_campaign_file(directory, tmp_path):
    (directory / "campaign.vast").write_bytes(b"")
    assert called("export", directory, tmp_path / "out").exit_code == 0


OTHER_METADATA = {
    "list indices must be integers": (["code", "observe"], []),
    "has no 'files'": (["code", "judge"], {"libraries": {}}),
    "has no 'changed'": (["oracles", 0, "source"], "changed"),
    "no attribute 'values'": (["producers"], [1]),
    "asked.only": (["asked", "only"], 5),
}


@pytest.mark.parametrize(("words", "steps", "value"), [(name, *each) for name, each in OTHER_METADATA.items()])
def test_past_rejects_metadata_that_can_not_be_compared(directory, words, steps, value):
    file = directory / "metadata.json"
    metadata = json.loads(file.read_text())
    *above, last = steps
    part = metadata
    for step in above:
        part = part[step]
    part[last] = value
    file.write_text(json.dumps(metadata))
    with pytest.raises(UnusableDirectory, match=rf"damaged campaign directory: .*{words}"):
        past_of(directory)
    assert newest_past(directory.parent, "small_room") is None


CONFIGURATIONS = "configurations.parquet"
OTHER_ROWS = [
    (CONFIGURATIONS, "scenario", "[1]"),
    (CONFIGURATIONS, "provenance", "{"),
    (CONFIGURATIONS, "steps", '[{"producer": 1, "keys": ["a"]}]'),
]


@pytest.mark.parametrize(("file", "column", "value"), OTHER_ROWS)
def test_past_rejects_rows_that_can_not_be_compared(directory, file, column, value):
    if file == "runs.parquet":
        pq.write_table(pa.table({"configuration": ["room-1"], "run_index": [0]}), directory / file)
    table = pq.read_table(directory / file)
    values = pa.array([value] * len(table))
    pq.write_table(table.set_column(table.schema.get_field_index(column), column, values), directory / file)
    with pytest.raises(UnusableDirectory, match="damaged campaign directory: "):
        past_of(directory)


@pytest.mark.parametrize("error", [pa.ArrowNotImplementedError, pa.ArrowKeyError, TypeError, OSError])
@pytest.mark.parametrize("command", ["show", "compare", "plan", "plan --since"])
def test_commands_report_damaged_table(directory, small_room, tmp_path, monkeypatch, command, error):
    def damaged(*_, **__):
        raise error("a page of another kind")

    monkeypatch.setenv("VASTFLOW_STORE", str(tmp_path / "store"))
    monkeypatch.setattr(pq, "ParquetFile", damaged)
    more = {"compare": [directory, directory], "plan --since": [directory, small_room]}
    result = called(*command.split(), *more.get(command, [directory]))
    assert (result.exit_code, result.stdout) == (2, "")
    assert f"{directory}: damaged campaign directory: configurations.parquet: can't be read: a page" in result.stderr


@pytest.mark.parametrize(
    ("file", "column"), [(CONFIGURATIONS, "name"), (CONFIGURATIONS, "family"), ("verdicts.parquet", "oracle")]
)
@pytest.mark.parametrize("command", ["show", "export"])
def test_commands_refuse_numbers_in_columns_of_text(directory, tmp_path, command, file, column):
    table = pq.read_table(directory / file)
    numbers = pa.array([7] * len(table))
    pq.write_table(table.set_column(table.schema.get_field_index(column), column, numbers), directory / file)
    more = ["--only", "room"] if command == "export" else []
    result = called(command, directory, *([tmp_path / "out"] * (command == "export")), *more)
    assert (result.exit_code, "Traceback" in result.stderr) == (2, False)
    assert f"column {column}: expected text, got int64" in result.stderr


@pytest.mark.parametrize("command", ["plan", "run"])
def test_commands_refuse_invalid_number_of_runs(directory, tmp_path, monkeypatch, command):
    monkeypatch.setenv("VASTFLOW_STORE", str(tmp_path / "store"))
    metadata = json.loads((directory / "metadata.json").read_text())
    metadata["asked"]["runs"] = "many"
    (directory / "metadata.json").write_text(json.dumps(metadata))
    result = called(command, directory)
    assert result.exit_code == 2
    assert "metadata.json: asked.runs: Input should be a valid integer" in result.stderr
