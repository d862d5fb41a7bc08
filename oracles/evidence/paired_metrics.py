"""Differences of what oracles measure between the paired runs of two campaigns, and the factors that explain them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from vastflow.oracles.evidence.findings import METRICS
from vastflow.oracles.evidence.pairing import Pairing
from vastflow.oracles.evidence.varied import chosen_rows, matched_sets
from vastflow.oracles.judgment.registry import SUCCESS
from vastflow.oracles.results.factors import factors_of
from vastflow.oracles.results.tables import NOT_JUDGED, PASS, Tables
from vastflow.oracles.statistics.analysis import holm
from vastflow.oracles.statistics.comparison import Target
from vastflow.oracles.statistics.intervals import LEVEL, Floats
from vastflow.oracles.statistics.matched import Codes, permuted
from vastflow.oracles.statistics.measured import MetricEffect, Runs, interval_of_mean, metric_effects

PAIRED: Final = {**METRICS, "path length": ((SUCCESS, "distance"),), "final error": ((SUCCESS, "final_distance"),)}
"""Quantities that are compared; each is the first of its oracles' metrics that both campaigns have."""
PASSING: Final = "passing"
"""Name of the verdict as a quantity: 1 for a passed run."""


@dataclass(frozen=True, slots=True)
class MetricDifference:
    """The difference of a metric, after less before, over pairs that reached their goals both times.

    Attributes:
        pairs, equal: Pairs with known values, and those with equal ones.
        before, after: Means over pairs; over paths, each counting once, for others of their kind.
        interval: Interval of the difference, by Student's t; None for fewer than two pairs or paths.
        adjusted: p-value of permutations within pairs or paths, by Holm over all metrics.
        most, most_difference: Configuration whose mean differs most, and by how much.
    """

    metric: str
    unit: str
    pairs: int
    equal: int
    before: float
    after: float
    difference: float
    interval: tuple[float, float] | None
    adjusted: float | None
    most: str
    most_difference: float


def paired_values(before: Tables, after: Tables, pairing: Pairing) -> dict[str, tuple[str, Floats]]:
    """Return unit and values (P, 2), before and after, by metric; NaN unless both runs reached their goals."""
    sides = ((before, pairing.row_before), (after, pairing.row_after))
    if any(SUCCESS not in tables.oracles for tables, _ in sides):
        return {}
    reached = np.all([tables.verdicts.of(SUCCESS)[rows] == PASS for tables, rows in sides], axis=0)
    found = {}
    for name, sources in PAIRED.items():
        for oracle, metric in sources:
            known = [tables.verdicts.metrics(oracle).get(metric) for tables, _ in sides if oracle in tables.oracles]
            columns = [column for column in known if column is not None]
            if len(columns) == 2:
                values = np.column_stack([c.values[rows] for c, (_, rows) in zip(columns, sides, strict=True)])
                found[name] = columns[1].unit, np.where(reached[:, None], values, np.nan)
                break
    return found


def metric_differences(
    values: Mapping[str, tuple[str, Floats]], pairing: Pairing, target: Target
) -> list[MetricDifference]:
    """Return the differences of metrics, `values` as of `paired_values`."""
    found, p_values = [], []
    for name, (unit, both) in values.items():
        known = np.isfinite(both).all(axis=1)
        rows, match = both[known], pairing.configuration[known]
        if not len(rows):
            continue
        drawn = rows if target == "these" else _means(rows, pairing.block[match])
        before, after = drawn.mean(axis=0).tolist()
        interval = interval_of_mean(drawn[:, 1] - drawn[:, 0], 1.0 - LEVEL)
        each = _means(rows, match) @ (-1.0, 1.0)
        most = int(np.abs(each).argmax())
        named = pairing.matches[int(np.unique(match)[most])].after
        equal = int((rows[:, 0] == rows[:, 1]).sum())
        p_values.append(permuted(drawn, None))
        found.append(
            MetricDifference(
                name, unit, len(rows), equal, before, after, after - before, interval, None, named, float(each[most])
            )
        )
    return [replace(each, adjusted=p) for each, p in zip(found, holm(p_values), strict=True)]


def explanations(
    values: Mapping[str, tuple[str, Floats]], after: Tables, pairing: Pairing, environments: Mapping[str, str]
) -> Sequence[MetricEffect]:
    """Return the factors shown to change a difference of a metric or of passing, the most certain first."""
    table, said = after.configurations, pairing.judged(None)
    places = {name: k for k, name in enumerate(table.names)}
    chosen = [places[match.after] for match in pairing.matches]
    factors, _ = factors_of(chosen_rows(table, chosen, environments))
    passing = np.column_stack([np.where(side < NOT_JUDGED, side == PASS, np.nan) for side in said])
    metrics = {
        name: (unit, both[:, 1] - both[:, 0]) for name, (unit, both) in {PASSING: ("1", passing), **values}.items()
    }
    runs = Runs(pairing.configuration, pairing.run_after, np.ones(len(passing), dtype=np.bool_), metrics)
    sets = {each.name: matched_sets(table, chosen, each.name) for each in factors}
    return [each for each in metric_effects(factors, sets, pairing.block, runs) if each.matters]


def _means(rows: Floats, groups: Codes) -> Floats:
    """Return the mean (k, 2) of each group."""
    _, at = np.unique(groups, return_inverse=True)
    return np.column_stack([np.bincount(at, weights=column) / np.bincount(at) for column in rows.T])
