"""Linear models of a response with dependent blocks: tests of columns, means at chosen points, and trends."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vastflow.oracles.statistics.intervals import Floats, Interval, few_clusters, interval, wilson_intervals

_SEED: Final = 1949
"""Seed of the random orders: equal data give equal p-values."""
_TINY: Final = 1e-9
_CHUNK: Final = 250
_ENOUGH: Final = 50


@dataclass(frozen=True, slots=True)
class Tested:
    """Result of a test.

    Attributes:
        p_value: None where it cannot be tested, and `why` says why.
        degrees: Independent columns beyond the others.
        variance: Of the response, that the columns explain beyond as many columns of noise.
        least: The lowest p-value that so few blocks can give, however large the effect; 0 where blocks do not limit it.
    """

    p_value: float | None
    degrees: int = 0
    variance: float = 0.0
    why: str = ""
    least: float = 0.0


class Contrasts:
    """Tests on one response with dependent blocks of values.

    Each test is made in the stratum where its columns vary (split-plot analysis, Yates 1935): columns that differ between blocks on
    means of blocks, others on what is left without these means. The p-value is the larger of two, which fail in different places:

    - The *permutation test* of F: residuals of the model without the columns in `draws` random orders (Freedman and Lane, J. Bus.
      Econ. Statist. 1 (1983) 292) within the stratum. It needs no distribution and is wrong where variances and group sizes differ together.
    - The *robust Wald test*, Hotelling's F of the effects over their sandwich covariance, blocks as clusters (HC2, Bell and
      McCaffrey 2002), or single values for few blocks. It is wrong where a small group has no variance because it always passes.

    Attributes:
        response: (m,).
        blocks: (m,) block of each value, renumbered 0..G - 1.
        sizes: (G,) number of values in each block.
    """

    def __init__(self, response: Floats, blocks: NDArray[np.int64], draws: int) -> None:
        self.response, self.draws = response, draws
        self.blocks: NDArray[np.int64] = np.unique(blocks, return_inverse=True)[1].astype(np.int64)
        self.sizes = np.bincount(self.blocks).astype(np.float64)

    def test(self, columns: Floats, others: Floats) -> Tested:
        """Test `columns` (m, q) given `others` (m, p), which include the constant."""
        last = 1 + columns.shape[1]
        between, within = self._split(np.column_stack((self.response, columns, others)))
        left_between, left_within = (beyond(part[:, 1:last], part[:, last:])[0] for part in (between, within))
        spread_between = float((self.sizes @ left_between**2).sum())
        spread_within = float((left_within**2).sum())
        if max(spread_between, spread_within) < _TINY * max(1.0, float((columns**2).sum())):
            return Tested(None, why="cannot be told from other factors")
        if spread_between >= spread_within:
            return self._tested(between, columns.shape[1], np.arange(len(between)), 0)
        return self._tested(within, columns.shape[1], self.blocks, len(between))

    def _split(self, table: Floats) -> tuple[Floats, Floats]:
        """Means (G, k) of blocks, and residuals (m, k) of rows."""
        means = np.zeros((len(self.sizes), table.shape[1]))
        np.add.at(means, self.blocks, table)
        means /= self.sizes[:, None]
        return means, table - means[self.blocks]

    def _tested(self, table: Floats, degrees: int, units: NDArray[np.int64], used: int) -> Tested:
        y, columns, others = table[:, 0], table[:, 1 : 1 + degrees], table[:, 1 + degrees :]
        left_over, basis = beyond(columns, others)
        tested = _basis(left_over)
        q = tested.shape[1]
        left = len(y) - used - basis.shape[1] - q
        if left < 1:
            return Tested(None, q, why="too few configurations")
        residual = y - basis @ (basis.T @ y)
        total, explained = float(residual @ residual), float(((tested.T @ residual) ** 2).sum())
        if total <= _TINY:
            return Tested(1.0, q)
        orders = self._orders_within if used else self._orders_between
        permuted = _permuted(residual, tested, basis, orders)
        robust = _robust(y, residual, tested, basis, units, left)
        noise = max(total - explained, 0.0) / left
        least = 0.0 if used else _least(columns, others, q)
        return Tested(max(permuted, robust), q, max(0.0, explained - q * noise) / len(y), least=least)

    @cached_property
    def _orders_between(self) -> NDArray[np.int32]:
        return self._orders(np.zeros(len(self.sizes)))

    @cached_property
    def _orders_within(self) -> NDArray[np.int32]:
        return self._orders(self.blocks.astype(np.float64))

    def _orders(self, blocks: Floats) -> NDArray[np.int32]:
        """Orders (draws, len(blocks)) of values, each within its block."""
        rng = np.random.default_rng(_SEED)
        orders = np.empty((self.draws, len(blocks)), dtype=np.int32)
        places = np.argsort(blocks, kind="stable")
        for order in orders:
            order[places] = np.argsort(blocks + rng.random(len(blocks)))
        return orders


def _least(columns: Floats, others: Floats, degrees: int) -> float:
    """Lowest p-value of the permutation test: orders within equal rows, and equal groups exchanged, change nothing."""
    sizes = np.unique(np.column_stack((columns, others)).round(9), axis=0, return_counts=True)[1].tolist()
    orders = math.factorial(len(columns)) // math.prod(map(math.factorial, sizes))
    saturated = len(_basis(others)[0]) == 1 and degrees == len(sizes) - 1
    return (math.prod(math.factorial(sizes.count(size)) for size in set(sizes)) if saturated else 1) / orders


def _permuted(residual: Floats, tested: Floats, basis: Floats, orders: NDArray[np.int32]) -> float:
    """Share of the orders of `residual`, its own included, with at least its own F."""
    total = float(residual @ residual)
    whole = np.hstack((tested, basis)).astype(np.float32)
    q = tested.shape[1]

    def statistic(rows: NDArray[np.float32]) -> NDArray[np.float32]:
        parts = (rows @ whole) ** 2
        explained = parts[:, :q].sum(axis=1)
        left = np.maximum(total - parts.sum(axis=1), 1e-6 * total)
        return np.asarray(explained / left)

    values = residual.astype(np.float32)
    observed = statistic(values[None, :])[0] * (1 - 1e-5)
    larger = drawn = 0
    for k in range(0, len(orders), _CHUNK):
        larger += int((statistic(values[orders[k : k + _CHUNK]]) >= observed).sum())
        drawn = min(k + _CHUNK, len(orders))
        if larger >= _ENOUGH:  # far from significance; more draws would not change that (Besag and Clifford 1991)
            break
    return (1 + larger) / (1 + drawn)


def _robust(y: Floats, residual: Floats, tested: Floats, basis: Floats, units: NDArray[np.int64], left: int) -> float:
    """p-value of Hotelling's F of the effects over their sandwich covariance; single values have `left` degrees of freedom."""
    from scipy.special import fdtrc

    q, count = tested.shape[1], int(units.max()) + 1
    clustered = 2 * q + 2 <= count < len(y)
    effects = tested.T @ residual
    errors = residual - tested @ effects
    leverage = (tested**2).sum(axis=1) + (basis**2).sum(axis=1)
    scores = tested * (errors / np.sqrt(np.maximum(1.0 - leverage, 0.05)))[:, None]
    freedom = left + q - 1
    if clustered:
        sums = np.zeros((count, q))
        np.add.at(sums, units, scores)
        scores, freedom = sums * np.sqrt(count / (count - 1)), min(freedom, count - 1)
    covariance = scores.T @ scores
    # An effect without variance is certain here; the permutations decide then.
    covariance += np.eye(q) * max(float(np.trace(covariance)), _TINY) * 1e-9
    found = float(effects @ np.linalg.solve(covariance, effects))
    remaining = freedom - q + 1
    return float(fdtrc(q, remaining, found * remaining / (freedom * q)))


def beyond(columns: Floats, others: Floats) -> tuple[Floats, Floats]:
    """Residuals of `columns` on `others`, and an orthonormal basis of the latter."""
    basis = _basis(others)
    return columns - basis @ (basis.T @ columns), basis


def _basis(columns: Floats) -> Floats:
    values, vectors = np.linalg.eigh(columns.T @ columns)
    keep = values > 1e-9 * max(float(values[-1]) if len(values) else 0.0, _TINY)
    basis: Floats = columns @ (vectors[:, keep] / np.sqrt(values[keep]))
    return basis


@dataclass(frozen=True, eq=False)
class MarginalMeans:
    """Means of k points of a model of rates.

    Attributes:
        means: (k,) within 0..1.
        covariance: (k, k), blocks as clusters.
        units: (k,) blocks at each point's level.
        most: (k,) their runs, which bound the effective number.
    """

    means: Floats
    covariance: Floats = field(repr=False)
    units: Floats
    most: Floats

    def intervals(self, level: float) -> list[Interval]:
        """Wilson intervals at the effective number of independent runs.

        That is p(1 - p)/V, reduced by (z/t)² for the few blocks behind V (Korn and Graubard, Survey Methodology 24 (1998) 193). Where a
        level always or never fails, V is zero and each block counts once.
        """
        p, variance = self.means, np.diagonal(self.covariance)
        inside = (p > 0) & (p < 1)
        few = few_clusters(self.units, level)
        known = inside & (variance > 1e-15)
        effective = np.where(
            known, p * (1 - p) / np.where(known, variance, 1.0) * few, np.where(inside, self.most, self.units)
        )
        n = np.minimum(effective, self.most)
        return [interval(ends) for ends in wilson_intervals(n * p, n, level)]

    def difference(self, a: int, b: int, level: float) -> tuple[float, float]:
        """Interval of means[a] - means[b] (Newcombe 1998, method 10; Zou and Donner, Stat. in Medicine 27 (2008) 1693)."""
        one, two = (self.intervals(level)[k] for k in (a, b))
        p, q = float(self.means[a]), float(self.means[b])
        scale = float(np.sqrt(self.covariance[a, a] * self.covariance[b, b]))
        together = float(np.clip(self.covariance[a, b] / scale, -1.0, 1.0)) if scale > 1e-15 else 0.0

        def reach(first: float, second: float) -> float:
            return float(np.sqrt(max(0.0, first**2 + second**2 - 2 * together * first * second)))

        down, up = reach(p - one.low, two.high - q), reach(one.high - p, q - two.low)
        return max(-1.0, p - q - down), min(1.0, p - q + up)


class Margins:
    """A linear model of `response` (m,) on the columns of `model` (m, columns), which may be dependent; residuals are HC2's.

    Args:
        blocks: (m,) 0..G - 1.
        runs: (m,) behind each response.

    Attributes:
        fitted: (m,).
        explained: Variance of `fitted` beyond that of as many columns of noise.
    """

    def __init__(self, model: Floats, response: Floats, blocks: NDArray[np.int64], runs: Floats) -> None:
        self._model, self._response, self._blocks, self._runs = model, response, blocks, runs
        self._inverse = np.linalg.pinv(model.T @ model, rcond=1e-10, hermitian=True).astype(np.float64)
        self.fitted: Floats = model @ (self._inverse @ (model.T @ response))
        leverage = np.einsum("ij,jk,ik->i", model, self._inverse, model, optimize=True)
        residual: Floats = response - self.fitted
        rank = round(float(leverage.sum()))
        left = len(response) - rank
        noise = float(residual @ residual) / left if left > 0 else float(response.var())
        self.explained = max(0.0, float(self.fitted.var()) - (rank - 1) * noise / len(response))
        self._weighted: Floats = residual / np.sqrt(np.maximum(1.0 - leverage, 0.05))

    def at(self, points: Floats, groups: Sequence[NDArray[np.bool_]]) -> MarginalMeans:
        """Means at `points` (k, columns); `groups` are the rows with each point's level.

        A point that the model cannot estimate, because its level is confounded, has the plain mean of its group.
        """
        combined = points @ self._inverse  # (k, columns)
        told = np.abs(combined @ (self._model.T @ self._model) - points).max(axis=1) < 1e-6
        weights = combined @ self._model.T  # (k, m): means are sums of these times responses
        for k, group in enumerate(groups):
            if not told[k]:
                weights[k] = group / group.sum()
        count = int(self._blocks.max()) + 1
        sums = np.zeros((len(points), count))
        for k in range(len(points)):
            residual = self._weighted if told[k] else self._response - self._response[groups[k]].mean()
            sums[k] = np.bincount(self._blocks, weights=weights[k] * residual, minlength=count)
        covariance = sums @ sums.T * (count / max(count - 1, 1))
        units = np.array([len(np.unique(self._blocks[group])) for group in groups], dtype=np.float64)
        most = np.array([self._runs[group].sum() for group in groups])
        means = np.clip(weights @ self._response, 0.0, 1.0)
        means = np.where(means < 1e-9, 0.0, np.where(means > 1 - 1e-9, 1.0, means))  # rounding is no failure
        return MarginalMeans(means, covariance, units, most)


LEAST_VALUES: Final = 3
"""Distinct values that a trend requires."""


@dataclass(frozen=True, slots=True)
class Trend:
    """The change of the failure rate over a number, other factors held.

    Attributes:
        change: From the smallest to the greatest number, within -1..1; its interval has blocks as clusters.
        smallest, greatest: Of the number.
        p_value: For zero slope; None where it cannot be tested.
        least: As of `Tested`.
    """

    change: float
    change_interval: tuple[float, float]
    smallest: float
    greatest: float
    p_value: float | None
    least: float = 0.0


def trend_of(contrasts: Contrasts, values: Floats, others: Floats, runs: Floats, error: float) -> Trend | None:
    """The trend of the response over `values`; None for fewer than `LEAST_VALUES`, or if they follow from `others`.

    The rates at both ends are `Margins` beside `others`; the test is that of `Contrasts` for one column.

    Args:
        values: (m,), NaN where a configuration lacks the number.
        others: (m, p) columns held, the constant and one that marks missing values among them.
        runs: (m,) behind each response.
    """
    known = np.isfinite(values)
    if len(np.unique(values[known])) < LEAST_VALUES:
        return None
    smallest, greatest = float(values[known].min()), float(values[known].max())
    column = np.where(known, (values - smallest) / (greatest - smallest), 0.0)[:, None]
    if float((beyond(column, others)[0] ** 2).sum()) < 1e-9 * len(values) or len(contrasts.sizes) < 2:
        return None
    usual = others[known].mean(axis=0)
    margins = Margins(np.hstack((others, column)), contrasts.response, contrasts.blocks, runs)
    found = margins.at(np.array([[*usual, 0.0], [*usual, 1.0]]), [known, known])
    tested = contrasts.test(column, others)
    return Trend(
        float(found.means[1] - found.means[0]),
        found.difference(1, 0, 1 - error),
        smallest,
        greatest,
        tested.p_value,
        tested.least,
    )
