"""Proofs in short: threads, mutants of every kind of file, machines that lack something, and the pipeline's benchmark."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import environment
import fuzz
import pytest
import threads
from bench_cluster import measured
from bench_pipeline import SCENARIO, bench_pipeline, campaign_text

from vastflow.flows import run_campaign
from vastflow.sim.scenario.language import declaring, grammar

MUTANTS = {
    "vast": 25,
    "osc": 40,
    "fpm": 40,
    "variation": 30,
    "map": 100,
    "picture": 150,
    "nav2": 40,
    "notebook": 150,
    "directory": 12,
}


@pytest.mark.parametrize("way", ["threads", "asyncio.to_thread"])
def test_threads_load_shared_plug_ins_and_scenarios_without_failures(tmp_path, monkeypatch, way):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    grammar._parser.cache_clear()
    declaring._library.cache_clear()
    assert not threads.failures(tmp_path, threads.read, threads.WAYS[way], rounds=3)


@pytest.mark.timeout(300)
def test_prefect_tasks_load_shared_plug_ins_without_failures(tmp_path, started_api):
    with started_api(tmp_path / "prefect", tmp_path / "log"):
        assert not threads.failures(tmp_path, threads.read, threads.WAYS["Prefect tasks"], rounds=2)


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
    for number, said, cpu_s in fuzz.read_here(kind, range(MUTANTS[name]), 1, folder):
        count.add(said if said in ("accepted", "refused") else f"{name} {number}: {said}", cpu_s)
    assert count.violations == []
    assert count.slowest_s < fuzz.MOST_CPU_S
    assert min(count.accepted, count.refused) > 0  # neither are all refused nor is all accepted


def test_fuzz_finds_files_neither_accepted_nor_refused(folder):
    def read(file):
        raise (KeyError, MemoryError, SystemExit)[file.stat().st_size % 3]("key")

    (kind,) = (kind for kind in fuzz.kinds(folder) if kind.name == "map")
    broken = fuzz.replace(kind, read=read)
    assert all("Error" in said or "Exit" in said for _, said, _ in fuzz.read_here(broken, range(5), 1, folder))
    silent = fuzz.replace(kind, read=lambda file: (_ for _ in ()).throw(kind.refusals[0]("somewhere")))
    assert all("does not name the file" in said for _, said, _ in fuzz.read_here(silent, range(5), 1, folder))


def _may_unshare() -> bool:
    tools = all(map(shutil.which, ("unshare", "setpriv", "mount")))
    return tools and os.geteuid() == 0 and subprocess.run(["unshare", "-m", "true"], check=False).returncode == 0


needs_namespaces = pytest.mark.skipif(not _may_unshare(), reason="needs root and mount namespaces")


@needs_namespaces
@pytest.mark.slow
@pytest.mark.parametrize("name", ["read-only home", "no /dev/shm", "another user's store"])
def test_defect_of_the_machine_is_reported_in_one_sentence(tmp_path_factory, name):
    lab = environment.Lab(tmp_path_factory.mktemp("lab"))
    pytests_own = 2 + ("PYTEST_XDIST_WORKER" in os.environ)  # which are for its user alone
    for parent in lab.folder.parents[:pytests_own]:
        parent.chmod(0o755)
    lab.laid_out()
    (condition,) = (condition for condition in environment.CONDITIONS if condition.name == name)
    as_nobody = ["setpriv", "--reuid", "65534", sys.executable, "-c", ""]
    if condition.user and subprocess.run(as_nobody, check=False).returncode:
        pytest.skip("another user may not run this Python")
    assert environment.refused(condition, lab) is None


@needs_namespaces
def test_environment_proof_detects_unexpected_sentence(tmp_path):
    lab = environment.Lab(tmp_path)
    lab.laid_out()
    condition = environment.Condition("a file", "touch LAB/file", "never said", results="file")
    assert "it says" in (environment.refused(condition, lab) or "")


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
