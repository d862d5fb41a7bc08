"""Intervals of a mean that hold at every look, so that runs may end by what they show.

A mean within -1..1 is tested by betting (Waudby-Smith and Ramdas, "Estimating means of bounded random variables by betting", JRSS B 86
(2024) 1). Against "the mean is at most δ", a wealth of 1 is multiplied by 1 + λ (x - δ) for each value x. With one λ in 0..1/(1 + δ), its
expectation never grows: a round has one value of each configuration, independent and with means μ_i, so it multiplies the expectation by
Π (1 + λ (μ_i - δ)) ≤ (1 + λ (mean of μ_i - δ))^m ≤ 1, the arithmetic mean being no less than the geometric one. The configurations' means need
not be equal. Values that depend on each other are one bet on their sum, and λ is smaller by the most values of a bet, which keeps the bound. Such
a wealth ever reaches 1/α with probability α at most (Ville, Étude critique de la notion de collectif, 1939), whatever decides when the
rounds end. The same holds for a mixture of several λ, one of which bets well whether few or many values differ.

The interval has the δ against which neither side has reached 1/α. Whatever is read from it, for any margin, is wrong only where the interval
misses the mean: together with probability 1 - level at most.
"""

import math
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vastflow.oracles.statistics.intervals import LEVEL, Floats

_BETS: Final = 0.5 ** np.arange(7)
"""λ as shares of 1/(1 + δ): all of the wealth where hardly anything differs, down to where half of the pairs do."""
_LOG_SHARES: Final = -np.log1p(np.arange(7)) - math.log((1.0 / (1.0 + np.arange(7))).sum())
"""Initial wealth on each bet; larger bets decide earlier, and have more."""
_STEPS: Final = 50


def interval_at_any_look(
    values: ArrayLike, noise: ArrayLike | None = None, level: float = LEVEL
) -> tuple[float, float]:
    """Interval of the mean of a quantity within -1..1, after any number of whole rounds.

    Args:
        values: (P,) one value of each configuration in each round.
        noise: (P,) equal numbers for values that share their noise, such as those of one seed; by default all are independent.

    Raises:
        ValueError: a value beyond -1..1, or no value.
    """
    x = np.asarray(values, dtype=np.float64)
    if not len(x) or not (np.abs(x) <= 1.0 + 1e-12).all():
        raise ValueError(f"expected values within -1..1, got {x.tolist()[:5]}")
    _, of = np.unique(np.arange(len(x)) if noise is None else noise, return_inverse=True)
    sums, sizes = np.bincount(of, weights=x), np.bincount(of)
    (sums, sizes), times = np.unique((sums, sizes), axis=1, return_counts=True)
    threshold = math.log(2.0 / (1.0 - level))
    return _lower(sums, sizes, times, threshold), -_lower(-sums, sizes, times, threshold)


def log_wealth(sums: ArrayLike, sizes: ArrayLike, times: ArrayLike, bound: float) -> Floats:
    """Logarithms (*S) of the wealth against a mean of at most `bound`.

    Args:
        sums, sizes: (V,) different bets: the sum of each one's values, and how many they are.
        times: (*S, V) how often each was made.
    """
    gains = (np.asarray(sums) - bound * np.asarray(sizes)) / np.max(sizes)
    factors = 1.0 + np.multiply.outer(gains, _BETS / (1.0 + bound))
    logs = np.log(np.maximum(factors, np.finfo(np.float64).tiny))  # all of it may be lost
    return np.asarray(np.logaddexp.reduce(np.asarray(times, dtype=np.float64) @ logs + _LOG_SHARES, axis=-1))


def _lower(sums: Floats, sizes: Floats, times: NDArray[np.int64], threshold: float) -> float:
    """Largest bound that is excluded.

    The wealth falls as the bound rises, and is at most 1 at the mean.
    """
    low, high = -1.0, float(times @ sums / (times @ sizes))
    for _ in range(_STEPS):
        middle = (low + high) / 2.0
        excluded = middle > -1.0 and log_wealth(sums, sizes, times, middle) >= threshold
        low, high = (middle, high) if excluded else (low, middle)
    return low
