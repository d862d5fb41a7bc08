"""Campaign directories of 0.2, whose tables say `judgement`: they open, show, compare, gate, replay, and export as those of today."""

import json
import shutil
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from command_line import called
from explored import TOKEN, explorer_of
from table import each_row

import vastflow
from vastflow.deployments.explorer.directories import Directories
from vastflow.oracles.judgment.verdict import Verdict
from vastflow.oracles.results.coverage import read_coverage
from vastflow.oracles.results.events import EventReader
from vastflow.oracles.results.former import FORMER
from vastflow.oracles.results.tables import read_tables

FOLDER = Path(__file__).parents[1] / "golden" / "written_by_0_2"
NAMES = ("tiny", "sought")


@pytest.fixture
def former(tmp_path):
    """The kept directories in a folder of their own."""
    return Path(shutil.copytree(FOLDER, tmp_path / "former"))


@pytest.fixture
def present(tmp_path):
    """The same, as they would be written today."""
    folder = Path(shutil.copytree(FOLDER, tmp_path / "present"))
    for file in folder.glob("*/verdicts.parquet"):
        table = pq.read_table(file)
        pq.write_table(table.rename_columns([FORMER.get(name, name) for name in table.column_names]), file)
    for file in (*folder.glob("*/coverage.json"), *folder.glob("*/events.jsonl")):
        text = file.read_text()
        for before, now in FORMER.items():
            text = text.replace(f'"{before}"', f'"{now}"')
        file.write_text(text)
    return folder


def test_kept_directories_have_former_names():
    for name in NAMES:
        assert "judgement" in pq.read_schema(FOLDER / name / "verdicts.parquet").names
        assert '"realised"' in (FOLDER / name / "coverage.json").read_text()
        assert '"judgement"' in (FOLDER / name / "events.jsonl").read_text()
        assert "schema" not in json.loads((FOLDER / name / "metadata.json").read_text())


@each_row(
    "arguments",
    [
        ("show", "tiny"),
        ("show", "sought"),
        ("show", "tiny", "--coverage"),
        ("show", "tiny", "--json"),
        ("show", "tiny", "--follow"),
        ("show", "tiny", "--lineage", "paths-1-2/0"),
        ("compare", "tiny", "tiny"),
        ("compare", "tiny", "tiny", "--gate", "--margin", "0.9"),
        ("plan", "tiny", "--why", "--trust"),
    ],
)
def test_command_answers_for_former_directory_as_for_present(arguments, former, present):
    said = []
    for folder in (former, present):
        result = called(
            *(folder / each if each in NAMES else each for each in arguments), VASTFLOW_STORE=str(folder / "store")
        )
        assert result.exit_code in (0, 130) and "damaged" not in result.output, result.output
        said.append(result.output.replace(str(folder), "FOLDER"))
    assert said[0] == said[1] and len(said[0]) > 60


@each_row("form", ["vast", "junit", "csv"])
def test_export_of_former_directory_equals_that_of_present(form, former, present):
    files = []
    for folder in (former, present):
        result = called("export", folder / "tiny", folder / form, "--format", form)
        assert result.exit_code == 0, result.output
        found = (file for file in (folder / form).rglob("*") if file.is_file())
        files.append({file.relative_to(folder).as_posix(): file.read_bytes() for file in found})
    assert files[0] == files[1] and files[0]


def test_former_run_replays_bit_for_bit(former, tmp_path):
    result = called("replay", former / "tiny", "paths-1-1", 0, "--at", 1, "--out", tmp_path / "out", "--trust")
    assert "equal to the recording bit for bit" in result.output, result.output


def test_former_tables_open_from_python(former):
    results = vastflow.open(former / "tiny")
    counts = results.summary
    assert (counts.passed, counts.failed, counts.not_judged) == (2, 4, 2)
    assert results.frame()["passed.near.py:Near"].sum() == 5
    tables = read_tables(former / "tiny")
    assert tables.verdicts.counts(None).sum(axis=0).tolist() == [2, 4, 2]
    assert read_coverage(former / "tiny")["families"]["paths"]["unrealizable"] == 2
    events = [event for event in EventReader(former / "tiny").new() if event.event == "verdicts"]
    assert {event.values["judgment"] for event in events} == {"pass", "fail", "not judged"}


def test_explorer_shows_former_directories(former):
    shutil.copytree(former / "tiny", former / "again")
    client = explorer_of(former)
    client.get("/", params={"token": TOKEN})
    assert "tiny" in (page := client.get("/").text) and "sought" in page
    ids = {each.path.name: each.id for each in Directories([former]).all()}
    for name, configuration in (("tiny", "paths-1-2"), ("sought", "point-0001")):
        of = {"c": ids[name]}
        for address, more in (
            ("/campaign", {}),
            ("/configuration", {"name": configuration}),
            ("/run", {"configuration": configuration, "run": 0}),
            ("/api/frames", {"configuration": configuration, "run": 0}),
        ):
            reply = client.get(address, params={**of, **more})
            assert reply.status_code == 200, (address, reply.text[:500])
    assert client.get("/compare", params={"a": ids["tiny"], "b": ids["again"]}).status_code == 200


def test_verdict_takes_former_name_of_judgment_and_warns():
    with pytest.warns(DeprecationWarning, match="judgement' goes with the next version. It is 'judgment' now") as told:
        verdict = Verdict("own", 0, judgement="pass")
    assert told[0].filename == __file__ and verdict == Verdict("own", 0, "pass")
    with pytest.warns(DeprecationWarning, match="Verdict: 'judgement' goes"):
        assert verdict.judgement == "pass"
    with pytest.raises(TypeError, match="judgment"):
        Verdict("own", 0, "pass", judgement="fail")
