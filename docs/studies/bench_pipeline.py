"""Benchmark the pipeline by a campaign whose runs do nothing.

    python docs/studies/bench_pipeline.py [--configurations 5480] [--runs 20] [--json]

runs this file, as `python docs/studies/bench_pipeline.py` does.
"""

import argparse
import contextlib
import json
import os
import shutil
import sqlite3
import sys
import tempfile
import time
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
        first = called(file)
        executed_s = _executed_s(Path(first["results"]))
        found: dict[str, Any] = {
            **{name: first[name] for name in ("configurations", "runs", "executed", "wall_s", "cpu_s")},
            "execution_cpu_s": round(executed_s, 2),
            "overhead_cpu_s": round(first["cpu_s"] - executed_s, 2),
            **{name: round(first[name], 1) for name in ("flow_peak_mb", "all_peak_mb")},
            **_task_runs(folder / "prefect"),
        }
        again = called(file)
        file.write_text(campaign_text(configurations, runs, edited=1))
        edit = called(file)
        for what, call in (("rerun", again), ("edit", edit)):
            found |= {f"{what}_{name}": call[name] for name in ("wall_s", "cpu_s", "executed")}
        return found | {
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


def called(file: Path, store: str | None = None) -> dict[str, Any]:
    """The summary of one call of `vastflow run`, with its CPU time and peak memory.

    Memory is of the flow's process, and of all together, which counts shared pages for each.
    """
    folder = file.parent
    # With the variable of Python every process would compile its modules, which takes half of a small campaign.
    dropped = ("PREFECT_", "PYTHONDONTWRITEBYTECODE")
    kept = {name: value for name, value in os.environ.items() if not name.startswith(dropped)}
    environment = {**kept, "PREFECT_HOME": str(folder / "prefect"), "VASTFLOW_STORE": store or str(folder / "store")}
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
    flow_mb = all_mb = 0.0
    before_s = sum(os.times()[2:4])
    with open(folder / "log", "wb") as log, open(folder / "printed", "w+", encoding="utf-8") as printed:
        process = psutil.Popen(command, env=environment, stdout=printed, stderr=log)
        while process.poll() is None:
            with contextlib.suppress(psutil.Error):
                sizes_mb = [each.memory_info().rss / 1e6 for each in (process, *process.children(recursive=True))]
                flow_mb, all_mb = max(flow_mb, sizes_mb[0]), max(all_mb, sum(sizes_mb))
            time.sleep(_SAMPLED_EVERY_S)
        printed.seek(0)
        if process.returncode:
            raise RuntimeError(f"vastflow run ended with {process.returncode}: {(folder / 'log').read_text()[-2000:]}")
        cpu_s = round(sum(os.times()[2:4]) - before_s, 2)  # also of processes that its own account lacks
        return {**json.load(printed), "cpu_s": cpu_s, "flow_peak_mb": flow_mb, "all_peak_mb": all_mb}


def _executed_s(results: Path) -> float:
    """CPU time of the runs themselves, from their logs."""
    with open(results / LOGS_FILE, "rb") as logs:
        return float(sum(run["cpu_s"] for line in logs for run in json.loads(line)["runs"]))


def _task_runs(home: Path) -> dict[str, int]:
    """Return the number of task runs in Prefect's database, and of those in a final state."""
    database = home / "prefect.db"
    with sqlite3.connect(f"file:{database}?mode=ro", uri=True) as connection:
        final = "state_type IN ('COMPLETED', 'FAILED', 'CRASHED', 'CANCELLED')"
        (row,) = connection.execute(f"SELECT count(*), coalesce(sum({final}), 0) FROM task_run")
    return dict(zip(("task_runs", "task_runs_final"), row, strict=True))


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
