"""Effects of factors and of their pairs on the failure rate, in a linear model of its levels."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from vastflow.oracles.results.factors import Factor
from vastflow.oracles.statistics.intervals import Floats, Interval, clustered_interval
from vastflow.oracles.statistics.linear import Contrasts, Margins, Tested, Trend, trend_of
from vastflow.oracles.statistics.matched import Codes, matched, means_of, permuted, table_of
from vastflow.oracles.statistics.power import Needed, Power, needed_for, power_of


@dataclass(frozen=True, slots=True)
class LevelEffect:
    """The failure rate at one level of a factor; each configuration counts once.

    Attributes:
        failed, runs: In matched sets, else in all configurations; with sequential stopping only their first runs.
        difference: Mantel and Haenszel's difference to the level with the fewest failures; None without matched sets.
        rate: Mean over the configurations with this level.
        adjusted: Mean if all configurations had this level and their own levels of the other factors, effects added up.
    """

    level: str
    failed: int
    runs: int
    difference: float | None
    difference_interval: tuple[float, float] | None
    configurations: int
    rate: float
    adjusted: float


@dataclass(frozen=True, slots=True)
class Claim:
    """Whether an effect is shown.

    Attributes:
        p_value: For no effect; None where it cannot be tested, and `note` says why.
        adjusted: By Holm over all tests of its kind.
        shown: Whether `adjusted` is at most the analysis' error.
        least: The lowest p-value that so few situations can give.
        powerless: Whether `least`, adjusted likewise, exceeds the error: no effect, however large, could be shown.
    """

    p_value: float | None
    note: str = ""
    adjusted: float | None = None
    shown: bool = False
    least: float = 0.0
    powerless: bool = False


@dataclass(frozen=True, slots=True)
class FactorEffect:
    """The effect of a factor.

    Attributes:
        highest, lowest: Levels with the highest and the lowest adjusted failure rate.
        difference: Between the two.
        these: Whether it has an effect on these situations, see `Matched`.
        others: Whether it has a mean effect on other situations like these, by permutations within situations or else by `Contrasts`;
            for a number with a trend, twice the smaller p-value of levels and trend (Bonferroni).
        situations: Blocks with matched sets.
        needed: Situations that could show an effect for others; None where these can.
        power: Least effects shown by as many situations and runs; None without matched sets.
        rates: Failure rate of each situation at each level, None where it has none.
        trend: For a number with three values or more.
    """

    name: str
    levels: tuple[LevelEffect, ...]
    highest: str
    lowest: str
    difference: float
    these: Claim
    others: Claim
    situations: int = 0
    needed: Needed | None = None
    rates: tuple[tuple[float | None, ...], ...] = field(default=(), repr=False)
    trend: Trend | None = None
    power: Power | None = None

    @property
    def matters(self) -> bool:
        return self.these.shown or self.others.shown


@dataclass(frozen=True, slots=True)
class LevelPair:
    """Configurations with a pair of levels.

    Attributes:
        rate: Mean failure rate.
        expected: The rate if the factors' effects added up.
        interval: Interval of `rate`, blocks as clusters; 0..1 for a single block.
    """

    levels: tuple[str, str]
    configurations: int
    rate: float
    expected: float
    interval: Interval


@dataclass(frozen=True, slots=True)
class InteractionEffect:
    """The interaction of two factors: how far their effects on rates do not add up.

    Attributes:
        cells: Existing pairs of levels.
        departure: `rate` - `expected` of the cell where that stands out most.
        claim: Whether they act together.
    """

    names: tuple[str, str]
    cells: tuple[LevelPair, ...]
    departure: float
    claim: Claim


class FactorModel:
    """The linear model of failure rates with a column for each level but the first of each factor.

    Args:
        runs: (m,) behind each response of `contrasts`.
        error: Error probability of the intervals.

    Attributes:
        margins: The fitted model.
    """

    def __init__(self, factors: Sequence[Factor], contrasts: Contrasts, runs: Floats, error: float) -> None:
        self._contrasts, self._runs, self._error = contrasts, runs, error
        self._columns: dict[str, Floats] = {
            factor.name: (factor.codes[:, None] == np.arange(1, len(factor.levels))).astype(np.float64)
            for factor in factors
        }
        # Configurations without a factor have a column of their own and are in no comparison of its levels.
        missing = [(factor.codes < 0).astype(np.float64) for factor in factors if (factor.codes < 0).any()]
        self._constant = np.column_stack([np.ones(len(runs)), *missing])
        self._matrix = np.column_stack([self._constant, *self._columns.values()])
        self.margins = Margins(self._matrix, contrasts.response)

    def effect(self, factor: Factor, first: tuple[Floats, Floats], sets: Codes | None = None) -> FactorEffect:
        """The effect of one factor, before adjustment for other tests.

        Args:
            first: (m,) failed and all runs, as many of each configuration as a stopping rule allows.
            sets: (m,) equal for configurations that are equal in all but the factor; None where no two are.
        """
        others = np.column_stack([self._constant, *(c for name, c in self._columns.items() if name != factor.name)])
        tested = self._contrasts.test(self._columns[factor.name], others)
        trend = None
        if factor.values is not None:
            trend = trend_of(self._contrasts, factor.values, others, self._runs, self._error)
        count, rates = len(factor.levels), self._contrasts.response
        groups = [factor.codes == k for k in range(count)]
        means = self.margins.at(self._points(factor), groups)
        numbers = None if factor.values is None else np.array([factor.values[group].mean() for group in groups])
        situations, both, table = self._contrasts.blocks, None, None
        if sets is not None:
            situations = joined(situations, sets)
            both = matched(*first, factor.codes, sets, numbers)
            table = None if both is None else table_of(rates, factor.codes, sets, situations)
        failed, n = (np.array([part[group].sum() for group in groups]) for part in first)
        if both:
            failed, n = both.failed.sum(axis=0), both.runs.sum(axis=0)
        base = int(np.argmin(failed / np.maximum(n, 1)))
        levels = []
        for k, (level, group) in enumerate(zip(factor.levels, groups, strict=True)):
            apart, ends = (both.difference(k, base) if both and k != base else None) or (None, None)
            size, rate, mean = int(group.sum()), float(rates[group].mean()), float(means[k])
            levels.append(LevelEffect(level, int(failed[k]), int(n[k]), apart, ends, size, rate, mean))
        low, high = int(means.argmin()), int(means.argmax())
        more = power = None
        if table is None:
            claim = _of_either(tested, trend)
        else:
            claim = Claim(permuted(table, numbers), least=math.factorial(count) ** (1.0 - len(table)))
            design = count, max(1, round(self._runs.sum() / table.size)), len(self._columns), self._error
            power = power_of(len(table), *design)
            if claim.least * len(self._columns) > self._error:
                more = needed_for(*design)
        by_situation = means_of(first[0] / np.maximum(first[1], 1), situations, factor.codes, count)
        return FactorEffect(
            factor.name,
            tuple(levels),
            factor.levels[high],
            factor.levels[low],
            float(means[high] - means[low]),
            Claim(None, "no matched configurations") if both is None else Claim(both.p_value),
            claim,
            0 if both is None else len(np.unique(situations)),
            more,
            tuple(tuple(None if np.isnan(rate) else rate for rate in row) for row in by_situation.tolist()),
            trend,
            power,
        )

    def interaction(self, a: Factor, b: Factor) -> InteractionEffect:
        """The interaction of two factors, before adjustment for other tests."""
        response, blocks = self._contrasts.response, self._contrasts.blocks
        joint = (self._columns[a.name][:, :, None] * self._columns[b.name][:, None, :]).reshape(len(response), -1)
        within, between = sorted((a, b), key=lambda factor: _is_between(factor, blocks))
        if _is_between(between, blocks) and not _is_between(within, blocks):
            tested = self._by_situation(within, between)
        elif joint.shape[1] * 3 > len(response):
            tested = Tested(None, why="too few configurations")
        else:
            tested = self._contrasts.test(joint, self._matrix)
            if tested.why and tested.degrees == 0:
                tested = replace(tested, why="the two do not vary together")
        cells = []
        for (k, first), (j, second) in product(enumerate(a.levels), enumerate(b.levels)):
            group = (a.codes == k) & (b.codes == j)
            if group.any():
                rate, expected = float(response[group].mean()), float(self.margins.fitted[group].mean())
                _, at = np.unique(blocks[group], return_inverse=True)
                interval = clustered_interval(np.bincount(at, weights=response[group]), np.bincount(at))
                cells.append(
                    LevelPair((first, second), int(group.sum()), rate, expected, interval or Interval(0.0, 1.0))
                )
        most = max(cells, key=lambda cell: abs(cell.rate - cell.expected) * np.sqrt(cell.configurations), default=None)
        departure = most.rate - most.expected if most else 0.0
        claim = Claim(tested.p_value, tested.why, least=tested.least)
        return InteractionEffect((a.name, b.name), tuple(cells), departure, claim)

    def _points(self, factor: Factor) -> Floats:
        """The usual configuration at each level, (L, columns)."""
        count = len(factor.levels)
        points = np.tile(self._matrix[factor.codes >= 0].mean(axis=0), (count, 1))
        names = list(self._columns)
        before = sum(self._columns[name].shape[1] for name in names[: names.index(factor.name)])
        first = self._constant.shape[1] + before
        points[:, first : first + count - 1] = np.eye(count)[:, 1:]
        return points

    def _by_situation(self, within: Factor, between: Factor) -> Tested:
        """Test whether the effect of a factor within blocks depends on a factor that varies between blocks.

        Each block's contrasts of the levels of `within` are regressed on all columns that differ between blocks, so that situations
        which respond differently are noise. The smallest p-value counts, times the number of contrasts (Bonferroni).
        """
        levels, blocks = len(within.levels), self._contrasts.blocks
        means = means_of(self._contrasts.response, blocks, within.codes, levels)
        kept = np.isfinite(means).all(axis=1)
        if not kept.any():
            return Tested(None, why="the two do not vary together")
        _, first = np.unique(blocks, return_index=True)
        beside = [
            found[first[kept]]
            for name, found in self._columns.items()
            if name != between.name and np.array_equal(found, found[first][blocks])
        ]
        situations = int(kept.sum())
        others, columns = np.column_stack([np.ones(situations), *beside]), self._columns[between.name][first[kept]]
        found = [
            Contrasts(means[kept] @ contrast, np.arange(situations), self._contrasts.draws).test(columns, others)
            for contrast in np.linalg.qr(np.column_stack([np.ones(levels), np.eye(levels)[:, 1:]]))[0].T[1:]
        ]
        p_values = [each.p_value for each in found if each.p_value is not None]
        if len(p_values) < len(found):
            return Tested(None, why=f"cannot be told from {situations} situations")
        least = len(found) * min(each.least for each in found)
        return Tested(min(1.0, len(found) * min(p_values)), found[0].degrees, least=least)


def _is_between(factor: Factor, blocks: Codes) -> bool:
    return len(np.unique(blocks)) == len(np.unique(np.stack((blocks, factor.codes)), axis=1).T)


def joined(blocks: Codes, sets: Codes) -> Codes:
    """Numbers (m,) of situations: blocks that share sets."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    _, at = np.unique(sets, return_inverse=True)
    size = int(blocks.max()) + 1
    links = coo_array((np.ones(len(at)), (blocks, size + at)), shape=(size + len(at), size + len(at)))
    situations: NDArray[np.int64] = connected_components(links, directed=False)[1][blocks].astype(np.int64)
    return situations


def _of_either(of_levels: Tested, trend: Trend | None) -> Claim:
    """The claim by a difference between levels or a trend (Bonferroni)."""
    found = [(each.p_value, each.least) for each in (of_levels, trend) if each is not None and each.p_value is not None]
    if not found:
        return Claim(None, of_levels.why)
    p_value, least = (len(found) * min(each) for each in zip(*found, strict=True))
    return Claim(min(1.0, p_value), least=least)
