"""Causes of failed runs, counted, and standstills at the start."""

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from vastflow.oracles.judgement.cause import CAUSES, Cause
from vastflow.oracles.results.schema import codes, integers
from vastflow.oracles.results.tables import Tables
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
    """Failed runs that stood still at the start; they are in every rate.

    Attributes:
        causes: Cause (of `vastflow.sim.loop.standstill.CAUSES`) to number of runs, the most frequent first.
        configurations: Configuration to number of runs, in the order of the table.
    """

    causes: Mapping[str, int]
    configurations: Mapping[str, int]

    @property
    def runs(self) -> int:
        """Number of runs."""
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
    columns = tables.runs["configuration"].to_pylist(), tables.runs["stood_still"].to_pylist()
    found = [(name, cause) for name, cause in zip(*columns, strict=True) if cause is not None]
    names, causes = (Counter(each[k] for each in found) for k in (0, 1))
    return Standstills(dict(causes.most_common()), dict(names))
