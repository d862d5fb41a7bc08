"""Causes of failed runs, standstills at the start, and oracles that pass or fail every run."""

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vastflow.oracles.judgment.cause import CAUSES, Cause
from vastflow.oracles.results.schema import codes, integers
from vastflow.oracles.results.tables import FAIL, PASS, Tables
from vastflow.oracles.statistics.intervals import Floats
from vastflow.sim.loop import standstill


@dataclass(frozen=True, slots=True)
class CauseCount:
    """The runs of one cause.

    Attributes:
        configurations: Number of configurations with such runs.
        configuration, run_index: An example: the first such run of the configuration with most of them.
    """

    cause: Cause
    runs: int
    configurations: int
    configuration: str
    run_index: int


def causes_of(tables: Tables) -> tuple[CauseCount, ...]:
    """The causes of failed runs, the most frequent first and `unknown` last."""
    runs = tables.runs
    if "cause" not in runs.column_names:  # of an earlier version
        return ()
    (cause, known), (configuration, names) = codes(runs["cause"]), codes(runs["configuration"])
    index = integers(runs["run_index"])
    found = []
    for name in CAUSES:
        if name in known:
            rows = np.flatnonzero(cause == known.index(name))
            of, times = np.unique(configuration[rows], return_counts=True)
            most = int(of[times.argmax()])
            first = int(index[rows[configuration[rows] == most]].min())
            found.append(CauseCount(name, len(rows), len(of), names[most], first))
    return tuple(sorted(found, key=lambda each: (each.cause == "unknown", -each.runs)))


def causes_by_configuration(tables: Tables) -> Mapping[str, Counter[str]]:
    """The number of failed runs by cause, of each configuration; there are none in a directory of an earlier version."""
    found: dict[str, Counter[str]] = {name: Counter() for name in tables.configurations.names}
    if "cause" in tables.runs.column_names:
        failed = tables.runs.filter(tables.runs["cause"].is_valid())
        for name, cause in zip(*(failed[column].to_pylist() for column in ("configuration", "cause")), strict=True):
            found[name][cause] += 1
    return found


def causes_json(causes: tuple[CauseCount, ...]) -> Mapping[str, Any]:
    """Cause to its counts, meaning, and example run."""
    return {
        each.cause: {
            "means": CAUSES[each.cause],
            "runs": each.runs,
            "configurations": each.configurations,
            "example": {"configuration": each.configuration, "run_index": each.run_index},
        }
        for each in causes
    }


@dataclass(frozen=True, slots=True)
class Standstills:
    """Failed runs in which the robot never moved; they count in every rate.

    Attributes:
        causes: Cause (of `vastflow.sim.loop.standstill.CAUSES`) to number of runs, the most frequent first.
        configurations: Configuration to number of runs, in the order of the table.
    """

    causes: Mapping[str, int]
    configurations: Mapping[str, int]

    @property
    def runs(self) -> int:
        return sum(self.configurations.values())

    @property
    def text(self) -> str:
        """`stood still at the start: 12 runs (10: the collision monitor …; 2: …)`."""
        why = "; ".join(f"{n:,}: {standstill.CAUSES.get(cause, cause)}" for cause, n in self.causes.items())
        said = f"stood still at the start: {self.runs:,} run{'' if self.runs == 1 else 's'}"
        return f"{said} ({why})" if why else said

    def of(self, names: Iterable[str]) -> int:
        """Number of runs of some configurations."""
        return sum(self.configurations.get(name, 0) for name in names)


def standstills_of(tables: Tables) -> Standstills:
    """The standstills of a campaign; empty for a directory of an earlier version."""
    if "stood_still" not in tables.runs.column_names:
        return Standstills({}, {})
    found = tables.runs.filter(tables.runs["stood_still"].is_valid())
    names, causes = (Counter(found[name].to_pylist()) for name in ("configuration", "stood_still"))
    return Standstills(dict(causes.most_common()), dict(names))


MEASURES_ALONE: Final = frozenset({"navigation"})
"""Oracles that only measure."""
MARGIN: Final = "margin"
"""Metric of the distance from failing: a run fails below 0."""
THRESHOLD: Final = "threshold"
"""Metric of the value above which another one fails a run."""


@dataclass(frozen=True, eq=False)
class Score:
    """The score behind an oracle's verdicts, over the judged runs that have it.

    Attributes:
        values: (n,) of `metric`, at most `thresholds` in a passed run, or at least where `is_margin`.
    """

    metric: str
    unit: str
    values: Floats = field(repr=False)
    thresholds: Floats = field(repr=False)
    is_margin: bool

    @property
    def threshold(self) -> float | None:
        """The threshold of all runs; None where they differ."""
        return float(self.thresholds[0]) if np.ptp(self.thresholds) == 0.0 else None

    @property
    def slacks(self) -> Floats:
        """Values (n,), as multiples of the threshold where runs differ in it."""
        return self.values if self.threshold is not None else self.values / self.thresholds


@dataclass(frozen=True, eq=False)
class Criterion:
    """An oracle with one verdict on all runs, and its score, if any."""

    oracle: str
    passes: bool
    runs: int
    score: Score | None

    @property
    def nearest(self) -> int | None:
        """Index of the run with the score nearest to the other verdict."""
        if self.score is None:
            return None
        at_most = not self.score.is_margin
        return int(np.argmax(self.score.slacks) if at_most == self.passes else np.argmin(self.score.slacks))


def criteria_of(tables: Tables) -> list[Criterion]:
    """The oracles that separate nothing among two runs or more, in their order."""
    found = []
    for oracle in tables.oracles:
        said = tables.verdicts.of(oracle)
        passed, failed = int((said == PASS).sum()), int((said == FAIL).sum())
        if oracle not in MEASURES_ALONE and passed + failed > 1 and 0 in (passed, failed):
            score = _score(tables, oracle, (said == PASS) | (said == FAIL))
            found.append(Criterion(oracle, failed == 0, passed + failed, score))
    return found


def criteria_json(criteria: list[Criterion]) -> dict[str, Any]:
    """Oracle to what all of its runs are, and its nearest score."""
    document: dict[str, dict[str, Any]] = {}
    for each in criteria:
        document[each.oracle] = {"passed": each.passes, "runs": each.runs}
        if (score := each.score) is not None and (nearest := each.nearest) is not None:
            document[each.oracle] |= {
                "metric": score.metric,
                "unit": score.unit,
                "nearest": float(score.values[nearest]),
                "threshold": float(score.thresholds[nearest]),
            }
    return document


def oracle_parameters(tables: Tables, oracle: str) -> Mapping[str, Any]:
    """The parameters of an oracle in the campaign file."""
    asked = (each["parameters"] for each in tables.metadata.get("oracles", []) if each["name"] == oracle)
    parameters: Mapping[str, Any] = next(asked, {})
    return parameters


def _score(tables: Tables, oracle: str, judged: NDArray[np.bool_]) -> Score | None:
    from vastflow.oracles.catalog.robustness import DEFAULT_BASIS  # with all that an oracle needs

    metrics = tables.verdicts.metrics(oracle)
    compared = {"performance": "rmse", "robustness": str(oracle_parameters(tables, oracle).get("basis", DEFAULT_BASIS))}
    name = MARGIN if MARGIN in metrics else compared.get(oracle, "score")
    if name not in metrics or (name != MARGIN and THRESHOLD not in metrics):
        return None
    values = metrics[name].values
    thresholds = np.zeros(len(values)) if name == MARGIN else metrics[THRESHOLD].values
    known = judged & np.isfinite(values) & np.isfinite(thresholds)
    if not known.any() or (name != MARGIN and (thresholds[known] <= 0.0).any()):
        return None
    return Score(name, metrics[name].unit, values[known], thresholds[known], name == MARGIN)
