"""Damaged campaign directories: a sentence with the file, never a traceback."""

import json
from datetime import datetime

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from typer.testing import CliRunner
from whole_directory import ConfigurationResult, write_results

from vastflow.flows.__main__ import app
from vastflow.flows.request.campaign_file import read_campaign
from vastflow.flows.request.run_request import Asked
from vastflow.flows.results.inputs import inputs_of
from vastflow.flows.results.past import newest_past, past_of
from vastflow.flows.results.provenance import ingredients_row
from vastflow.flows.results.summary import Work
from vastflow.oracles.judgement.verdict import Verdict
from vastflow.oracles.results.unusable import UnusableDirectory
from vastflow.producers.instantiation.instantiate import instantiate
from vastflow.tasks.keys.keys import Keys
from vastflow.tasks.keys.source import installed_tree


@pytest.fixture
def directory(small_room, tmp_path):
    """A campaign directory without recordings."""
    campaign, oracles = read_campaign(small_room)
    results = write_results(
        tmp_path / "results",
        campaign,
        inputs_of(campaign, oracles),
        instantiate(campaign),
        lambda configuration: ConfigurationResult(verdicts=[Verdict("success", k, "pass") for k in range(2)]),
        runs=2,
        oracles=["success"],
        keys=Keys("x86_64; glibc 2.36; ; ", "e" * 64, "o" * 64, "j" * 64, 0, []),
        record={
            "asked": Asked("room.vast", 2).as_json(),
            **ingredients_row(installed_tree(), campaign.families, oracles),
        },
        created=datetime(2026, 11, 21, 6, 5, 4),
        work=lambda: Work(4, 0, 30.0, 2.0, 1.5),
        report=lambda place: None,
    )
    return results.directory


def called(*arguments):
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


DAMAGES = {
    "a list": b"[]",
    "an empty map": b"{}",
    "null": b"null",
    "no JSON": b"{",
    "counts that are none": json.dumps({"name": "n", "created": "now", "counts": 4, "asked": 5}).encode(),
}


@pytest.mark.parametrize("content", DAMAGES.values(), ids=DAMAGES)
@pytest.mark.parametrize("command", ["show", "export", "compare", "plan"])
def test_metadata_that_is_none_is_said_in_a_sentence(directory, tmp_path, monkeypatch, command, content):
    monkeypatch.setenv("VASTFLOW_STORE", str(tmp_path / "store"))
    (directory / "metadata.json").write_bytes(content)
    more = {"export": [tmp_path / "out"], "compare": [directory], "plan": ["room-1"]}
    result = called(command, directory, *more.get(command, []))
    assert (result.exit_code, result.stdout) == (2, "")
    assert f"{directory}: damaged campaign directory" in result.stderr


def test_export_does_without_what_the_campaign_file_says_of_its_scenario(directory, tmp_path):
    (directory / "campaign.vast").write_bytes(b"")
    assert called("export", directory, tmp_path / "out").exit_code == 0


def test_plan_says_why_it_can_not_tell_what_a_run_would_do(directory, tmp_path, monkeypatch):
    monkeypatch.setenv("VASTFLOW_STORE", str(tmp_path / "store"))
    (directory / "campaign.vast").unlink()
    result = called("plan", directory, "room-1")
    assert result.exit_code == 0, result.output
    said = " ".join(result.stdout.split())
    assert "what a run of it would do today can't be told" in said and "campaign.vast" in said


def test_whole_directory_is_a_past(directory):
    assert list(past_of(directory).by_name) == ["room-1", "room-2"]
    assert newest_past(directory.parent, "small_room").directory == directory


OTHER_METADATA = {
    "name": (["name"], 7),
    "created": (["created"], 20261121),
    "numeric_class": (["numeric_class"], 4),
    "seed": (["seed"], "none"),
    "code.observe": (["code", "observe"], []),
    "code.judge.files": (["code", "judge"], {"libraries": {}}),
    "code.execute.libraries.numpy": (["code", "execute", "libraries", "numpy"], 2),
    "code: has no changed": (["oracles", 0, "source"], "changed"),
    "oracles.0.name": (["oracles", 0, "name"], None),
    "oracles": (["oracles"], {}),
    "producers": (["producers"], [1]),
    "asked.runs": (["asked", "runs"], "2"),
    "asked.only": (["asked", "only"], 5),
}


@pytest.mark.parametrize(("place", "steps", "value"), [(name, *each) for name, each in OTHER_METADATA.items()])
def test_past_rejects_metadata_of_another_kind_with_its_place(directory, place, steps, value):
    file = directory / "metadata.json"
    metadata = json.loads(file.read_text())
    *above, last = steps
    part = metadata
    for step in above:
        part = part[step]
    part[last] = value
    file.write_text(json.dumps(metadata))
    with pytest.raises(
        UnusableDirectory,
        match=rf"damaged campaign directory: metadata\.json: {place}(: Input should|: Field required|$)",
    ):
        past_of(directory)
    assert newest_past(directory.parent, "small_room") is None


OTHER_ROWS = {
    "scenario": "[1]",
    "provenance": "{",
    "steps": '[{"producer": 1, "keys": []}]',
    "abstract": None,
    "scenario_digest": None,
    "timeout_s": "soon",
}


@pytest.mark.parametrize(("column", "value"), OTHER_ROWS.items(), ids=OTHER_ROWS)
def test_past_rejects_rows_of_another_kind_with_their_place(directory, column, value):
    rewrite(directory / "configurations.parquet", column, value)
    with pytest.raises(UnusableDirectory, match=rf"damaged campaign directory: configurations\.parquet: 0\.{column}"):
        past_of(directory)


@pytest.mark.parametrize(
    ("column", "values"), [("configuration", [None]), ("run_index", ["first"]), ("run_index", [-1])]
)
def test_runs_that_are_none_are_no_past(directory, column, values):
    rows = {"configuration": ["room-1"], "run_index": [0], column: values}
    pq.write_table(pa.table(rows), directory / "runs.parquet")
    with pytest.raises(UnusableDirectory, match=rf"damaged campaign directory: runs\.parquet: 0\.{column}"):
        past_of(directory)


def test_table_without_its_columns_is_no_past(directory):
    pq.write_table(pa.table({"other": [1]}), directory / "runs.parquet")
    with pytest.raises(
        UnusableDirectory, match=r"damaged campaign directory: runs\.parquet: 0\.configuration: Field required"
    ):
        past_of(directory)


def rewrite(file, column, value):
    """Write a table anew with one value in all rows of a column."""
    table = pq.read_table(file)
    values = pa.array([value] * len(table))
    pq.write_table(table.set_column(table.schema.get_field_index(column), column, values), file)


PYARROW = (
    pa.ArrowNotImplementedError,
    pa.ArrowInvalid,
    pa.ArrowKeyError,
    pa.ArrowTypeError,
    pa.ArrowIndexError,
    OSError,
)


@pytest.mark.parametrize("error", PYARROW)
@pytest.mark.parametrize("command", ["show", "compare", "plan", "plan --since"])
def test_whatever_pyarrow_finds_in_a_damaged_table_is_said_in_a_sentence(
    directory, small_room, tmp_path, monkeypatch, command, error
):
    def damaged(*_, **__):
        raise error("a page of another kind")

    monkeypatch.setenv("VASTFLOW_STORE", str(tmp_path / "store"))
    monkeypatch.setattr(pq, "ParquetFile", damaged)
    more = {"compare": [directory, directory], "plan --since": [directory, small_room], "plan": [directory, "room-1"]}
    result = called(*command.split(), *more.get(command, [directory]))
    assert (result.exit_code, result.stdout) == (2, "")
    assert f"{directory}: damaged campaign directory: configurations.parquet: can't be read: a page" in result.stderr
