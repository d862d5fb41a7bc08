"""Effects: how much a factor changes the failure rate, level by level."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from vastflow.oracles.statistics.contrast import Tested
from vastflow.oracles.statistics.factors import Factor
from vastflow.oracles.statistics.intervals import Floats, Interval
from vastflow.oracles.statistics.margins import Margins
from vastflow.oracles.statistics.trend import Trend


@dataclass(frozen=True, slots=True)
class LevelEffect:
    """The failure rate at one level of a factor; each configuration counts once.

    Attributes:
        rate: Mean over the configurations that have the level.
        adjusted: The mean that all of them would have with this level and their own levels of the other factors, effects added up.
        interval: Of `adjusted`, blocks as clusters.
    """

    level: str
    configurations: int
    rate: float
    adjusted: float
    interval: Interval


@dataclass(frozen=True, slots=True)
class FactorEffect:
    """What a factor does.

    Attributes:
        highest, lowest: Levels with the highest and the lowest adjusted failure rate.
        difference: Between the two.
        difference_interval: Of it, allowing for their choice among all pairs of levels (Bonferroni).
        share: Of the variance between configurations that the factor explains beyond the others, repetition noise taken out.
        p_value: Of no effect; None where it can't be tested, `note` says why. Of a number with a trend, twice the smaller of the
            p-values of its levels and of its trend (Bonferroni).
        trend: Of a number with three values or more; None for others.
        adjusted: The same by Holm over all factors and pairs.
        significant: Whether `adjusted` is at most the analysis' error.
    """

    name: str
    levels: tuple[LevelEffect, ...]
    highest: str
    lowest: str
    difference: float
    difference_interval: tuple[float, float]
    share: float
    p_value: float | None
    adjusted: float | None = None
    significant: bool = False
    note: str = ""
    trend: Trend | None = None


def factor_effect(
    factor: Factor,
    tested: Tested,
    margins: Margins,
    columns: Mapping[str, Floats],
    constant: Floats,
    between: float,
    error: float,
    trend: Trend | None = None,
) -> FactorEffect:
    """The effect of one factor, not yet adjusted for the others that are tested.

    Args:
        margins: Of the model that has `constant` (m, c) and then the `columns` (m, L - 1) of each factor, in their order.
        between: Variance between configurations.
    """
    has = factor.codes >= 0
    usual = np.concatenate([constant[has].mean(axis=0), *(found[has].mean(axis=0) for found in columns.values())])
    points = np.tile(usual, (len(factor.levels), 1))
    first = constant.shape[1] + sum(f.shape[1] for f in list(columns.values())[: list(columns).index(factor.name)])
    points[:, first : first + len(factor.levels) - 1] = np.eye(len(factor.levels))[:, 1:]
    groups = [factor.codes == k for k in range(len(factor.levels))]
    found = margins.at(points, groups)
    levels = tuple(
        LevelEffect(level, int(group.sum()), float(margins.response[group].mean()), float(mean), interval)
        for level, group, mean, interval in zip(
            factor.levels, groups, found.means, found.intervals(1 - error), strict=True
        )
    )
    low, high = int(found.means.argmin()), int(found.means.argmax())
    pairs = len(levels) * (len(levels) - 1) / 2
    p_value = _of_either(tested.p_value, trend)
    return FactorEffect(
        factor.name,
        levels,
        factor.levels[high],
        factor.levels[low],
        float(found.means[high] - found.means[low]),
        found.difference(high, low, 1 - error / pairs),
        share_of(tested, between),
        p_value,
        note=tested.why if p_value is None else "",
        trend=trend,
    )


def _of_either(of_levels: float | None, trend: Trend | None) -> float | None:
    """The p-value of a difference between levels or of a trend."""
    found = [p for p in (of_levels, trend.p_value if trend else None) if p is not None]
    return min(1.0, len(found) * min(found)) if found else None


def share_of(tested: Tested, between: float) -> float:
    """Share of the variance between configurations that was explained, 0..1."""
    return min(1.0, tested.variance / between) if between > 0 else 0.0
