"""Searches of real spaces, by the simulator: runs that a strategy needs to a failure, and how near a boundary comes to a dense grid.

    python tests/proofs/search_real.py [door] [passage] [boundary] [--seeds 5] [--batches 12] [--strategies …] [--store FOLDER]

A robot drives through a door from one room to another, which takes some seconds.

- `door`: a box that is not on the map stands somewhere in front of the door.
- `passage`: a box leaves a passage in the door, and the lidar has noise.
- `boundary`: in the same space, where half of the runs fail, against a grid of five times the runs.

The first two look for the longest time to the goal, in at most `--batches` of 20 runs, until a point takes as long as a run may. It counts
where most fresh runs of it fail. With `--store`, what was run is kept: so the proof can be run in parts. The exit code is 1 where the
boundary misses its goal.
"""

import argparse
import json
import sys
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np
import pyarrow.parquet as pq
import yaml
from minimize import NOISE, box
from PIL import Image
from search import NEAR, curve_of

from vastflow.flows import run_campaign

TIMEOUT_S: Final = 20.0
FAILED_S: Final = TIMEOUT_S - 0.01
"""Mean time of a point of which all runs fail."""
RUNS, PER_BATCH = 5, 4
CONFIRMING_RUNS, CONFIRMING_FAILURES = 5, 3
GRID, GRID_RUNS = 9, 10
"""Points of the reference grid along each parameter, and runs of each."""
BOUNDARY_RUNS, BOUNDARY_BATCH = 3, 6

DOOR_Y_M: Final = (1.95, 3.05)
BOX_M: Final = 1.0
Y_OF_PASSAGE_M: Final = BOX_M / 2 + DOOR_Y_M[0]
"""Of the center of the box where it leaves a passage of nothing."""
PASSAGES_M: Final = (0.6, 1.1)
NOISES_M: Final = (0.0, 0.35)

Space = Mapping[str, tuple[float, float]]

DOOR: Final[Space] = {"x": (1.4, 2.7), "y": (0.6, 4.4)}
PASSAGE: Final[Space] = {NOISE: NOISES_M, "y": tuple(Y_OF_PASSAGE_M + width_m for width_m in PASSAGES_M)}
SPACES: Final = {"door": (DOOR, box("box", "$x", "$y", 0.5)), "passage": (PASSAGE, box("box", 3.0, "$y", BOX_M))}


def parameters_of(obstacle: Mapping[str, Any], **more: Any) -> list[dict[str, Any]]:
    """Those of the scenario."""
    task = {"start_pose": {"x": 1.0, "y": 2.5, "yaw": 0.0}, "goal_pose": {"x": 4.2, "y": 2.5, "yaw": 0.0}}
    return [
        {key: value} for key, value in {"map_file": "door.yaml", **task, "static_objects": [obstacle], **more}.items()
    ]


def run(folder: Path, store: Path, name: str, runs: int, **sections: Any) -> Path:
    """The directory of a campaign on a plan of two rooms with a door between them."""
    cells = np.full((100, 110), 254, dtype=np.uint8)
    cells[[0, -1], :] = cells[:, [0, -1]] = 0
    cells[:, 59:61] = 0
    low, high = (round((5.0 - y_m) / 0.05) for y_m in DOOR_Y_M)
    cells[high:low, 59:61] = 254
    Image.fromarray(cells).save(folder / "door.pgm")
    (folder / "door.yaml").write_text("{image: door.pgm, resolution: 0.05, origin: [0.0, 0.0, 0.0]}\n")
    execution = {"runs": runs, "timeout": TIMEOUT_S}
    file = folder / f"{name}.vast"
    data = {"version": 1, "metadata": {"name": name}, **sections, "execution": execution}
    file.write_text(yaml.safe_dump(data, sort_keys=False))
    return run_campaign(file, results=folder / "results", store=store).directory


def search_of(space: Space, obstacle: Mapping[str, Any], strategy: str, seed: int, **more: Any) -> dict[str, Any]:
    """The section `search`."""
    dimensions = {name: {"type": "float", "low": low, "high": high} for name, (low, high) in space.items()}
    return {
        "strategy": strategy,
        "seed": seed,
        "search_space": dimensions,
        "parameters": parameters_of(obstacle),
        "per_batch": PER_BATCH,
        **more,
    }


def runs_to_confirmed(folder: Path, store: Path, name: str, strategy: str, seed: int, batches: int) -> int:
    """Runs until a failure is confirmed; all that there may be where none is."""
    space, obstacle = SPACES[name]
    archive = {"bins": 5, "measures": {each: {"low": low, "high": high} for each, (low, high) in space.items()}}
    search = search_of(
        space,
        obstacle,
        strategy,
        seed,
        extract={"plugin": "metrics", "params": {"time": {"oracle": "success", "metric": "time"}}},
        objectives=[{"name": "time"}],
        budget=[{"batches": batches}],
        stopping=[{"target_objective": FAILED_S}],
        confirm=CONFIRMING_RUNS,
        strategy_parameters={"archive": archive} if strategy == "qd" else {},
    )
    directory = run(folder, store, f"{name}-{strategy}-{seed}", RUNS, search=search)
    said = json.loads((directory / "metadata.json").read_text())["search"]
    if said["best"] is None or said["best"]["objective"] < FAILED_S:
        return batches * PER_BATCH * RUNS
    rows = pq.read_table(directory / "runs.parquet", columns=["configuration", "run_index", "outcome"]).to_pylist()
    fresh = [row for row in rows if row["configuration"] == said["best"]["configuration"] and row["run_index"] >= RUNS]
    confirmed = sum(row["outcome"] != "succeeded" for row in fresh) >= CONFIRMING_FAILURES
    return said["runs"] if confirmed else batches * PER_BATCH * RUNS


def found(folder: Path, store: Path, name: str, asked: argparse.Namespace) -> None:
    """Print runs to the first confirmed failure by strategy."""
    print(f"\n{name}: runs to a confirmed failure, {asked.seeds} seeds, at most {asked.batches * PER_BATCH * RUNS}")
    for strategy in asked.strategies:
        runs = [runs_to_confirmed(folder, store, name, strategy, seed, asked.batches) for seed in range(asked.seeds)]
        low, middle, high = np.quantile(runs, (0.25, 0.5, 0.75))
        print(f"{strategy:10} median {middle:.0f} [{low:.0f}, {high:.0f}] of {runs}", flush=True)


def grid_rates(folder: Path, store: Path) -> np.ndarray[Any, Any]:
    """(GRID, GRID) failure rates over noise and passage."""
    places = [
        (f"point-{i}-{k}", noise, y)
        for i, noise in enumerate(np.linspace(*PASSAGE[NOISE], GRID).tolist())
        for k, y in enumerate(np.linspace(*PASSAGE["y"], GRID).tolist())
    ]
    families = [
        {"name": name, "parameters": parameters_of(box("box", 3.0, y, BOX_M), **{NOISE: noise})}
        for name, noise, y in places
    ]
    rows = pq.read_table(
        run(folder, store, "passage-grid", GRID_RUNS, configuration=families) / "runs.parquet",
        columns=["family", "outcome"],
    ).to_pylist()
    failed = dict.fromkeys((name for name, _, _ in places), 0)
    for row in rows:
        failed[row["family"]] += row["outcome"] != "succeeded"
    return np.array(list(failed.values())).reshape(GRID, GRID) / GRID_RUNS


def boundary(folder: Path, store: Path, seeds: int) -> bool:
    """Print how far the curve of 50 % is from that of the grid, as a share of the range of passages; whether the goal is met."""
    along = np.linspace(0.0, 1.0, GRID)
    reference = curve_of(grid_rates(folder, store) - 0.5, along)
    budget, distances = GRID * GRID * GRID_RUNS // 5, []
    for seed in range(seeds):
        batches = budget // (BOUNDARY_RUNS * BOUNDARY_BATCH)
        more = {"per_batch": BOUNDARY_BATCH, "budget": [{"batches": batches}], "confirm": 0}
        search = search_of(*SPACES["passage"], "boundary", seed, **more)
        directory = run(folder, store, f"passage-boundary-{seed}", BOUNDARY_RUNS, search=search)
        expected = np.array(pq.read_table(directory / "boundary.parquet")["expected"]) - 0.5
        side = round(len(expected) ** 0.5)
        curve = curve_of(expected.reshape(side, side), np.linspace(0.0, 1.0, side))[:: (side - 1) // (GRID - 1)]
        off = np.where(np.isnan(curve) & np.isnan(reference), 0.0, curve - reference)
        distances.append(float(np.sqrt(np.mean(np.where(np.isnan(off), 1.0, off) ** 2))))
    said = f"{budget} runs against the grid's {GRID * GRID * GRID_RUNS}"
    print(f"\nboundary: root mean square distance to the grid's curve, {seeds} seeds, {said}")
    print(f"boundary: median {np.median(distances):.4f}, worst {max(distances):.4f}", flush=True)
    return max(distances) <= NEAR


def main(asked: argparse.Namespace) -> int:
    with TemporaryDirectory() as place:
        folder, store = Path(place), asked.store or Path(place, "store")
        names = asked.proofs or (*SPACES, "boundary")
        for name in (each for each in SPACES if each in names):
            found(folder, store, name, asked)
        return 0 if "boundary" not in names or boundary(folder, store, asked.seeds) else 1


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("proofs", nargs="*", metavar="PROOF", help="of door, passage, boundary; else all")
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--batches", type=int, default=12)
    parser.add_argument("--strategies", nargs="+", default=["random", "optuna", "qd"])
    parser.add_argument("--store", type=Path)
    sys.exit(main(parser.parse_args()))
