"""Proofs in short: mutants of every kind of file, and the pipeline's benchmark."""

import os
import re
from pathlib import Path

import fuzz
import pytest
import typer
from bench_cluster import measured
from bench_pipeline import SCENARIO, bench_pipeline, campaign_text

from vastflow.flows import run_campaign

FEW = {"vast": 25, "osc": 40, "fpm": 40, "variation": 30, "nav2": 40, "directory": 12}
MUTANTS = {**FEW, "map": 100, "picture": 150, "notebook": 150}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("fuzz")
    fuzz.laid_out(folder)
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("name", MUTANTS)
def test_mutant_is_accepted_or_refused_with_its_file(folder, monkeypatch, name):
    monkeypatch.setenv("VASTFLOW_STORE", str(folder / "store"))
    (kind,) = (kind for kind in fuzz.kinds(folder) if kind.name == name)
    count = fuzz.Count()
    for number, (said, cpu_s) in enumerate(fuzz.read_here(kind, range(MUTANTS[name]), 1, folder)):
        count.add(f"{name} {number}", said, cpu_s)
    assert count.violations == []
    assert min(count.accepted, count.refused) > 0  # neither are all refused nor is all accepted


def test_fuzz_finds_unnamed_files_raised_errors_and_ended_processes(folder, monkeypatch):
    for arguments in (["validate", "nothing.vast"], ["store", "info", "--stor"]):
        assert fuzz.answer(folder / "mutant.vast", arguments).startswith("the refusal does not name the file")
    broken = typer.Typer()
    broken.command()(lambda: {}["key"])
    with monkeypatch.context() as patch:
        patch.setattr(fuzz, "app", broken)
        assert "KeyError" in fuzz.answer(folder / "mutant.yaml", [])
    (kind,) = (kind for kind in fuzz.kinds(folder) if kind.name == "map")
    monkeypatch.setattr(fuzz, "answer", lambda file, arguments: os._exit(7))
    assert "the process ended with 7" in fuzz.watched(kind, range(1), 1, folder).violations[0]


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_pipeline_executes_everything_once_and_one_configuration_after_an_edit():
    found = bench_pipeline(configurations=6, runs=2)
    assert (found["configurations"], found["runs"], found["executed"]) == (6, 12, 12)
    assert (found["rerun_executed"], found["edit_executed"]) == (0, 2)
    assert found["task_runs"] == found["task_runs_final"] > 0
    assert found["edit_task_runs"] == 3, "the shard of the edited configuration, through three stages"
    assert found["cpu_s"] > found["overhead_cpu_s"] > 0 < found["flow_peak_mb"]


OF_A_CALL = {"metadata.json", "logs", ".files.json"}


def contents(directory: Path) -> dict[str, bytes]:
    """All files that follow from the campaign alone, the report without what it says of its call."""
    found = {}
    for file in sorted(directory.rglob("*")):
        if file.is_file() and file.relative_to(directory).parts[0] not in OF_A_CALL:
            content = file.read_bytes()
            if file.name == "report.html":
                for mark in (b"when", b"work"):
                    content = re.sub(b"(?s)<!-- %b -->.*?<!-- /%b -->" % (mark, mark), b"", content)
            found[file.relative_to(directory).as_posix()] = content
    return found


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_edited_campaign_equals_fresh_run(tmp_path, monkeypatch):
    monkeypatch.delenv("PREFECT_API_URL", raising=False)
    (tmp_path / "nothing.osc").write_text(SCENARIO)
    file = tmp_path / "nothing.vast"

    def run(store, results):
        return run_campaign(file, store=str(tmp_path / store), results=str(tmp_path / results), workers=1)

    file.write_text(campaign_text(24, 2, edited=0))
    assert run("store", "first").summary.executed == 48
    file.write_text(campaign_text(24, 2, edited=1))
    edited = run("store", "edited")
    assert (edited.summary.executed, edited.summary.reused) == (2, 46)
    assert contents(edited.directory) == contents(run("other", "nothing").directory)


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_workers_of_cluster_are_busy_with_units_of_seconds(tmp_path):
    found = measured(slots=8, ideal_s=10.0, folder=tmp_path)
    assert (found["slots"], found["units"]) == (8, 80)
    assert found["efficiency"] > 0.5, "on a machine that others use"
