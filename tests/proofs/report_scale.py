"""Evidence and report of a synthetic campaign of the paper's size: CPU time, memory and size of the report.

Two campaign directories are written as `vastflow run` would: one of a robot on the five shipped floor plans, with four
oracles and recordings of a minute each, and one of scenarios without a robot, with one oracle. Each one's report is made in a process of
its own. Exit code 1 where a limit of issue 7 is not met; the limits are those of the whole size.

    python tests/proofs/report_scale.py [--configurations 5480] [--runs 20] [--keep FOLDER]
"""

import json
import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from amcl_accuracy import route
from missions import parser_of
from scipy.ndimage import gaussian_filter1d

from vastflow.oracles.results.schema import CONFIGURATIONS, EXCLUSIONS, JUDGED_RUNS, REJECTIONS, VERDICTS, write_table
from vastflow.producers.floorplan.files import read_plan_file
from vastflow.producers.floorplan.grid import grid_of
from vastflow.sim.model.blocks import write_block
from vastflow.sim.world.map_file import load_map

PLANS = Path(__file__).parents[2] / "campaigns" / "floorplans"
NAMES = ("corridors", "hospital_lobby", "nested_rooms", "office_wing", "university")
WAYS = 8
"""Different ways on each map."""
LOST = (0, 1, 4, 12, 20)
"""Runs of 20 that end early, in the blocks that are written."""
ROWS = 600
MOST: Mapping[str, Mapping[str, float]] = {
    "robot": {"cpu_s": 90.0, "memory_mb": 2000.0, "report_mb": 20.0},
    "idle": {"cpu_s": 6.0},
}

COLUMNS = (
    *("t_ms", "x_mm", "y_mm", "yaw_mrad", "estimated_x_mm", "estimated_y_mm", "estimated_yaw_mrad", "speed_mmps"),
    *("yaw_rate_mradps", "command_speed_mmps", "command_yaw_rate_mradps", "localized"),
)
CAUSES = ("gave up recovering", "lost", "blocked by an obstacle", "contact", "unknown")
"""Of runs that end early; then of those that fail an oracle alone."""
LIMITS = {"performance": "left the path", "robustness": "mislocalized", "safety": "too close"}
MEASURED = {
    "success": {"distance": "m", "final_distance": "m", "missed_goals": "1", "recoveries": "1", "time": "s"},
    "performance": {"length_ratio": "1", "reference_length": "m", "rmse": "m", "threshold": "m"},
    "robustness": {"update": "m", "step": "m", "metre": "m", "mean": "m", "maximum": "m", "updates": "1", "threshold": "m"},
    "safety": {"smallest_separation": "m", "margin": "m", "contacts": "1", "response_time": "s", "violation_time": "s"},
}  # fmt: skip
REJECTED = {"family": "performance-corridors", "parent": "performance-corridors", "producer": "PathVariationRandom"}
IDLE = '{"environment":{},"task":{},"system":{}}'


def write_campaign(directory: Path, configurations: int, runs: int, *, robot: bool = True) -> None:
    """Write a campaign directory of `configurations` × `runs` runs; the same arguments give the same bytes."""
    rng = np.random.default_rng(7)
    for folder in ("recordings", "traces", "environments"):
        (directory / folder).mkdir(parents=True)
    places = [_place(directory, name, runs, rng) for name in NAMES] if robot else []
    rows: dict[str, list[dict[str, Any]]] = {"configurations": [], "runs": [], "verdicts": []}
    for k in range(configurations):
        place = places[k % len(places)] if places else None
        way = k // 5 % WAYS
        if place is None:
            configuration = {"name": f"idle-{k + 1}", "family": "idle", "abstract": "builtin:idle", "timeout_s": 1.0}
            configuration |= {"scenario": IDLE, "factors": json.dumps({"k": k}), "provenance": "{}"}
            lost = 0
        else:
            configuration, chance = _configuration(k, place, place["ways"][way], rng)
            written = min(LOST, key=lambda n: abs(n - 20 * chance))
            lost = min(written, runs)
            for folder in ("recordings", "traces"):
                os.link(place["files"][way, written], directory / folder / f"{configuration['name']}.parquet")
        rows["configurations"].append({**configuration, "scenario_digest": f"{k:064x}", "steps": "[]"})
        of = {"configuration": configuration["name"], "family": configuration["family"]}
        for run_index in range(runs):
            early = run_index < lost
            verdicts = list(_verdicts(early, robot, rng))
            rows["verdicts"] += [{**of, "run_index": run_index, **verdict} for verdict in verdicts]
            failed = [verdict["oracle"] for verdict in verdicts if verdict["judgement"] == "fail"]
            cause = LIMITS.get(failed[0], CAUSES[k % 5]) if failed else None
            rows["runs"].append({**of, **_mission(run_index, early), "contacts": 0, "cause": cause})
    for table, schema in (("configurations", CONFIGURATIONS), ("runs", JUDGED_RUNS), ("verdicts", VERDICTS)):
        write_table(directory / f"{table}.parquet", schema, rows[table])
    rejected = [{"reason": f"no goal at {m} m ± 0.5 m", "requested": f'{{"path_length": {m}}}'} for m in range(20, 28)]
    rejections = [{**REJECTED, "inputs": "{}", **each} for each in rejected * 5]
    write_table(directory / "rejections.parquet", REJECTIONS, rejections)
    write_table(directory / "exclusions.parquet", EXCLUSIONS, [])
    (directory / "campaign.vast").write_text("version: 1\nmetadata: {name: synthetic}\n")
    counts = {"configurations": configurations, "runs": configurations * runs, "executed": 0, "cpu_s": 1.0}
    metadata = {"name": "synthetic", "created": "2026-11-21T06:00:00", "vastflow": "0.1.0"}
    metadata |= {"versions": {"python": "3.11"}, "host": {"name": "lab", "machine": "x86_64", "cpus": 2}}
    metadata |= {"asked": {"file": "synthetic.vast", "runs": runs}, "counts": counts, "notes": [], "faults": []}
    (directory / "metadata.json").write_text(json.dumps(metadata))


def _place(directory: Path, name: str, runs: int, rng: np.random.Generator) -> dict[str, Any]:
    """A map of the directory with ways on it and blocks of runs along them."""
    grid = grid_of(read_plan_file(PLANS / f"{name}.fpm").building())
    folder = directory / "environments" / "made"
    folder.mkdir()
    (folder / "map.yaml").write_bytes(grid.header("map.pgm"))
    (folder / "map.pgm").write_bytes(grid.picture())
    (folder / "provenance.json").write_text(json.dumps({"file": f"{name}.fpm"}))
    occupancy = load_map(folder / "map.yaml")
    folder.rename(folder.with_name(occupancy.digest))
    ways = [route(occupancy, rng) for _ in range(WAYS)]
    blocks = directory / "blocks"
    blocks.mkdir(exist_ok=True)
    files = {}
    for w, way in enumerate(ways):
        for lost in LOST:
            file = blocks / f"{name}-{w}-{lost}.parquet"
            file.write_bytes(_block(way, min(lost, runs), runs, rng))
            files[w, lost] = file
    return {"name": name, "digest": occupancy.digest, "ways": ways, "files": files}


def _block(way: np.ndarray, lost: int, runs: int, rng: np.random.Generator) -> bytes:
    """A block of `runs` runs along `way`, of which the first `lost` stop before its end."""
    rows, columns = [], []
    for run_index in range(runs):
        n = ROWS if run_index >= lost else int(ROWS * rng.uniform(0.3, 0.8))
        at = np.linspace(0, len(way) * n / ROWS - 1, n).astype(int)
        sway = gaussian_filter1d(rng.normal(0, 1.2, (n, 2)), 25, axis=0, mode="nearest")
        xy_m = way[at] + np.clip(sway, -0.3, 0.3)
        yaw = np.unwrap(np.arctan2(*np.gradient(xy_m, axis=0).T[::-1]))
        true = np.column_stack([xy_m, yaw]) * 1000
        estimated = true + gaussian_filter1d(rng.normal(0, 60, (n, 3)), 8, axis=0)
        speed = np.hypot(*np.gradient(xy_m, axis=0).T) * 1e4
        turn = np.gradient(yaw) * 1e4
        found = [np.arange(n) * 100, *true.T, *estimated.T, speed, turn, speed, turn, np.arange(n) % 5 == 0]
        columns.append({name: np.asarray(c).round().astype(np.int32) for name, c in zip(COLUMNS, found, strict=True)})
        rows.append({**_mission(run_index, run_index < lost), "events": [], "entities": []})
    return write_block(rows, columns)


def _mission(run_index: int, early: bool) -> dict[str, Any]:
    return {
        "run_index": run_index,
        "seed": f"1:{run_index}",
        "outcome": "aborted" if early else "succeeded",
        "error_code": 104 if early else 0,
        "reason": "no valid control" if early else "",
        "simulated_s": 60.0,
        "distance_m": 12.5,
        "recoveries": 3 if early else 0,
        "missed_goals": 0,
    }


def _configuration(
    k: int, place: Mapping[str, Any], way: np.ndarray, rng: np.random.Generator
) -> tuple[dict[str, Any], float]:
    """A configuration, and the chance of a run's early end: noise and drop-outs do harm, most together."""
    kind = ("performance", "robustness", "safety")[k // 40 % 3]
    poses = {
        f"{end}_pose": {"position": {"x": round(float(x), 3), "y": round(float(y), 3)}, "orientation": {"yaw": 0.0}}
        for end, (x, y) in (("start", way[0]), ("goal", way[-1]))
    }
    noise, drop = (0.0, 0.1, 0.2, 0.4)[k // 120 % 4], (0.0, 0.3, 0.6)[k // 480 % 3]
    system = {
        "laserscan_gaussian_noise_std_deviation": noise,
        "laserscan_random_drop_percentage": drop,
        "robot_radius": (0.22, 0.3)[k // 1440 % 2],
    }
    environment: dict[str, Any] = {"map_file": {"file": place["digest"]}}
    if kind == "safety":
        x, y = way[len(way) // 2].round(3).tolist()
        pose = {"position": {"x": x, "y": y}, "orientation": {"yaw": 0.3}}
        environment["static_objects"] = [
            {"entity_name": "box", "model": "box", "xacro_arguments": "width:=0.5, length:=0.5", "spawn_pose": pose}
        ]
    family = f"{kind}-{place['name']}"
    configuration = {
        "name": f"{family}-{k + 1}",
        "family": family,
        "environment": place["digest"],
        "abstract": "builtin:navigate_to_pose",
        "timeout_s": 120.0,
        "scenario": json.dumps({"environment": environment, "task": poses, "system": system}),
        "factors": json.dumps({**environment, **poses, **system}),
        "provenance": json.dumps({"_path": way[::8].round(3).tolist(), "_path_length": 15.0}),
    }
    return configuration, min(rng.beta(0.3, 2.5) + noise * drop * 2.0 + 0.3 * noise, 1.0)


def _verdicts(early: bool, robot: bool, rng: np.random.Generator) -> Iterator[dict[str, Any]]:
    wrong = rng.random(4) < (0.0, 0.003, 0.005, 0.002)
    value = rng.random(8).round(6).tolist()
    for k, (oracle, names) in enumerate(MEASURED.items() if robot else [("success", {"time": "s"})]):
        failed = early if oracle == "success" else bool(wrong[k]) and robot
        metrics = {name: {"value": value[i % 8], "unit": unit} for i, (name, unit) in enumerate(names.items())}
        if early and "response_time" in metrics:
            metrics["response_time"]["value"] = None
        yield {
            "oracle": oracle,
            "judgement": "fail" if failed else "pass",
            "reason": f"{oracle}: {value[0]:.3f} is too much" if failed else "",
            "metrics": json.dumps(metrics, separators=(",", ":")),
        }


def measured(directory: Path) -> dict[str, float]:
    """Make a report in a process of its own; return CPU time (s), peak memory (MB), and size (MB)."""
    # Not ru_maxrss, in which Linux keeps what the parent had before the program began.
    program = (
        "import pathlib, sys\nfrom vastflow.oracles.page.report import write_report\n"
        "write_report(pathlib.Path(sys.argv[1]))\n"
        "print(next(l for l in pathlib.Path('/proc/self/status').read_text().splitlines() if l.startswith('VmHWM')).split()[1])\n"
    )
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(
        [sys.executable, "-c", program, str(directory)], check=True, stdout=subprocess.PIPE, text=True
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return {
        "cpu_s": round(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, 2),
        "memory_mb": round(float(done.stdout) / 1000, 1),
        "report_mb": round((directory / "report.html").stat().st_size / 1e6, 2),
    }


def main() -> int:
    """Write, measure, print."""
    parser = parser_of(__doc__)
    parser.add_argument("--configurations", type=int, default=5480)
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--keep", type=Path)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        root: Path = arguments.keep or Path(temporary)
        found = {}
        for name in MOST:
            if not (root / name).exists():
                write_campaign(root / name, arguments.configurations, arguments.runs, robot=name == "robot")
            found[name] = measured(root / name)
            print(name, json.dumps(found[name]), flush=True)
    kept = all(found[name][what] <= most for name, limits in MOST.items() for what, most in limits.items())
    print("within the limits" if kept else "NOT within the limits")
    return 0 if kept else 1


if __name__ == "__main__":
    sys.exit(main())
