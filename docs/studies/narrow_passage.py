"""Count MPPI's runs that arrive through a wide enough passage, by inflation.

    python docs/studies/narrow_passage.py [--passages 0.75 0.8 0.85 0.9] [--runs 24] [--workers N]

The robot drives through the door of `search_real.py`, where a box leaves a passage, without noise, with the parameters of Nav2's default
file but for those of the inflation layers. Beside them stands what a cell costs at the inflation's edge, where the next one costs nothing.
"""

import itertools
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import pandas as pd
from minimize import box
from missions import parser_of
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


def arrived(place: Place, passages_m: list[float], runs: int) -> pd.DataFrame:
    """Runs that reach the goal: a row for each inflation, a column for each passage."""
    cases = [(*inflation, passage_m) for inflation, passage_m in itertools.product(INFLATIONS, passages_m)]
    families = [family(f"case-{k}", *case) for k, case in enumerate(cases)]
    rows = pd.read_parquet(run(place, "passages", runs, configuration=families) / "runs.parquet")
    found = (rows.outcome == "succeeded").groupby(rows.family).sum()
    names = ["inflation_radius", "cost_scaling_factor", "passage"]
    table = pd.DataFrame(cases, columns=names).assign(arrived=[found[each["name"]] for each in families])
    return table.pivot(index=names[:2], columns="passage", values="arrived")


def main() -> None:
    """Print a row for each inflation."""
    parser = parser_of(__doc__)
    parser.add_argument("--passages", type=float, nargs="+", default=[0.75, 0.8, 0.85, 0.9])
    parser.add_argument("--runs", type=int, default=24)
    parser.add_argument("--workers", type=int)
    asked = parser.parse_args()
    with TemporaryDirectory() as folder:
        found = arrived(Place(Path(folder), Path(folder, "store"), asked.workers), asked.passages, asked.runs)
    inscribed_m = inscribed_radius_m(outline_of(NavParameters().local_costmap))
    edges = [cost_at_distance(radius_m, inscribed_m, scaling) for radius_m, scaling in found.index]
    print(f"of {asked.runs} runs\n{found.assign(**{'cost at its edge': edges}).to_string()}")


if __name__ == "__main__":
    main()
