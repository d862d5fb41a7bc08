"""A campaign that can be killed: its files, its processes, and what they say of the runs they execute.

Executions are counted from outside: `sitecustomize` wraps the function that workers call, and writes a line to a file when a
block begins, for each run, and when the block is stored.
"""

import contextlib
import json
import os
import shutil
import socket
import subprocess
import sys
import time
import urllib.request
import uuid
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import psutil

from vastflow.tasks.prefect.adapter import SERVER_SETTINGS

WORKERS = 2
CONFIGURATIONS = 30
RUNS = 4
MARK = "VASTFLOW_PROOF"
TRACE = "VASTFLOW_PROOF_TRACE"
ENDS_S = 420.0
"""A life that takes longer hangs; an undisturbed one takes some 20 s on an idle machine."""

SCENARIO = """\
import osc.helpers

scenario nothing:
    first: int
    second: int
    do serial:
        log("first")
        wait elapsed(0.2s)
        log("second")
"""

CAMPAIGN = f"""\
version: 1
metadata: {{name: killed}}
configuration:
- name: crossed
  variations:
  - ParameterVariationList: {{name: first, values: [1, 2, 3, 4]}}
  - ParameterVariationList: {{name: second, values: [1, 2, 3, 4, 5]}}
- name: pairs
  variations:
  - ParameterVariationList: {{name: first, values: [11, 12, 13, 14, 15]}}
  - ParameterVariationList: {{name: second, values: [21, 22]}}
execution: {{scenario_file: nothing.osc, runs: {RUNS}, timeout: 10}}
"""

ROBOT_CAMPAIGN = f"""\
version: 1
metadata: {{name: killed}}
configuration:
- name: crossed
  parameters: &poses
  - map_file: room.yaml
  - start_pose: {{position: {{x: 1.0, y: 1.5}}, orientation: {{yaw: 0.0}}}}
  - goal_pose: {{position: {{x: 2.5, y: 1.5}}, orientation: {{yaw: 0.0}}}}
  variations:
  - ParameterVariationList: {{name: laserscan_gaussian_noise_std_deviation, values: [0.0, 0.01, 0.02, 0.03]}}
  - ParameterVariationList: {{name: laserscan_random_drop_percentage, values: [0.0, 0.1, 0.2, 0.3, 0.4]}}
- name: pairs
  parameters: *poses
  variations:
  - ParameterVariationList: {{name: robot_radius, values: [0.16, 0.17, 0.18, 0.19, 0.2]}}
  - ParameterVariationList: {{name: inflation_radius, values: [0.4, 0.5]}}
execution: {{runs: {RUNS}}}
"""
"""Campaign of as many configurations, with a robot that drives 1.5 m through an empty room."""

ROOM = "{image: room.pgm, resolution: 0.05, origin: [0, 0, 0]}"
ROOM_PGM = b"P5 80 60 255\n" + bytes(0 if x in (0, 79) or y in (0, 59) else 254 for y in range(60) for x in range(80))

TRACER = """\
import functools, importlib.abc, importlib.machinery, json, os, sys, time

inside = []

def said(**row):
    with open(os.environ["VASTFLOW_PROOF_TRACE"], "a") as trace:
        trace.write(json.dumps({"t_s": time.monotonic(), "pid": os.getpid(), **row}) + "\\n")

def traced_block(execute):
    @functools.wraps(execute)
    def block(store, key, scenario, start, stop, seed):
        said(what="begin", key=scenario.digest, start=start, stop=stop)
        inside.append(key)
        try:
            found = execute(store, key, scenario, start, stop, seed)
        finally:
            inside.pop()
        said(what="end", key=scenario.digest, start=start, stop=stop)
        return found
    return block

def traced_run(execute):
    @functools.wraps(execute)
    def run(scenario, run_index, *rest):
        if inside:  # not one that only compiles kernels
            said(what="run", key=scenario.digest, start=run_index, stop=run_index + 1)
            time.sleep(0.15)
        return execute(scenario, run_index, *rest)
    return run

WRAPPED = {"vastflow.tasks.engine.work": traced_block, "vastflow.sim.run": traced_run}

class Finder(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path, target=None):
        if name not in WRAPPED:
            return None
        spec = importlib.machinery.PathFinder.find_spec(name, path)
        execute = spec.loader.exec_module
        def exec_module(module):
            execute(module)
            module.execute = WRAPPED[name](module.execute)
            if hasattr(module, "compile_kernels") and not os.environ.get("VASTFLOW_PROOF_ROBOT"):
                module.compile_kernels = functools.wraps(module.compile_kernels)(lambda *_: None)
        spec.loader.exec_module = exec_module
        return spec

if os.environ.get("VASTFLOW_PROOF_TRACE"):
    sys.meta_path.insert(0, Finder())
"""
"""`sitecustomize`: the sleep makes a block of runs last longer than the half second in which a worker process notices that its
parent is gone, else it would always be done before; it costs no processor."""


@dataclass(frozen=True)
class Lab:
    """Inputs that all points share: code, campaign file, and a Prefect home with its database.

    Attributes:
        robot: Whether a robot drives in the campaign.
    """

    folder: Path
    robot: bool = False

    @classmethod
    def made(cls, folder: Path, copied: bool = True, robot: bool = False) -> "Lab":
        """Write all that is needed; with a copy of the code, or else with the code as it is installed."""
        code = folder / "code"
        code.mkdir()
        if copied:  # with the root package's own file: without it the installed package is found, and follows edits
            package = Path(__file__).parents[2] / ".package" / "vastflow"
            shutil.copytree(package, code / "vastflow", ignore=shutil.ignore_patterns("__pycache__"))
        (code / "sitecustomize.py").write_text(TRACER)
        (folder / "nothing.osc").write_text(SCENARIO)
        (folder / "room.yaml").write_text(ROOM)
        (folder / "room.pgm").write_bytes(ROOM_PGM)
        (folder / "killed.vast").write_text(ROBOT_CAMPAIGN if robot else CAMPAIGN)
        return cls(folder, robot)

    @property
    def campaign(self) -> Path:
        return self.folder / "killed.vast"

    @property
    def home(self) -> Path:
        return self.folder / "prefect"


class Place:
    """One point's store, results and Prefect home; its processes carry a mark in their environment.

    Args:
        api: Address of an API to be configured; without one each life has its own, embedded.
        setting: With `cluster` or `local`, workers of a Dask cluster execute the runs.
    """

    def __init__(self, lab: Lab, name: str, api: str | None = None, setting: str = "embedded") -> None:
        self.folder = lab.folder / name
        self.folder.mkdir()
        self.store, self.results = self.folder / "store", self.folder / "results"
        self.scheduler_file, self.database = self.folder / "scheduler.json", self.folder / "prefect" / "prefect.db"
        self.mark = uuid.uuid4().hex
        self._lab, self.api = lab, api
        self._cluster = {"cluster": str(self.scheduler_file), "local": f"local:{WORKERS}"}.get(setting)
        if lab.home.exists():
            shutil.copytree(lab.home, self.folder / "prefect")

    def environment(self) -> dict[str, str]:
        kept = _environment(self.folder)
        if self.api:
            password = "PREFECT_API_AUTH_STRING"
            kept |= {
                "PREFECT_API_URL": self.api,
                **({password: os.environ[password]} if password in os.environ else {}),
            }
        if self._lab.robot:
            kept["VASTFLOW_PROOF_ROBOT"] = "1"
        return {
            **kept,
            "PYTHONPATH": os.pathsep.join(filter(None, [str(self._lab.folder / "code"), kept.get("PYTHONPATH")])),
            "PREFECT_SERVER_ANALYTICS_ENABLED": "false",
            "VASTFLOW_STORE": str(self.store),
            "XDG_CACHE_HOME": str(self._lab.folder / "cache"),
            MARK: self.mark,
            TRACE: str(self.folder / "trace"),
        }

    def begin(self, *arguments: str, campaign: Path | None = None) -> "Life":
        """Start `vastflow` with these arguments, else a campaign, the lab's if none is given."""
        asked = arguments or ("run", str(campaign or self._lab.campaign), "--results", str(self.results))
        options = ["--workers", str(WORKERS), "--json"]
        if self._cluster:
            options += ["--cluster", self._cluster]
        return Life(self, ["vastflow.flows.cli", *asked, *options])

    def trace(self) -> list[dict[str, Any]]:
        file = self.folder / "trace"
        lines = file.read_text().splitlines() if file.exists() else []
        return [json.loads(line) for line in lines if line.endswith("}")]

    def begun(self) -> list[dict[str, Any]]:
        """Blocks that were begun and are not stored: they are in flight, or were when their process died."""
        begun: dict[tuple[Any, ...], list[dict[str, Any]]] = {}
        for row in self.trace():
            blocks = begun.setdefault((row["pid"], row["key"], row["start"]), [])
            if row["what"] == "begin":
                blocks.append(row)
            elif row["what"] == "end":
                blocks.pop()  # a worker that was interrupted may execute the same block again
        return [row for blocks in begun.values() for row in blocks]

    def marked(self) -> list[psutil.Process]:
        """Processes of this place that live."""
        found = []
        for process in psutil.process_iter():
            with contextlib.suppress(psutil.Error):
                if process.environ().get(MARK) == self.mark and process.status() != psutil.STATUS_ZOMBIE:
                    found.append(process)
        return found

    def directories(self) -> list[Path]:
        """Return the folders that a user would take for campaign directories."""
        return sorted(path for path in self.results.glob("*") if not path.name.startswith("."))


class Life:
    """One process of `vastflow`, from its start to its end."""

    def __init__(self, place: Place, command: Sequence[str]) -> None:
        self.place = place
        self.began_s = time.monotonic()
        number = len(list(place.folder.glob("out-*")))
        self._out, self._err = place.folder / f"out-{number}", place.folder / f"err-{number}"
        self.process = _started(command, place.environment(), self._out, self._err)

    @property
    def elapsed_s(self) -> float:
        return time.monotonic() - self.began_s

    def victims(self, kind: str) -> list[psutil.Process]:
        """Processes of this kind that live."""
        if kind == "flow":
            return [self.process] if self.process.poll() is None else []
        said = {
            "worker": ("loky.backend.popen_loky_posix", "multiprocessing.spawn"),
            "server": ("vastflow.tasks.prefect.api_server",),
            "scheduler": ("dask_worker import serve",),
        }[kind]
        found = []
        with contextlib.suppress(psutil.Error):
            for child in self.process.children(recursive=True):
                with contextlib.suppress(psutil.Error):
                    command = " ".join(child.cmdline())
                    if any(each in command for each in said) and child.status() != psutil.STATUS_ZOMBIE:
                        found.append(child)
        return found

    def phase(self) -> str:
        """The activity of a process, as seen from outside."""
        if list(self.place.results.glob(".*.partial")):
            return "reporting"
        if any(row["what"] == "begin" for row in self.place.trace()):
            return "recording" if self.has_executed(CONFIGURATIONS) else "executing"
        return "starting"

    def has_executed(self, blocks: int) -> bool:
        """Whether so many blocks of `RUNS` runs are stored, as far as there are so many."""
        runs = sum(row["stop"] - row["start"] for row in self.place.trace() if row["what"] == "end")
        return runs >= min(blocks, CONFIGURATIONS) * RUNS

    @property
    def goes_on(self) -> bool:
        """Whether it has not ended; one that hangs is killed."""
        if self.elapsed_s > ENDS_S:
            self.process.kill()
        return self.process.poll() is None

    def end(self, timeout_s: float = ENDS_S) -> int | None:
        """Its exit code; None if it hangs, and is killed then."""
        try:
            return self.process.wait(timeout_s)
        except psutil.TimeoutExpired:
            return None

    def summary(self) -> dict[str, Any]:
        found: dict[str, Any] = json.loads(self._out.read_text())
        return found

    def words(self) -> str:
        return self._err.read_text(errors="replace")


class Api:
    """A real `prefect server start`, with a database of its own that outlives it."""

    def __init__(self, folder: Path, home: Path) -> None:
        self._folder = folder
        folder.mkdir()
        if home.exists():
            shutil.copytree(home, folder / "prefect")
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        self.url = f"http://127.0.0.1:{self.port}/api"
        self.database = folder / "prefect" / "prefect.db"
        self._process: psutil.Popen | None = None

    def start(self) -> None:
        """Start it and wait until it answers."""
        command = ["prefect", "server", "start", "--host", "127.0.0.1", "--port", str(self.port)]
        self._process = _started(command, _environment(self._folder) | SERVER_SETTINGS, self._folder / "log")

        def answers() -> bool:
            with contextlib.suppress(OSError), urllib.request.urlopen(f"{self.url}/health", timeout=5):
                return True
            return False

        if not _came(answers):
            raise RuntimeError(f"Prefect's server did not start: {(self._folder / 'log').read_text()[-2000:]}")

    def kill(self) -> None:
        """kill -9, with all that it started."""
        if self._process is not None:
            _killed(self._process)


class Crew:
    """A Dask cluster: a scheduler, and workers of one thread, each with the process that watches over it."""

    def __init__(self, place: Place) -> None:
        self._place = place
        self._begin()

    def victims(self, kind: str) -> list[list[psutil.Process]]:
        """Return the processes to kill."""
        if kind == "scheduler":
            return [[self._scheduler]] if self._scheduler.poll() is None else []
        there = [worker for worker in self._workers if worker.poll() is None]
        if kind == "nanny":
            return [[worker] for worker in there]
        found = []
        for worker in there:
            with contextlib.suppress(psutil.Error):
                below = [each for each in worker.children(recursive=True) if "spawn_main" in " ".join(each.cmdline())]
                if below:
                    found.append(below if kind == "worker" else [worker, *below])
        return found

    def complete(self, victim: str) -> None:
        """Start what is gone, as whatever watches over it would; workers end with their scheduler."""
        if victim == "scheduler":
            self.stop()
            self._begin()
        self._workers = [worker if worker.poll() is None else self._worker() for worker in self._workers]

    def stop(self) -> None:
        """Kill the cluster."""
        _killed(self._scheduler, *self._workers)

    def _begin(self) -> None:
        before = self._address()  # a killed scheduler leaves its file
        self._scheduler = self._started("scheduler", "--port", "0")
        _came(lambda: self._address() not in ("", before))
        self._workers = [self._worker() for _ in range(WORKERS)]

    def _address(self) -> str:
        """Return what the scheduler's file has, or nothing while there is none or it is being written."""
        with contextlib.suppress(OSError, ValueError):
            return str(json.loads(self._place.scheduler_file.read_text())["address"])
        return ""

    def _worker(self) -> psutil.Popen:
        return self._started("worker", "--nthreads", "1", "--memory-limit", "0", "--death-timeout", "30")

    def _started(self, *arguments: str) -> psutil.Popen:
        file = [
            "--scheduler-file",
            str(self._place.scheduler_file),
            "--no-dashboard",
            "--dashboard-address",
            "127.0.0.1:0",
        ]
        return _started(["dask", *arguments, *file], self._place.environment(), self._place.folder / "crew")


def _environment(folder: Path) -> dict[str, str]:
    """This process's environment without what it says of Prefect and vastflow, and with a Prefect home in a folder."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("PREFECT_", "VASTFLOW_"))}
    return {**kept, "PREFECT_HOME": str(folder / "prefect")}


def _started(
    command: Sequence[str], environment: Mapping[str, str], out: Path, err: Path | None = None
) -> psutil.Popen:
    """Start a module in its own session; it writes to files, by default both outputs to one."""
    with open(out, "ab") as stdout, open(err or out, "ab") as stderr:
        return psutil.Popen(
            [sys.executable, "-m", *command],
            cwd=out.parent,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=stdout,
            stderr=stderr,
            start_new_session=True,
        )


def _killed(*processes: psutil.Popen) -> None:
    """kill -9, with all that they started."""
    for process in processes:
        with contextlib.suppress(psutil.Error):
            for each in [process, *process.children(recursive=True)]:
                with contextlib.suppress(psutil.Error):
                    each.kill()
    psutil.wait_procs(processes, timeout=10)


def _came(true: Callable[[], bool]) -> bool:
    """Wait until something is true, but not for ever."""
    deadline_s = time.monotonic() + 120
    while not true() and time.monotonic() < deadline_s:
        time.sleep(0.1)
    return true()
