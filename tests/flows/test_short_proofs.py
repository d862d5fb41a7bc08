"""Proofs in short: mutants of every kind of file, and the pipeline's benchmark."""

import json
import resource
import sys
import time

import bench_cluster
import psutil
import pytest
from bench_pipeline import SCENARIO, bench_pipeline, campaign_text
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from killed_outcome import differing, digests
from mutants import laid_out
from typer.testing import CliRunner

from vastflow.flows import run_campaign
from vastflow.flows.cli.__main__ import app

MUTANTS = {"vast": 25, "osc": 40, "fpm": 40, "variation": 30, "map": 100, "picture": 150, "nav2": 40, "notebook": 150}
MUTANTS |= {"directory": 12}
MOST_CPU_S = 10.0
MOST_BYTES = 2**30


@pytest.fixture(scope="module")
def kinds(tmp_path_factory):
    return laid_out(tmp_path_factory.mktemp("mutants"))


@pytest.fixture
def little_memory():
    """Memory for `MOST_BYTES` more than this process has."""
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (psutil.Process().memory_info().vms + MOST_BYTES, hard))
    yield
    resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


@pytest.mark.slow
@pytest.mark.parametrize("name", MUTANTS)
def test_mutant_is_accepted_or_refused_with_its_file(kinds, little_memory, tmp_path, monkeypatch, name):
    """More mutants of any seed: `--hypothesis-profile=other --hypothesis-seed=N`."""
    monkeypatch.setenv("VASTFLOW_STORE", str(tmp_path / "store"))
    codes = set()

    @settings(max_examples=MUTANTS[name], phases=[Phase.generate])
    @given(st.randoms(use_true_random=True))
    def read(rng):
        file = kinds[name].mutant(rng)
        command = [str(each) for each in kinds[name].command(file, rng)]
        began_s = time.process_time()
        result = CliRunner().invoke(app, command)
        assert time.process_time() - began_s < MOST_CPU_S
        if result.exception is not None and not isinstance(result.exception, SystemExit):
            raise result.exception
        said = " ".join(result.stderr.split())
        assert result.exit_code in (0, 2) and "Traceback" not in said
        assert result.exit_code == 0 or file.name in said or (name == "directory" and str(file.parent) in said)
        codes.add(result.exit_code)

    read()
    assert codes == {0, 2}, "neither are all refused nor is all accepted"


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
