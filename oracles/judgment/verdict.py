"""Verdicts of oracles on runs, and quantities of several runs."""

import json
import math
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, wraps
from typing import Any, Final, Literal, TypeAlias

import numpy as np

Judgment: TypeAlias = Literal["pass", "fail", "not judged"]


@dataclass(frozen=True, slots=True)
class Metric:
    """A number, or None, with its unit (`m`, `s`, `m/s`, `1`)."""

    value: float | None
    unit: str


class WrittenMetrics(Mapping[str, Metric]):
    """Metrics in written form, decoded when one is read.

    Args:
        text: Metrics in the form of `metrics_text`.
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


FORMER: Final = "judgement"
"""The former name of `judgment`, which oracles and notebooks of 0.2 may use for one more version."""


def warn_of_former(place: str) -> None:
    """Warn whoever uses `FORMER`."""
    text = f"{place}: {FORMER!r} goes with the next version. It is 'judgment' now."
    warnings.warn(text, DeprecationWarning, stacklevel=3)


def _taking_former(kind: type["Verdict"]) -> type["Verdict"]:
    made = kind.__init__

    @wraps(made)
    def make(self: "Verdict", *args: Any, **named: Any) -> None:
        if FORMER in named:
            warn_of_former("Verdict")
            named["judgment"] = named.pop(FORMER)
        made(self, *args, **named)

    def read(self: "Verdict") -> Judgment:
        warn_of_former("Verdict")
        return self.judgment

    kind.__init__ = make  # type: ignore[method-assign]
    setattr(kind, FORMER, property(read))
    return kind


@_taking_former
@dataclass(frozen=True, slots=True)
class Verdict:
    """One oracle's judgment of one run.

    Attributes:
        reason: Why the run failed or was not judged; empty for a pass.
        metrics: The same names for any judgment.
    """

    oracle: str
    run_index: int
    judgment: Judgment
    reason: str = ""
    metrics: Mapping[str, Metric] = field(default_factory=dict)


def run_judgment(judgments: Iterable[Judgment]) -> Judgment:
    """The joint judgment of a run: `fail` if any, `pass` if all, else `not judged`."""
    said = set(judgments)
    if "fail" in said:
        return "fail"
    return "pass" if said == {"pass"} else "not judged"


def metrics_text(metrics: Mapping[str, Metric]) -> str:
    """Canonical JSON of `metrics`: `{"time":{"value":1.5,"unit":"s"}}`.

    Raises:
        ValueError: a metric that is not finite.
    """
    if isinstance(metrics, WrittenMetrics):
        return metrics.text
    return _TEXT({name: {"value": metrics[name].value, "unit": metrics[name].unit} for name in sorted(metrics)})


def write_verdicts(verdicts: Sequence[Verdict]) -> bytes:
    """Canonical JSON of `verdicts`, the metrics of each as a text.

    Raises:
        ValueError: as `metrics_text`.
    """
    rows = [
        {name: getattr(each, name) for name in _FIELDS} | {"metrics": metrics_text(each.metrics)} for each in verdicts
    ]
    return json.dumps(rows, separators=(",", ":"), sort_keys=True).encode()


def read_verdicts(content: bytes) -> list[Verdict]:
    """Read the output of `write_verdicts`."""
    return [
        Verdict(row["oracle"], row["run_index"], row["judgment"], row["reason"], WrittenMetrics(row["metrics"]))
        for row in json.loads(content)
    ]


_FIELDS: Final = ("judgment", "oracle", "reason", "run_index")
_TEXT: Final = json.JSONEncoder(ensure_ascii=False, separators=(",", ":"), allow_nan=False).encode


Aggregate: TypeAlias = Literal["mean", "median", "min", "max", "quantile"]


@dataclass(frozen=True, slots=True)
class RunQuantity:
    """A number of each run, and its aggregate over runs.

    Attributes:
        oracle: None for all oracles together.
        metric: None for whether the run failed.
        q: Level of the aggregate `quantile`, 0..1.
    """

    oracle: str | None = None
    metric: str | None = None
    aggregate: Aggregate = "mean"
    q: float | None = None

    def samples(self, verdicts: Sequence[Verdict], runs: range) -> list[float]:
        """The quantity of each run that has one: a metric, or 1 for a failure and 0 for a pass."""
        by_run: dict[int, list[Verdict]] = {}
        for each in verdicts:
            if each.run_index in runs and self.oracle in (None, each.oracle):
                by_run.setdefault(each.run_index, []).append(each)
        found = (self._sample(by_run[run]) for run in sorted(by_run))
        return [value for value in found if value is not None]

    def value(self, samples: Sequence[float]) -> float | None:
        """Aggregate the samples; None without any."""
        if not samples:
            return None
        if self.metric is None or self.aggregate == "mean":
            return math.fsum(samples) / len(samples)
        if self.aggregate in ("min", "max"):
            return min(samples) if self.aggregate == "min" else max(samples)
        return float(np.quantile(samples, 0.5 if self.q is None else self.q))

    def _sample(self, verdicts: Sequence[Verdict]) -> float | None:
        if self.metric is None:
            said = run_judgment([each.judgment for each in verdicts])
            return None if said == "not judged" else float(said == "fail")
        metric = verdicts[0].metrics.get(self.metric)
        return None if metric is None else metric.value
