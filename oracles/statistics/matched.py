"""Permutation tests of a factor: over matched sets for these situations, over situations for others like them."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import permutations
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vastflow.oracles.statistics.intervals import Floats, wilson_intervals
from vastflow.oracles.statistics.tails import hypergeometric, log_chi2_tail

Codes = NDArray[np.int64]
DRAWS: Final = 9999
MOST_ORDERS: Final = 100_000
_SET_SEED: Final = 1959
_ORDER_SEED: Final = 1935
_CHUNK: Final = 333
_MANY: Final = 16  # 2 ** 17 orders are more than `MOST_ORDERS`
_LARGE: Final = 1000
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


def matched(failed: Floats, runs: Floats, codes: Codes, sets: Codes, values: Floats | None) -> Matched | None:
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
    whole, total = runs.sum(axis=1), failed.sum(axis=1)
    chances = np.ones(1)
    for n, m, size in zip(runs[:, 0], total, whole, strict=True):
        chances = np.convolve(chances, hypergeometric(n, m, size))
    expected = float((runs[:, 0] * total / whole).sum())
    away, observed = np.abs(np.arange(len(chances)) - expected), abs(float(failed[:, 0].sum() - expected))
    return min(1.0, float(chances[away >= observed - 1e-9].sum()))


def _drawn(failed: Floats, runs: Floats, values: Floats | None) -> float:
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
        found = log_chi2_tail(np.einsum("ij,jk,ik->i", away, inverse, away), degrees)
        if centered is not None and steep > 0.0:
            found = np.minimum(found, log_chi2_tail((away @ centered) ** 2 / steep, 1))
        return np.asarray(found)

    observed = float(statistic(failed.sum(axis=0)[None])[0]) + 1e-9
    larger = drawn = 0
    for sums in _assignments(runs.astype(np.int64), total.astype(np.int64), np.random.default_rng(_SET_SEED)):
        larger, drawn = larger + int((statistic(sums) <= observed).sum()), drawn + len(sums)
        if larger >= _ENOUGH:  # far from significance; more draws would not change that (Besag and Clifford 1991)
            break
    return (1 + larger) / (1 + drawn)


def _assignments(runs: Codes, total: Codes, rng: np.random.Generator) -> Iterator[Floats]:
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


def table_of(rates: Floats, codes: Codes, sets: Codes, blocks: Codes) -> Floats | None:
    """Mean rate (k, L) of each situation at each level, over the sets that have every level once.

    None where these hold fewer than half of the configurations.

    Args:
        rates, codes, sets, blocks: (m,) of the configurations; a block is a situation, of whole sets.
    """
    _, at = np.unique(sets, return_inverse=True)
    there = np.zeros((int(at.max()) + 1, int(codes.max()) + 1))
    np.add.at(there, (at[codes >= 0], codes[codes >= 0]), 1)
    kept = (there == 1).all(axis=1)[at] & (codes >= 0)
    if 2 * kept.sum() < len(codes):
        return None
    _, place = np.unique(blocks[kept], return_inverse=True)
    return means_of(rates[kept], place, codes[kept], there.shape[1])


def means_of(rates: Floats, rows: Codes, codes: Codes, levels: int) -> Floats:
    """Mean rate (rows, L) in each row at each level, NaN without data."""
    cells = (rows * levels + codes)[codes >= 0]
    size = (int(rows.max()) + 1) * levels
    n = np.bincount(cells, minlength=size)
    sums = np.bincount(cells, weights=rates[codes >= 0], minlength=size)
    return np.where(n > 0, sums / np.maximum(n, 1), np.nan).reshape(-1, levels)


def permuted(table: Floats, values: Floats | None) -> float:
    """p-value for equal levels of rates (k, L), by their orders within situations.

    All orders if there are at most `MOST_ORDERS`, else 9,999 random ones, of which the sums are normal in a table above `_LARGE`. The statistic is the smaller p-value of the spread of
    the levels' means and, for numbers, of their linear trend.
    """
    sums = _sums(table)
    away = sums - sums.mean(axis=1, keepdims=True)
    p_values = _shares((away**2).sum(axis=1))
    if values is not None and len(values) > 2 and np.isfinite(values).all():
        p_values = np.minimum(p_values, _shares((away @ (values - values.mean())) ** 2))
    return float((p_values <= p_values[0] + 1e-12).mean())


def needed(levels: int, tests: int, error: float) -> int:
    """Number of situations from which the lowest p-value, times the number of tests, is at most `error`."""
    return math.ceil(1 + math.log(tests / error) / math.log(math.factorial(levels)) - 1e-9)


def _sums(table: Floats) -> Floats:
    """Sums (orders, L) over situations; the first row is that of `table` itself."""
    k, levels = table.shape
    if k > _MANY or math.factorial(levels) ** k > MOST_ORDERS:
        rng = np.random.default_rng(_ORDER_SEED)
        if table.size > _LARGE:
            spread = np.sqrt(table.var(axis=1).sum() * levels / (levels - 1))
            return np.vstack((table.sum(axis=0), table.sum() / levels + _centered(rng, levels) * spread))
        size = max(1, 1_000_000 // table.size)
        sizes = [min(size, DRAWS - done) for done in range(0, DRAWS, size)]
        drawn = [rng.permuted(np.broadcast_to(table, (n, k, levels)), axis=2).sum(axis=1) for n in sizes]
        return np.vstack((table.sum(axis=0), *drawn))
    orders = list(permutations(range(levels)))
    sums = np.zeros((1, levels))
    for row in table:
        sums = (sums[:, None, :] + row[orders]).reshape(-1, levels)
    return sums


def _centered(rng: np.random.Generator, levels: int) -> Floats:
    normal: Floats = rng.standard_normal((DRAWS, levels))
    return np.asarray(normal - normal.mean(axis=1, keepdims=True))


def _shares(statistic: Floats) -> Floats:
    rounded = np.round(statistic, 9)
    return 1.0 - np.searchsorted(np.sort(rounded), rounded) / len(rounded)
