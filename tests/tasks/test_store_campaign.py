"""Whole campaigns over a store on S3, with a real Prefect, worker processes, and a server that dies."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from room import SHORT_DRIVES, drawn_room

from vastflow.flows import run_campaign
from vastflow.flows.run import flow_call, prepared
from vastflow.tasks.keys.source import installed_tree
from vastflow.tasks.store.remote_files import RemoteFiles
from vastflow.tasks.store.store import StoreError, open_store

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]

CONFIGURATIONS = 2


@pytest.fixture
def file(tmp_path, monkeypatch, prefect_home):
    """The campaign's file; its map and Prefect's home are beside it."""
    drawn_room(tmp_path, 60)
    (tmp_path / "remote.vast").write_text(SHORT_DRIVES.replace("NAME", "remote"))
    monkeypatch.setenv("PREFECT_HOME", str(prefect_home(tmp_path / "prefect")))
    monkeypatch.delenv("PREFECT_API_URL", raising=False)
    tree = installed_tree()
    monkeypatch.setattr(prepared, "installed_tree", lambda: tree)
    return tmp_path / "remote.vast"


class KillsAfter:
    """Kills a server once so many runs have been executed."""

    def __init__(self, server, runs):
        self.server, self.runs = server, runs

    def update(self, progress):
        if self.server is not None and progress.executed >= self.runs:
            self.server.kill()
            self.server = None


def test_campaign_on_s3_resumes_after_server_outage(file, tmp_path, start_s3, s3_variables, monkeypatch):
    server = start_s3()
    s3_variables(server)
    monkeypatch.setattr(RemoteFiles, "local", tmp_path / "local")
    monkeypatch.delenv("XDG_CACHE_HOME")  # where the compiled kernels are that other tests have used

    def run(runs, **options):
        return run_campaign(
            file, results=tmp_path / "results", store="s3://bucket/store", runs=runs, workers=2, **options
        )

    with pytest.raises(StoreError, match=rf"store: can't use 's3://bucket/store' .*{server.url}"):
        run(200, observer=KillsAfter(server, 10))
    assert list((tmp_path / "results").glob("[!.]*")) == []
    server.start()

    found = run(200)
    assert found.faults == ()
    assert found.summary.reused >= 10
    assert found.summary.executed + found.summary.reused == 200 * CONFIGURATIONS

    def refuse(*_):
        raise AssertionError("Prefect was started")

    monkeypatch.setattr(flow_call, "ApiServer", refuse)
    again = run(200)
    assert (again.summary.executed, again.summary.reused) == (0, 200 * CONFIGURATIONS)
    recordings = [(result.directory / "recordings" / "room-1.parquet").read_bytes() for result in (found, again)]
    assert recordings[0] == recordings[1]


STEPS = """
version: 1
metadata: {{name: {name}}}
configuration:
- name: crossed
  variations:
  - ParameterVariationList: {{name: first, values: {values}}}
  - ParameterVariationList: {{name: second, values: [1, 2, 3, 4]}}
execution: {{scenario_file: steps.osc, runs: {runs}, timeout: 10}}
"""
STEPS_OSC = """
import osc.helpers

scenario steps:
    first: int
    second: int
    do serial:
        log("first")
        wait elapsed(0.2s)
"""


@pytest.fixture
def digests(monkeypatch):
    """Name to digest of a campaign directory's files, without what says how they were computed."""
    monkeypatch.syspath_prepend(Path(__file__).parents[1] / "proofs")
    import killed_outcome

    yield killed_outcome.digests
    del sys.modules["killed_outcome"]


@pytest.fixture
def begun(tmp_path, kernels, s3, prefect_home):
    """Begins a campaign in a process and with a Prefect of its own; at the end none is left."""
    (tmp_path / "cache" / "vastflow").mkdir(parents=True)
    (tmp_path / "cache" / "vastflow" / "kernels").symlink_to(kernels)
    processes = []

    def begin(name, file, store, workers):
        kept = {variable: value for variable, value in os.environ.items() if not variable.startswith("PREFECT_")}
        options = ["--results", tmp_path / name, "--store", store, "--workers", workers]
        processes.append(
            subprocess.Popen(
                [str(each) for each in (sys.executable, "-m", "vastflow.flows.cli", "run", file, *options)],
                env={**kept, "PREFECT_HOME": str(prefect_home(tmp_path / f"prefect-{name}"))},
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                text=True,
            )
        )
        return processes[-1]

    yield begin
    for process in processes:
        process.kill()
        process.wait(10)


def ended_well(*processes):
    said = [process.communicate(timeout=300)[1] for process in processes]
    assert [process.returncode for process in processes] == [0] * len(processes), said


def test_concurrent_campaigns_on_one_s3_store_equal_single_ones(tmp_path, s3, shared_s3, begun, digests):
    # They have most runs in common, and cut them into other blocks: each meets what the other is just writing.
    (tmp_path / "steps.osc").write_text(STEPS_OSC)
    values, runs, workers = {"many": [1, 2, 3, 4], "long": [3, 4, 5]}, {"many": 6, "long": 9}, {"many": 1, "long": 2}
    files = {name: tmp_path / f"{name}.vast" for name in values}
    for name, file in files.items():
        file.write_text(STEPS.format(name=name, values=values[name], runs=runs[name]))
    ended_well(*(begun(f"{name}-alone", files[name], tmp_path / f"store-{name}", workers[name]) for name in files))
    ended_well(*(begun(f"{name}-both", files[name], s3, workers[name]) for name in files))

    for name in files:
        (alone,), (both,) = ((tmp_path / f"{name}-{how}").iterdir() for how in ("alone", "both"))
        assert len(pq.read_table(both / "runs.parquet")) == 4 * len(values[name]) * runs[name]
        assert digests(both) == digests(alone)
        damaged = re.findall(r"(\S+) is damaged", (both / "logs" / "campaign.log").read_text())
        assert {f"{s3}/{key}" for key in damaged} <= shared_s3.lost
    store = open_store(s3)
    # A file that the server lost of two writers, and that no campaign read since, is still missing.
    faulty = {f"{s3}/{holding.key}" for holding in store.holdings() if store.fault(holding.key)}
    assert faulty <= shared_s3.lost
