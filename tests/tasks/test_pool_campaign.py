"""Campaigns whose shards a work pool computes: a real API, a real worker of type `process`, a real S3 server."""

import json
import os
import signal
import subprocess
import sys
import time

import pyarrow.parquet as pq
import pytest
from prefect.client.schemas.actions import WorkPoolCreate
from prefect.settings import temporary_settings
from typer.testing import CliRunner

from vastflow.flows import run_campaign
from vastflow.flows.__main__ import app
from vastflow.flows.request.work_pool import WorkPool
from vastflow.sim.model.faults import UserError
from vastflow.tasks.store.remote_files import RemoteFiles
from vastflow.tasks.store.store import open_store

pytestmark = [pytest.mark.slow, pytest.mark.timeout(580)]

END_S = 200

ROOM = """
version: 1
metadata: {name: pooled}
configuration:
  - name: room
    parameters:
      - map_file: ../maps/room.yaml
      - start_pose: {x: 1.0, y: 1.5, yaw: 0.0}
      - goal_pose: {x: 1.6, y: 1.5, yaw: 0.0}
    variations:
      - ParameterVariationList:
          name: laserscan_gaussian_noise_std_deviation
          values: [0.0, 0.01, 0.02]
execution: {runs: 2, timeout: 30}
evaluation:
  oracles:
    - own_oracle.py:Distance: {least_m: 0.1}
"""
ORACLE = """
from vastflow.oracles.judgement.oracle import Oracle, Parameters


class DistanceParameters(Parameters):
    least_m: float


class Distance(Oracle[DistanceParameters]):
    Parameters = DistanceParameters
    metrics = {"distance": "m"}

    def judge(self, trace, situation):
        distance_m = trace.run.distance_m
        if distance_m < self.parameters.least_m:
            return self.failed(trace, "did not move", distance=distance_m)
        return self.passed(trace, distance=distance_m)
"""

PROGRAMS = """
version: 1
metadata: {{name: programs}}
configuration:
  - name: step
    variations:
      - ParameterVariationList:
          name: command
          values: {commands}
execution: {{scenario_file: step.osc, runs: 1, timeout: 60, run_files: [step.py]}}
"""
SEARCH = """
version: 1
metadata: {name: sought}
search:
  strategy: random
  search_space: {x: {type: float, low: 1, high: 11}}
  per_batch: 2
  budget: [{batches: 2}]
  confirm: 2
execution: {scenario_file: wait.osc, runs: 1, timeout: 6}
"""
SLEEPS = """
version: 1
metadata: {name: asleep}
search:
  strategy: random
  search_space: {x: {type: float, low: 2, high: 3}}
  per_batch: 4
  budget: [{batches: 2}]
  confirm: 0
execution: {scenario_file: sleep.osc, runs: 1, timeout: 60}
"""
SLEEP_OSC = """
import osc.helpers

scenario sleep_x:
    x: string
    do serial:
        run_process('sleep ' + x)
"""
WAIT_OSC = """
import osc.helpers

scenario wait_x:
    timeout(6s)
    x: time
    do serial:
        wait elapsed(x)
"""
STEP_OSC = """
import osc.helpers

scenario step:
    command: string
    do serial:
        run_process(command)
"""
STEP = """
import os, pathlib, signal, sys, time
import psutil

number, place, how = int(sys.argv[1]), pathlib.Path(sys.argv[2]), sys.argv[3]
with open(place / "executed", "a") as executed:
    executed.write(f"{number}\\n")
marker = place / f"marker-{number}"
if how == "poison" or (how == "once" and not marker.exists()):
    marker.touch()
    flow_run = next(p for p in psutil.Process().parents() if any("prefect" in part for part in p.cmdline()))
    flow_run.kill()
    time.sleep(30)
if how == "slow":
    time.sleep(2)
"""


@pytest.fixture(scope="module")
def api(started_api, tmp_path_factory):
    """A client of an API of its own, with a pool `lab`."""
    folder = tmp_path_factory.mktemp("lab")
    with started_api(folder / "prefect", folder / "server.log") as client:
        client.create_work_pool(WorkPoolCreate(name="lab", type="process"))
        yield client


@pytest.fixture
def worker(api, started_worker, tmp_path):
    with started_worker(api, tmp_path / "worker") as process:
        yield process


@pytest.fixture
def room(tmp_path):
    """A campaign whose map lies beside its folder, with an oracle of its own."""
    side = 60
    cells = bytes(0 if x in (0, side - 1) or y in (0, side - 1) else 254 for y in range(side) for x in range(side))
    (tmp_path / "maps").mkdir()
    (tmp_path / "campaign").mkdir()
    (tmp_path / "maps" / "room.pgm").write_bytes(b"P5 %d %d 255\n" % (side, side) + cells)
    (tmp_path / "maps" / "room.yaml").write_text("{image: room.pgm, resolution: 0.05, origin: [0, 0, 0]}")
    (tmp_path / "campaign" / "own_oracle.py").write_text(ORACLE)
    (tmp_path / "campaign" / "room.vast").write_text(ROOM)
    return tmp_path / "campaign" / "room.vast"


@pytest.fixture
def programs(tmp_path):
    """Makes a campaign of programs, each given as `how` it behaves; they say outside of it that they were executed."""

    def made(*how):
        commands = [f"{sys.executable} step.py {k} {tmp_path} {each}" for k, each in enumerate(how)]
        (tmp_path / "step.osc").write_text(STEP_OSC)
        (tmp_path / "step.py").write_text(STEP)
        (tmp_path / "programs.vast").write_text(PROGRAMS.format(commands=json.dumps(commands)))
        return tmp_path / "programs.vast"

    return made


def executed(tmp_path):
    """Numbers of the programs that were started, as often as they were."""
    file = tmp_path / "executed"
    return sorted(map(int, file.read_text().split())) if file.exists() else []


def contents(directory):
    """Runs and verdicts of a campaign directory, byte for byte."""
    found = {
        str(file.relative_to(directory)): file.read_bytes()
        for folder in ("recordings", "traces", "environments")
        for file in sorted((directory / folder).rglob("*"))
        if file.is_file()
    }
    tables = {name: pq.read_table(directory / name) for name in ("runs.parquet", "verdicts.parquet")}
    return found, tables


def test_store_and_worker_need_not_be_on_one_machine(api, started_worker, room, kernels, tmp_path, s3, monkeypatch):
    monkeypatch.setattr(RemoteFiles, "local", tmp_path / "local")
    monkeypatch.delenv("XDG_CACHE_HOME")  # where the compiled kernels are that other tests have used
    here = run_campaign(room, results=tmp_path / "here", store=tmp_path / "store-here", workers=2)
    other = tmp_path / "other-home"
    (other / "cache" / "vastflow").mkdir(parents=True)
    (other / "cache" / "vastflow" / "kernels").symlink_to(kernels)
    elsewhere = {"HOME": str(other), "XDG_CACHE_HOME": str(other / "cache")}
    with started_worker(api, tmp_path / "elsewhere", **elsewhere):
        there = run_campaign(room, results=tmp_path / "there", store=s3, pool="lab")
    assert (there.summary.executed, there.faults) == (6, ())
    assert contents(there.directory) == contents(here.directory)
    assert list((other / "cache" / "vastflow" / "bundles").iterdir()) == []


def test_poison_is_found_and_not_judged_and_the_others_are(api, worker, programs, tmp_path):
    file = programs("poison", "well", "well")
    found = run_campaign(file, results=tmp_path / "results", store=tmp_path / "store", pool="lab", workers=1)
    assert [(fault.configuration, fault.stage) for fault in found.faults] == [("step-1", "execute")]
    assert "its worker's process ended each time, at last with it alone" in found.faults[0].error
    assert (found.summary.passed, found.summary.not_judged) == (2, 1)
    assert executed(tmp_path).count(0) <= 4  # in three tries of the whole shard, and alone


def test_search_on_a_pool_equals_the_local_one(api, worker, tmp_path):
    (tmp_path / "wait.osc").write_text(WAIT_OSC)
    (tmp_path / "sought.vast").write_text(SEARCH)
    file, there = tmp_path / "sought.vast", {"results": tmp_path / "there", "store": tmp_path / "store-there"}
    here = run_campaign(file, results=tmp_path / "here", store=tmp_path / "store-here", workers=1)
    shown = {each.id for each in api.read_flow_runs()}
    found = run_campaign(file, pool="lab", workers=1, **there)
    assert (found.summary.executed, found.faults) == (4 + 2, ())
    tables = [(each.directory / "evaluations.parquet").read_bytes() for each in (found, here)]
    assert tables[0] == tables[1]
    best = json.loads((found.directory / "metadata.json").read_text())["search"]["best"]["configuration"]
    batches = {
        each.id: each for each in api.read_flow_runs() if each.id not in shown and each.name.startswith("sought, ")
    }
    named = {each.name: each.state.name for each in batches.values() if "configurations" not in each.name}
    assert named == dict.fromkeys(
        [
            "sought, batch 1, point-0001 to point-0002",
            "sought, batch 2, point-0003 to point-0004",
            f"sought, confirmation of {best}",
        ],
        "Completed",
    )
    artifacts = [each for each in api.read_artifacts() if each.flow_run_id in batches]
    bars = [each.data for each in artifacts if each.key == "sought-batch"]
    assert bars == [100.0] * 3
    said = sorted(each.data for each in artifacts if each.key == "sought-search")
    assert "before: 2 points, 0 of them rejected, 2 runs" in said[1] and "batches 1 of 2" in said[1]
    assert f"at {best}" in said[2] and "ended at batches 2 of 2" in said[2]
    assert run_campaign(file, pool="nowhere", **there).summary.executed == 0


def test_interrupted_search_ends_its_batch_and_goes_on_in_it(api, tmp_path):
    (tmp_path / "sleep.osc").write_text(SLEEP_OSC)
    file = tmp_path / "asleep.vast"
    file.write_text(SLEEPS)
    options = ["--results", tmp_path / "results", "--store", tmp_path / "store", "--workers", "1"]
    command = [sys.executable, "-m", "vastflow.flows", "run", file, *options]

    def batches():
        return [run for run in api.read_flow_runs() if run.name.startswith("asleep, batch")]

    environment = {**os.environ, "PREFECT_API_URL": str(api.api_url), "PREFECT_HOME": str(tmp_path / "home")}
    with subprocess.Popen([*map(str, command)], env=environment, stderr=subprocess.PIPE, text=True) as campaign:
        wait_until(lambda: any("batch 2" in run.name for run in batches()))
        campaign.send_signal(signal.SIGINT)
        _, said = campaign.communicate(timeout=240)
    assert campaign.returncode == 130, said
    found = run_campaign(file, results=tmp_path / "results", store=tmp_path / "store", workers=1)
    assert (found.summary.passed, found.faults) == (8, ()) and found.summary.reused >= 4
    assert sorted(run.name for run in batches()) == [
        "asleep, batch 1, point-0001 to point-0004",
        *["asleep, batch 2, point-0005 to point-0008"] * 2,
    ]
    assert all(run.state.is_final() for run in batches())


def test_ctrl_c_cancels_the_shards_and_says_how_to_go_on(api, worker, programs, tmp_path):
    file = programs(*["slow"] * 12)
    environment = {**os.environ, "PREFECT_API_URL": str(api.api_url), "PREFECT_HOME": str(tmp_path / "home")}
    options = ["--pool", "lab", "--results", tmp_path / "results", "--store", tmp_path / "store", "--workers", "1"]
    command = [sys.executable, "-m", "vastflow.flows", "run", file, *options]
    with subprocess.Popen([*map(str, command)], env=environment, stderr=subprocess.PIPE, text=True) as campaign:
        wait_until(lambda: len(executed(tmp_path)) >= 3)
        campaign.send_signal(signal.SIGINT)
        _, said = campaign.communicate(timeout=240)
    assert campaign.returncode == 130
    assert "interrupted; `vastflow run " in said
    wait_until(lambda: not [run for run in api.read_flow_runs() if " of step" in run.name and not run.state.is_final()])
    before = len(executed(tmp_path))
    found = run_campaign(file, results=tmp_path / "results", store=tmp_path / "store", pool="lab", workers=1)
    assert (found.summary.passed, found.faults) == (12, ())
    assert found.summary.reused >= before - 2
    assert len(executed(tmp_path)) <= 12 + 2  # what was in flight


def test_api_and_a_pool_have_to_be_there(api, programs, tmp_path, monkeypatch):
    file = programs("well")
    with pytest.raises(UserError, match="expected an existing work pool, got 'lap'; did you mean 'lab'"):
        run_campaign(file, results=tmp_path, store=tmp_path / "store", pool="lap")
    with temporary_settings({"api.url": None}):
        result = CliRunner().invoke(
            app, ["run", str(file), "--pool", "lab", "--results", str(tmp_path), "--store", str(tmp_path / "store")]
        )
    assert (result.exit_code, result.stdout) == (2, "")
    assert "no API of Prefect is configured; start one by `prefect server start`" in result.stderr
    assert "Traceback" not in result.stderr


@pytest.mark.skipif(os.environ.get("VASTFLOW_DEPLOYMENTS") != "all", reason="VASTFLOW_DEPLOYMENTS=all runs it")
def test_campaign_ends_without_its_s3_server_and_goes_on_later(
    api, started_worker, programs, start_s3, s3_variables, tmp_path
):
    server = start_s3()
    s3_variables(server)
    file = programs(*["slow"] * 8)
    options = ["--pool", "lab", "--shards", "4", "--workers", "1", "--results", str(tmp_path / "results")]
    command = [sys.executable, "-m", "vastflow.flows", "run", str(file), "--store", "s3://bucket/pooled", *options]
    environment = {**os.environ, "PREFECT_API_URL": str(api.api_url), "PREFECT_HOME": str(tmp_path / "home")}
    with started_worker(api, tmp_path / "worker"):
        with subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True) as campaign:
            wait_until(lambda: len(executed(tmp_path)) >= 4)
            server.kill()
            _, said = campaign.communicate(timeout=150)
        assert campaign.returncode == 2
        assert "store: " in said and "can't use 's3://bucket/pooled'" in said
        assert "Traceback" not in said
        server.start()
        kept = len(open_store("s3://bucket/pooled").holdings())
        assert kept > 0
        found = run_campaign(
            file, results=tmp_path / "results", store="s3://bucket/pooled", pool=WorkPool("lab", shards=4), workers=1
        )
    assert (found.summary.passed, found.faults) == (8, ())
    assert found.summary.executed + found.summary.reused == 8


def test_wrong_credentials_are_one_sentence(api, programs, shared_s3, s3_variables, tmp_path):
    s3_variables(shared_s3, secret="WRONG")
    result = CliRunner().invoke(
        app, ["run", str(programs("well")), "--pool", "lab", "--results", str(tmp_path), "--store", "s3://bucket/x"]
    )
    assert result.exit_code == 2
    assert "check the credentials (AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY, or AWS_PROFILE)" in result.stderr
    assert "Traceback" not in result.stderr


def wait_until(condition):
    deadline_s = time.monotonic() + END_S
    while not condition():
        assert time.monotonic() < deadline_s
        time.sleep(0.3)
