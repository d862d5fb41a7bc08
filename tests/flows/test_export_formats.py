"""Export formats as plug-ins: found by name or in a file, held to one contract."""

import re
import shutil
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from command_line import called, refused
from table import each_row
from whole_directory import ConfigurationResult, write_results

from vastflow.flows.export.conformance import CHECKS, sample_campaigns
from vastflow.flows.export.export import ExportSource
from vastflow.flows.export.format import Format, format_of
from vastflow.oracles.judgment.verdict import Verdict
from vastflow.sim.model.archive import write_outputs
from vastflow.sim.model.blocks import write_recordings
from vastflow.sim.model.faults import UserError
from vastflow.sim.model.recording import Outputs, Recording, Run
from vastflow.sim.plug_ins.snapshot import snapshot_of

NAMES = """from vastflow.plugins import ExportedCampaign, Format


class Names(Format):
    def files(self, campaign: ExportedCampaign):
        yield "names.txt", "".join(f"{each.name}: {len(list(each.runs))}\\n" for each in campaign.configurations).encode()
        yield from campaign.files.items()
"""


@pytest.fixture
def results(small_room, tmp_path):
    verdicts = [Verdict("success", 0, "pass"), Verdict("success", 1, "fail", "mission aborted")]
    outputs = Outputs({"positions": {"t": np.array([0.5, np.nan])}}, {"notes/read.me": b"\x00\xff"})
    row = Run(0, "7", "succeeded", 0, "", 7.5, 5.0, 0, 0)
    found = ConfigurationResult(
        recordings=[write_recordings([Recording(row, {"t_ms": np.array([0, 100], dtype=np.int32)})])],
        verdicts=verdicts,
        outputs=[write_outputs({0: outputs})],
    )
    return write_results(small_room, tmp_path / "results", found, oracles=("success",)).directory


def contents(folder):
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_export_writes_files_of_its_format_into_folders_of_runs(results, tmp_path):
    for name in ("vast", "junit", "csv"):
        said = called("export", results, tmp_path / name, "--format", name).stdout
        assert said.startswith("2 configurations; 4 runs: 2 passed, 2 failed\n")
    everything, report, tables = (contents(tmp_path / name) for name in ("vast", "junit", "csv"))
    assert report == {"test.xml": everything["junit.xml"]}
    outside = {name: content for name, content in everything.items() if name.endswith(".csv")}
    for k in (1, 2):
        assert outside.pop(f"room-{k}/0/outputs/positions.csv") == outside[f"room-{k}/0/positions.csv"]
    assert tables == outside
    assert "room-1/0/positions.csv" in tables


def test_format_in_a_file_is_exported_by_its_class(results, tmp_path, monkeypatch):
    (tmp_path / "names.py").write_text(NAMES)
    monkeypatch.chdir(tmp_path)
    called("export", results, "out", "--format", "names.py:Names", "--only", "*-2")
    found = contents(tmp_path / "out")
    assert found.pop("names.txt") == b"room-2: 2\n"
    assert {"campaign.vast", "room.pgm", "room.yaml"} <= found.keys()


@each_row(
    ("name", "words"),
    [
        ("junitt", "Unknown format 'junitt'. Did you mean 'junit'?"),
        ("names.py:Gone", r"'names.py' has no class 'Gone'. "),
        ("names.py:ExportedCampaign", "'names.py:ExportedCampaign' is not a format. Expected a subclass of .*Format"),
        ("breaks.py:Breaks", r"'breaks.py:Breaks' can't be imported: ZeroDivisionError: division by zero"),
    ],
)
def test_format_is_refused_in_a_sentence(results, tmp_path, monkeypatch, name, words):
    (tmp_path / "names.py").write_text(NAMES)
    (tmp_path / "breaks.py").write_text("1 / 0\n")
    monkeypatch.chdir(tmp_path)
    assert re.match(words, refused("export", results, "out", "--format", name))
    assert not (tmp_path / "out").exists()


@each_row(
    ("line", "words"),
    [
        ('yield "../away", b""', "expected a path inside the folder, got '../away'"),
        ("raise KeyError('x')", "Format 'Own' raised KeyError. 'x'"),
        ("raise SystemExit(0)", "Format 'Own' raised PlugInExit. Its code raised SystemExit(0)"),
    ],
)
def test_format_that_breaks_while_it_writes_leaves_nothing(results, tmp_path, monkeypatch, line, words):
    (tmp_path / "own.py").write_text(
        f'from vastflow.plugins import Format\n\nclass Own(Format):\n    def files(self, campaign):\n        yield "a", b""\n        {line}\n'
    )
    monkeypatch.chdir(tmp_path)
    assert words in refused("export", results, "out", "--format", "own.py:Own")
    assert not (tmp_path / "out").exists() and not (tmp_path / "away").exists()


@pytest.mark.parametrize("name", ["csv", "junit", "vast"])
@pytest.mark.parametrize("check", CHECKS)
def test_own_formats_keep_the_contract(name, check):
    check(format_of(name, Path()))


def test_samples_have_columns_of_a_campaign_directory(results):
    (run,) = [run for each in sample_campaigns()[1].configurations for run in each.runs if run.recorded]
    rows = [{*pq.read_schema(results / f"{table}.parquet").names} for table in ("runs", "verdicts")]
    assert [{*run.row}, {*run.verdicts[0]}] == rows


class Own(Format):
    """Does what `do` yields of a campaign, and counts its calls."""

    def __init__(self, do):
        self.calls = 0
        self.do = do

    def files(self, campaign):
        self.calls += 1
        return self.do(self, campaign)


def change(own, campaign):
    for each in campaign.configurations:
        for run in each.runs:
            run.outputs.clear()
    return iter(())


@each_row(
    ("check", "do", "words"),
    [
        ("check_files", lambda own, campaign: iter([("/a", b"")]), r"must yield a path inside the folder, got '/a'"),
        ("check_files", lambda own, campaign: iter([("a/../b", b"")]), "must yield a path inside the folder"),
        ("check_files", lambda own, campaign: iter([("a", "text")]), "must yield bytes or the path of a file for 'a'"),
        ("check_files", lambda own, campaign: iter([("a", Path("gone"))]), "must yield bytes or the path of a file"),
        ("check_files", lambda own, campaign: iter([("a", b""), ("./a", b"")]), r"must yield './a' once"),
        ("check_files", lambda own, campaign: iter([("a", b""), ("a/b", b"")]), r"files at \['a'\], which are folders"),
        ("check_files", lambda own, campaign: [campaign.configurations[0]], "must not raise, and raised IndexError"),
        ("check_determinism", lambda own, campaign: [("a", bytes(own.calls))], "must yield the same files"),
        ("check_files", change, "must not raise, and raised AttributeError"),
    ],
)
def test_conformance_finds_a_format_that_breaks_the_contract(check, do, words):
    (found,) = [each for each in CHECKS if each.__name__ == check]
    with pytest.raises(AssertionError, match=words):
        found(Own(do))


def test_format_without_a_name_or_file_is_a_user_error():
    with pytest.raises(UserError, match="Unknown format ''"):
        format_of("", Path())


def test_exported_rule_of_own_file_is_its_name(results, tmp_path):
    inputs = shutil.copytree(results, tmp_path / "copy") / "inputs"
    inputs.mkdir(exist_ok=True)
    (inputs / "pacer.py").write_text("class Pacer:\n    pass\n")
    source = ExportSource(inputs.parent)
    rule = [{"file": snapshot_of(inputs / "pacer.py", inputs).digest}, "Pacer"]
    scenario = {"environment": {"movers": [{"rule": rule}]}, "task": {}, "system": {}}
    assert source.values_of({"scenario": scenario}) == {"movers": [{"rule": "pacer.py:Pacer"}]}
