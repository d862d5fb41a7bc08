"""Does RoboVAST's own library read an export? Makes an environment for robovast 2.2.1, runs two campaigns, exports, and compares.

What its functions return is compared with vastflow's own tables: statuses, poses, behaviors, outputs of programs, parameters, maps.
Notebooks with the calls of those of RoboVAST's examples run as well, and those of a clone of RoboVAST 1.0 if its path is given.

    python tests/proofs/robovast_reads.py [--python python3.12] [--clone PATH] [--results PATH PATH]

Exit code 1 when something differs or an environment can't be made. Needs uv, Python 3.12 or 3.13, and a package index.
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq

from vastflow import open as open_results
from vastflow.oracles.results.schema import table_of
from vastflow.sim.model.archive import members_of
from vastflow.sim.model.blocks import read_block

ROOT = Path(__file__).parents[2]
VERSION = "2.2.1"
PACKAGES = (f"robovast=={VERSION}", "matplotlib", "nbclient", "nbformat", "ipykernel", "numpy<2.4")  # numpy.trapz
CLONED = ("growth_sim", "basic_nav")
"""Campaigns of a clone with notebooks. Those of basic_nav read a map of Nav2's own installation, and robovast_nav of the clone."""

READS = """
import json, sys
import pandas as pd
from pathlib import Path
from robovast.common.analysis import *
from robovast.common.analysis import open_campaign_store, run_scope
from robovast.common.campaign_data import *
from robovast.common.results_utils import campaign_vast, iter_run_folders

DATA_DIR = ''

root = Path(DATA_DIR)
found = {}
found["run folders"] = len(list(iter_run_folders(str(root.parent))))
found["vast"] = campaign_vast(root).name
info = get_vast_configuration_info(root)
found["passed"], found["failed"] = info["num_passed"], info["num_failed"]
statuses = read_run_statuses(DATA_DIR)
found["statuses"] = sorted(map(list, statuses[["config", "run", "status"]].to_numpy().tolist()))
results = {}
for config in list_config_dirs(root):
    read_scenario_config(config)
    for run in list_run_dirs(config):
        results[f"{config.name}/{run.name}"] = read_test_result(run)["success"]
        read_sysinfo(run, root)["platform"]["machine"]
found["results"] = results
found["configs"] = [each["name"] for each in read_resolved_configurations(root)["configs"]]
found["execution"] = read_execution_metadata(root)["execution_type"]
store = open_campaign_store(DATA_DIR)
found["units"] = [name for name, in store.execute("SELECT config_name FROM unit ORDER BY id")]
store.close()
found["runs"] = []
for_each_run(DATA_DIR, lambda run: found["runs"].append(run_scope(run)[1:]))
found["runs"].sort()
names = {path.name for path in root.glob("*/0/*.csv")}
if "poses.csv" in names:
    poses = read_output_files(DATA_DIR, lambda run: read_output_csv(run, "poses.csv"))
    truth = poses[poses["frame"] == "turtlebot4_base_link_gt"]
    speeds = calculate_speeds_from_poses(truth)
    found["poses"] = {f"{c}/{r}": [len(g), g["position.x"].iloc[-1]] for (c, r), g in truth.groupby(["config", "run"], observed=True)}
    found["top speed"] = float(speeds["linear_speed"].max())
    behaviors = read_output_files(DATA_DIR, lambda run: read_output_csv(run, "behaviors.csv"))
    drives = get_behavior_info("differential_drive_robot.nav_to_pose", behaviors)
    found["drives"] = {f"{c}/{r}": d for c, r, d in zip(drives["config"], drives["run"], drives["duration"])}
    name = list_config_dirs(root)[0].name
    found["map"] = config_file(DATA_DIR, get_scenario_parameter(root / name, "map_file"), name).name
else:
    grown = read_output_files(DATA_DIR, lambda run: read_output_csv(run, "growth.csv"))
    found["grown"] = {f"{c}/{r}": [len(g), round(float(g["population"].max()), 6), float(g["growth_rate"].iloc[0])]
                      for (c, r), g in grown.groupby(["config", "run"], observed=True)}
Path(sys.argv[1] if len(sys.argv) > 1 and not sys.argv[1].startswith("-") else "found.json").write_text(json.dumps(found, default=str))
"""
"""The calls of RoboVAST's notebooks and of its tools, over one campaign."""

EXECUTES = """
import sys, nbformat
from nbclient import NotebookClient
book = nbformat.read(sys.argv[1], 4)
for cell in book.cells:
    cell.source = cell.source.replace("DATA_DIR = ''", f"DATA_DIR = {sys.argv[2]!r}")
NotebookClient(book, timeout=300, kernel_name="python3", resources={"metadata": {"path": sys.argv[3]}}).execute()
"""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--python", default="python3.12", help="interpreter, by name or path")
    parser.add_argument("--clone", type=Path, default=os.environ.get("ROBOVAST_CLONE"), help="of RoboVAST 1.0")
    parser.add_argument(
        "--results", nargs=2, type=Path, metavar="PATH", help="of the quickstart and of growth; else both are run"
    )
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="vastflow-robovast-") as temporary:
        home = Path(temporary)
        python = home / "env/bin/python"
        run("uv", "venv", "--quiet", "--python", asked.python, home / "env")
        run("uv", "pip", "install", "--quiet", "--python", python, *PACKAGES)
        wrong = 0
        for k, name in enumerate(("quickstart", "growth")):
            results = asked.results[k] if asked.results else executed(name, home)
            exported = home / f"exported-{name}" / results.resolve().name
            run(command(), "export", results, exported)
            wrong += compared(name, results, read(python, exported, home), notebook(python, exported, home))
        wrong += cloned(python, home, asked.clone)
    print(f"{wrong} differences")
    return 1 if wrong else 0


def command() -> Path:
    """The command in this environment."""
    return Path(sys.executable).with_name("vastflow")


def run(*words: object) -> None:
    """Run a command; it must succeed."""
    done = subprocess.run([str(part) for part in words], capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"{' '.join(map(str, words))}\n{done.stdout[-3000:]}{done.stderr[-3000:]}")


def executed(name: str, home: Path) -> Path:
    """The directory of a shipped campaign, run with one run of each configuration."""
    run(command(), "run", ROOT / f"campaigns/{name}/{name}.vast", "--runs", 1, "--results", home / "results")
    (directory,) = (home / "results").glob(f"{name}-*")
    return directory


def read(python: Path, exported: Path, home: Path) -> dict[str, object]:
    """Return what RoboVAST's functions give for an export."""
    script = home / "reads.py"
    script.write_text(READS.replace("DATA_DIR = ''", f"DATA_DIR = {str(exported)!r}"), encoding="utf-8")
    run(python, script, home / "found.json")
    return dict(json.loads((home / "found.json").read_text(encoding="utf-8")))


def notebook(python: Path, exported: Path, home: Path) -> dict[str, object]:
    """The same from a notebook, whose line `DATA_DIR = ''` is replaced as RoboVAST's program does."""
    cell = {"cell_type": "code", "id": "a", "metadata": {}, "outputs": [], "execution_count": None, "source": READS}
    file = home / "reads.ipynb"
    file.write_text(json.dumps({"cells": [cell], "metadata": {}, "nbformat": 4, "nbformat_minor": 5}), encoding="utf-8")
    execute(python, file, exported, home)
    return dict(json.loads((home / "found.json").read_text(encoding="utf-8")))


def execute(python: Path, file: Path, exported: Path, home: Path) -> None:
    (home / "found.json").unlink(missing_ok=True)
    (home / "executes.py").write_text(EXECUTES, encoding="utf-8")
    run(python, home / "executes.py", file, exported, home)


def cloned(python: Path, home: Path, clone: Path | None) -> int:
    """Run campaigns of a clone here, and their notebooks on the exports; return how many fail."""
    if clone is None:
        print(f"SKIPPED: the notebooks of {', '.join(CLONED)}; name a clone by --clone or ROBOVAST_CLONE")
        return 0
    wrong = 0
    for name in CLONED:
        folder, results = Path(clone) / f"configs/examples/{name}", home / f"clone-{name}"
        words = ["run", folder / f"{name}.vast", "--runs", "1", "--results", results]
        subprocess.run(
            [command(), *words], capture_output=True, check=False
        )  # 3, as RoboVAST's library is not in this environment
        (directory,) = results.iterdir()
        run(command(), "export", directory, exported := home / f"exported-clone-{name}" / directory.name)
        one = min(each.parent for each in exported.glob("*/0/"))
        places = {"analysis_run": one / "0", "analysis_config": one, "analysis_campaign": exported}
        for level, place in places.items():
            file = folder / "analysis" / f"{level}.ipynb"
            try:
                execute(python, file, place, home)
                print(f"{name}: {file.name}: runs")
            except SystemExit as error:
                wrong += 1
                print(f"{file}: {str(error)[-1500:]}")
    return wrong


def compared(name: str, results: Path, *readings: dict[str, object]) -> int:
    """The number of values in which a reading differs from vastflow's tables."""
    expected = own_values(results)
    wrong = 0
    for found in readings:
        for key, value in expected.items():
            if json.loads(json.dumps(value)) != found.get(key):
                wrong += 1
                print(f"{name}: {key}: expected {str(value)[:300]}, got {str(found.get(key))[:300]}")
        unexpected = found.keys() - expected.keys()
        wrong += len(unexpected)
        print(
            f"{name}: {len(expected)} values of RoboVAST's functions compared{f', unexpected {unexpected}' if unexpected else ''}"
        )
    return wrong


def own_values(results: Path) -> dict[str, object]:
    """The same values from vastflow's own tables."""
    frame = open_results(str(results)).frame()
    names = [(str(row.configuration), int(row.run_index), bool(row.passed)) for row in frame.itertuples()]
    configurations = list(dict.fromkeys(name for name, _, _ in names))
    told: dict[str, object] = {
        "run folders": len(names),
        "vast": "campaign.vast",
        "passed": sum(passed for *_, passed in names),
        "failed": sum(not passed for *_, passed in names),
        "statuses": sorted([name, str(k), "passed" if passed else "failed"] for name, k, passed in names),
        "results": {f"{name}/{k}": passed for name, k, passed in names},
        "configs": configurations,
        "execution": "local",
        "units": configurations,
    }
    told["runs"] = sorted([name, k] for name, k, _ in names)
    blocks = {name: list(read_block(results / f"recordings/{name}.parquet")) for name in configurations}
    if any(columns for block in blocks.values() for _, columns in block):
        runs = {f"{name}/{run['run_index']}": columns for name in configurations for run, columns in blocks[name]}
        told["poses"] = {key: [len(columns["t_ms"]), int(columns["x_mm"][-1]) / 1000] for key, columns in runs.items()}
        behaviors = pq.read_table(results / "behaviors.parquet").to_pylist()
        spans: dict[str, list[tuple[float, str]]] = {}
        for row in behaviors:
            if row["name"] == "nav_to_pose" and row["status"] in ("RUNNING", "SUCCESS", "FAILURE"):
                spans.setdefault(f"{row['configuration']}/{row['run_index']}", []).append((row["t_s"], row["status"]))
        told["drives"] = {
            key: next(t for t, status in rows if status != "RUNNING")
            - next(t for t, status in rows if status == "RUNNING")
            for key, rows in spans.items()
            if {status for _, status in rows} > {"RUNNING"}
        }
        told["map"] = "map.yaml"
        told["top speed"] = max(top_speed(columns) for columns in runs.values())
    else:
        factors = dict(zip(frame["configuration"].astype(str), frame["growth_rate"], strict=True))
        told["grown"] = {f"{name}/{k}": [*grown(results, name, k), float(factors[name])] for name, k, _ in names}
    return told


def top_speed(columns: dict[str, np.ndarray]) -> float:
    """The highest speed between two poses, m/s."""
    t_s, x_m, y_m = (columns[name] / 1000 for name in ("t_ms", "x_mm", "y_mm"))
    return float((np.hypot(np.diff(x_m), np.diff(y_m)) / np.diff(t_s)).max())


def grown(results: Path, configuration: str, run_index: int) -> tuple[int, float]:
    """Rows and largest population of the table that a run's program wrote."""
    with zipfile.ZipFile(results / f"outputs/{configuration}.zip") as archive:
        _, name, entry = next(
            (run, name, entry) for (run, _, name), entry in members_of(archive).items() if run == run_index
        )
        table = table_of(archive.read(entry), name)
    return len(table), round(float(max(table["population"].to_pylist())), 6)


if __name__ == "__main__":
    shutil.which("uv") or sys.exit("uv: no such program; expected one that is installed")
    sys.exit(main())
