"""Verdicts: what an oracle says of one run."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, TypeAlias

Judgement: TypeAlias = Literal["pass", "fail", "not judged"]


@dataclass(frozen=True, slots=True)
class Metric:
    """A number with its unit (`m`, `s`, `m/s`, `1`); None where it can't be had in this run."""

    value: float | None
    unit: str


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
