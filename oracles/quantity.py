"""Quantities: what verdicts say of several runs of one configuration, as one number."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from vastflow.oracles.verdict import Verdict, run_judgement

Aggregate: TypeAlias = Literal["mean", "median", "min", "max", "quantile"]


@dataclass(frozen=True, slots=True)
class RunQuantity:
    """A number of one run, and how those of several runs become one.

    Attributes:
        oracle: Whose verdicts; None for all oracles together.
        metric: Of the oracle; None for whether the run failed.
        q: With the aggregate `quantile`: which, from 0 to 1.
    """

    oracle: str | None = None
    metric: str | None = None
    aggregate: Aggregate = "mean"
    q: float | None = None

    def samples(self, verdicts: Sequence[Verdict], runs: range) -> list[float]:
        """The number of each of `runs` that has one, in order: a metric in its unit; 1 for a run that failed and 0 for one that passed."""
        by_run: dict[int, list[Verdict]] = {}
        for each in verdicts:
            if each.run_index in runs and self.oracle in (None, each.oracle):
                by_run.setdefault(each.run_index, []).append(each)
        found = (self._sample(by_run[run]) for run in sorted(by_run))
        return [value for value in found if value is not None]

    def value(self, samples: Sequence[float]) -> float | None:
        """What the samples come to; None without any."""
        if not samples:
            return None
        if self.metric is None or self.aggregate == "mean":
            return math.fsum(samples) / len(samples)
        if self.aggregate in ("min", "max"):
            return min(samples) if self.aggregate == "min" else max(samples)
        return float(np.quantile(samples, 0.5 if self.q is None else self.q))

    def _sample(self, verdicts: Sequence[Verdict]) -> float | None:
        if self.metric is None:
            said = run_judgement([each.judgement for each in verdicts])
            return None if said == "not judged" else float(said == "fail")
        metric = verdicts[0].metrics.get(self.metric)
        return None if metric is None else metric.value
