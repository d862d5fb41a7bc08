"""Verdicts: what an oracle says of one run, and the quantity that several runs of a configuration give."""

import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Final, Literal, TypeAlias

import numpy as np

Judgement: TypeAlias = Literal["pass", "fail", "not judged"]


@dataclass(frozen=True, slots=True)
class Metric:
    """A number with its unit (`m`, `s`, `m/s`, `1`); None where it can't be had in this run."""

    value: float | None
    unit: str


class WrittenMetrics(Mapping[str, Metric]):
    """Metrics as they stand in a file, read when one is asked for: a campaign copies millions that nobody asks for.

    Args:
        text: As `metrics_text` gives it.
    """

    def __init__(self, text: str) -> None:
        self.text = text

    def __getitem__(self, name: str) -> Metric:
        return self._metrics[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._metrics)

    def __len__(self) -> int:
        return len(self._metrics)

    def __repr__(self) -> str:
        return repr(self._metrics)

    @cached_property
    def _metrics(self) -> dict[str, Metric]:
        return {name: Metric(**metric) for name, metric in json.loads(self.text).items()}


@dataclass(frozen=True, slots=True)
class Verdict:
    """One oracle's judgement of one run.

    Attributes:
        judgement: `not judged` is neither: what the oracle needs is missing, `reason` says what.
        reason: Why the run failed or was not judged; empty for a pass.
        metrics: Name to number, the same names whatever the judgement.
    """

    oracle: str
    run_index: int
    judgement: Judgement
    reason: str = ""
    metrics: Mapping[str, Metric] = field(default_factory=dict)


def run_judgement(judgements: Iterable[Judgement]) -> Judgement:
    """What all oracles together say of a run: `fail` if one does, `pass` if all do, else `not judged`."""
    said = set(judgements)
    if "fail" in said:
        return "fail"
    return "pass" if said == {"pass"} else "not judged"


def metrics_text(metrics: Mapping[str, Metric]) -> str:
    """`metrics` as JSON, by name: `{"time":{"value":1.5,"unit":"s"}}`; the same text for equal ones.

    Raises:
        ValueError: a metric that is infinite or not a number; a metric that can't be had is None.
    """
    if isinstance(metrics, WrittenMetrics):
        return metrics.text
    return _TEXT({name: {"value": metrics[name].value, "unit": metrics[name].unit} for name in sorted(metrics)})


def write_verdicts(verdicts: Sequence[Verdict]) -> bytes:
    """`verdicts` as canonical JSON, the metrics of each a text of its own: equal verdicts give equal bytes.

    Raises:
        ValueError: as `metrics_text`.
    """
    rows = [
        {
            "judgement": verdict.judgement,
            "metrics": metrics_text(verdict.metrics),
            "oracle": verdict.oracle,
            "reason": verdict.reason,
            "run_index": verdict.run_index,
        }
        for verdict in verdicts
    ]
    return json.dumps(rows, separators=(",", ":")).encode()


def read_verdicts(content: bytes) -> list[Verdict]:
    """What `write_verdicts` wrote."""
    return [
        Verdict(row["oracle"], row["run_index"], row["judgement"], row["reason"], WrittenMetrics(row["metrics"]))
        for row in json.loads(content)
    ]


_TEXT: Final = json.JSONEncoder(ensure_ascii=False, separators=(",", ":"), allow_nan=False).encode


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
