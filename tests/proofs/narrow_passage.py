"""Count MPPI's runs that arrive through a wide enough passage, by inflation.

    python tests/proofs/narrow_passage.py [--passages 0.75 0.8 0.85 0.9] [--runs 24] [--workers N]

The robot drives through the door of `search_real.py`, where a box leaves a passage, without noise, with the parameters of Nav2's default
file but for those of the inflation layers. Beside them stands what a cell costs at the inflation's edge, where the next one costs nothing.
"""

import argparse
import itertools
from collections import Counter
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import pyarrow.parquet as pq
from minimize import box
from search_real import BOX_M, Y_OF_PASSAGE_M, Place, parameters_of, run

from vastflow.sim.nav2.costmaps.inflation import cost_at_distance
from vastflow.sim.nav2.costmaps.outline import inscribed_radius_m, outline_of
from vastflow.sim.nav2.parameters.stack import NavParameters

INFLATIONS: Final = ((0.7, 3.0), (1.0, 3.0), (1.5, 3.0), (0.7, 6.0), (0.7, 10.0))
"""Radius (m) and `cost_scaling_factor`; the first ones are the default file's."""


def family(name: str, radius_m: float, scaling: float, passage_m: float) -> dict[str, Any]:
    """A family of one configuration."""
    given = parameters_of(box("box", 3.0, Y_OF_PASSAGE_M + passage_m, BOX_M))
    return {"name": name, "parameters": [*given, {"inflation_radius": radius_m}, {"cost_scaling_factor": scaling}]}


def arrived(place: Place, passages_m: list[float], runs: int) -> list[list[int]]:
    """Runs that reach the goal: of each inflation, of each passage."""
    cases = itertools.product(INFLATIONS, passages_m)
    families = [family(f"case-{k}", *inflation, passage_m) for k, (inflation, passage_m) in enumerate(cases)]
    directory = run(place, "passages", runs, configuration=families)
    rows = pq.read_table(directory / "runs.parquet", columns=["family", "outcome"]).to_pylist()
    found = Counter(row["family"] for row in rows if row["outcome"] == "succeeded")
    counts = iter([found[each["name"]] for each in families])
    return [[next(counts) for _ in passages_m] for _ in INFLATIONS]


def main() -> None:
    """Print a row for each inflation."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--passages", type=float, nargs="+", default=[0.75, 0.8, 0.85, 0.9])
    parser.add_argument("--runs", type=int, default=24)
    parser.add_argument("--workers", type=int)
    asked = parser.parse_args()
    with TemporaryDirectory() as folder:
        place = Place(Path(folder), Path(folder, "store"), asked.workers)
        found = arrived(place, asked.passages, asked.runs)
    widths = " | ".join(f"{passage_m} m" for passage_m in asked.passages)
    print(f"of {asked.runs} runs\n| inflation_radius | cost_scaling_factor | cost at its edge | {widths} |")
    print("|---:" * (3 + len(asked.passages)) + "|")
    inscribed_m = inscribed_radius_m(outline_of(NavParameters().local_costmap))
    for (radius_m, scaling), counts in zip(INFLATIONS, found, strict=True):
        edge = cost_at_distance(radius_m, inscribed_m, scaling)
        print(f"| {radius_m} m | {scaling:g} | {edge:.0f} | {' | '.join(map(str, counts))} |")


if __name__ == "__main__":
    main()
