"""On each of the paper's five maps: random paths, several runs each, without noise or obstacles.

Prints a table for each length with a line a map, and every failure with its reason. A length that a map has no path of is left out.
Exit code 1 when a map falls below 95 % of missions or the median true final distance to the goal exceeds 0.35 m; 2 when the
maps are not there.

    python docs/studies/five_maps.py [--maps DIR] [--only NAME] [--controller mppi|dwb|rpp] [--length 10 --length 20]
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import pandas as pd
from missions import map_files, map_parser, random_paths, runs_of, written

PATHS = 10
RUNS = 3
LEAST_SHARE = 0.95
GREATEST_MEDIAN_M = 0.35


def table_of(runs: pd.DataFrame) -> pd.DataFrame:
    """A row for each map."""
    weighted = runs["robustness.mean (m)"] * runs.simulated_s
    groups = runs.assign(reached=runs.outcome == "succeeded", weighted=weighted).groupby("family", observed=True)
    found = groups.agg(
        **{
            "runs": ("reached", "size"),
            "reached": ("reached", "sum"),
            "final median (m)": ("success.final_distance (m)", "median"),
            "max (m)": ("success.final_distance (m)", "max"),
            "localization mean (m)": ("weighted", "sum"),
            "localization max (m)": ("robustness.maximum (m)", "max"),
            "time (s)": ("simulated_s", "median"),
            "recoveries": ("recoveries", "sum"),
        }
    )
    found["localization mean (m)"] /= groups.simulated_s.sum()
    return found


def main() -> int:
    parser = map_parser(__doc__)
    parser.add_argument("--controller", choices=("mppi", "dwb", "rpp"), default="mppi")
    parser.add_argument("--length", action="append", type=float, metavar="M", help="of the paths; may be repeated")
    options = parser.parse_args()
    files = map_files(options.maps, options.only)
    good = True
    for length_m in options.length or (10.0, 20.0):
        path = {"path_length": length_m, "path_length_tolerance": 0.5, "num_paths": PATHS}
        families = [random_paths(file, options.controller, path) for file in files]
        with TemporaryDirectory() as folder:
            sections = {"execution": {"runs": RUNS}, "evaluation": {"oracles": ["robustness"]}}
            runs = runs_of(written(Path(folder), configuration=families, **sections))
        found = table_of(runs)
        good &= bool((found.reached >= LEAST_SHARE * found.runs).all())
        good &= bool((found["final median (m)"] <= GREATEST_MEDIAN_M).all())
        print(f"{options.controller}, paths of {length_m:g} m\n{found.to_string(float_format='{:.3f}'.format)}\n")
        failures = runs.loc[runs.outcome != "succeeded", ["configuration", "run_index", "outcome", "reason"]]
        print("every mission reached its goal" if failures.empty else failures.to_string(index=False), flush=True)
    return 0 if good else 1


if __name__ == "__main__":
    raise SystemExit(main())
