"""Criteria that separate nothing: oracles that pass every run, or fail every one, and how far their thresholds are from the runs."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vastflow.oracles.catalog.robustness import DEFAULT_BASIS
from vastflow.oracles.results.tables import Tables
from vastflow.oracles.results.verdict_table import FAIL, PASS
from vastflow.oracles.statistics.intervals import Floats

MEASURES_ALONE: Final = frozenset({"navigation"})
"""Oracles that pass every run whatever happens in it."""
MARGIN: Final = "margin"
"""The metric by which an oracle says how far a run is from failing: below 0 it fails."""
THRESHOLD: Final = "threshold"
"""The metric that says what another one is compared with: above it a run fails."""


@dataclass(frozen=True, eq=False)
class Score:
    """What an oracle's verdicts follow from, over the judged runs that have it.

    Attributes:
        metric: Its name; values may be at most `thresholds` (n,), or at least where `is_margin`.
    """

    metric: str
    unit: str
    values: Floats = field(repr=False)
    thresholds: Floats = field(repr=False)
    is_margin: bool

    @property
    def threshold(self) -> float | None:
        """The threshold; None where runs differ in it."""
        return float(self.thresholds[0]) if np.ptp(self.thresholds) == 0.0 else None

    @property
    def slacks(self) -> Floats:
        """(n,) values in the unit of the score, or where runs differ in their threshold as multiples of it."""
        return self.values if self.threshold is not None else self.values / self.thresholds


@dataclass(frozen=True, eq=False)
class Criterion:
    """An oracle whose runs all passed, or all failed.

    Attributes:
        score: None for an oracle that says none.
    """

    oracle: str
    passes: bool
    runs: int
    score: Score | None

    @property
    def nearest(self) -> int | None:
        """Index of the run whose score is nearest to what would have changed its verdict."""
        if self.score is None:
            return None
        at_most = not self.score.is_margin
        return int(np.argmax(self.score.slacks) if at_most == self.passes else np.argmin(self.score.slacks))


def criteria_of(tables: Tables) -> list[Criterion]:
    """The oracles that separate nothing, in their order. One run says nothing of an oracle."""
    return list(_criteria(tables))


def criteria_json(criteria: list[Criterion]) -> dict[str, Any]:
    """`criteria` as JSON values."""
    return {
        each.oracle: {
            "passed": each.passes,
            "runs": each.runs,
            **({} if each.score is None or each.nearest is None else _score_json(each.score, each.nearest)),
        }
        for each in criteria
    }


def _criteria(tables: Tables) -> Iterator[Criterion]:
    for oracle in tables.oracles:
        said = tables.verdicts.of(oracle)
        passed, failed = int((said == PASS).sum()), int((said == FAIL).sum())
        if oracle not in MEASURES_ALONE and passed + failed > 1 and 0 in (passed, failed):
            yield Criterion(
                oracle, failed == 0, passed + failed, _score(tables, oracle, (said == PASS) | (said == FAIL))
            )


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
    """The metric that an oracle compares with its threshold; empty where nothing says so."""
    if oracle == "performance":
        return "rmse"
    if oracle == "robustness":
        asked = (each["parameters"] for each in tables.metadata.get("oracles", []) if each["name"] == oracle)
        parameters: Mapping[str, Any] = next(asked, {})
        return str(parameters.get("basis", DEFAULT_BASIS))
    return "score"


def _score_json(score: Score, nearest: int) -> dict[str, Any]:
    return {
        "metric": score.metric,
        "unit": score.unit,
        "nearest": float(score.values[nearest]),
        "threshold": float(score.thresholds[nearest]),
    }
