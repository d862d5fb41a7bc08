"""Verdicts: what an oracle says of one run."""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
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


def run_judgement(judgements: Iterable[Judgement]) -> Judgement:
    """What all oracles together say of a run: `fail` if one does, `pass` if all do, else `not judged`."""
    said = set(judgements)
    if "fail" in said:
        return "fail"
    return "pass" if said == {"pass"} else "not judged"


def write_verdicts(verdicts: Sequence[Verdict]) -> bytes:
    """`verdicts` as canonical JSON: equal verdicts give equal bytes.

    Raises:
        ValueError: a metric that is infinite or not a number; a metric that can't be had is None.
    """
    rows = [asdict(verdict) for verdict in verdicts]
    return json.dumps(rows, sort_keys=True, separators=(",", ":"), allow_nan=False).encode()


def read_verdicts(content: bytes) -> list[Verdict]:
    """What `write_verdicts` wrote."""
    return [
        Verdict(**{**row, "metrics": {name: Metric(**metric) for name, metric in row["metrics"].items()}})
        for row in json.loads(content)
    ]
