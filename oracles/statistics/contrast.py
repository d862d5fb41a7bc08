"""Contrasts: tests whether columns explain a response beyond other columns and the noise of blocks."""

import math
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
        variance: Of the response, that the columns explain beyond as many columns of noise.
        least: The lowest p-value that so few blocks can give, however large the effect; 0 where blocks do not limit it.
    """

    p_value: float | None
    degrees: int = 0
    variance: float = 0.0
    why: str = ""
    least: float = 0.0


class Contrasts:
    """Tests on one response whose values come in dependent blocks.

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
        """Test `columns` (m, q) beside `others` (m, p), which hold the constant."""
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
