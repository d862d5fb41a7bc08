"""The Gaussian process of strategies that expect something of points that were not run, over the unit cube."""

import itertools
from typing import Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_VARIANCE: Final = 0.25
"""Prior variance: the standard deviation 1/2 is the range of a rate round its middle."""
_JITTER: Final = 1e-6
_SCALES: Final = (0.15, 0.3, 0.6, 1.2, 2.4)
_NOISES: Final = (0.001, 0.01, 0.1)
"""Correlation lengths, the same along all dimensions, and variances of a value beside that of all, of which the likeliest are taken."""


def promise(units: Floats, gains: Floats, at: Floats) -> Floats:
    """Return the upper confidence bound (m,) at (m, d) coordinates: mean plus standard deviation.

    The upper confidence bound of N. Srinivas et al., ICML 2010, 1015.

    Args:
        units: (n, d) coordinates.
        gains: (n,) what was found there, more is better.
    """
    n, d = units.shape
    values = (gains - gains.mean()) * (np.sqrt(_VARIANCE) / (gains.std() or 1.0))
    tried = [(np.full(n, _VARIANCE * noise), np.full(d, scale)) for noise, scale in itertools.product(_NOISES, _SCALES)]
    likeliest = max(tried, key=lambda each: likelihood(units, values, *each))
    mean, deviation = predicted(units, values, *likeliest, at)
    return mean + deviation


def likelihood(units: Floats, values: Floats, variances: Floats, scales: Floats) -> float:
    """The log marginal likelihood of the values, up to a constant.

    Args:
        units: (n, d) coordinates.
        values: (n,) what was found there, less what is expected where nothing is known.
        variances: (n,) of what was found.
        scales: (d,) correlation lengths.
    """
    factor = _factor(units, variances, scales)
    white = np.linalg.solve(factor, values)
    return float(-0.5 * white @ white - np.log(np.diag(factor)).sum())


def predicted(units: Floats, values: Floats, variances: Floats, scales: Floats, at: Floats) -> tuple[Floats, Floats]:
    """Return mean and standard deviation at (m, d) coordinates; for the other arguments see `likelihood`."""
    factor = _factor(units, variances, scales)
    cross = np.linalg.solve(factor, _kernel(units, at, scales))
    mean = cross.T @ np.linalg.solve(factor, values)
    return mean, np.sqrt(np.maximum(_VARIANCE - (cross**2).sum(axis=0), 0.0))


def _kernel(left: Floats, right: Floats, scales: Floats) -> Floats:
    """Matérn's covariance with ν = 5/2."""
    from scipy.spatial.distance import cdist

    distance = np.sqrt(5.0) * cdist(left / scales, right / scales)
    kernel: Floats = _VARIANCE * (1 + distance + distance**2 / 3) * np.exp(-distance)
    return kernel


def _factor(units: Floats, variances: Floats, scales: Floats) -> Floats:
    factor: Floats = np.asarray(
        np.linalg.cholesky(_kernel(units, units, scales) + np.diag(variances + _JITTER)), np.float64
    )
    return factor
