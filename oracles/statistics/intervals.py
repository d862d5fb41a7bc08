"""Confidence intervals of success rates, of many configurations at once."""

import math
from dataclasses import dataclass
from statistics import NormalDist
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

LEVEL: Final = 0.95
"""Confidence of every interval of the report."""

Floats: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Interval:
    """A confidence interval of a rate, within [0, 1]."""

    low: float
    high: float

    @property
    def thousandths(self) -> tuple[int, int]:
        """The ends as they are shown: outwards to the next 0.1 %, so that a further rounding outwards gives what it gives at once."""
        low, high = thousandths(np.array((self.low, self.high))).tolist()
        return low, high


def thousandths(ends: Floats) -> NDArray[np.int64]:
    """`Interval.thousandths` of many intervals (*S, 2); what is exact but for floating point's error stays."""
    exact = np.round(1000.0 * ends, 6)
    return np.stack((np.floor(exact[..., 0]), np.ceil(exact[..., 1])), axis=-1).astype(np.int64)


def wilson_intervals(passed: ArrayLike, judged: ArrayLike, level: float = LEVEL) -> Floats:
    """Wilson's score interval of binomial proportions (E. B. Wilson, JASA 22 (1927) 209).

    With p = passed / n and z the (1 + level) / 2 quantile of the normal distribution:
    (p + z²/2n ± z sqrt(p(1 - p)/n + z²/4n²)) / (1 + z²/n). Nothing is known at n = 0: 0..1.

    Args:
        passed, judged: 0 <= passed <= judged, of shapes that broadcast to S; not necessarily whole, for effective sample sizes.

    Returns:
        (*S, 2), low and high.

    Raises:
        ValueError: more passes than judged runs, or fewer than none.
    """
    x, n = counts(passed, judged)
    z = normal_quantile(level)
    known = n > 0
    m = np.where(known, n, 1.0)
    p = x / m
    center = p + z * z / (2 * m)
    half = z * np.sqrt(p * (1 - p) / m + z * z / (4 * m * m))
    scale = 1 + z * z / m
    # At p = 0 and p = 1 one end is exact; rounding must not push it inside or outside.
    low = np.where(known & (x > 0), (center - half) / scale, 0.0)
    high = np.where(known & (x < n), (center + half) / scale, 1.0)
    return np.stack((low, high), axis=-1)


def clopper_pearson_intervals(passed: ArrayLike, judged: ArrayLike, level: float = LEVEL) -> Floats:
    """Clopper and Pearson's exact interval of binomial proportions (Biometrika 26 (1934) 404).

    Quantiles of beta distributions: a/2 of B(x, n - x + 1) and 1 - a/2 of B(x + 1, n - x), with a = 1 - level. It covers the
    rate with at least `level` whatever the rate, and is the wider for it. Nothing is known at n = 0: 0..1.

    Args:
        passed, judged: 0 <= passed <= judged, of shapes that broadcast to S.

    Returns:
        (*S, 2), low and high.

    Raises:
        ValueError: more passes than judged runs, or fewer than none.
    """
    from scipy.special import betaincinv

    x, n = counts(passed, judged)
    tail = (1 - level) / 2
    some, missed = x > 0, x < n
    low = np.where(some, betaincinv(np.where(some, x, 1.0), n - x + 1, tail), 0.0)
    high = np.where(missed, betaincinv(x + 1, np.where(missed, n - x, 1.0), 1 - tail), 1.0)
    return np.stack((low, high), axis=-1)


def few_clusters(clusters: ArrayLike, level: float = LEVEL) -> Floats:
    """(z/t)² with Student's t at m - 1 degrees of freedom: what a sample size is worth whose variance is that of m `clusters`."""
    from scipy.special import stdtrit

    freedom = np.maximum(np.asarray(clusters, dtype=np.float64) - 1.0, 1.0)
    return np.asarray((normal_quantile(level) / stdtrit(freedom, (1 + level) / 2)) ** 2)


def interval(ends: Floats) -> Interval:
    """One interval from its (2,) ends."""
    return Interval(float(ends[0]), float(ends[1]))


def counts(passed: ArrayLike, judged: ArrayLike) -> tuple[Floats, Floats]:
    """Passes and judged runs as floats of one shape.

    Raises:
        ValueError: more passes than judged runs, or fewer than none.
    """
    x, n = np.broadcast_arrays(np.asarray(passed, dtype=np.float64), np.asarray(judged, dtype=np.float64))
    wrong = ~((x >= 0) & (x <= n))
    if wrong.any():
        at = int(np.argmax(wrong))
        raise ValueError(f"passed must be in 0..n, got {_plain(x.flat[at])} of {_plain(n.flat[at])}")
    return x, n


def normal_quantile(level: float) -> float:
    """Half the width, in standard deviations, of a two-sided interval of confidence `level`."""
    return NormalDist().inv_cdf((1 + level) / 2)


def _plain(value: float) -> str:
    return f"{value:g}" if math.isfinite(value) else str(value)
