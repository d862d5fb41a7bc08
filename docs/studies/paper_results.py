"""A campaign directory of one of the paper's campaigns, reduced to the figures that the paper states of its own."""

import json
import statistics
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import pyarrow.parquet as pq
from paper_published import LOCAL_PADDING_M, LOCAL_RADIUS_M, PUBLISHED, Kind, Published
from scipy import ndimage

from vastflow.oracles.judgment.verdict import Judgment, run_judgment
from vastflow.oracles.results.units import units_of
from vastflow.oracles.statistics.intervals import Counts, Interval, clustered, counts_of, pooled, wilson
from vastflow.sim.model.faults import UserError
from vastflow.sim.model.files import read_json
from vastflow.sim.nav2.costmaps.outline import inscribed_radius_m, padded_outline
from vastflow.sim.world.map_file import load_map

READINGS: Final[Mapping[Kind, tuple[str, ...]]] = {
    "robustness": ("update", "step", "metre", "mean", "maximum"),
    "safety": ("footprint", "cube"),
}
"""Readings of "summed localization error", and of "the maximum distance from the cube center to a corner"."""
NAME: Final = "paper-"
ORIGINAL_MAPS: Final = "-original-maps"
KEPT: Final = ("recordings", "traces", "logs")
RUN_LOGS: Final = "logs/runs.jsonl"
DENSITIES_PER_M: Final = (0.2, 0.6)
COLLISION_M: Final = inscribed_radius_m(padded_outline(LOCAL_RADIUS_M, LOCAL_PADDING_M))
"""Distance of the robot's center from a wall up to which the wall reaches into its padded footprint (m)."""

Row = Mapping[str, Any]
RunKey = tuple[str, int]


class NotThePapers(UserError, ValueError):
    """A campaign directory that is none of the paper's campaigns, or lacks what is needed; says what was found."""


Weights = Mapping[str, int]
"""Configuration to the number of requests; 1 for those not in it."""


@dataclass(frozen=True, slots=True)
class WeightedRate:
    """The rate of weighted configurations.

    Attributes:
        counts: Runs, each as often as its configuration was requested.
        rate: Weighted mean of the configurations' rates; None where nothing was judged.
        interval: Wilson's interval of the rate, at Kish's effective number of runs, (Σ w)² / Σ (w² / n).
        clustered: For other configurations of their kind, see `clustered`.
    """

    counts: Counts
    rate: float | None
    interval: Interval
    clustered: Interval | None


def weights_of(configurations: Iterable[tuple[str, str | None]]) -> dict[str, int]:
    """Weight of each executed configuration: 1 and the number of its duplicates, from names and `duplicate_of`."""
    return dict(Counter(duplicate_of or name for name, duplicate_of in configurations))


def weighted_counts(counts: Mapping[str, Counts], weights: Weights) -> dict[str, Counts]:
    """Counts with each configuration weighted by its number of requests."""
    return {
        name: Counts(*(weights.get(name, 1) * n for n in (each.passed, each.failed, each.not_judged)))
        for name, each in counts.items()
    }


def weighted_rate(
    counts: Mapping[str, Counts], weights: Weights, blocks: Mapping[str, int] | None = None
) -> WeightedRate:
    """The rate over configurations with weights, and with block numbers if configurations share blocks."""
    repeated = weighted_counts(counts, weights)
    judged = [(weights.get(name, 1), each) for name, each in counts.items() if each.judged]
    rate, interval = None, Interval(0.0, 1.0)
    if judged:
        total = sum(weight for weight, _ in judged)
        rate = min(sum(weight * each.passed / each.judged for weight, each in judged) / total, 1.0)
        effective = total**2 / sum(weight**2 / each.judged for weight, each in judged)
        interval = wilson(rate * effective, effective)
    of = None if blocks is None else [blocks[name] for name in repeated]
    return WeightedRate(pooled(repeated.values()), rate, interval, clustered(list(repeated.values()), blocks=of))


class Requested(NamedTuple):
    """Counts of the requested configurations by what became of them.

    `all` is the product of all choices, or the size of a family's sample. Others have no way of the length on the map, no room for the
    obstacles, or are equal to another; `distinct` is what is left, each one once.
    """

    all: int
    no_way: int
    no_room: int
    duplicates: int
    distinct: int


@dataclass(frozen=True, slots=True)
class Reading:
    """One reading of a criterion that the paper's words leave open.

    Attributes:
        name: A metric of `robustness`, or the radius of an obstacle in `safety`.
        alone: Runs by this criterion alone.
        reached: Runs that pass only if the mission succeeded too.
        median_m: Median of the error, or of the margin to the required separation; None where there is none.
    """

    name: str
    alone: Counts
    reached: Counts
    median_m: float | None


@dataclass(frozen=True, slots=True)
class Part:
    """Some of the configurations, with the counts of their runs."""

    name: str
    configurations: int
    counts: Counts


@dataclass(frozen=True, slots=True)
class Begun:
    """Configurations that start alike.

    Attributes:
        counts: Judgments of their runs by all oracles together.
        stood_still: Runs whose robot was sent and never moved.
    """

    configurations: int
    counts: Counts
    stood_still: int


@dataclass(frozen=True, slots=True)
class Starts:
    """The configurations of a campaign by where they start.

    Attributes:
        near: Configurations that start with a wall in their padded footprint.
        free: The others.
        moved: Judgments, by all oracles together, of the runs that did not stand still, wherever they start.
        causes: Why runs stood still, of `vastflow.sim.loop.standstill.CAUSES`, to how many did.
    """

    near: Begun
    free: Begun
    moved: Counts
    causes: Mapping[str, int]


class Way(NamedTuple):
    """Means over runs: simulated time (s), and way driven (m)."""

    simulated_s: float
    distance_m: float


@dataclass(frozen=True)
class PaperResults:
    """One of the paper's campaigns as it was run here.

    Attributes:
        original_maps: Whether on the paper's maps, else on our own floor plans.
        sampled_from: Distinct configurations of which those that were run are a sample; None where all were run.
        runs: Number of runs of each configuration.
        counts: Configuration to what all oracles together say of its runs.
        weights: Configuration to how often the file asks for it.
        blocks: Configuration to the number of its block, equal on one map with one task.
        oracles: Name to what each says of all runs.
        reached: Judgments, by the campaign's own oracle, of the runs whose mission succeeded.
        parts: Parts of the configurations, by what the campaign varies.
        starts: By the room that the robot has where it starts.
        readings: Readings of the criterion of robustness or safety; empty for performance.
        ways: Means over the runs as they are, and over the weighted runs.
        stored_bytes: Recordings, traces, behaviors, logs and tables, without report and pictures.
        runs_cpu_s: CPU time of the simulation of all runs, by their logs.
        executed, executed_s, cpu_s: Runs executed by the call that wrote the directory, their simulated time, CPU time of all its processes.
        cpus: Number of CPUs of that call's host.
    """

    kind: Kind
    original_maps: bool
    requested: Requested
    sampled_from: int | None
    runs: int
    counts: Mapping[str, Counts]
    weights: Mapping[str, int]
    blocks: Mapping[str, int]
    oracles: Mapping[str, Counts]
    reached: Counts
    parts: tuple[Part, ...]
    starts: Starts
    readings: tuple[Reading, ...]
    ways: tuple[Way, Way]
    stored_bytes: int
    runs_cpu_s: float
    executed: int
    executed_s: float
    cpu_s: float
    cpus: int

    @property
    def published(self) -> Published:
        """The paper's own."""
        return PUBLISHED[self.kind]

    @property
    def whole(self) -> Counts:
        """All runs."""
        return pooled(self.counts.values())

    @property
    def alone(self) -> float | None:
        """Simulated time for a second of CPU, of the simulation alone."""
        return self.ways[0].simulated_s * self.whole_runs / self.runs_cpu_s if self.runs_cpu_s else None

    @property
    def call(self) -> float | None:
        """Simulated time for a second of CPU, of the whole call; None where it executed nothing."""
        return self.executed_s / self.cpu_s if self.executed and self.cpu_s else None

    @property
    def whole_runs(self) -> int:
        """Runs of all configurations."""
        return sum(each.judged + each.not_judged for each in self.counts.values())

    @property
    def configurations(self) -> int:
        """Number of configurations that were run."""
        return len(self.counts)

    @property
    def as_the_paper_counts(self) -> int:
        """Configurations of the whole campaign, equal ones apart."""
        return self.requested.distinct + self.requested.duplicates


def paper_results(directory: Path) -> PaperResults:
    """Read a campaign directory.

    Raises:
        NotThePapers: it is of another campaign.
        OSError, ValueError, KeyError: it is damaged.
    """
    metadata = read_json(directory / "metadata.json")
    kind = _kind(directory, metadata["name"])
    configurations = _rows(
        directory, "configurations", ["name", "duplicate_of", "environment", "factors", "provenance", "scenario"]
    )
    runs = _rows(directory, "runs", ["configuration", "run_index", "simulated_s", "distance_m", "stood_still"])
    verdicts = _rows(directory, "verdicts", ["configuration", "run_index", "oracle", "judgment", "metrics"])
    counts = metadata["counts"]
    said: dict[RunKey, list[Judgment]] = defaultdict(list)
    for row in verdicts:
        said[_run(row)].append(row["judgment"])
    judgments = {key: run_judgment(each) for key, each in said.items()}
    of_each: dict[str, list[Judgment]] = defaultdict(list)
    for (name, _), judgment in judgments.items():
        of_each[name].append(judgment)
    by_configuration = {name: counts_of(each) for name, each in of_each.items()}
    weights = weights_of((row["name"], row["duplicate_of"]) for row in configurations)
    blocks = units_of([json.loads(row["scenario"]) for row in configurations]).codes.tolist()
    distinct = [row for row in configurations if row["duplicate_of"] is None]
    begun = [{**row, "start": json.loads(row["factors"])["start_pose"]} for row in distinct]
    return PaperResults(
        kind=kind,
        original_maps=metadata["name"].endswith(ORIGINAL_MAPS),
        requested=requested_of(read_json(directory / "coverage.json")),
        sampled_from=counts.get("sampled_from"),
        runs=metadata["asked"]["runs"],
        counts=by_configuration,
        weights=weights,
        blocks=dict(zip((row["name"] for row in configurations), blocks, strict=True)),
        oracles={name: Counts(**said) for name, said in counts["oracles"].items()},
        reached=_reached(kind, verdicts),
        parts=parts_of(kind, distinct, by_configuration),
        starts=starts_of(directory / "environments", begun, runs, judgments),
        readings=tuple(_readings(kind, verdicts)),
        ways=(_way(runs, {}), _way(runs, weights)),
        stored_bytes=sum(_stored(directory)),
        runs_cpu_s=sum(_cpu_s(directory)),
        executed=counts["executed"],
        executed_s=counts["simulated_s"],
        cpu_s=counts["cpu_s"],
        cpus=metadata["host"]["cpus"],
    )


def requested_of(coverage: Row) -> Requested:
    """The sums over the families of `coverage.json`, in whole configurations.

    What a producer rejects is counted there once, whatever else would have been combined with it; here as many times as that.
    """
    asked = no_way = 0
    for family in coverage["families"].values():
        design = family["design"]
        if design["kind"] != "cartesian":
            asked += design["size"]
            continue
        asked += design["product"]
        ways = sum(by["count"] for name, by in family["unrealizable_by"].items() if name.startswith("PathVariation"))
        no_way += ways * _later_choices(family["factors"])
    duplicates, distinct = coverage["duplicate"], coverage["realized"]
    return Requested(asked, no_way, asked - no_way - duplicates - distinct, duplicates, distinct)


def _later_choices(factors: list[Row]) -> int:
    """Number of configurations of each kind."""
    product, seen = 1, False
    for factor in factors:
        product *= factor["levels"] if seen else 1
        seen = seen or "start_pose" in factor["name"]
    return product


def _kind(directory: Path, name: str) -> Kind:
    for kind in PUBLISHED:
        if name in (f"{NAME}{kind}", f"{NAME}{kind}{ORIGINAL_MAPS}"):
            return kind
    raise NotThePapers(f"{directory}: campaign {name!r} is none of the paper's; one of those in campaigns/paper")


def _reached(kind: Kind, verdicts: list[Row]) -> Counts:
    succeeded = {_run(row) for row in verdicts if row["oracle"] == "success" and row["judgment"] == "pass"}
    return counts_of(row["judgment"] for row in verdicts if row["oracle"] == kind and _run(row) in succeeded)


def _run(row: Row) -> RunKey:
    return row["configuration"], row["run_index"]


def _readings(kind: Kind, verdicts: list[Row]) -> Iterator[Reading]:
    reached = {_run(row): row["judgment"] for row in verdicts if row["oracle"] == "success"}
    measured = {_run(row): json.loads(row["metrics"]) for row in verdicts if row["oracle"] == kind}
    for name in READINGS.get(kind, ()):
        found = {key: (_error if kind == "robustness" else _separation)(each, name) for key, each in measured.items()}
        values = [value for value, _ in found.values() if value is not None]
        both = counts_of(run_judgment([judgment, reached[key]]) for key, (_, judgment) in found.items())
        median_m = statistics.median(values) if values else None
        yield Reading(name, counts_of(judgment for _, judgment in found.values()), both, median_m)


def _error(metrics: Row, basis: str) -> tuple[float | None, Judgment]:
    """The localization error on one basis, and what it says of the run."""
    value = metrics[basis]["value"]
    if value is None:
        return None, "not judged"
    return value, "pass" if value <= metrics["threshold"]["value"] else "fail"


def _separation(metrics: Row, radius: str) -> tuple[float | None, Judgment]:
    """The margin to the required separation, under one reading of the obstacle's radius."""
    margin_m = metrics[f"{radius}_margin"]["value"]
    kept = (margin_m is None or margin_m >= 0) and not metrics["obstacle_contacts"]["value"]
    return margin_m, "pass" if kept else "fail"


def _way(runs: list[Row], weights: Mapping[str, int]) -> Way:
    weight = [weights.get(row["configuration"], 1) for row in runs]
    whole = sum(weight) or 1
    return Way(*(sum(w * row[name] for w, row in zip(weight, runs, strict=True)) / whole for name in Way._fields))


def _cpu_s(directory: Path) -> Iterator[float]:
    file = directory / RUN_LOGS
    lines = file.read_text(encoding="utf-8").splitlines() if file.is_file() else []
    yield from (row["cpu_s"] for line in lines for row in json.loads(line)["runs"])


def _stored(directory: Path) -> Iterator[int]:
    for folder in KEPT:
        yield from (file.stat().st_size for file in (directory / folder).rglob("*") if file.is_file())
    yield from (file.stat().st_size for file in directory.glob("*.parquet"))


def _rows(directory: Path, table: str, columns: list[str]) -> list[Row]:
    return pq.ParquetFile(directory / f"{table}.parquet").read(columns=columns).to_pylist()


def parts_of(kind: Kind, configurations: Iterable[Row], counts: Mapping[str, Counts]) -> tuple[Part, ...]:
    """Every level of everything that varies, in order."""
    found: dict[tuple[str, float, str], list[Counts]] = defaultdict(list)
    for row in configurations:
        for level in _levels(kind, json.loads(row["factors"]), json.loads(row["provenance"])):
            found[level].append(counts.get(row["name"], Counts()))
    return tuple(Part(level[-1], len(of_level), pooled(of_level)) for level, of_level in sorted(found.items()))


def _levels(kind: Kind, factors: Row, provenance: Row) -> Iterator[tuple[str, float, str]]:
    """Yield what varies and its level, by which parts are ordered, and the part's name."""
    if kind == "robustness":
        loops, lost = factors["number_of_loops"], factors["laserscan_random_drop_percentage"]
        noise_m = factors["laserscan_gaussian_noise_std_deviation"]
        yield "loops", loops, f"loops {loops}"
        yield "lost", lost, f"lost beams {100 * lost:.0f} %"
        yield "noise", noise_m, f"noise {noise_m:.2f} m"
        return
    radius_m = factors["global_costmap.robot_radius"]
    yield "global", radius_m, f"global radius {radius_m:.3f} m"
    if kind != "safety":
        return
    if "spawn_trigger_threshold" in factors:
        ahead_m = factors["spawn_trigger_threshold"]
        yield "obstacle appears", ahead_m, f"obstacle appears at {ahead_m:g} m"
    elif obstacles := factors.get("static_objects", []):
        found_per_m = len(obstacles) / provenance["_path_length"]
        density_per_m = min(DENSITIES_PER_M, key=lambda asked_per_m: abs(asked_per_m - found_per_m))
        yield "obstacles", density_per_m, f"obstacles, {density_per_m:g} for each meter"
    else:
        yield "obstacles", 0.0, "no obstacles"


def starts_of(
    environments: Path, configurations: Iterable[Row], runs: Iterable[Row], judgments: Mapping[RunKey, Judgment]
) -> Starts:
    """Sort configurations by the room they have at the start.

    Args:
        environments: Folder of the campaign directory's maps.
        configurations: `name`, `environment` and the pose `start`, a row each.

    Raises:
        ValueError, OSError: a map is damaged.
    """

    @cache
    def ground(environment: str) -> Any:
        occupancy = load_map(environments / environment / "map.yaml")
        cells = ndimage.distance_transform_edt(~occupancy.occupied)
        return occupancy, np.maximum(cells - 0.5, 0.0) * occupancy.resolution_m

    def is_near(environment: str, position: Mapping[str, float]) -> bool:
        """Whether a wall's cell is that near, or the place off the map."""
        occupancy, distance_m = ground(environment)
        cell = occupancy.cell_of(position["x"], position["y"])
        return not occupancy.contains(*cell) or round(float(distance_m[cell]), 9) <= COLLISION_M

    near = {row["name"]: is_near(row["environment"], row["start"]["position"]) for row in configurations}
    stood_still = {_run(row): row["stood_still"] for row in runs if row["stood_still"] is not None}

    def begun(beside_a_wall: bool) -> Begun:
        names = {name for name, beside in near.items() if beside is beside_a_wall}
        said = counts_of(judgment for (name, _), judgment in judgments.items() if name in names)
        return Begun(len(names), said, sum(name in names for name, _ in stood_still))

    moved = counts_of(said for key, said in judgments.items() if key not in stood_still)
    return Starts(begun(True), begun(False), moved, Counter(stood_still.values()))
