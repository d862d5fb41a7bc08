"""Measure the effect of latency on flakiness, in the same situations with each preset.

The configurations are those of `campaigns/latency/presets.vast` with more paths and boxes. Runs that the store has are not run again.

    python docs/studies/latency_presets.py [--configurations 100] [--runs 20] [--workers 2] [--controller mppi] [--store STORE]
"""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import pandas as pd
from missions import parser_of, runs_of, sections_of, situations, written

from vastflow.sim.system.robot import PRESETS

CAMPAIGN: Final = Path(__file__).parents[2] / "campaigns" / "latency" / "presets.vast"
PRESET: Final = "robot.latency.preset"
PATHS: Final = 8
PLACEMENTS: Final = 2


def larger(folder: Path, controller: str) -> Path:
    """The campaign with more paths and boxes, and one controller."""
    sections = sections_of(CAMPAIGN)
    for family in sections["configuration"]:
        _, paths, obstacles, _ = family["variations"]
        family["parameters"] = [{"controller": controller}]
        paths["PathVariationRandom"]["num_paths"] = PATHS
        for kind in obstacles["OneOfVariation"]["variations"]:
            next(iter(kind.values()))["count"] = PLACEMENTS
    return written(folder, **sections)


def classes_of(runs: pd.DataFrame) -> dict[str, str | int]:
    """Counts of configurations by what their runs did; `runs` has `configuration` and `passed`."""
    found = runs.groupby("configuration", observed=True).passed.agg(["size", "sum"])
    failures = found["size"] - found["sum"]
    always, failing = found["sum"] == 0, failures > 0
    return {
        "configurations": len(found),
        "runs": len(runs),
        "failing runs": failures.sum(),
        "failing configurations": failing.sum(),
        "always": always.sum(),
        "flaky": (failing & ~always).sum(),
        "flaky of the failing": f"{(failing & ~always).sum() / max(failing.sum(), 1):.0%}",
        "failing runs of always failing": f"{failures[always].sum() / max(failures.sum(), 1):.0%}",
    }


def table_of(runs: pd.DataFrame) -> pd.DataFrame:
    """A row for each preset and reading of a pass."""
    reached, safe = (runs[f"passed.{oracle}"].fillna(oracle == "safety") for oracle in ("success", "safety"))
    readings = {"reached": reached, "kept its distance": reached & safe}
    rows = [
        {"a pass is": reading, "preset": each, **classes_of(runs.assign(passed=passed)[runs[PRESET] == each])}
        for reading, passed in readings.items()
        for each in PRESETS
    ]
    return pd.DataFrame(rows)


def main() -> None:
    """Run and print the table."""
    parser = parser_of(__doc__)
    parser.add_argument("--configurations", type=int, default=100)
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--workers", type=int)
    parser.add_argument("--controller", default="mppi")
    parser.add_argument("--store")
    asked = parser.parse_args()
    with TemporaryDirectory() as folder:
        file = larger(Path(folder), asked.controller)
        chosen = [each.name for group in situations(file, PRESET, len(PRESETS), asked.configurations) for each in group]
        found = table_of(runs_of(file, only=chosen, runs=asked.runs, workers=asked.workers, store=asked.store))
    print(found.to_string(index=False))


if __name__ == "__main__":
    main()
