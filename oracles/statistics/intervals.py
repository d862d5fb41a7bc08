"""Rates, and confidence intervals of them, of clustered runs, and of the mean of a bounded quantity."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from statistics import NormalDist
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vastflow.oracles.judgment.verdict import Judgment

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
        """The ends rounded outwards to 0.1 %; rounding them outwards once more agrees with rounding once."""
        low, high = thousandths(np.array((self.low, self.high))).tolist()
        return low, high


def thousandths(ends: Floats) -> NDArray[np.int64]:
    """`Interval.thousandths` of many intervals (*S, 2), rounding errors of floating point left out."""
    exact = np.round(1000.0 * ends, 6)
    return np.stack((np.floor(exact[..., 0]), np.ceil(exact[..., 1])), axis=-1).astype(np.int64)


def wilson_intervals(passed: ArrayLike, judged: ArrayLike, level: float = LEVEL) -> Floats:
    """Wilson's score intervals (*S, 2) of binomial proportions (E. B. Wilson, JASA 22 (1927) 209); 0..1 at n = 0.

    Args:
        passed, judged: 0 <= passed <= judged (else a `ValueError`), of shapes that broadcast to S; fractions are effective sample sizes.
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
    """Clopper and Pearson's exact intervals (*S, 2) of binomial proportions (Biometrika 26 (1934) 404); 0..1 at n = 0.

    Args:
        passed, judged: 0 <= passed <= judged (else a `ValueError`), of shapes that broadcast to S.
    """
    from scipy.special import betaincinv

    x, n = counts(passed, judged)
    tail = (1 - level) / 2
    some, missed = x > 0, x < n
    low = np.where(some, betaincinv(np.where(some, x, 1.0), n - x + 1, tail), 0.0)
    high = np.where(missed, betaincinv(x + 1, np.where(missed, n - x, 1.0), 1 - tail), 1.0)
    return np.stack((low, high), axis=-1)


def few_clusters(clusters: ArrayLike, level: float = LEVEL) -> Floats:
    """Return (z/t)² with m - 1 degrees of freedom, the worth of a variance from m `clusters`."""
    from scipy.special import stdtrit

    freedom = np.maximum(np.asarray(clusters, dtype=np.float64) - 1.0, 1.0)
    return np.asarray((normal_quantile(level) / stdtrit(freedom, (1 + level) / 2)) ** 2)


def interval(ends: Floats) -> Interval:
    return Interval(float(ends[0]), float(ends[1]))


def counts(passed: ArrayLike, judged: ArrayLike) -> tuple[Floats, Floats]:
    """Passes and judged runs as floats of one shape.

    Raises:
        ValueError: more passes than judged runs, or negative counts.
    """
    x, n = np.broadcast_arrays(np.asarray(passed, dtype=np.float64), np.asarray(judged, dtype=np.float64))
    wrong = ~((x >= 0) & (x <= n))
    if wrong.any():
        at = int(np.argmax(wrong))
        raise ValueError(f"passed must be in 0..n, got {x.flat[at]:g} of {n.flat[at]:g}")
    return x, n


def normal_quantile(level: float) -> float:
    """Half the width, in standard deviations, of a two-sided interval of confidence `level`."""
    return NormalDist().inv_cdf((1 + level) / 2)


_INDEPENDENT: Final = 0.2
_ALIKE: Final = 0.1
"""Prior weights of the two limits: runs independent of their cluster, and clusters whose runs all agree."""
_NODES: Final = 14
_FEWEST: Final = 6
_ZOOMS: Final = 5
_LOG_NEGLIGIBLE: Final = 9.0
_STEPS: Final = 161
_FAR: Final = 24.0


def clustered_interval(
    passed: ArrayLike, judged: ArrayLike, level: float = LEVEL, blocks: ArrayLike | None = None
) -> Interval | None:
    """Interval of the rate among configurations like these, which are themselves a sample (clusters).

    Clusters are beta-binomial (Skellam, JRSS B 10 (1948) 257). Few of them say little about the intraclass correlation, so it is averaged
    over, with a prior like 1/√c. The ends are quantiles of the rate's posterior, with priors 1/p (lower) and 1/(1 - p) (upper), or
    those of Student's t interval of the clusters' rates where they are farther out, as with rates that no beta distribution has. The interval is never narrower than Clopper and Pearson's of all runs, nor wider than theirs of clusters. Its coverage and width are in
    `docs/studies/clustered_coverage.py` and docs/statistics.md.

    Args:
        passed, judged: (m,), one entry a configuration; passes may be fractions.
        blocks: (m,) equal numbers for configurations of one block (see `Units`), which are the clusters where there are several.

    Returns:
        None for fewer than two configurations with judged runs.
    """
    x, n = counts(passed, judged)
    of = None if blocks is None else np.asarray(blocks)[n > 0]
    x, n = x[n > 0], n[n > 0]
    if of is not None and len(found := np.unique(of, return_inverse=True)[1]) and found.max() > 0:
        x, n = (np.bincount(found, weights=each).astype(np.float64) for each in (x, n))
    m, total, all_passed = len(n), float(n.sum()), float(x.sum())
    if m < 2:
        return None
    of_runs, of_clusters = clopper_pearson_intervals([all_passed, min(float((x / n).sum()), m)], [total, m], level)
    low, high = of_clusters
    if 0.0 < all_passed < total:
        posterior, rates = _posterior(x, n, level), x / n
        half = normal_quantile(level) * float(rates.std(ddof=1) / np.sqrt(m * few_clusters(m, level)))
        low, high = max(low, min(posterior[0], rates.mean() - half)), min(high, max(posterior[1], rates.mean() + half))
    return Interval(float(min(low, of_runs[0])), float(max(high, of_runs[1])))


def _posterior(x: Floats, n: Floats, level: float) -> tuple[float, float]:
    total, all_passed = n.sum(), x.sum()
    center = np.log(all_passed / (total - all_passed))
    narrow = np.sqrt(total / (all_passed * (total - all_passed)))
    # Logits, close together where independent runs would have the rate, and far out enough for clusters that agree.
    steps = np.linspace(-1.0, 1.0, _STEPS) * np.arcsinh(_FAR / narrow)
    logit, apart = center + narrow * np.sinh(steps), np.cosh(steps)
    p, q = 1 / (1 + np.exp(-logit)), 1 / (1 + np.exp(logit))
    likelihood = _likelihood(x, n, p, q)
    tail = (1 - level) / 2
    # The prior of a logit is p(1 - p) times that of the rate.
    return (_quantile(likelihood * q * apart, logit, tail), _quantile(likelihood * p * apart, logit, 1 - tail))


def _likelihood(x: Floats, n: Floats, p: Floats, q: Floats) -> Floats:
    """Likelihood of each rate `p` = 1 - `q`, averaged over correlations; the maximum is close to 1."""
    kinds, times = np.unique(np.stack((x, n - x)), axis=1, return_counts=True)
    log_p, log_q = np.log(p), np.log(q)
    independent = x.sum() * log_p + (n - x).sum() * log_q + np.log(_INDEPENDENT)
    agree = ((x == 0) | (x == n)).all()
    alike = (x > 0).sum() * log_p + (x == 0).sum() * log_q + np.log(_ALIKE) if agree else np.full_like(p, -np.inf)
    # Between the limits the correlation is the squared sine of an angle. With many clusters few angles matter, so zoom in on these.
    low, high = 0.0, np.pi / 2
    for _ in range(_ZOOMS):
        angles, step = np.linspace(low, high, _NODES, endpoint=False, retstep=True)
        angles += step / 2
        weights = np.cos(angles) * step * (1 - _INDEPENDENT - _ALIKE)
        between = _beta_binomial(kinds, times, np.sin(angles) ** 2, p, q) + np.log(weights)[:, None]
        found = np.flatnonzero(between.max(axis=1) > between.max() - _LOG_NEGLIGIBLE)
        if len(found) >= _FEWEST:
            break
        low, high = max(angles[found[0]] - step, 0.0), min(angles[found[-1]] + step, np.pi / 2)
    log = np.concatenate(([independent, alike], between))
    likelihood: Floats = np.exp(log - log.max()).sum(axis=0)
    return likelihood


def _beta_binomial(kinds: Floats, times: NDArray[np.int64], correlations: Floats, p: Floats, q: Floats) -> Floats:
    """Log likelihood (correlations, rates); `kinds` (2, K) are passes and failures of clusters that occur `times` times."""
    from scipy.special import betaln

    found = np.empty((len(correlations), len(p)))
    for k, size in enumerate((1 - correlations) / correlations):
        a, b = size * p, size * q
        found[k] = times @ (betaln(kinds[0][:, None] + a, kinds[1][:, None] + b) - betaln(a, b))
    return found


def _quantile(density: Floats, logit: Floats, share: float) -> float:
    """Rate at which the cumulative density, given at equal steps, reaches `share`."""
    below = np.concatenate(([0.0], np.cumsum((density[1:] + density[:-1]) / 2)))
    return float(1 / (1 + np.exp(-np.interp(share, below / below[-1], logit))))


_BET_STEPS: Final = 768
_EXACT: Final = 1e-9
_LOG_U: Final = np.linspace(-18.0, 10.0, _BET_STEPS)
"""Range of the integrand, in units of the whole deviation."""
_U: Final = np.exp(_LOG_U)


def mean_interval(values: ArrayLike, level: float = LEVEL) -> tuple[float, float]:
    """Interval of the mean of a quantity within -1..1, from independent `values`.

    The lower end is Gaffke's: the (1 - level)/2 quantile of Σ w_i x_i - w_0, where the weights w are Dirichlet with all parameters 1
    (Gaffke, Mathematical Methods of Statistics 14 (2005) 451; Learned-Miller and Thomas, "A new confidence interval for the mean of a bounded
    random variable", 2019); the upper end likewise. For values of -1 and 1 it is Clopper and Pearson's. That it holds its level for
    every distribution is conjectured, and no counterexample is known.

    Raises:
        ValueError: a value beyond -1..1, or no value.
    """
    x = np.asarray(values, dtype=np.float64)
    if not len(x) or not (np.abs(x) <= 1.0 + 1e-12).all():
        raise ValueError(f"expected values within -1..1, got {x.tolist()[:5]}")
    tail = (1 - level) / 2
    return _lower(x, tail), -_lower(-x, tail)


def needed(margin: float, level: float = LEVEL) -> int | None:
    """Number of values, all 0, that rule out a mean of -`margin`; None where no number does."""
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
    """Probability that the weighted mean is below `mean`, by Imhof's inversion (Biometrika 48 (1961) 419).

    It is that of Σ E_i (x_i - mean) < 0 with exponential E_i: 1/2 + 1/pi ∫ sin(θ)/(uρ) du, θ = Σ arctan(a u), ρ = Π sqrt(1 + a²u²).
    """
    a = at - mean
    scaled = np.multiply.outer(a / math.sqrt(float((times * a * a).sum())), _U)
    angle, size = times @ np.arctan(scaled), 0.5 * (times @ np.log1p(scaled * scaled))
    return 0.5 - float(np.trapezoid(np.sin(angle) * np.exp(-size), _LOG_U)) / math.pi


@dataclass(frozen=True, slots=True)
class Counts:
    """Numbers of judgments; rates exclude unjudged runs."""

    passed: int = 0
    failed: int = 0
    not_judged: int = 0

    @property
    def judged(self) -> int:
        return self.passed + self.failed

    @property
    def rate(self) -> float | None:
        """Share of passes among the judged; None where nothing was judged."""
        return self.passed / self.judged if self.judged else None

    @property
    def interval(self) -> Interval:
        """Wilson interval of the rate, for runs of these same configurations."""
        return wilson(self.passed, self.judged)


def counts_of(judgments: Iterable[Judgment]) -> Counts:
    said = list(judgments)
    return Counts(said.count("pass"), said.count("fail"), said.count("not judged"))


def pooled(clusters: Iterable[Counts]) -> Counts:
    clusters = list(clusters)
    return Counts(sum(c.passed for c in clusters), sum(c.failed for c in clusters), sum(c.not_judged for c in clusters))


def wilson(passed: float, n: float, level: float = LEVEL) -> Interval:
    """Wilson's score interval of one proportion, see `wilson_intervals`."""
    return interval(wilson_intervals(passed, n, level))


def clustered(
    configurations: Sequence[Counts], level: float = LEVEL, blocks: Sequence[int] | None = None
) -> Interval | None:
    """Interval for other configurations like these, see `clustered_interval`."""
    return clustered_interval([c.passed for c in configurations], [c.judged for c in configurations], level, blocks)
