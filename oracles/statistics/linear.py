"""Linear models of a response with dependent blocks: tests of columns, means at chosen points, and trends."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vastflow.oracles.statistics.intervals import Floats

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
        least: The lowest p-value that so few blocks can give, however large the effect; 0 where blocks do not limit it.
        slope: Coefficient of a single column, its standard error with blocks as units, and degrees of freedom; None for few blocks.
    """

    p_value: float | None
    degrees: int = 0
    why: str = ""
    least: float = 0.0
    slope: tuple[float, float, float] | None = None


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
        if float(residual @ residual) <= _TINY:
            return Tested(1.0, q, slope=(0.0, 0.0, left) if q == 1 else None)
        orders = self._orders_within if used else self._orders_between
        permuted = _permuted(residual, tested, basis, orders)
        robust, deviation, freedom = _robust(y, residual, tested, basis, units, left)
        least = 0.0 if used else _least(columns, others, q)
        slope = None
        if degrees == 1 and (not used or _is_clustered(q, units)):
            norm = float(left_over[:, 0] @ left_over[:, 0])
            slope = (float(left_over[:, 0] @ residual) / norm, deviation / math.sqrt(norm), freedom)
        return Tested(max(permuted, robust), q, least=least, slope=slope)

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


def _is_clustered(q: int, units: NDArray[np.int64]) -> bool:
    return 2 * q + 2 <= int(units.max()) + 1 < len(units)


def _robust(
    y: Floats, residual: Floats, tested: Floats, basis: Floats, units: NDArray[np.int64], left: int
) -> tuple[float, float, float]:
    """p-value of Hotelling's F of the effects over their sandwich covariance, standard error of the first, and degrees of freedom.

    Single values have `left` degrees of freedom.
    """
    from scipy.special import fdtrc

    q, count = tested.shape[1], int(units.max()) + 1
    effects = tested.T @ residual
    errors = residual - tested @ effects
    leverage = (tested**2).sum(axis=1) + (basis**2).sum(axis=1)
    scores = tested * (errors / np.sqrt(np.maximum(1.0 - leverage, 0.05)))[:, None]
    freedom = left + q - 1
    if _is_clustered(q, units):
        sums = np.zeros((count, q))
        np.add.at(sums, units, scores)
        scores, freedom = sums * np.sqrt(count / (count - 1)), min(freedom, count - 1)
    covariance = scores.T @ scores
    # An effect without variance is certain here; the permutations decide then.
    covariance += np.eye(q) * max(float(np.trace(covariance)), _TINY) * 1e-9
    found = float(effects @ np.linalg.solve(covariance, effects))
    remaining = freedom - q + 1
    p_value = float(fdtrc(q, remaining, found * remaining / (freedom * q)))
    return p_value, math.sqrt(float(covariance[0, 0])), freedom


def beyond(columns: Floats, others: Floats) -> tuple[Floats, Floats]:
    """Residuals of `columns` on `others`, and an orthonormal basis of the latter."""
    basis = _basis(others)
    return columns - basis @ (basis.T @ columns), basis


def _basis(columns: Floats) -> Floats:
    values, vectors = np.linalg.eigh(columns.T @ columns)
    keep = values > 1e-9 * max(float(values[-1]) if len(values) else 0.0, _TINY)
    basis: Floats = columns @ (vectors[:, keep] / np.sqrt(values[keep]))
    return basis


class Margins:
    """A linear model of `response` (m,) on the columns of `model` (m, columns), which may be dependent.

    Attributes:
        fitted: (m,).
    """

    def __init__(self, model: Floats, response: Floats) -> None:
        self._model, self._response = model, response
        self._inverse = np.linalg.pinv(model.T @ model, rcond=1e-10, hermitian=True).astype(np.float64)
        self.fitted: Floats = model @ (self._inverse @ (model.T @ response))

    def at(self, points: Floats, groups: Sequence[NDArray[np.bool_]]) -> Floats:
        """Means (k,) at `points` (k, columns), within 0..1; `groups` are the rows with each point's level.

        A point that the model cannot estimate, because its level is confounded, has the plain mean of its group.
        """
        combined = points @ self._inverse  # (k, columns)
        told = np.abs(combined @ (self._model.T @ self._model) - points).max(axis=1) < 1e-6
        plain = [self._response[group].mean() for group in groups]
        means = np.clip(np.where(told, combined @ (self._model.T @ self._response), plain), 0.0, 1.0)
        return np.where(means < 1e-9, 0.0, np.where(means > 1 - 1e-9, 1.0, means))  # rounding is no failure


LEAST_VALUES: Final = 3
"""Distinct values that a trend requires."""


@dataclass(frozen=True, slots=True)
class Trend:
    """The change of the failure rate over a number, other factors held: a least-squares slope.

    Attributes:
        change: From the smallest to the greatest number, within -1..1.
        change_interval: By independent units, see `trend_of`.
        smallest, greatest: Limits of the number's values.
        p_value: For zero slope; None where it cannot be tested.
        least: The lowest possible p-value, see `Tested`.
    """

    change: float
    change_interval: tuple[float, float]
    smallest: float
    greatest: float
    p_value: float | None
    least: float = 0.0

    @property
    def shown(self) -> bool:
        """Whether the interval rules out that nothing changes."""
        return self.change_interval[0] > 0.0 or self.change_interval[1] < 0.0


def trend_of(contrasts: Contrasts, values: Floats, others: Floats, runs: Floats, error: float) -> Trend | None:
    """The trend of the response over `values`; None for few values or units, or if they follow from `others`.

    The interval is Student's, of the standard error of the test of `Contrasts`: with values that vary within units, that of the mean of the
    units' slopes. It is no narrower than repetitions of these very configurations alone make it, since slopes of total effects do not differ.

    Args:
        values: (m,), NaN where a configuration lacks the number.
        others: (m, p) columns held, the constant and one that marks missing values among them.
        runs: (m,) behind each response.
    """
    from scipy.special import ndtri, stdtrit

    known = np.isfinite(values)
    if len(np.unique(values[known])) < LEAST_VALUES:
        return None
    smallest, greatest = float(values[known].min()), float(values[known].max())
    column = np.where(known, (values - smallest) / (greatest - smallest), 0.0)[:, None]
    left = beyond(column, others)[0][:, 0]
    if float(left @ left) < 1e-9 * len(values) or len(contrasts.sizes) < 2:
        return None
    tested = contrasts.test(column, others)
    if tested.slope is None:
        return None
    change, deviation, freedom = tested.slope
    smoothed = (runs * contrasts.response + 0.5) / (runs + 1)
    repeated = math.sqrt(float((left / (left @ left)) ** 2 @ (smoothed * (1 - smoothed) / runs)))
    half = max(float(stdtrit(freedom, 1 - error / 2)) * deviation, float(ndtri(1 - error / 2)) * repeated)
    ends = (max(-1.0, change - half), min(1.0, change + half))
    return Trend(min(1.0, max(-1.0, change)), ends, smallest, greatest, tested.p_value, tested.least)
