"""Proofs in short: mutants of every kind of file, strangers' campaigns, and the pipeline's benchmark."""

import json
import sys

import bench_cluster
import fuzz
import pytest
import strangers
from bench_pipeline import SCENARIO, bench_pipeline, campaign_text
from killed_outcome import differing, digests
from mutants import laid_out

from vastflow.flows import run_campaign

MUTANTS = {"campaign file": 25, "scenario file": 40, "floor plan": 40, "floor plan variation": 30, "map": 100}
MUTANTS |= {"map picture": 150, "Nav2 parameter file": 40, "notebook": 150, "directory": 24, "recording": 24}
MUTANTS |= {"explorer directory": 40, "explorer events": 25, "store manifest": 60}


@pytest.fixture(scope="module")
def kinds(tmp_path_factory):
    return laid_out(tmp_path_factory.mktemp("mutants"))


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("name", MUTANTS)
def test_mutant_is_read_or_refused_in_a_sentence(kinds, tmp_path, monkeypatch, name):
    monkeypatch.setenv("VASTFLOW_STORE", str(tmp_path / "store"))
    count = fuzz.watched(name, kinds[name], range(MUTANTS[name]), 0)
    assert count.violations == []
    assert count.accepted + count.refused == MUTANTS[name]
    assert count.refused > 0 or name == "store manifest"  # what is damaged there is computed again


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_looking_at_campaign_of_a_stranger_executes_nothing(capsys):
    with pytest.raises(SystemExit, match="False"):
        strangers.main()
    assert "0 executed in all" in capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_pipeline_executes_everything_once_and_one_configuration_after_an_edit():
    found = bench_pipeline(configurations=6, runs=2)
    assert (found["configurations"], found["runs"], found["executed"]) == (6, 12, 12)
    assert (found["rerun_executed"], found["edit_executed"]) == (0, 2)
    assert found["task_runs"] == found["task_runs_final"] > 0
    assert found["edit_task_runs"] == 3, "the shard of the edited configuration, through three stages"
    assert found["cpu_s"] > found["overhead_cpu_s"] > 0 < found["flow_peak_mb"]


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
    assert 'id="maps"' not in (edited.directory / "report.html").read_text(), "no robot drives"
    assert differing(digests(edited.directory), digests(run("other", "nothing").directory)) == ""


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_workers_of_cluster_are_busy_with_units_of_seconds(capsys, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["bench_cluster.py", "--slots", "8", "--seconds", "20", "--json"])
    bench_cluster.main()
    (found,) = json.loads(capsys.readouterr().out)
    assert (found["slots"], found["units"]) == (8, 160)
    assert found["efficiency"] > 0.5, "on a machine that others use"
