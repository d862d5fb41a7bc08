"""Count runs that keep their distance to obstacles that appear after various delays.

A simulator that spawns a box on request, as Gazebo does, needs a moment for it, and the paper does not say how long. The same configurations
of `campaigns/paper/safety.vast`, on its paths of 10 m, are run with each delay, and the same runs are judged by both readings of the
obstacle's radius.

    python tests/proofs/spawn_delays.py [--configurations 40] [--runs 4] [--json FILE]

`python tests/proofs/paper_page.py --delays FILE RESULTS...` puts the table into the page.
"""

import argparse
import json
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
import yaml

from vastflow.oracles.catalog.safety import READINGS
from vastflow.oracles.judgement.judge import judge_block
from vastflow.oracles.judgement.registry import oracles_of
from vastflow.oracles.judgement.verdict import Judgement, run_judgement
from vastflow.oracles.observation.observe import observe_block
from vastflow.oracles.statistics.intervals import counts_of
from vastflow.producers.campaign import Campaign, load_campaign
from vastflow.producers.instantiation.instantiate import instantiate
from vastflow.producers.model.configuration import Configuration
from vastflow.sim.model.blocks import write_recordings
from vastflow.sim.model.digest import digest
from vastflow.sim.run import run

SAFETY: Final = Path(__file__).parents[2] / "campaigns" / "paper" / "safety.vast"
DELAYS_S: Final = (0.0, 0.4, 0.8)
WAY_M: Final = 10.0


def triggered(configurations: int) -> tuple[Campaign, list[list[Configuration]]]:
    """The campaign with nothing but obstacles that appear, and configurations evenly spread over it: each with every delay."""
    asked = yaml.safe_load(SAFETY.read_text(encoding="utf-8").replace("../", f"{SAFETY.parent.parent}/"))
    for family in asked["configuration"]:
        _, ways, obstacles, _ = family["variations"]
        ways["PathVariationRandom"]["path_length"] = WAY_M
        kinds = obstacles["OneOfVariation"]["variations"]
        kinds[:] = [kind for kind in kinds if "ObstacleVariationWithDistanceTrigger" in kind]
        kinds[0]["ObstacleVariationWithDistanceTrigger"]["spawn_delay_s"] = list(DELAYS_S)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / SAFETY.name
        file.write_text(yaml.safe_dump(asked), encoding="utf-8")
        campaign = load_campaign(file)
        found: dict[str, list[Configuration]] = {}
        for each in instantiate(campaign).configurations:
            # Delays are the inner choice of the obstacle's producer: of one placement they come one after the other.
            alike = {k: v for k, v in each.factors.items() if not k.endswith("_delay_s")}
            found.setdefault(digest(each.family, alike), []).append(each)
    groups = [group for group in found.values() if len(group) == len(DELAYS_S)]
    chosen = np.unique(np.linspace(0, len(groups) - 1, min(configurations, len(groups))).astype(int))
    return campaign, [groups[k] for k in chosen]


def rows_of(groups: Sequence[Sequence[Configuration]], runs: int, seed: int) -> list[dict[str, Any]]:
    """Rates of mission, separation, and both, by delay and radius."""
    oracles, rows = oracles_of([("safety", {})]), []
    for k, delay_s in enumerate(DELAYS_S):
        reached: list[Judgement] = []
        kept: dict[str, list[Judgement]] = {reading: [] for reading in READINGS}
        for scenario in (group[k].scenario for group in groups):
            block = write_recordings([run(scenario, index, seed) for index in range(runs)])
            for verdict in judge_block(scenario, block, observe_block(scenario, block), oracles).verdicts:
                if verdict.oracle == "success":
                    reached.append(verdict.judgement)
                elif verdict.oracle == "safety":
                    for reading in READINGS:
                        margin = verdict.metrics[f"{reading}_margin"].value
                        touched = verdict.metrics["obstacle_contacts"].value
                        kept[reading].append("fail" if touched or (margin is not None and margin < 0) else "pass")
        for reading in READINGS:
            both = [run_judgement(pair) for pair in zip(reached, kept[reading], strict=True)]
            said = {"reached": reached, "kept": kept[reading], "both": both}
            rates = {name: counts_of(judgements).rate for name, judgements in said.items()}
            rows.append({"delay_s": delay_s, "reading": reading, **rates})
    return rows


def main() -> None:
    """Run, print, and keep what the page takes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--configurations", type=int, default=40)
    parser.add_argument("--runs", type=int, default=4)
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    campaign, groups = triggered(asked.configurations)
    rows = rows_of(groups, asked.runs, campaign.seed)
    print(f"{len(groups)} configurations × {asked.runs} runs with each delay")
    shown = pd.DataFrame(rows)[["delay_s", "reading", "kept", "reached", "both"]]
    names = {"delay_s": "delay (s)", "reading": "radius", "kept": "kept its distance", "reached": "goal reached"}
    percent = {name: "{:.1%}".format for name in ("kept", "reached", "both")}
    print(shown.to_string(index=False, header=[names.get(name, name) for name in shown], formatters=percent))
    if asked.json:
        said = {"configurations": len(groups), "runs": asked.runs, "rows": rows}
        asked.json.write_text(json.dumps(said, indent=1) + "\n")


if __name__ == "__main__":
    main()
