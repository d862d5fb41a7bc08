"""Measure strategies in the simulator: runs to a failure, and boundary error against a dense grid.

    python docs/studies/search_real.py [door] [passage] [boundary] [--seeds 5] [--batches 12] [--strategies …] [--workers N] [--store FOLDER]

A robot drives through a door from one room to another, which takes 7 s where nothing is in its path.

- `door`: a box that is not on the map stands somewhere in front of the door. It blocks the door in about 2 % of the space; near there,
  the robot needs longer.
- `passage`: a box leaves a passage in the door, which is wide enough unless the lidar has much noise.
- `boundary`: which passages are too narrow with how much noise, against a grid of five times the runs.

The first two look for the longest time to the goal, in at most `--batches` of 16 runs, until both runs of a point take as long as a run
may. It counts where most fresh runs of it fail. With `--store`, what was run is kept: so the proof can be run in parts. The exit code is 1
where the boundary misses its goal.
"""

import argparse
import itertools
import json
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np
import pandas as pd
import yaml
from minimize import NOISE, box, map_of, two_rooms
from scipy.optimize import isotonic_regression
from search import NEAR, Floats, curve_of

from vastflow.flows import run_campaign

TIMEOUT_S: Final = 25.0
FAILED_S: Final = TIMEOUT_S - 0.01
"""Mean time of a point of which all runs fail."""
RUNS, PER_BATCH = 2, 8
CONFIRMING_RUNS, CONFIRMING_FAILURES = 5, 3
AGAIN: Final = 1000
"""From the seed of a search to that of the one that goes on after it."""
NOISES, PASSAGES, GRID_RUNS = 9, 27, 8
"""Points of the reference grid along each parameter, and runs of each: passages lie closer than the cells of the costmap, at whose edges
the rate jumps."""
BOUNDARY_RUNS, BOUNDARY_BATCH = 2, 8
REDRAWN: Final = 200
"""Grids that are drawn from the rates of the reference, which say how well it is known itself."""

DOOR_Y_M: Final = (1.95, 3.05)
BOX_M: Final = 1.0
Y_OF_PASSAGE_M: Final = BOX_M / 2 + DOOR_Y_M[0]
"""Center (m) of the box where it leaves a passage of zero width."""
Space = Mapping[str, tuple[float, float]]


def passages(noises_m: tuple[float, float], narrowest_m: float, widest_m: float) -> Space:
    """Noise of the lidar, and places of the box that leave passages of these widths."""
    return {NOISE: noises_m, "y": (Y_OF_PASSAGE_M + narrowest_m, Y_OF_PASSAGE_M + widest_m)}


DOOR: Final[Space] = {"x": (1.5, 2.7), "y": (0.6, 4.4)}
PASSAGE: Final = passages((0.0, 0.35), 1.0, 1.1)
NARROW_AND_WIDE: Final = passages((0.1, 0.35), 0.6, 1.1)
"""With less noise about half of the runs pass whatever the passage: there is no line to be found."""
IN_THE_DOOR: Final = box("box", 3.0, "$y", BOX_M)
SPACES: Final = {"door": (DOOR, box("box", "$x", "$y", 0.5)), "passage": (PASSAGE, IN_THE_DOOR)}


@dataclass(frozen=True)
class Place:
    """The folder in which campaigns are written and run."""

    folder: Path
    store: Path
    workers: int | None = None


def parameters_of(*obstacles: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Parameters of the scenario."""
    return [
        {"map_file": "door.yaml"},
        {"start_pose": {"x": 1.0, "y": 2.5, "yaw": 0.0}},
        {"goal_pose": {"x": 4.2, "y": 2.5, "yaw": 0.0}},
        *([{"static_objects": list(obstacles)}] if obstacles else []),
    ]


def run(place: Place, name: str, runs: int, **sections: Any) -> Path:
    """The directory of a campaign on a plan of two rooms with a door between them."""
    folder = place.folder
    cells = two_rooms(110)
    low, high = (round((5.0 - y_m) / 0.05) for y_m in DOOR_Y_M)
    cells[high:low, 59:61] = 254
    map_of(cells, folder / "door.yaml")
    execution = {"runs": runs, "timeout": TIMEOUT_S}
    file = folder / f"{name}.vast"
    data = {"version": 1, "metadata": {"name": name}, **sections, "execution": execution}
    file.write_text(yaml.safe_dump(data, sort_keys=False))
    return run_campaign(file, results=folder / "results", store=place.store, workers=place.workers).directory


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


def runs_to_confirmed(place: Place, name: str, strategy: str, seed: int, batches: int) -> int:
    """Runs until a failure is confirmed; all that there may be where none is.

    A search ends at what it finds. Where that is not confirmed, another goes on with a seed of its own.
    """
    most, spent = batches * PER_BATCH * RUNS, 0
    for own_seed in itertools.count(seed, AGAIN):
        runs, confirmed = runs_of(place, name, strategy, own_seed, batches)
        spent += runs
        if confirmed or spent >= most:
            break
    return min(spent, most)


def runs_of(place: Place, name: str, strategy: str, seed: int, batches: int) -> tuple[int, bool]:
    """Runs of one search, those that confirm what it finds included, and whether they do."""
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
    directory = run(place, f"{name}-{strategy}-{seed}", RUNS, search=search)
    best = json.loads((directory / "metadata.json").read_text())["search"]["best"]
    if best is None or best["objective"] < FAILED_S:
        return batches * PER_BATCH * RUNS, False
    rows, proposed = (pd.read_parquet(directory / f"{name}.parquet") for name in ("runs", "evaluations"))
    fresh = rows[(rows.configuration == best["configuration"]) & (rows.run_index >= RUNS)]
    confirmed = bool((fresh.outcome != "succeeded").sum() >= CONFIRMING_FAILURES)
    return (list(proposed.configuration).index(best["configuration"]) + 1) * RUNS + CONFIRMING_RUNS, confirmed


def found(place: Place, name: str, asked: argparse.Namespace) -> None:
    """Print runs to the first confirmed failure by strategy."""
    print(f"\n{name}: runs to a confirmed failure, {asked.seeds} seeds, at most {asked.batches * PER_BATCH * RUNS}")
    for strategy in asked.strategies:
        runs = [runs_to_confirmed(place, name, strategy, seed, asked.batches) for seed in range(asked.seeds)]
        low, middle, high = np.quantile(runs, (0.25, 0.5, 0.75))
        print(f"{strategy:10} median {middle:.0f} [{low:.0f}, {high:.0f}] of {runs}", flush=True)


def grid_rates(place: Place) -> Floats:
    """(NOISES, PASSAGES) failure rates over noise and passage."""
    sides = zip(NARROW_AND_WIDE.values(), (NOISES, PASSAGES), strict=True)
    noises, ys = (np.linspace(*ends, count).tolist() for ends, count in sides)
    boxes = [[box("box", 3.0, y, BOX_M)] for y in ys]
    variations = [
        {"ParameterVariationList": {"name": NOISE, "values": noises}},
        {"ParameterVariationList": {"name": "static_objects", "values": boxes, "dimension": "environment"}},
    ]
    family = {"name": "grid", "parameters": parameters_of(), "variations": variations}
    directory = run(place, "passage-grid", GRID_RUNS, configuration=[family])
    rows = pd.read_parquet(directory / "runs.parquet")
    failed = (rows.outcome != "succeeded").groupby(rows.configuration, sort=False).mean()
    return np.asarray(failed).reshape(NOISES, PASSAGES)


def searched_rates(place: Place, seed: int, runs: int) -> Floats:
    """(n, n) failure rates over noise and passage that `boundary` expects after so many runs."""
    more = {
        "per_batch": BOUNDARY_BATCH,
        "budget": [{"batches": runs // (BOUNDARY_RUNS * BOUNDARY_BATCH)}],
        "confirm": 0,
    }
    search = search_of(NARROW_AND_WIDE, IN_THE_DOOR, "boundary", seed, **more)
    directory = run(place, f"passage-boundary-{seed}", BOUNDARY_RUNS, search=search)
    expected = pd.read_parquet(directory / "boundary.parquet").expected.to_numpy()
    side = round(len(expected) ** 0.5)
    return expected.reshape(side, side)


def passage_of(rates: Floats) -> Floats:
    """Return the passage (NOISES,) at which half of the runs fail, as a share of the range, or NaN.

    A wider passage fails no more often: of rates the nearest that fall count, for of few runs one or the other crosses 50 % early.
    """
    falling = np.stack([isotonic_regression(each, increasing=False).x for each in rates])
    curve = curve_of(falling - 0.5, np.linspace(0.0, 1.0, rates.shape[1]))
    return curve[:: (len(curve) - 1) // (NOISES - 1)]


def distance(curve: Floats, reference: Floats) -> float:
    """Root mean square; where one of them has no place, it is the whole range."""
    off = np.where(np.isnan(curve) & np.isnan(reference), 0.0, curve - reference)
    return float(np.sqrt(np.mean(np.where(np.isnan(off), 1.0, off) ** 2)))


def boundary(place: Place, seeds: int) -> bool:
    """Print the distance between the 50 % curves of search and grid; True if the goal is met."""
    rates, budget, draws = grid_rates(place), NOISES * PASSAGES * GRID_RUNS // 5, np.random.default_rng(0)
    reference = passage_of(rates)
    redrawn = [passage_of(draws.binomial(GRID_RUNS, rates) / GRID_RUNS) for _ in range(REDRAWN)]
    said = f"{budget} runs against the grid's {rates.size * GRID_RUNS}"
    print(f"\nboundary: root mean square distance to the grid's curve, {seeds} seeds, {said}")
    print(f"the grid drawn again from its own rates: median {np.median([distance(c, reference) for c in redrawn]):.4f}")
    distances = [distance(passage_of(searched_rates(place, seed, budget)), reference) for seed in range(seeds)]
    print(
        f"boundary: median {np.median(distances):.4f}, worst {max(distances):.4f} of {np.round(distances, 4).tolist()}"
    )
    return max(distances) <= NEAR


def main(asked: argparse.Namespace) -> int:
    names = asked.proofs or (*SPACES, "boundary")
    with TemporaryDirectory() as folder:
        place = Place(Path(folder), asked.store or Path(folder, "store"), asked.workers)
        for name in (each for each in SPACES if each in names):
            found(place, name, asked)
        return 0 if "boundary" not in names or boundary(place, asked.seeds) else 1


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("proofs", nargs="*", metavar="PROOF", help="of door, passage, boundary; else all")
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--batches", type=int, default=12)
    parser.add_argument("--strategies", nargs="+", default=["random", "optuna", "qd"])
    parser.add_argument("--workers", type=int)
    parser.add_argument("--store", type=Path)
    sys.exit(main(parser.parse_args()))
