"""Why runs failed, counted: how many of each cause, and one run of each to look at."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from vastflow.oracles.judgement.cause import CAUSES, Cause
from vastflow.oracles.results.column import codes, integers
from vastflow.oracles.results.tables import Tables


@dataclass(frozen=True, slots=True)
class CauseCount:
    """The runs of one cause.

    Attributes:
        configurations: How many have any.
        configuration: That with most of them, the first of several; where to look first.
        run_index: The first of its runs.
    """

    cause: Cause
    runs: int
    configurations: int
    configuration: str
    run_index: int


def causes_of(tables: Tables) -> tuple[CauseCount, ...]:
    """The causes of failed runs, the most frequent first and `unknown` last; none of a directory that an earlier version wrote."""
    runs = tables.runs
    if "cause" not in runs.column_names:
        return ()
    (cause, known), (configuration, names), index = (
        codes(runs["cause"]),
        codes(runs["configuration"]),
        integers(runs["run_index"]),
    )
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
    """Cause to its counts, what it means, and the run to look at."""
    return {
        each.cause: {
            "means": CAUSES[each.cause],
            "runs": each.runs,
            "configurations": each.configurations,
            "example": {"configuration": each.configuration, "run_index": each.run_index},
        }
        for each in causes
    }
