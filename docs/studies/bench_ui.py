"""Time of each view of the explorer on a synthetic campaign, with random filters.

    python docs/studies/bench_ui.py [--configurations 5480] [--runs 20] [--requests 60] [--json]

Times are those of whole replies over loopback, from the request to the last byte. `first_view_s` is what the page of a campaign asks
for first, of a server that has just started; `start_s` is its start. Memory is the server's, at its peak, with the paths of all maps.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import httpx
import numpy as np
import pandas as pd
import psutil
from bench_show import loop_s, shown
from PIL import Image

from vastflow.oracles.evidence.wide import WIDE_FILE
from vastflow.oracles.observation.observe import observe_block
from vastflow.oracles.results.schema import CONFIGURATIONS, REJECTIONS, json_text, write_table
from vastflow.sim.model.blocks import write_recordings
from vastflow.sim.model.recording import Event, Recording, Run
from vastflow.sim.model.scenario import Scenario
from vastflow.sim.world.world import map_content

CELL_M: Final = 0.05
WIDTH_M: Final = 20.0
HEIGHT_M: Final = 12.0
MAPS: Final = 5
BLOCKS: Final = 8
"""Recordings of one map that configurations share; none looks into a file of another name."""
ROWS: Final = 400
FAMILIES: Final = ("noise", "clutter", "doors")
METRICS: Final[Mapping[str, int]] = {"success": 5, "performance": 5, "safety": 12}
"""Number of metrics of each oracle."""


def write_map(folder: Path, number: int) -> Path:
    """Write the map of a hall with a pillar, and return its YAML file."""
    cells = np.full((round(HEIGHT_M / CELL_M), round(WIDTH_M / CELL_M)), 254, dtype=np.uint8)
    cells[[0, -1], :] = cells[:, [0, -1]] = 0
    cells[40 + 8 * number : 60 + 8 * number, 150:170] = 0
    folder.mkdir(parents=True, exist_ok=True)
    Image.fromarray(cells).save(folder / "map.pgm")
    (folder / "map.yaml").write_text(
        f"image: map.pgm\nresolution: {CELL_M}\norigin: [0.0, 0.0, 0.0]\n"
        "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    return folder / "map.yaml"


def recording(rng: np.random.Generator, run_index: int) -> Recording:
    """Return a run along a bent path through the hall, with a contact now and then."""
    along = np.linspace(0.0, 1.0, ROWS)
    bend = rng.normal(0.0, 1.0) * np.sin(np.pi * along)
    x_m, y_m = 1.5 + along * rng.uniform(5.0, WIDTH_M - 3.0), HEIGHT_M / 2 + bend + rng.normal(0.0, 0.01, ROWS)
    outcome = "succeeded" if rng.random() < 0.7 else "aborted"

    def fixed(values: Any) -> Any:
        return np.rint(1000.0 * np.broadcast_to(values, ROWS)).astype(np.int32)

    columns = {
        "t_ms": fixed(np.arange(ROWS) * 0.05),
        "x_mm": fixed(x_m),
        "y_mm": fixed(y_m),
        "yaw_mrad": fixed(0.0),
        "estimated_x_mm": fixed(x_m + 0.02),
        "estimated_y_mm": fixed(y_m),
        "estimated_yaw_mrad": fixed(0.0),
        "speed_mmps": fixed(0.4 + 0.1 * np.sin(9 * along)),
        "yaw_rate_mradps": fixed(0.0),
        "command_speed_mmps": fixed(0.4),
        "command_yaw_rate_mradps": fixed(0.0),
        "localized": np.ones(ROWS, dtype=np.int32),
    }
    events = (Event(9.0, "contact", float(x_m[180]), float(y_m[180]), "wall", 0.2),) if outcome == "aborted" else ()
    row = (run_index, f"{run_index}", outcome, 0, "", ROWS * 0.05, 12.0, 0, 0, events)
    return Recording(Run(*row), columns)  # type: ignore[arg-type]


def write_campaign(directory: Path, configurations: int, runs: int) -> Path:
    """Write a campaign directory as the explorer reads it, with recordings and traces."""
    rng = np.random.default_rng(5)
    directory.mkdir(parents=True)
    (directory / "campaign.vast").write_text("version: 1\n")
    counts = {"configurations": configurations, "runs": configurations * runs}
    metadata = {"name": "synthetic", "created": "2026-11-26T06:00:00", "vastflow": "0.2.0", "counts": counts}
    (directory / "metadata.json").write_text(json.dumps({**metadata, "notes": [], "faults": []}))
    task = {"start_pose": {"x": 1.5, "y": 6.0}, "goal_pose": {"x": 18.0, "y": 6.0}}
    blocks, digests, scenarios = [], [], []
    for number in range(MAPS):
        content = map_content(write_map(directory / "inputs" / f"hall{number}", number))
        write_map(directory / "environments" / content.digest, number)
        environment: dict[str, Any] = {"map_file": content, "static_objects": []}
        scenario = Scenario("builtin:navigate_to_pose", 60.0, environment, task, {})
        digests.append(content.digest)
        scenarios.append(json_text({"environment": environment, "task": task, "system": {}}))
        block = [write_recordings([recording(rng, k) for k in range(runs)]) for _ in range(BLOCKS)]
        blocks.append([(each, observe_block(scenario, each)) for each in block])
    _write_configurations(directory, configurations, digests, scenarios)
    names = [f"{FAMILIES[k % len(FAMILIES)]}-{k}" for k in range(configurations)]
    for folder, part in (("recordings", 0), ("traces", 1)):
        (directory / folder).mkdir()
        firsts: dict[tuple[int, int], Path] = {}
        for k, name in enumerate(names):
            which, file = (k % MAPS, k // MAPS % BLOCKS), directory / folder / f"{name}.parquet"
            if which in firsts:
                os.link(firsts[which], file)
            else:
                file.write_bytes(blocks[which[0]][which[1]][part])
                firsts[which] = file
    wide(names, runs, rng).to_parquet(directory / WIDE_FILE, compression="zstd", index=False)
    return directory


def _write_configurations(directory: Path, n: int, digests: Sequence[str], scenarios: Sequence[str]) -> None:
    rows = (
        {
            "name": f"{FAMILIES[k % len(FAMILIES)]}-{k}",
            "family": FAMILIES[k % len(FAMILIES)],
            "environment": digests[k % MAPS],
            "abstract": "builtin:navigate_to_pose",
            "timeout_s": 60.0,
            "scenario": scenarios[k % MAPS],
            "factors": "{}",
            "provenance": "{}",
            "steps": "[]",
        }
        for k in range(n)
    )
    write_table(directory / "configurations.parquet", CONFIGURATIONS, rows)
    write_table(directory / "rejections.parquet", REJECTIONS, [])


def wide(names: Sequence[str], runs: int, rng: np.random.Generator) -> pd.DataFrame:
    """Return a table as `vastflow.oracles.evidence.wide` writes it, with some 50 columns."""
    m = len(names)
    n = m * runs
    of = np.repeat(np.arange(m), runs)

    def levels(texts: Sequence[str], codes: Any) -> pd.Categorical:
        return pd.Categorical.from_codes(codes, pd.Index(texts, dtype="string"))

    noise, drop, length = rng.choice([0.0, 0.1, 0.2, 0.4], m), rng.choice([0.0, 0.2, 0.4], m), rng.uniform(4, 24, m)
    failed = rng.random(n) < (0.1 + noise + 0.3 * drop)[of]
    judged = rng.random(n) > 0.01
    reasons = ["timed out", "contact with wall", "goal missed", *(f"stopped {k} cm before box" for k in range(40))]
    columns: dict[str, Any] = {
        "configuration": levels(names, of),
        "family": levels(FAMILIES, (np.arange(m) % len(FAMILIES))[of]),
        "run_index": np.tile(np.arange(runs), m),
        "outcome": levels(["succeeded", "aborted", "timed_out"], np.where(failed, rng.integers(1, 3, n), 0)),
        "reason": levels(reasons, np.where(failed, rng.integers(0, len(reasons), n), -1)),
        "cause": levels(["lost", "blocked", "unknown"], np.where(failed, rng.integers(0, 3, n), -1)),
        **{name: rng.gamma(4.0, 5.0, n) for name in ("simulated_s", "distance_m")},
        **{name: rng.poisson(0.4, n).astype(float) for name in ("recoveries", "missed_goals", "contacts")},
    }
    for name in ("passed", *(f"passed.{oracle}" for oracle in METRICS)):
        columns[name] = pd.arrays.BooleanArray(
            ~failed if name == "passed" else ~failed | (rng.random(n) < 0.5), ~judged
        )
    for oracle, number in METRICS.items():
        for k in range(number):
            columns[f"{oracle}.metric{k} (m)"] = np.where(rng.random(n) < 0.05, np.nan, rng.normal(k, 1.0, n))
    given = {
        "laserscan_gaussian_noise_std_deviation": noise[of],
        "laserscan_random_drop_percentage": drop[of],
        "path length (m)": length[of],
        **{f"factor{k}": rng.uniform(0.0, 1.0, m)[of] for k in range(5)},
        "amount": rng.integers(0, 6, m).astype(float)[of],
        "map_file": levels([f"hall{k}" for k in range(MAPS)], (np.arange(m) % MAPS)[of]),
        "start_pose": levels([json.dumps({"x": k, "y": 6.0}) for k in range(m)], of),
        "controller": levels(["dwb", "mppi", "rpp"], rng.integers(0, 3, m)[of]),
    }
    return pd.DataFrame({**columns, **given})


@contextmanager
def served(folder: Path) -> Iterator[tuple[httpx.Client, psutil.Process, float]]:
    """Serve a folder by `vastflow ui`, and yield a client, the server, and the time of its start (s)."""
    began_s = time.perf_counter()
    command = [sys.executable, "-m", "vastflow.flows.cli", "ui", str(folder), "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as server:
        try:
            assert server.stdout is not None
            address = httpx.URL(server.stdout.readline().strip())
            with httpx.Client(base_url=address.copy_with(query=None), timeout=60.0, follow_redirects=True) as client:
                client.get("/", params=dict(address.params)).raise_for_status()
                yield client, psutil.Process(server.pid), time.perf_counter() - began_s
        finally:
            server.terminate()


def random_filter(facets: Sequence[Mapping[str, Any]], rng: np.random.Generator) -> str:
    """Return the text of a filter of one to four random facets."""
    conditions = []
    for k in rng.choice(len(facets), rng.integers(1, 5), replace=False).tolist():
        name, facet = facets[k]["name"], facets[k]
        if facet["kind"] == "values":
            known = [each["value"] for each in facet["values"] if each["value"] is not None]
            conditions.append(f"{name}={'|'.join(rng.choice(known, max(1, len(known) // 2), replace=False).tolist())}")
        else:
            low, high = np.sort(rng.uniform(facet["low"], facet["high"], 2)).tolist()
            conditions.append(f"{name}:{low}..{high}")
    return ";".join(conditions)


def measured(folder: Path, requests: int) -> dict[str, Any]:
    """Return times and memory of the explorer over the campaign in a folder."""
    rng = np.random.default_rng(11)
    with served(folder) as (client, server, start_s):
        page = client.get("/").text
        c = page.split("/campaign?c=")[1].split('"')[0].split("&")[0]
        began_s = time.perf_counter()
        client.get("/campaign", params={"c": c}).raise_for_status()
        first = {view: client.get(f"/api/{view}", params={"c": c}).json() for view in ("summary", "facets", "rows")}
        first_view_s = time.perf_counter() - began_s
        facets, maps = first["facets"]["facets"], [each["id"] for each in first["summary"]["maps"]]
        names = [each["name"] for each in first["summary"]["columns"]]
        for environment in maps:
            while True:
                reply = client.get("/api/paths", params={"c": c, "environment": environment})
                header = json.loads(reply.content.split(b"\n")[0])
                if header["read"] == header["configurations_here"]:
                    break
                time.sleep(0.05)
        paths_s = time.perf_counter() - began_s - first_view_s

        def query(view: str) -> dict[str, Any]:
            some = rng.choice(names, 2, replace=False).tolist()
            return {
                "rows": {"sort": some[0], "start": 50, "order": "descending"},
                "points": {"column": some},
                "parallel": {},
                "paths": {"environment": rng.choice(maps), "layer": rng.choice(["paths", "ends", "rate"])},
            }.get(view, {})

        found: dict[str, Any] = {}
        for view in ("summary", "facets", "rows", "points", "parallel", "paths"):
            times_ms = []
            for _ in range(requests):
                asked = {"c": c, "f": random_filter(facets, rng), **query(view)}
                began_s = time.perf_counter()
                client.get(f"/api/{'points' if view == 'parallel' else view}", params=asked).raise_for_status()
                times_ms.append(1000.0 * (time.perf_counter() - began_s))
            found[view] = quantiles(times_ms)
        configurations = [row["configuration"] for row in first["rows"]["rows"]]
        for view, more in (("", {}), ("/paths", {}), ("/signals", {"signal": "speed_mps"})):
            times_ms = []
            for name in configurations:
                began_s = time.perf_counter()
                client.get(f"/api/configuration{view}", params={"c": c, "name": name, **more}).raise_for_status()
                times_ms.append(1000.0 * (time.perf_counter() - began_s))
            found[f"configuration{view}"] = quantiles(times_ms)
        status = Path(f"/proc/{server.pid}/status").read_text().splitlines()
        peak_mb = int(next(line for line in status if line.startswith("VmHWM")).split()[1]) / 1000.0
    return {
        "start_s": start_s,
        "first_view_s": first_view_s,
        "paths_s": paths_s,
        "peak_mb": peak_mb,
        "slowest_p95_ms": max(each["p95_ms"] for each in found.values()),
        "views": found,
    }


def quantiles(times_ms: Sequence[float]) -> dict[str, float]:
    """Return median, 95th percentile, and worst of some times."""
    p50, p95 = np.quantile(times_ms, (0.5, 0.95)).tolist()
    return {"p50_ms": p50, "p95_ms": p95, "worst_ms": max(times_ms)}


def main() -> None:
    """Write the campaign, serve it, and print what was measured."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--configurations", type=int, default=5480)
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--requests", type=int, default=60)
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="vastflow-ui-") as temporary:
        write_campaign(Path(temporary, "synthetic-2026-11-26-060000"), asked.configurations, asked.runs)
        found = measured(Path(temporary), asked.requests)
    sizes = {"configurations": asked.configurations, "runs": asked.configurations * asked.runs}
    print(shown({**sizes, **found, "load": os.getloadavg()[0], "loop_s": loop_s()}, as_json=asked.json))


if __name__ == "__main__":
    main()
