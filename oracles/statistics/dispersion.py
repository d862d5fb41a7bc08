"""Over-dispersion: variance between configurations beyond the variance between runs of one."""

import math
from dataclasses import dataclass
from statistics import NormalDist
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from vastflow.oracles.statistics.intervals import Floats, counts

_LEAST_SIZE: Final = 1e-6
_LARGEST_SIZE: Final = 1e7
"""Bounds of alpha + beta in the fit."""


@dataclass(frozen=True, slots=True)
class Dispersion:
    """The distribution B(alpha, beta) of the configurations' rates.

    Attributes:
        configurations: Number of those with judged runs.
        mean: Share of passed runs.
        alpha, beta: Parameters of the beta-binomial fit; None at its limits, one rate for all, or only rates 0 and 1.
        icc: Intraclass correlation 1 / (alpha + beta + 1): 0 for independent runs, 1 where all runs of each configuration agree; None
            where no configuration has two judged runs.
        icc_moments: By analysis of variance; negative where configurations differ less than by chance.
        p_value: p-value of Tarone's one-sided test of no over-dispersion.
        design_effect: Variance of the mean over that of independent runs.
    """

    configurations: int
    mean: float
    alpha: float | None
    beta: float | None
    icc: float | None
    icc_moments: float | None
    p_value: float
    design_effect: float | None


def dispersion(passed: ArrayLike, judged: ArrayLike) -> Dispersion | None:
    """Fit a beta-binomial distribution to configurations; None where nothing was judged.

    Maximum likelihood (Skellam, JRSS B 10 (1948) 257) started at the moments (Ridout, Demétrio and Firth, Biometrics 55 (1999) 137);
    Tarone's test (Biometrika 66 (1979) 585); design effect 1 + (n - 1) icc with n = Σ n_i² / Σ n_i (Kish 1965).

    Args:
        passed, judged: (m,) counts, one entry a configuration.
    """
    x, n = counts(passed, judged)
    x, n = x[n > 0], n[n > 0]
    if not len(n):
        return None
    total = float(n.sum())
    mean = float(x.sum()) / total
    moments = _icc_by_moments(x, n)
    alpha = beta = icc = effect = None
    if moments is not None:
        agree = bool(((x == 0) | (x == n)).all())  # with themselves, run for run
        if mean in (0.0, 1.0):
            icc = 0.0
        elif agree:
            icc = 1.0
        elif (fit := _fitted(x, n, moments)) is None:
            icc = 0.0
        else:
            alpha, beta = fit
            icc = 1.0 / (alpha + beta + 1.0)
        effect = 1.0 + (float((n * n).sum()) / total - 1.0) * icc
    return Dispersion(len(n), mean, alpha, beta, icc, moments, _tarone(x, n), effect)


def _icc_by_moments(x: Floats, n: Floats) -> float | None:
    m, total = len(n), float(n.sum())
    if m < 2 or total <= m:
        return None
    squares = float((x * x / n).sum())
    between = (squares - float(x.sum()) ** 2 / total) / (m - 1)
    within = (float(x.sum()) - squares) / (total - m)
    size = (total - float((n * n).sum()) / total) / (m - 1)
    variance = between + (size - 1) * within
    return (between - within) / variance if variance > 0 else 0.0


def _tarone(x: Floats, n: Floats) -> float:
    p = float(x.sum() / n.sum())
    spread = 2.0 * float((n * (n - 1)).sum())
    if p in (0.0, 1.0) or spread == 0.0:
        return 1.0
    score = float(((x - n * p) ** 2).sum()) / (p * (1 - p))
    return NormalDist().cdf((float(n.sum()) - score) / math.sqrt(spread))


def _fitted(x: Floats, n: Floats, start: float) -> tuple[float, float] | None:
    """Most likely alpha and beta; None at the limit of equal configurations."""
    from scipy.optimize import minimize
    from scipy.special import betaln, psi

    (x, n), times = np.unique(np.stack((x, n)), axis=1, return_counts=True)

    def loss(at: Floats) -> tuple[float, Floats]:
        """Beta-binomial loss and its gradient at the logit of the mean and the logarithm of alpha + beta."""
        mu, size = 1 / (1 + math.exp(-at[0])), math.exp(at[1])
        a, b = mu * size, (1 - mu) * size
        value = betaln(x + a, n - x + b) - betaln(a, b)
        both = psi(a + b) - psi(n + a + b)
        by_a, by_b = psi(x + a) - psi(a) + both, psi(n - x + b) - psi(b) + both
        by_mean = (times * (by_a - by_b)).sum() * size * mu * (1 - mu)
        by_size = (times * (by_a * mu + by_b * (1 - mu))).sum() * size
        return -float((times * value).sum()), -np.array([by_mean, by_size])

    mean, icc = float((times * x).sum() / (times * n).sum()), min(max(start, 1e-3), 0.9)
    begin = np.array([math.log(mean / (1 - mean)), math.log(1 / icc - 1)])
    limits = [(begin[0] - 6.0, begin[0] + 6.0), (math.log(_LEAST_SIZE), math.log(_LARGEST_SIZE))]
    exactly = {"ftol": 1e-15, "gtol": 1e-9, "maxiter": 1000}
    found = minimize(loss, begin, jac=True, method="L-BFGS-B", bounds=limits, options=exactly)
    if found.fun >= loss(np.array([begin[0], limits[1][1]]))[0] - 1e-6:
        return None
    mu, size = 1 / (1 + math.exp(-found.x[0])), math.exp(found.x[1])
    return mu * size, (1 - mu) * size


_JEFFREYS: Final = 0.5


def chance_of_at_least(bound: float, passed: ArrayLike, judged: ArrayLike, fit: Dispersion | None) -> Floats:
    """Posterior P(p >= `bound`) of rates p (m,): p ~ Beta(alpha + x, beta + n - x).

    Args:
        passed, judged: (m,) counts, one entry a configuration.
        fit: Has alpha and beta (empirical Bayes); both are 0.5 (Jeffreys) at its limits and without a fit.
    """
    from scipy.special import betainc

    x, n = counts(passed, judged)
    alpha = fit.alpha if fit is not None and fit.alpha is not None else _JEFFREYS
    beta = fit.beta if fit is not None and fit.beta is not None else _JEFFREYS
    return np.asarray(1.0 - betainc(alpha + x, beta + n - x, bound), dtype=np.float64)
