"""Mean of a bounded quantity: bounds that hold although what has not been seen may be the worst."""

import math
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vastflow.oracles.statistics.intervals import LEVEL, Floats

_STEPS: Final = 768
_EXACT: Final = 1e-9
_LOG_U: Final = np.linspace(-18.0, 10.0, _STEPS)
"""From where the integrand still grows to where it has died, in units of the whole's deviation."""
_U: Final = np.exp(_LOG_U)


def mean_interval(values: ArrayLike, level: float = LEVEL) -> tuple[float, float]:
    """Interval of the mean of a quantity within -1..1, of which independent `values` were drawn.

    Its lower end is Gaffke's: the (1 - level)/2 quantile of Σ w_i x_i + w_0 · (-1), where the weights w are distributed like the gaps
    between uniform numbers (Dirichlet with all parameters 1), so that what was not seen is taken for the worst there can be (Gaffke,
    "Three test statistics for a nonparametric one-sided hypothesis on the mean of a nonnegative variable", Mathematical Methods of
    Statistics 14 (2005) 451; Learned-Miller and Thomas, "A new confidence interval for the mean of a bounded random variable", 2019).
    Of values -1 and 1 alone it is Clopper and Pearson's, and of zeros alone -1 + alpha^(1/n): a loss that hits one of n, wholly,
    is not overlooked. That it holds its level for every distribution is conjectured, and no counterexample is known. The upper end is
    likewise.

    Raises:
        ValueError: a value beyond -1..1, or none at all.
    """
    x = np.asarray(values, dtype=np.float64)
    if not len(x) or not (np.abs(x) <= 1.0 + 1e-12).all():
        raise ValueError(f"a mean needs values within -1..1, got {x.tolist()[:5]}")
    tail = (1 - level) / 2
    return _lower(x, tail), -_lower(-x, tail)


def needed(margin: float, level: float = LEVEL) -> int | None:
    """How many values rule out a mean of -`margin`, if each of them is 0; None where no number does.

    One of them may be -1 with a probability of `margin`, and n of them show none with (1 - margin)^n.
    """
    if margin <= 0.0:
        return None
    if margin >= 1.0:
        return 1
    return math.floor(math.log((1 - level) / 2) / math.log1p(-margin)) + 1


def _lower(values: Floats, tail: float) -> float:
    """The `tail` quantile of the mean of `values` and -1 under Dirichlet weights."""
    from scipy.optimize import brentq

    at, times = np.unique(np.append(values, -1.0), return_counts=True)
    if at[-1] - at[0] < 1e-6:
        return float(at[0])
    n = int(times.sum())
    center = float(times @ at) / n
    deviation = math.sqrt(float(times @ (at - center) ** 2) / (n * (n + 1)))
    # Cantelli: no quantile is farther off, and farther off the integrand below swings too fast.
    low = max(center - deviation * math.sqrt((1 - tail) / tail), float(at[0]) + _EXACT)
    high = min(center + deviation * math.sqrt(tail / (1 - tail)), float(at[-1]) - _EXACT)
    return float(brentq(lambda mean: _below(mean, at, times) - tail, low, high, xtol=_EXACT))


def _below(mean: float, at: Floats, times: NDArray[np.int64]) -> float:
    """Probability that the weighted mean is below `mean`.

    Weights are exponential variables over their sum, so it is that of Σ E_i (x_i - mean) < 0, by Imhof's inversion of the characteristic
    function (Biometrika 48 (1961) 419): 1/2 + 1/pi ∫ sin(θ)/(uρ) du, with θ = Σ arctan(a u) and ρ = Π sqrt(1 + a²u²).
    """
    a = at - mean
    scaled = np.multiply.outer(a / math.sqrt(float((times * a * a).sum())), _U)
    angle, size = times @ np.arctan(scaled), 0.5 * (times @ np.log1p(scaled * scaled))
    return 0.5 - float(np.trapezoid(np.sin(angle) * np.exp(-size), _LOG_U)) / math.pi
