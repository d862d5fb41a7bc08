"""Posterior: how likely a configuration's own success rate reaches a bound, given its runs and how configurations differ."""

from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from vastflow.oracles.statistics.dispersion import Dispersion
from vastflow.oracles.statistics.intervals import Floats, counts

_JEFFREYS: Final = 0.5


def chance_of_at_least(bound: float, passed: ArrayLike, judged: ArrayLike, fit: Dispersion | None) -> Floats:
    """(m,) P(p >= `bound`) of success rates p, posterior to x of n runs that passed: p ~ Beta(alpha + x, beta + n - x).

    Args:
        passed, judged: (m,) counts, one entry a configuration.
        fit: Has alpha and beta of the beta-binomial, which the other configurations tell (empirical Bayes). At a limit of that
            distribution, or without a fit, both are 0.5 (Jeffreys): each configuration is taken for itself.
    """
    from scipy.special import betainc

    x, n = counts(passed, judged)
    alpha = fit.alpha if fit is not None and fit.alpha is not None else _JEFFREYS
    beta = fit.beta if fit is not None and fit.beta is not None else _JEFFREYS
    return np.asarray(1.0 - betainc(alpha + x, beta + n - x, bound), dtype=np.float64)
