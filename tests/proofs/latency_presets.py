"""Measure the effect of latency on flakiness, in the same situations with each preset.

The configurations are those of `campaigns/latency/presets.vast` with more paths and boxes. Every run is a line of the file `--keep`; what
it has is not run again, and rounds go over all configurations, so that the table may be printed of a part.

    python tests/proofs/latency_presets.py [--configurations 100] [--runs 20] [--workers 2] [--controller mppi] [--keep FILE]
"""

import argparse
import json
import multiprocessing
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import yaml

from vastflow.oracles.judgement.judge import judge_block
from vastflow.oracles.judgement.oracle import Oracle
from vastflow.oracles.judgement.registry import oracles_of
from vastflow.oracles.observation.observe import observe_block
from vastflow.producers.campaign import load_campaign
from vastflow.producers.instantiation.instantiate import instantiate
from vastflow.producers.model.configuration import Configuration
from vastflow.sim.model.blocks import write_recordings
from vastflow.sim.model.digest import digest
from vastflow.sim.nav2.parameters.robot import PRESETS
from vastflow.sim.run import run

CAMPAIGN: Final = Path(__file__).parents[2] / "campaigns" / "latency" / "presets.vast"
PRESET: Final = "robot.latency.preset"
PATHS: Final = 8
PLACEMENTS: Final = 2
READINGS: Final = ("reached", "kept its distance")


@dataclass(frozen=True, slots=True)
class Classes:
    """Configurations by what their runs did.

    Attributes:
        failures: Failing runs.
        of_always: Those of configurations all of whose runs fail.
    """

    configurations: int
    always: int
    flaky: int
    runs: int
    failures: int
    of_always: int

    @property
    def flaky_share(self) -> float:
        """Number of failing configurations with runs that pass."""
        return self.flaky / (self.always + self.flaky) if self.always + self.flaky else float("nan")

    @property
    def always_share(self) -> float:
        """Share of failing runs in configurations that always fail."""
        return self.of_always / self.failures if self.failures else float("nan")


def classes_of(passed: Mapping[str, Sequence[bool]]) -> Classes:
    """Classes of configurations by the passes of their runs."""
    failing = {name: runs for name, runs in passed.items() if not all(runs)}
    always = [runs for runs in failing.values() if not any(runs)]
    return Classes(
        len(passed),
        len(always),
        len(failing) - len(always),
        sum(map(len, passed.values())),
        sum(list(runs).count(False) for runs in failing.values()),
        sum(map(len, always)),
    )


def situations(count: int, controller: str) -> tuple[list[dict[str, Configuration]], tuple[Oracle[Any], ...]]:
    """So many situations of the campaign, evenly spread over it, each with every preset; and its oracles."""
    asked = yaml.safe_load(CAMPAIGN.read_text(encoding="utf-8").replace("../", f"{CAMPAIGN.parent.parent}/"))
    for family in asked["configuration"]:
        _, paths, obstacles, _ = family["variations"]
        family["parameters"] = [{"controller": controller}]
        paths["PathVariationRandom"]["num_paths"] = PATHS
        for kind in obstacles["OneOfVariation"]["variations"]:
            next(iter(kind.values()))["count"] = PLACEMENTS
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / CAMPAIGN.name
        file.write_text(yaml.safe_dump(asked), encoding="utf-8")
        campaign = load_campaign(file)
        found: dict[str, dict[str, Configuration]] = {}
        for each in instantiate(campaign).configurations:
            alike = {key: value for key, value in each.factors.items() if key != PRESET}
            found.setdefault(digest(each.family, alike), {})[str(each.factors[PRESET])] = each
    whole = [group for group in found.values() if len(group) == len(PRESETS)]
    chosen = np.unique(np.linspace(0, len(whole) - 1, min(count, len(whole))).astype(int))
    return [whole[k] for k in chosen], oracles_of([(each.name, each.parameters) for each in campaign.oracles])


def judged(configuration: Configuration, run_index: int, oracles: Sequence[Oracle[Any]]) -> list[bool]:
    """Whether a run reached its goal, and whether it kept its distance too."""
    block = write_recordings([run(configuration.scenario, run_index)])
    verdicts = judge_block(
        configuration.scenario, block, observe_block(configuration.scenario, block), oracles
    ).verdicts
    reached = next(verdict.judgement == "pass" for verdict in verdicts if verdict.oracle == "success")
    return [reached, all(verdict.judgement != "fail" for verdict in verdicts)]


def table(kept: Mapping[str, Mapping[int, list[bool]]], names: Sequence[str]) -> Iterator[str]:
    """A line for each preset and reading of a pass, of the runs that all presets have."""
    yield "| a pass is | preset | configurations | runs | failing runs | failing configurations | always | flaky | flaky of the failing | failing runs of always failing |"
    yield "|---|---|---|---|---|---|---|---|---|---|"
    for k, reading in enumerate(READINGS):
        for preset in PRESETS:
            passed: dict[str, list[bool]] = {}
            for name in names:
                runs = [kept.get(f"{name} {each}", {}) for each in PRESETS]
                if common := set.intersection(*(set(each) for each in runs)):
                    passed[name] = [kept[f"{name} {preset}"][index][k] for index in sorted(common)]
            c = classes_of(passed)
            yield (
                f"| {reading} | {preset} | {c.configurations} | {c.runs} | {c.failures} | {c.always + c.flaky} | {c.always} | {c.flaky} "
                f"| {c.flaky_share:.0%} | {c.always_share:.0%} |"
            )


def _kept(file: Path) -> dict[str, dict[int, list[bool]]]:
    kept: dict[str, dict[int, list[bool]]] = {}
    for line in file.read_text().splitlines() if file.exists() else ():
        key, run_index, found = json.loads(line)
        kept.setdefault(key, {})[run_index] = found
    return kept


def _work(task: tuple[str, Configuration, int, tuple[Oracle[Any], ...]]) -> tuple[str, int, list[bool]]:
    key, configuration, run_index, oracles = task
    return key, run_index, judged(configuration, run_index, oracles)


def _loop_s() -> float:
    before = time.process_time()
    for _ in range(5_000_000):
        pass
    return time.process_time() - before


def main() -> None:
    """Run what is not kept, round by round, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--configurations", type=int, default=100)
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--controller", default="mppi")
    parser.add_argument("--keep", type=Path, default=Path("latency_presets.jsonl"))
    asked = parser.parse_args()
    groups, oracles = situations(asked.configurations, asked.controller)
    names = [digest(group["ideal"].family, group["ideal"].name)[:16] for group in groups]
    kept = _kept(asked.keep)
    tasks = [
        (f"{name} {preset}", group[preset], run_index, oracles)
        for run_index in range(asked.runs)
        for name, group in zip(names, groups, strict=True)
        for preset in PRESETS
        if run_index not in kept.get(f"{name} {preset}", {})
    ]
    print(f"{len(groups)} situations, {len(tasks)} runs to do; loop {_loop_s():.3f} s", flush=True)
    with asked.keep.open("a") as file, multiprocessing.get_context("spawn").Pool(asked.workers) as pool:
        for key, run_index, found in pool.imap_unordered(_work, tasks):
            print(json.dumps([key, run_index, found]), file=file, flush=True)
    print("\n".join(table(_kept(asked.keep), names)))


if __name__ == "__main__":
    main()
