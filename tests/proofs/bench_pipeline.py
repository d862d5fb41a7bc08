"""Benchmark the pipeline by a campaign whose runs do nothing.

    vastflow dev bench pipeline [--configurations 5480] [--runs 20] [--json]

runs this file, as `python tests/proofs/bench_pipeline.py` does.
"""

import argparse
import json
import os
import shutil
import sqlite3
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import psutil
from bench_show import shown

from vastflow.flows.results.tables import LOGS_FILE

SCENARIO: Final = """\
import osc.helpers

scenario nothing:
    first: int
    second: int
    do serial:
        log("done")
"""

LEVELS: Final = 20
"""Values of the second parameter; the first has as many as that takes."""

_SAMPLED_EVERY_S: Final = 0.1


@dataclass(frozen=True, slots=True)
class Cost:
    """Cost of one call of `vastflow run`.

    Attributes:
        summary: What it printed.
        cpu_s: CPU time of the flow's process and all below it, ended ones as they were seen last.
        flow_peak_mb, all_peak_mb: Most resident memory of the flow's process, and of all together (shared pages count for each).
    """

    summary: Mapping[str, Any]
    wall_s: float
    cpu_s: float
    flow_peak_mb: float
    all_peak_mb: float


def bench_pipeline(configurations: int = 5480, runs: int = 20) -> dict[str, Any]:
    """Run a campaign that does nothing, then again with nothing to do, then with one configuration edited.

    Everything is made in a temporary folder: store, results, and Prefect's own data, with the API server that `vastflow run`
    starts by itself.

    Returns:
        `overhead_cpu_s` (all but the execution of runs, of flow, server and workers), `flow_peak_mb`, `rerun_wall_s`,
        `rerun_executed`, `edit_wall_s`, `edit_executed`, how many task runs Prefect's database has after the first, how many of them
        are final, how many the edit added, and more of the same.
    """
    folder = Path(tempfile.mkdtemp(prefix="vastflow-bench-"))
    try:
        file = folder / "nothing.vast"
        (folder / "nothing.osc").write_text(SCENARIO)
        file.write_text(campaign_text(configurations, runs, edited=0))
        first = _cost(file)
        executed_s = _executed_s(Path(first.summary["results"]))
        found: dict[str, Any] = {
            "configurations": first.summary["configurations"],
            "runs": first.summary["runs"],
            "executed": first.summary["executed"],
            "wall_s": round(first.wall_s, 2),
            "cpu_s": round(first.cpu_s, 2),
            "execution_cpu_s": round(executed_s, 2),
            "overhead_cpu_s": round(first.cpu_s - executed_s, 2),
            "flow_peak_mb": round(first.flow_peak_mb, 1),
            "all_peak_mb": round(first.all_peak_mb, 1),
            **_task_runs(folder / "prefect"),
        }
        again = _cost(file)
        found |= {
            "rerun_wall_s": round(again.wall_s, 2),
            "rerun_cpu_s": round(again.cpu_s, 2),
            "rerun_executed": again.summary["executed"],
        }
        file.write_text(campaign_text(configurations, runs, edited=1))
        edit = _cost(file)
        return found | {
            "edit_wall_s": round(edit.wall_s, 2),
            "edit_cpu_s": round(edit.cpu_s, 2),
            "edit_executed": edit.summary["executed"],
            "edit_task_runs": _task_runs(folder / "prefect")["task_runs"] - found["task_runs"],
            "store_mb": round(sum(f.stat().st_size for f in (folder / "store").rglob("*") if f.is_file()) / 1e6, 1),
            "cores": os.cpu_count(),
        }
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def campaign_text(configurations: int, runs: int, edited: int) -> str:
    """The campaign file: all configurations but one in a family of two crossed parameters, and the one that is edited."""
    crossed, rest = divmod(configurations - 1, LEVELS)
    families = [("crossed", range(crossed), range(LEVELS)), ("rest", range(-1, 0), range(rest))]
    text = "version: 1\nmetadata: {name: nothing}\nconfiguration:\n"
    for name, first, second in families:
        if first and second:
            text += f"- name: {name}\n  variations:\n"
            text += f"  - ParameterVariationList: {{name: first, values: {list(first)}}}\n"
            text += f"  - ParameterVariationList: {{name: second, values: {list(second)}}}\n"
    text += f"- name: edited\n  parameters: [{{first: -2}}, {{second: {edited}}}]\n"
    return text + f"execution: {{scenario_file: nothing.osc, runs: {runs}, timeout: 10}}\n"


def _cost(file: Path) -> Cost:
    folder = file.parent
    environment = {
        **{name: value for name, value in os.environ.items() if not name.startswith("PREFECT_")},
        "PREFECT_HOME": str(folder / "prefect"),
        "VASTFLOW_STORE": str(folder / "store"),
    }
    command = [
        sys.executable,
        "-m",
        "vastflow.flows.cli",
        "run",
        str(file),
        "--results",
        str(folder / "results"),
        "--json",
    ]
    began_s = time.perf_counter()
    with open(folder / "log", "wb") as log:
        process = subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=log, text=True)
        meter = _Meter(process.pid)
        printed, _ = process.communicate()
        wall_s = time.perf_counter() - began_s
        meter.stop()
    if process.returncode:
        raise RuntimeError(f"vastflow run ended with {process.returncode}: {(folder / 'log').read_text()[-2000:]}")
    return Cost(json.loads(printed), wall_s, meter.cpu_s, meter.flow_peak_mb, meter.all_peak_mb)


class _Meter:
    """Samples a process and all below it until it is stopped."""

    def __init__(self, pid: int) -> None:
        self._flow = psutil.Process(pid)
        self._cpu_s: dict[psutil.Process, float] = {}
        self.flow_peak_mb = self.all_peak_mb = 0.0
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._sample_on, daemon=True)
        self._thread.start()

    @property
    def cpu_s(self) -> float:
        """CPU time of all processes that were seen."""
        return sum(self._cpu_s.values())

    def stop(self) -> None:
        """Sample no more."""
        self._stopped.set()
        self._thread.join()

    def _sample_on(self) -> None:
        while not self._stopped.wait(_SAMPLED_EVERY_S):
            try:
                family = [self._flow, *self._flow.children(recursive=True)]
            except psutil.NoSuchProcess:
                continue
            together = 0.0
            for process in {*family, *self._cpu_s}:
                try:
                    with process.oneshot():
                        times, rss_mb = process.cpu_times(), process.memory_info().rss / 1e6
                except psutil.Error:
                    continue
                self._cpu_s[process] = times.user + times.system
                together += rss_mb
                if process == self._flow:
                    self.flow_peak_mb = max(self.flow_peak_mb, rss_mb)
            self.all_peak_mb = max(self.all_peak_mb, together)


def _executed_s(results: Path) -> float:
    """CPU time of the runs themselves, from their logs."""
    with open(results / LOGS_FILE, "rb") as logs:
        return float(sum(run["cpu_s"] for line in logs for run in json.loads(line)["runs"]))


def _task_runs(home: Path) -> dict[str, int]:
    """Return the number of task runs in Prefect's database, and of those in a final state."""
    database = home / "prefect.db"
    if not database.exists():
        return {"task_runs": 0, "task_runs_final": 0}
    with sqlite3.connect(f"file:{database}?mode=ro", uri=True) as connection:
        (every,) = connection.execute("SELECT count(*) FROM task_run").fetchone()
        final = "SELECT count(*) FROM task_run WHERE state_type IN ('COMPLETED', 'FAILED', 'CRASHED', 'CANCELLED')"
        (ended,) = connection.execute(final).fetchone()
    return {"task_runs": every, "task_runs_final": ended}


def main() -> None:
    """Print what was measured."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--configurations", type=int, default=5480)
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    print(shown(bench_pipeline(asked.configurations, asked.runs), as_json=asked.json))


if __name__ == "__main__":
    main()
