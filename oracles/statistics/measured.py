"""Effects of factors on metrics of runs that reached their goals, from paired runs."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from vastflow.oracles.results.factors import Factor
from vastflow.oracles.statistics.analysis import adjusted_claims
from vastflow.oracles.statistics.effects import Claim, joined
from vastflow.oracles.statistics.intervals import Floats
from vastflow.oracles.statistics.matched import Codes, means_of, needed, permuted
from vastflow.oracles.statistics.power import Needed


@dataclass(frozen=True, slots=True)
class MetricEffect:
    """The effect of a factor on a metric, over rounds.

    A round is the runs of one number in a matched set, of which all reached the goal.

    Attributes:
        name, metric, unit: Names of the factor and of the metric, and the metric's unit.
        levels, means: Compared levels, and the mean at each, where each situation counts once.
        left_out: Levels at which fewer than half of the missions reached the goal, or have a known value.
        rounds, of: Rounds compared, of all.
        sets, above: Matched sets with compared rounds, and those with more at the highest level than at the lowest.
        situations: Independent units of them.
        interval: Interval of the difference of the means at highest and lowest level, by Student's t over situations, allowing for the
            choice among all pairs of levels (Bonferroni); None for a single situation.
        these: Whether the metric differs on these situations, by `permuted` within rounds.
        others: Whether it does on others like them, by `permuted` within situations.
    """

    name: str
    metric: str
    unit: str
    levels: tuple[str, ...]
    means: tuple[float, ...]
    left_out: tuple[str, ...]
    rounds: int
    of: int
    sets: int
    above: int
    situations: int
    interval: tuple[float, float] | None
    these: Claim
    others: Claim
    needed: Needed | None = None

    @property
    def matters(self) -> bool:
        return self.these.shown or self.others.shown


@dataclass(frozen=True, eq=False)
class Runs:
    """Runs of the configurations of an analysis.

    Attributes:
        configuration: (R,) place of each run's configuration.
        number: (R,) its run index: runs of one number meet the same noise at all levels of a parameter of the system.
        reached: (R,) whether it reached its goals.
        metrics: Unit and (R,) values by name; NaN where unknown.
    """

    configuration: Codes = field(repr=False)
    number: Codes = field(repr=False)
    reached: NDArray[np.bool_] = field(repr=False)
    metrics: Mapping[str, tuple[str, Floats]] = field(repr=False)


def metric_effects(
    factors: Sequence[Factor], sets: Mapping[str, Codes], units: Codes, runs: Runs, error: float = 0.05
) -> tuple[MetricEffect, ...]:
    """The effects of all factors on all metrics, the most certain first.

    Claims on these situations and on others are a family each, adjusted by Holm over factors and metrics. They are conditional on what was
    reached: a level that fails the hard situations is compared on the easy ones alone.

    Args:
        factors: (m,) codes each, see `factors_of`.
        sets: Factor to (m,) numbers, equal for configurations that are equal in all but the factor.
        units: (m,) independent unit of each configuration.
    """
    found = [
        effect
        for factor in factors
        for name, (unit, values) in runs.metrics.items()
        if (effect := _effect(factor, name, unit, values, sets[factor.name], units, runs, error)) is not None
    ]
    found = adjusted_claims(adjusted_claims(found, "these", error), "others", error)
    found = [
        replace(each, needed=Needed(needed(len(each.levels), len(found), error), None))
        if each.others.powerless
        else each
        for each in found
    ]
    return tuple(sorted(found, key=lambda each: (each.these.p_value, each.others.p_value)))


def _effect(
    factor: Factor, name: str, unit: str, values: Floats, sets: Codes, units: Codes, runs: Runs, error: float
) -> MetricEffect | None:
    """The effect before adjustment; None where fewer than two levels can be compared, or all is equal."""
    of_run = factor.codes[runs.configuration]
    some, most = of_run >= 0, int(runs.number.max(initial=0)) + 1
    keys, rounds = np.unique((sets[runs.configuration] * most + runs.number)[some], return_inverse=True)
    level = np.where(runs.reached & np.isfinite(values), of_run, -1)[some]
    table = means_of(values[some], rounds, level, len(factor.levels))
    kept = np.isfinite(table).mean(axis=0) >= 0.5
    whole = np.isfinite(table[:, kept]).all(axis=1)
    if kept.sum() < 2 or not whole.any():
        return None
    rows, set_of = table[whole][:, kept], keys[whole] // most
    if np.ptp(rows) == 0.0:
        return None
    known, place = np.unique(set_of, return_inverse=True)
    by_set = _means(rows, place)
    first = np.full(int(sets.max()) + 1, -1)
    first[sets] = joined(units, sets)
    of_unit = np.unique(first[known], return_inverse=True)[1]
    by_unit = _means(by_set, of_unit)
    means, situations = by_unit.mean(axis=0), len(by_unit)
    high, low = int(means.argmax()), int(means.argmin())
    apart = by_unit[:, high] - by_unit[:, low]
    levels = [each for each, is_kept in zip(factor.levels, kept, strict=True) if is_kept]
    numbers = None
    if factor.values is not None:
        numbers = np.array([factor.values[factor.codes == k].mean() for k in np.flatnonzero(kept)])
    return MetricEffect(
        factor.name,
        name,
        unit,
        tuple(levels),
        tuple(means.tolist()),
        tuple(each for each, is_kept in zip(factor.levels, kept, strict=True) if not is_kept),
        len(rows),
        len(table),
        len(by_set),
        int((by_set[:, high] > by_set[:, low]).sum()),
        situations,
        interval_of_mean(apart, error / math.comb(len(levels), 2)),
        Claim(permuted(rows, numbers)),
        Claim(permuted(by_unit, numbers), least=math.factorial(len(levels)) ** (1.0 - situations)),
    )


def _means(table: Floats, groups: Codes) -> Floats:
    rows, levels = table.shape
    return means_of(table.reshape(-1), np.repeat(groups, levels), np.tile(np.arange(levels), rows), levels)


def interval_of_mean(values: Floats, error: float) -> tuple[float, float] | None:
    """Return Student's interval of a mean, which misses it with a probability of `error`; None for a single value."""
    from scipy.special import stdtrit

    if (n := len(values)) < 2:
        return None
    half = float(stdtrit(n - 1, 1 - error / 2)) * float(values.std(ddof=1)) / math.sqrt(n)
    return float(values.mean()) - half, float(values.mean()) + half
