"""Effects: how much a factor changes the failure rate, level by level, and on matched sets of the same situations."""

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
from vastflow.oracles.statistics.situations import means_of, permuted, table_of

DRAWS: Final = 9999
_SEED: Final = 1959
_CHUNK: Final = 333
_ENOUGH: Final = 100


@dataclass(frozen=True, eq=False)
class Matched:
    """Runs of a factor's L levels in S sets that are equal in everything but the factor.

    Attributes:
        failed, runs: (S, L). Only sets with runs at two levels or more.
        values: (L,) the numbers behind the levels, where they are numbers.
    """

    failed: Floats = field(repr=False)
    runs: Floats = field(repr=False)
    values: Floats | None = field(default=None, repr=False)

    @property
    def p_value(self) -> float:
        """Of no effect in any set: failures fall on a set's runs at random (multivariate hypergeometric), sets independent.

        Two levels: exact, by convolution. More: `DRAWS` draws of the generalized statistic Q (Landis, Heyman and Koch 1978) and, of
        numbers, of their linear trend T; the smaller of the p-values of both is the statistic.
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
    """The matched sets among (m,) configurations; None where there are none.

    Args:
        codes: (m,) level of each, -1 for none.
        sets: (m,) equal for configurations that are equal in all but the factor.
        values: (L,) as of `Matched`.
    """
    some = codes >= 0
    _, at = np.unique(sets[some], return_inverse=True)
    tables = np.zeros((2, int(at.max(initial=-1)) + 1, int(codes.max()) + 1))
    for table, counts in zip(tables, (failed, runs), strict=True):
        np.add.at(table, (at, codes[some]), counts[some])
    kept = (tables[1] > 0).sum(axis=1) > 1
    return Matched(tables[0, kept], tables[1, kept], values) if kept.any() else None


def _exact(failed: Floats, runs: Floats) -> float:
    """Share of all ways for failures to fall whose count at the first level is as far from the expected one."""
    from scipy.stats import hypergeom

    whole, total = runs.sum(axis=1), failed.sum(axis=1)
    chances = np.ones(1)
    for n, m, size in zip(runs[:, 0], total, whole, strict=True):
        chances = np.convolve(chances, hypergeom.pmf(np.arange(n + 1), size, m, n))
    away = np.abs(np.arange(len(chances)) - float((runs[:, 0] * total / whole).sum()))
    observed = abs(float(failed[:, 0].sum() - (runs[:, 0] * total / whole).sum()))
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
        """(D,) the logarithm of the smaller p-value, of (D, L) failures; by chi-squared, which need not hold."""
        away = sums - expected
        found = chi2.logsf(np.einsum("ij,jk,ik->i", away, inverse, away), degrees)
        if centered is not None and steep > 0.0:
            found = np.minimum(found, chi2.logsf((away @ centered) ** 2 / steep, 1))
        return np.asarray(found)

    observed = float(statistic(failed.sum(axis=0)[None])[0]) + 1e-9
    larger = drawn = 0
    for sums in _assignments(runs.astype(np.int64), total.astype(np.int64), np.random.default_rng(_SEED)):
        larger, drawn = larger + int((statistic(sums) <= observed).sum()), drawn + len(sums)
        if larger >= _ENOUGH:  # far from showing anything; more draws would tell the same (Besag and Clifford 1991)
            break
    return (1 + larger) / (1 + drawn)


def _assignments(runs: NDArray[np.int64], total: NDArray[np.int64], rng: np.random.Generator) -> Iterator[Floats]:
    """(`_CHUNK`, L) failures at each level over all sets, `DRAWS` in all: level by level, hypergeometric."""
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
        failed, runs: In matched sets, and where there are none in all configurations; with sequential stopping their first runs alone.
        difference: Mantel and Haenszel's difference to the level with the fewest failures, over matched sets; None without any.
        rate: Mean over the configurations that have the level.
        adjusted: The mean that all of them would have with this level and their own levels of the other factors, effects added up.
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
        p_value: Of no effect; None where it can't be tested, `note` says why.
        adjusted: The same by Holm over all that the table asks of its kind.
        shown: Whether `adjusted` is at most the analysis' error.
    """

    p_value: float | None
    note: str = ""
    adjusted: float | None = None
    shown: bool = False


@dataclass(frozen=True, slots=True)
class FactorEffect:
    """What a factor does.

    Attributes:
        highest, lowest: Levels with the highest and the lowest adjusted failure rate.
        difference: Between the two.
        difference_interval: Of it, allowing for their choice among all pairs of levels (Bonferroni).
        share: Of the variance between configurations that the factor explains beyond the others, repetition noise taken out.
        these: Whether it has an effect on these situations, see `Matched`.
        others: Whether it has a mean effect on other situations like these, by permutations within situations or else by `Contrasts`;
            of a number with a trend then twice the smaller of the p-values of its levels and of its trend (Bonferroni).
        situations: Blocks with matched sets; 0 without any.
        needed: Situations from which `others` could be shown; None where these are enough.
        rates: Failure rate of each situation at each level, None where it has none: what a plot draws.
        trend: Of a number with three values or more; None for others.
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
        """Whether it is shown to, on these situations or on others."""
        return self.these.shown or self.others.shown


@dataclass(frozen=True, eq=False)
class Runs:
    """What a factor's tests look at beside the rates of configurations.

    Attributes:
        failed, runs: (m,) of each configuration, as many of all as a stopping rule allows.
        situations: (m,) numbers of the situations that matched sets join.
        matched: None without any.
        table: (k, L) rates of situations at levels where these are balanced; else None.
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
    """The runs of one factor's matched `sets` (m,), and of its situations: the blocks that share sets."""
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
    """(L,) the number behind each level."""
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
    """The effect of one factor, not yet adjusted for the others that are tested.

    Args:
        tested: By `Contrasts`; counts where situations are not balanced.
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
    both = runs.matched
    counted = (
        [(both.failed[:, k], both.runs[:, k]) for k in range(len(groups))]
        if both
        else [(runs.failed[g], runs.runs[g]) for g in groups]
    )
    failed, n = np.array([[float(part.sum()) for part in pair] for pair in counted]).T
    base = int(np.argmin(failed / np.maximum(n, 1)))
    unknown = (None, None)
    differences = [both.difference(k, base) or unknown if both and k != base else unknown for k in range(len(groups))]
    levels = tuple(
        LevelEffect(
            level,
            int(failed[k]),
            int(n[k]),
            difference[0],
            difference[1],
            int(groups[k].sum()),
            float(margins.response[groups[k]].mean()),
            float(found.means[k]),
            interval,
        )
        for k, (level, difference, interval) in enumerate(
            zip(factor.levels, differences, found.intervals(1 - error), strict=True)
        )
    )
    low, high = int(found.means.argmin()), int(found.means.argmax())
    pairs = len(levels) * (len(levels) - 1) / 2
    if runs.table is not None:
        others = Claim(permuted(runs.table, _level_values(factor)))
    else:
        p_value = _of_either(tested.p_value, trend)
        others = Claim(p_value, tested.why if p_value is None else "")
    return FactorEffect(
        factor.name,
        levels,
        factor.levels[high],
        factor.levels[low],
        float(found.means[high] - found.means[low]),
        found.difference(high, low, 1 - error / pairs),
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


def _of_either(of_levels: float | None, trend: Trend | None) -> float | None:
    """The p-value of a difference between levels or of a trend."""
    found = [p for p in (of_levels, trend.p_value if trend else None) if p is not None]
    return min(1.0, len(found) * min(found)) if found else None


def share_of(tested: Tested, between: float) -> float:
    """Share of the variance between configurations that was explained, 0..1."""
    return min(1.0, tested.variance / between) if between > 0 else 0.0
