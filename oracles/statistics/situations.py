"""Situations: permutation tests of a factor over situations, for other situations like these."""

import math
from collections.abc import Sequence
from itertools import permutations
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vastflow.oracles.statistics.intervals import Floats

MOST_ORDERS: Final = 100_000
_DRAWS: Final = 9999
_SEED: Final = 1935


def table_of(
    rates: Floats, codes: NDArray[np.int64], sets: NDArray[np.int64], blocks: NDArray[np.int64]
) -> Floats | None:
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


def means_of(rates: Floats, rows: NDArray[np.int64], codes: NDArray[np.int64], levels: int) -> Floats:
    """Mean rate (rows, L) in each row at each level, NaN where there is none."""
    cells = (rows * levels + codes)[codes >= 0]
    size = (int(rows.max()) + 1) * levels
    n = np.bincount(cells, minlength=size)
    sums = np.bincount(cells, weights=rates[codes >= 0], minlength=size)
    return np.where(n > 0, sums / np.maximum(n, 1), np.nan).reshape(-1, levels)


def permuted(table: Floats, values: Floats | None) -> float:
    """p-value for equal levels of rates (k, L), by their orders within situations.

    All orders if there are at most `MOST_ORDERS`, else 9,999 random ones. The statistic is the smaller p-value of the spread of
    the levels' means and, for numbers, of their linear trend.
    """
    sums = _sums(table)
    away = sums - sums.mean(axis=1, keepdims=True)
    p_values = _shares((away**2).sum(axis=1))
    if values is not None and len(values) > 2 and np.isfinite(values).all():
        p_values = np.minimum(p_values, _shares((away @ (values - values.mean())) ** 2))
    return float((p_values <= p_values[0] + 1e-12).mean())


def smallest(situations: int, levels: int) -> float:
    """The lowest p-value that `situations` can give, however large the effect."""
    return float(math.factorial(levels)) ** (1 - situations)


def needed(levels: int, tests: int, error: float) -> int:
    """Number of situations from which the lowest p-value, times the number of tests, is at most `error`."""
    return math.ceil(1 + math.log(tests / error) / math.log(math.factorial(levels)) - 1e-9)


def _sums(table: Floats) -> Floats:
    """Sums (orders, L) over situations, those of `table` itself first."""
    k, levels = table.shape
    if math.factorial(levels) ** k > MOST_ORDERS:
        rng = np.random.default_rng(_SEED)
        size = max(1, 1_000_000 // table.size)
        sizes = [min(size, _DRAWS - done) for done in range(0, _DRAWS, size)]
        drawn = [rng.permuted(np.broadcast_to(table, (n, k, levels)), axis=2).sum(axis=1) for n in sizes]
        return np.vstack((table.sum(axis=0), *drawn))
    orders: Sequence[tuple[int, ...]] = list(permutations(range(levels)))
    sums = np.zeros((1, levels))
    for row in table:
        sums = (sums[:, None, :] + row[orders]).reshape(-1, levels)
    return sums


def _shares(statistic: Floats) -> Floats:
    """Share of the orders with at least the statistic of each."""
    rounded = np.round(statistic, 9)
    return 1.0 - np.searchsorted(np.sort(rounded), rounded) / len(rounded)
