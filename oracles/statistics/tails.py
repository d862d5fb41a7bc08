"""Tails of distributions and adjusted p-values by `scipy.special` alone: importing `scipy.stats` takes as long as a report."""

import numpy as np
from numpy.typing import ArrayLike

from vastflow.oracles.statistics.intervals import Floats


def binomial_at_most(x: ArrayLike, n: ArrayLike, p: float) -> Floats:
    """Return P(X <= x) of binomial counts X of n, 0 < p < 1."""
    from scipy.special import betainc

    x, n = np.broadcast_arrays(np.asarray(x, dtype=np.float64), np.asarray(n, dtype=np.float64))
    inside = (x >= 0) & (x < n)
    found = betainc(np.where(inside, n - x, 1.0), np.where(inside, x + 1.0, 1.0), 1.0 - p)
    return np.asarray(np.where(inside, found, x >= n), dtype=np.float64)


def binomial_quantile(share: float, n: ArrayLike, p: float) -> Floats:
    """Smallest count x of n with P(X <= x) >= `share`, 0 < p < 1."""
    from scipy.special import bdtrik

    n = np.asarray(n, dtype=np.float64)
    x = np.clip(np.ceil(np.nan_to_num(bdtrik(share, n, p))), 0.0, n)  # it is none below the share of 0
    x = np.where(binomial_at_most(x, n, p) < share, x + 1.0, x)
    return np.asarray(np.where(binomial_at_most(x - 1.0, n, p) >= share, x - 1.0, x))


def hypergeometric(drawn: float, failures: float, size: float) -> Floats:
    """P(X = x) at x = 0..`drawn` of the failures X among `drawn` of `size` runs, of which `failures` failed."""
    from scipy.special import betaln

    def log_binomial(n: Floats | float, k: Floats | float) -> Floats:
        """Logarithm of n over k, 0 <= k <= n."""
        return np.asarray(-np.log1p(n) - betaln(n - k + 1.0, k + 1.0))

    x = np.arange(drawn + 1.0)
    there = (x <= failures) & (drawn - x <= size - failures)
    rest, k = size - failures, np.where(there, x, max(0.0, drawn - size + failures))
    chances = np.exp(log_binomial(failures, k) + log_binomial(rest, drawn - k) - log_binomial(size, drawn))
    return np.asarray(np.where(there, chances, 0.0))


def log_chi2_tail(x: Floats, degrees: float) -> Floats:
    """Logarithm of P(X > x) of a chi-squared X."""
    from scipy.special import chdtrc

    with np.errstate(divide="ignore"):
        return np.asarray(np.log(chdtrc(degrees, x)))


def false_discovery(p_values: Floats) -> Floats:
    """p-values (m,) adjusted by Benjamini and Hochberg (JRSS B 57 (1995) 289)."""
    order = np.argsort(p_values)[::-1]
    scaled = p_values[order] * len(order) / np.arange(len(order), 0, -1)
    adjusted = np.empty_like(scaled)
    adjusted[order] = np.minimum(np.minimum.accumulate(scaled), 1.0)
    return adjusted
