"""Effects of a factor on the failure rate, level by level and on matched sets of the same situations."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vastflow.oracles.results.factors import Factor
from vastflow.oracles.statistics.contrast import Tested
from vastflow.oracles.statistics.intervals import Floats, Interval, wilson_intervals
from vastflow.oracles.statistics.margins import Margins, Trend
from vastflow.oracles.statistics.situations import means_of, permuted, smallest, table_of

DRAWS: Final = 9999
_SEED: Final = 1959
_CHUNK: Final = 333
_ENOUGH: Final = 100


@dataclass(frozen=True, eq=False)
class Matched:
    """Runs at a factor's L levels in S sets that are equal in everything else.

    Attributes:
        failed, runs: (S, L). Only sets with runs at two levels or more.
        values: (L,) the numbers behind the levels; None for levels without numbers.
    """

    failed: Floats = field(repr=False)
    runs: Floats = field(repr=False)
    values: Floats | None = field(default=None, repr=False)

    @property
    def p_value(self) -> float:
        """p-value for no effect in any set: failures fall on a set's runs at random (multivariate hypergeometric).

        Exact for two levels. For more, `DRAWS` draws of the smaller p-value of the generalized statistic Q (Landis, Heyman and Koch 1978)
        and, for numbers, of their linear trend.
        """
        some = (self.failed.sum(axis=1) % self.runs.sum(axis=1)) > 0
        if not some.any():
            return 1.0
        failed, runs = self.failed[some], self.runs[some]
        return _exact(failed, runs) if runs.shape[1] == 2 else _drawn(failed, runs, self.values)

    def difference(self, level: int, base: int) -> tuple[float, tuple[float, float]] | None:
        """Mantel and Haenszel's difference of the failure rates of two levels; None where no set has both.

        The interval is Newcombe's (1998, method 10), of the rates with Mantel and Haenszel's weights.
        """
        n, m = self.runs[:, level], self.runs[:, base]
        both = (n > 0) & (m > 0)
        if not both.any():
            return None
        weights = n[both] * m[both] / (n[both] + m[both])
        p, q = (float(weights @ (self.failed[both, k] / self.runs[both, k]) / weights.sum()) for k in (level, base))
        size = np.array([n[both].sum(), m[both].sum()])
        one, two = wilson_intervals(np.array([p, q]) * size, size).tolist()
        down, up = np.hypot(p - one[0], two[1] - q), np.hypot(one[1] - p, q - two[0])
        return p - q, (max(-1.0, p - q - float(down)), min(1.0, p - q + float(up)))


def matched(
    failed: Floats, runs: Floats, codes: NDArray[np.int64], sets: NDArray[np.int64], values: Floats | None
) -> Matched | None:
    """The matched sets among (m,) configurations; None without any.

    Args:
        codes: (m,) level of each, -1 for none.
        sets: (m,) equal for configurations that are equal in all but the factor.
        values: (L,) as in `Matched`.
    """
    some = codes >= 0
    _, at = np.unique(sets[some], return_inverse=True)
    tables = np.zeros((2, int(at.max(initial=-1)) + 1, int(codes.max()) + 1))
    for table, counts in zip(tables, (failed, runs), strict=True):
        np.add.at(table, (at, codes[some]), counts[some])
    kept = (tables[1] > 0).sum(axis=1) > 1
    return Matched(tables[0, kept], tables[1, kept], values) if kept.any() else None


def _exact(failed: Floats, runs: Floats) -> float:
    """Probability that the count at the first level is at least as far from the expected one, by convolution."""
    from scipy.stats import hypergeom

    whole, total = runs.sum(axis=1), failed.sum(axis=1)
    chances = np.ones(1)
    for n, m, size in zip(runs[:, 0], total, whole, strict=True):
        chances = np.convolve(chances, hypergeom.pmf(np.arange(n + 1), size, m, n))
    expected = float((runs[:, 0] * total / whole).sum())
    away, observed = np.abs(np.arange(len(chances)) - expected), abs(float(failed[:, 0].sum() - expected))
    return min(1.0, float(chances[away >= observed - 1e-9].sum()))


def _drawn(failed: Floats, runs: Floats, values: Floats | None) -> float:
    from scipy.stats import chi2

    whole, total = runs.sum(axis=1), failed.sum(axis=1)
    expected = (runs * (total / whole)[:, None]).sum(axis=0)
    scale = total * (whole - total) / (whole**2 * (whole - 1))
    variance = np.diag((scale * whole) @ runs) - (runs * scale[:, None]).T @ runs
    inverse = np.linalg.pinv(variance, hermitian=True)
    degrees = np.linalg.matrix_rank(variance, hermitian=True)
    centered = None if values is None or not np.isfinite(values).all() else values - values.mean()
    steep = 0.0 if centered is None else float(centered @ variance @ centered)

    def statistic(sums: Floats) -> Floats:
        """Logarithm (D,) of the smaller chi-squared tail of (D, L) failures; a statistic, not a p-value."""
        away = sums - expected
        found = chi2.logsf(np.einsum("ij,jk,ik->i", away, inverse, away), degrees)
        if centered is not None and steep > 0.0:
            found = np.minimum(found, chi2.logsf((away @ centered) ** 2 / steep, 1))
        return np.asarray(found)

    observed = float(statistic(failed.sum(axis=0)[None])[0]) + 1e-9
    larger = drawn = 0
    for sums in _assignments(runs.astype(np.int64), total.astype(np.int64), np.random.default_rng(_SEED)):
        larger, drawn = larger + int((statistic(sums) <= observed).sum()), drawn + len(sums)
        if larger >= _ENOUGH:  # far from significance; more draws would not change that (Besag and Clifford 1991)
            break
    return (1 + larger) / (1 + drawn)


def _assignments(runs: NDArray[np.int64], total: NDArray[np.int64], rng: np.random.Generator) -> Iterator[Floats]:
    """Draw (`_CHUNK`, L) failures at each level over all sets, `DRAWS` in all: level by level, hypergeometric."""
    for _ in range(DRAWS // _CHUNK):
        left = np.broadcast_to(total, (_CHUNK, len(total)))
        rest = runs.sum(axis=1)
        sums = np.empty((_CHUNK, runs.shape[1]))
        for level, n in enumerate(runs.T):
            rest = rest - n
            taken = rng.hypergeometric(n, rest, left)
            sums[:, level] = taken.sum(axis=1)
            left = left - taken
        yield sums


@dataclass(frozen=True, slots=True)
class LevelEffect:
    """The failure rate at one level of a factor; each configuration counts once.

    Attributes:
        failed, runs: In matched sets, else in all configurations; with sequential stopping only their first runs.
        difference: Mantel and Haenszel's difference to the level with the fewest failures; None without matched sets.
        rate: Mean over the configurations with this level.
        adjusted: Mean if all configurations had this level and their own levels of the other factors, effects added up.
        interval: Of `adjusted`, blocks as clusters.
    """

    level: str
    failed: int
    runs: int
    difference: float | None
    difference_interval: tuple[float, float] | None
    configurations: int
    rate: float
    adjusted: float
    interval: Interval


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
        difference: Between the two; its interval allows for their choice among all pairs of levels (Bonferroni).
        share: Of the variance between configurations that the factor explains beyond the others, repetition noise removed.
        these: Whether it has an effect on these situations, see `Matched`.
        others: Whether it has a mean effect on other situations like these, by permutations within situations or else by `Contrasts`;
            for a number with a trend, twice the smaller p-value of levels and trend (Bonferroni).
        situations: Blocks with matched sets.
        needed: Situations from which `others` could be shown; None where there are enough.
        rates: Failure rate of each situation at each level, None where it has none.
        trend: For a number with three values or more.
    """

    name: str
    levels: tuple[LevelEffect, ...]
    highest: str
    lowest: str
    difference: float
    difference_interval: tuple[float, float]
    share: float
    these: Claim
    others: Claim
    situations: int = 0
    needed: int | None = None
    rates: tuple[tuple[float | None, ...], ...] = field(default=(), repr=False)
    trend: Trend | None = None

    @property
    def matters(self) -> bool:
        """Whether an effect is shown, on these situations or on others."""
        return self.these.shown or self.others.shown


@dataclass(frozen=True, eq=False)
class Runs:
    """Runs behind a factor's tests.

    Attributes:
        failed, runs: (m,) of each configuration, as many of all as a stopping rule allows.
        situations: (m,) numbers of the situations that matched sets join.
        table: (k, L) rates of situations at levels where these are balanced.
    """

    failed: Floats
    runs: Floats
    situations: NDArray[np.int64]
    matched: Matched | None
    table: Floats | None


def runs_of(
    factor: Factor,
    rates: Floats,
    first: tuple[Floats, Floats],
    blocks: NDArray[np.int64],
    sets: NDArray[np.int64],
) -> Runs:
    """Runs of a factor's matched `sets` (m,) and of its situations, the blocks that share sets."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    _, at = np.unique(sets, return_inverse=True)
    size = int(blocks.max()) + 1
    links = coo_array((np.ones(len(at)), (blocks, size + at)), shape=(size + len(at), size + len(at)))
    situations = connected_components(links, directed=False)[1][blocks].astype(np.int64)
    found = matched(*first, factor.codes, at, _level_values(factor))
    table = None if found is None else table_of(rates, factor.codes, at, situations)
    return Runs(*first, situations, found, table)


def _level_values(factor: Factor) -> Floats | None:
    """The number (L,) behind each level."""
    if factor.values is None:
        return None
    return np.array([factor.values[factor.codes == k].mean() for k in range(len(factor.levels))])


def factor_effect(
    factor: Factor,
    tested: Tested,
    margins: Margins,
    columns: Mapping[str, Floats],
    constant: Floats,
    between: float,
    error: float,
    runs: Runs,
    trend: Trend | None = None,
) -> FactorEffect:
    """The effect of one factor, before adjustment for other tests.

    Args:
        tested: By `Contrasts`; used where situations are not balanced.
        margins: Of the model of `constant` (m, c) followed by the `columns` (m, L - 1) of each factor.
        between: Variance between configurations.
    """
    has, count = factor.codes >= 0, len(factor.levels)
    usual = np.concatenate([constant[has].mean(axis=0), *(found[has].mean(axis=0) for found in columns.values())])
    points = np.tile(usual, (count, 1))
    first = constant.shape[1] + sum(f.shape[1] for f in list(columns.values())[: list(columns).index(factor.name)])
    points[:, first : first + count - 1] = np.eye(count)[:, 1:]
    groups = [factor.codes == k for k in range(count)]
    found = margins.at(points, groups)
    both = runs.matched
    if both:
        failed, n = both.failed.sum(axis=0), both.runs.sum(axis=0)
    else:
        failed, n = (np.array([part[group].sum() for group in groups]) for part in (runs.failed, runs.runs))
    base = int(np.argmin(failed / np.maximum(n, 1)))
    differences: list[tuple[float | None, tuple[float, float] | None]]
    differences = [(both.difference(k, base) if both and k != base else None) or (None, None) for k in range(count)]
    intervals = found.intervals(1 - error)
    levels = tuple(
        LevelEffect(
            level,
            int(failed[k]),
            int(n[k]),
            differences[k][0],
            differences[k][1],
            int(groups[k].sum()),
            float(margins.response[groups[k]].mean()),
            float(found.means[k]),
            intervals[k],
        )
        for k, level in enumerate(factor.levels)
    )
    low, high = int(found.means.argmin()), int(found.means.argmax())
    if runs.table is not None:
        others = Claim(permuted(runs.table, _level_values(factor)), least=smallest(len(runs.table), count))
    else:
        p_value, least = _of_either(tested, trend)
        others = Claim(p_value, tested.why if p_value is None else "", least=least)
    return FactorEffect(
        factor.name,
        levels,
        factor.levels[high],
        factor.levels[low],
        float(found.means[high] - found.means[low]),
        found.difference(high, low, 1 - error / (count * (count - 1) / 2)),
        share_of(tested, between),
        Claim(None, "no matched configurations") if both is None else Claim(both.p_value),
        others,
        0 if both is None else len(np.unique(runs.situations)),
        rates=_rates(factor, runs),
        trend=trend,
    )


def _rates(factor: Factor, runs: Runs) -> tuple[tuple[float | None, ...], ...]:
    """Mean rate of each situation at each level, None where it has none."""
    rates = runs.failed / np.maximum(runs.runs, 1)
    found = means_of(rates, runs.situations, factor.codes, len(factor.levels)).tolist()
    return tuple(tuple(None if math.isnan(rate) else rate for rate in row) for row in found)


def _of_either(of_levels: Tested, trend: Trend | None) -> tuple[float | None, float]:
    """p-value for no difference between levels and no trend (Bonferroni), and the lowest that there can be."""
    found = [(each.p_value, each.least) for each in (of_levels, trend) if each is not None and each.p_value is not None]
    if not found:
        return None, 0.0
    p_value, least = (len(found) * min(each) for each in zip(*found, strict=True))
    return min(1.0, p_value), least


def share_of(tested: Tested, between: float) -> float:
    """Share, 0..1, of the variance between configurations that the tested columns explain."""
    return min(1.0, tested.variance / between) if between > 0 else 0.0
