"""Campaigns on a Dask cluster of real processes: a scheduler, and workers that find it by its file."""

import contextlib
import json
import os
import signal
import subprocess
import sys
import time

import psutil
import pyarrow.parquet as pq
import pytest
from asleep import SLEEP_X, SLEEPING_SEARCH, gated, wait_until
from room import SHORT_DRIVES, drawn_room

from vastflow.flows import run_campaign
from vastflow.tasks.store.remote_files import RemoteFiles

pytestmark = [pytest.mark.slow, pytest.mark.timeout(580)]

ROOM = SHORT_DRIVES.replace("NAME", "pooled").replace("room.yaml", "../maps/room.yaml").replace("0.01]", "0.01, 0.02]")
OWN_ORACLE = "evaluation: {oracles: ['own_oracle.py:Distance': {least_m: 0.1}]}\n"
ORACLE = """
from vastflow.oracles.judgment.oracle import Oracle, Parameters


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

HOARDER = """
import os
import sys
import time

from vastflow.oracles.judgment.oracle import Oracle, Parameters


class HoarderParameters(Parameters):
    parent: int


class Hoarder(Oracle[HoarderParameters]):
    Parameters = HoarderParameters
    metrics = {}

    def judge(self, trace, situation):
        if os.getppid() == self.parameters.parent and not hasattr(sys, "hoard"):
            sys.hoard = b"x" * (600 << 20)
        time.sleep(0.5)
        return self.passed(trace)
"""
"""Takes memory on the workers of one nanny, and time everywhere."""

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
    next(p for p in psutil.Process().parents() if any("spawn_main" in part for part in p.cmdline())).kill()
    time.sleep(30)
if how == "slow":
    time.sleep(2)
"""


class Cluster:
    """`dask scheduler` and `dask worker` processes."""

    def __init__(self, folder):
        self.folder, self.processes = folder, []
        self.file = folder / "scheduler.json"
        self.begin()

    def begin(self):
        self.file.unlink(missing_ok=True)
        self.scheduler = self.started("scheduler", "--port", "0")
        wait_until(self.file.exists)

    def worker(self, memory="0", **variables):
        return self.started("worker", "--nthreads", "1", "--memory-limit", memory, **variables)

    def wait_for_worker(self):
        wait_until(lambda: "Register worker" in (self.folder / "log").read_text())

    def started(self, *arguments, **variables):
        file = ("--scheduler-file", str(self.file), "--no-dashboard", "--dashboard-address", "127.0.0.1:0")
        with open(self.folder / "log", "ab") as log:
            process = psutil.Popen(
                [sys.executable, "-m", "dask", *arguments, *file],
                cwd=self.folder,
                env={**os.environ, **variables},
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
            )
        self.processes.append(process)
        return process

    def kill(self):
        for process in self.processes:
            with contextlib.suppress(psutil.Error):
                for each in [*process.children(recursive=True), process]:
                    each.kill()
        psutil.wait_procs(self.processes, timeout=20)
        self.processes.clear()


@pytest.fixture
def cluster(tmp_path):
    (tmp_path / "dask").mkdir()
    made = Cluster(tmp_path / "dask")
    yield made
    made.kill()


@pytest.fixture
def room(tmp_path):
    """A campaign whose map lies beside its folder, with an oracle of its own."""
    drawn_room(tmp_path / "maps", 60)
    (tmp_path / "campaign").mkdir()
    (tmp_path / "campaign" / "own_oracle.py").write_text(ORACLE)
    (tmp_path / "campaign" / "room.vast").write_text(ROOM + OWN_ORACLE)
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


def run(file, tmp_path, cluster, **options):
    return run_campaign(file, results=tmp_path / "results", store=tmp_path / "store", cluster=cluster.file, **options)


def test_cluster_and_one_machine_give_the_same_bytes(room, tmp_path):
    here = run_campaign(room, results=tmp_path / "here", store=tmp_path / "store-here", workers=2)
    there = run_campaign(room, results=tmp_path / "there", store=tmp_path / "store-there", cluster="local:2")
    assert (there.summary.executed, there.faults) == (6, ())
    assert contents(there.directory) == contents(here.directory)


def test_store_and_worker_need_not_be_on_one_machine(cluster, room, kernels, tmp_path, s3, monkeypatch):
    monkeypatch.setattr(RemoteFiles, "local", tmp_path / "local")
    monkeypatch.delenv("XDG_CACHE_HOME")  # where the compiled kernels are that other tests have used
    here = run_campaign(room, results=tmp_path / "here", store=tmp_path / "store-here", workers=2)
    for number in (1, 2):
        other = tmp_path / f"home-{number}"
        (other / "cache" / "vastflow").mkdir(parents=True)
        (other / "cache" / "vastflow" / "kernels").symlink_to(kernels)
        cluster.worker(HOME=str(other), XDG_CACHE_HOME=str(other / "cache"))
    there = run_campaign(room, results=tmp_path / "there", store=s3, cluster=cluster.file)
    assert (there.summary.executed, there.faults) == (6, ())
    assert contents(there.directory) == contents(here.directory)
    (files,) = (tmp_path / "home-1" / "cache" / "vastflow" / "bundles").glob("*/**/maps")
    assert sorted(each.name for each in files.iterdir()) == ["room.pgm", "room.yaml"]


def test_late_and_killed_workers_lose_nothing(cluster, programs, tmp_path):
    file = programs("once", *["well"] * 7)
    subprocess.Popen([sys.executable, "-c", "import time; time.sleep(8)"]).wait()
    cluster.worker()
    found = run(file, tmp_path, cluster)
    assert (found.summary.passed, found.faults) == (8, ())
    assert sorted(set(executed(tmp_path))) == list(range(8))


def test_worker_paused_for_memory_loses_nothing(cluster, programs, tmp_path):
    file = programs(*["well"] * 8)
    fractions = {"PAUSE": "0.5", "TERMINATE": "false"}
    limits = {f"DASK_DISTRIBUTED__WORKER__MEMORY__{name}": each for name, each in fractions.items()}
    full = cluster.worker("1 GiB", **limits)
    cluster.worker()
    wait_until(lambda: (cluster.folder / "log").read_text().count("Register worker") == 2)
    (tmp_path / "hoarder.py").write_text(HOARDER)
    oracles = f"evaluation: {{oracles: [{{'hoarder.py:Hoarder': {{parent: {full.pid}}}}}]}}\n"
    file.write_text(file.read_text() + oracles)
    found = run(file, tmp_path, cluster)
    assert (found.summary.passed, found.faults) == (8, ())
    assert sorted(set(executed(tmp_path))) == list(range(8))
    assert len(executed(tmp_path)) <= 8 + 2  # what was in flight
    said = (cluster.folder / "log").read_text()
    assert "Pausing worker" in said and "Resuming worker" not in said


def test_poison_run_is_not_judged_and_others_are(cluster, programs, tmp_path):
    cluster.worker()
    cluster.worker()
    found = run(programs("poison", "well", "well"), tmp_path, cluster)
    assert [(fault.configuration, fault.stage) for fault in found.faults] == [("step-1", "execute")]
    assert "each worker process that ran this died" in found.faults[0].error
    assert (found.summary.passed, found.summary.not_judged) == (2, 1)


def test_restarted_scheduler_is_found(cluster, programs, tmp_path):
    file = programs(*["slow"] * 8)
    command = [sys.executable, "-m", "vastflow.flows.cli", "run", file, "--cluster", cluster.file]
    command += ["--results", tmp_path / "results", "--store", tmp_path / "store", "--json"]
    cluster.worker()
    log = tmp_path / "said"
    with (
        open(log, "w") as said,
        subprocess.Popen([*map(str, command)], stdout=subprocess.PIPE, stderr=said, text=True) as campaign,
    ):
        wait_until(lambda: len(executed(tmp_path)) >= 2)
        cluster.kill()
        wait_until(lambda: "no Dask scheduler answers at" in log.read_text())
        cluster.begin()
        cluster.worker()
        out, _ = campaign.communicate(timeout=300)
    assert campaign.returncode == 0, log.read_text()
    assert json.loads(out)["passed"] == 8
    assert len(executed(tmp_path)) <= 8 + 2  # what was in flight


def test_late_worker_with_other_code_gets_nothing(cluster, programs, tmp_path):
    cluster.worker()
    cluster.wait_for_worker()
    late = []

    class Watching:
        def update(self, progress):
            if progress.runs_done and not late:
                late.append(cluster.worker(NUMBA_OPT="1"))

    found = run(programs(*["slow"] * 8), tmp_path, cluster, observer=Watching())
    assert (found.summary.passed, found.faults, len(late)) == (8, (), 1)
    assert len(executed(tmp_path)) == 8


def test_ctrl_c_frees_the_cluster_within_seconds(cluster, programs, tmp_path):
    file = programs(*["slow"] * 12)
    cluster.worker()
    command = [sys.executable, "-m", "vastflow.flows.cli", "run", file, "--cluster", cluster.file]
    command += ["--results", tmp_path / "results", "--store", tmp_path / "store"]
    with subprocess.Popen([*map(str, command)], stderr=subprocess.PIPE, text=True) as campaign:
        wait_until(lambda: len(executed(tmp_path)) >= 3)
        campaign.send_signal(signal.SIGINT)
        _, said = campaign.communicate(timeout=240)
    assert campaign.returncode == 130
    assert "Interrupted. `vastflow run " in said
    # The worker may be at one that it was just given, but not at the next: six seconds are three of them.
    wait_until(lambda: executed(tmp_path) == (time.sleep(6) or executed(tmp_path)))
    assert len(executed(tmp_path)) < 12
    found = run(file, tmp_path, cluster)
    assert (found.summary.passed, found.faults) == (12, ())
    assert len(executed(tmp_path)) <= 12 + 2  # what was in flight


def test_search_on_a_cluster_equals_the_local_one(tmp_path):
    (tmp_path / "wait.osc").write_text(WAIT_OSC)
    (tmp_path / "sought.vast").write_text(SEARCH)
    file, there = tmp_path / "sought.vast", {"results": tmp_path / "there", "store": tmp_path / "store-there"}
    here = run_campaign(file, results=tmp_path / "here", store=tmp_path / "store-here", workers=1)
    found = run_campaign(file, cluster="local:2", workers=1, **there)
    assert (found.summary.executed, found.faults) == (4 + 2, ())
    tables = [(each.directory / "evaluations.parquet").read_bytes() for each in (found, here)]
    assert tables[0] == tables[1]
    assert run_campaign(file, cluster="tcp://127.0.0.1:9", **there).summary.executed == 0, "nothing is missing"


@pytest.fixture(scope="module")
def api(started_api, tmp_path_factory):
    folder = tmp_path_factory.mktemp("lab")
    with started_api(folder / "prefect", folder / "server.log") as client:
        yield client


def test_interrupted_search_resumes_in_batch(api, tmp_path):
    (tmp_path / "sleep.osc").write_text(SLEEP_X.replace("'sleep '", f'"{gated(tmp_path, 4)} "'))
    file = tmp_path / "asleep.vast"
    file.write_text(SLEEPING_SEARCH)
    options = ["--results", tmp_path / "results", "--store", tmp_path / "store", "--workers", "1"]
    command = [sys.executable, "-m", "vastflow.flows.cli", "run", file, *options]

    def batches():
        return [run for run in api.read_flow_runs() if run.name.startswith("asleep, batch")]

    environment = {**os.environ, "PREFECT_API_URL": str(api.api_url), "PREFECT_HOME": str(tmp_path / "home")}
    with subprocess.Popen([*map(str, command)], env=environment, stderr=subprocess.PIPE, text=True) as campaign:
        wait_until(lambda: any("batch 2" in run.name for run in batches()))
        campaign.send_signal(signal.SIGINT)
        _, said = campaign.communicate(timeout=240)
    assert campaign.returncode == 130, said
    (tmp_path / "go").touch()
    found = run_campaign(file, results=tmp_path / "results", store=tmp_path / "store", workers=1)
    assert (found.summary.passed, found.faults) == (8, ()) and found.summary.reused >= 4
    assert sorted(run.name for run in batches()) == [
        "asleep, batch 1, point-0001 to point-0004",
        *["asleep, batch 2, point-0005 to point-0008"] * 2,
    ]
    assert all(run.state.is_final() for run in batches())
