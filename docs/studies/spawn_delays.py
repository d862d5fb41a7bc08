"""Count runs that keep their distance to obstacles that appear after various delays.

A simulator that spawns a box on request, as Gazebo does, needs a moment for it, and the paper does not say how long. The same configurations
of `campaigns/paper/safety.vast`, on its paths of 10 m, are run with each delay, and the same runs are judged by both readings of the
obstacle's radius.

    python docs/studies/spawn_delays.py [--configurations 40] [--runs 4] [--json FILE]

`python docs/studies/paper_page.py --delays FILE RESULTS...` puts the table into the page.
"""

import json
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import pandas as pd
from missions import parser_of, runs_of, sections_of, situations, written

from vastflow.oracles.catalog.safety import READINGS

SAFETY: Final = Path(__file__).parents[2] / "campaigns" / "paper" / "safety.vast"
DELAYS_S: Final = (0.0, 0.4, 0.8)
WAY_M: Final = 10.0


def delayed(folder: Path) -> Path:
    """The campaign with nothing but obstacles that appear, with each delay."""
    sections = sections_of(SAFETY)
    for family in sections["configuration"]:
        _, ways, obstacles, _ = family["variations"]
        ways["PathVariationRandom"]["path_length"] = WAY_M
        kinds = obstacles["OneOfVariation"]["variations"]
        kinds[:] = [kind for kind in kinds if "ObstacleVariationWithDistanceTrigger" in kind]
        kinds[0]["ObstacleVariationWithDistanceTrigger"]["spawn_delay_s"] = list(DELAYS_S)
    return written(folder, **sections)


def rows_of(runs: pd.DataFrame) -> list[dict[str, Any]]:
    """Rates of mission, separation, and both, by delay and radius."""
    rows = []
    for delay_s, group in runs.groupby("spawn_delay_s"):
        for reading in READINGS:
            near = group[f"safety.{reading}_margin (m)"] < 0
            kept, reached = ~near & (group["safety.obstacle_contacts"] == 0), group["passed.success"]
            rates = {"reached": reached.mean(), "kept": kept.mean(), "both": (reached & kept).mean()}
            rows.append({"delay_s": delay_s, "reading": reading, **rates})
    return rows


def main() -> None:
    """Run, print, and keep what the page takes."""
    parser = parser_of(__doc__)
    parser.add_argument("--configurations", type=int, default=40)
    parser.add_argument("--runs", type=int, default=4)
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    with TemporaryDirectory() as folder:
        file = delayed(Path(folder))
        groups = situations(file, "_delay_s", len(DELAYS_S), asked.configurations)
        rows = rows_of(runs_of(file, only=[each.name for group in groups for each in group], runs=asked.runs))
    print(f"{len(groups)} configurations × {asked.runs} runs with each delay")
    print(pd.DataFrame(rows).to_string(index=False, float_format="{:.3f}".format))
    if asked.json:
        said = {"configurations": len(groups), "runs": asked.runs, "rows": rows}
        asked.json.write_text(json.dumps(said, indent=1) + "\n")


if __name__ == "__main__":
    main()
