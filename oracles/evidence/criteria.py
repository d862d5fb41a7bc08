"""Criteria that separate nothing: oracles that pass or fail every run, and their nearest scores."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vastflow.oracles.catalog.robustness import DEFAULT_BASIS
from vastflow.oracles.results.tables import FAIL, PASS, Tables
from vastflow.oracles.statistics.intervals import Floats

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
    """An oracle whose runs all passed, or all failed, and the score behind that, if it has one."""

    oracle: str
    passes: bool
    runs: int
    score: Score | None

    @property
    def nearest(self) -> int | None:
        """Index of the run whose score is nearest to the other verdict."""
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
    """JSON values of `criteria`."""
    return {
        each.oracle: {
            "passed": each.passes,
            "runs": each.runs,
            **_score_json(each.score, each.nearest),
        }
        for each in criteria
    }


def _score(tables: Tables, oracle: str, judged: NDArray[np.bool_]) -> Score | None:
    metrics = tables.verdicts.metrics(oracle)
    name = MARGIN if MARGIN in metrics else _compared(tables, oracle)
    if name not in metrics or (name != MARGIN and THRESHOLD not in metrics):
        return None
    values = metrics[name].values
    thresholds = np.zeros(len(values)) if name == MARGIN else metrics[THRESHOLD].values
    known = judged & np.isfinite(values) & np.isfinite(thresholds)
    if not known.any() or (name != MARGIN and (thresholds[known] <= 0.0).any()):
        return None
    return Score(name, metrics[name].unit, values[known], thresholds[known], name == MARGIN)


def _compared(tables: Tables, oracle: str) -> str:
    """The metric that an oracle compares with its threshold."""
    if oracle == "performance":
        return "rmse"
    if oracle == "robustness":
        asked = (each["parameters"] for each in tables.metadata.get("oracles", []) if each["name"] == oracle)
        parameters: Mapping[str, Any] = next(asked, {})
        return str(parameters.get("basis", DEFAULT_BASIS))
    return "score"


def _score_json(score: Score | None, nearest: int | None) -> dict[str, Any]:
    if score is None or nearest is None:
        return {}
    return {
        "metric": score.metric,
        "unit": score.unit,
        "nearest": float(score.values[nearest]),
        "threshold": float(score.thresholds[nearest]),
    }
