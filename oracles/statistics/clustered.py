"""The rate of others: an interval over configurations that are themselves a sample."""

from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vastflow.oracles.statistics.intervals import LEVEL, Floats, Interval, clopper_pearson_intervals, counts

_INDEPENDENT: Final = 0.2
_ALIKE: Final = 0.1
"""Prior weight of the two limits: runs do not depend on their cluster, and all runs of a cluster agree."""
_NODES: Final = 14
_FEWEST: Final = 6
_ZOOMS: Final = 5
_LOG_NEGLIGIBLE: Final = 9.0
_STEPS: Final = 161
_FAR: Final = 24.0


def clustered_interval(
    passed: ArrayLike, judged: ArrayLike, level: float = LEVEL, blocks: ArrayLike | None = None
) -> Interval | None:
    """Interval of the rate among configurations *like* these, which are themselves a sample (clusters).

    Runs of one configuration resemble each other, so pooled runs tell less of other configurations than as many independent ones. How
    much less is the intraclass correlation, of which few clusters, or few failures, say next to nothing: an estimate of it makes
    intervals that miss high rates. So it is not estimated but averaged over: clusters are beta-binomial (Skellam, JRSS B 10 (1948) 257), and
    the ends are quantiles of the rate's posterior, of which the prior is 1/p for the lower end and 1/(1 - p) for the upper one,
    as that of Clopper and Pearson's is; that of a correlation c between 0 and 1 is like 1/√c. Of independent runs the interval is thus theirs of all runs, of clusters that agree in themselves
    theirs of clusters, and between the two otherwise; it is never wider than the latter nor narrower than the former. Where all runs
    agree each cluster counts once.

    Its coverage and width are in `tests/proofs/clustered_coverage.py` and docs/statistics.md.

    Configurations of one block share what makes them hard (a path under twenty settings, see `blocks_of`), so that blocks are the
    clusters where there are several; where there is one, its configurations are, and others are others of that block.

    None for fewer than two configurations with judged runs: one says nothing of others.

    Args:
        passed, judged: (m,), one entry a configuration; passes need not be whole numbers.
        blocks: (m,) equal numbers for configurations of one block; by default each is its own.
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
        posterior = _posterior(x, n, level)
        low, high = max(low, posterior[0]), min(high, posterior[1])
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
    return (
        _quantile(likelihood * q * apart, logit, tail),
        _quantile(likelihood * p * apart, logit, 1 - tail),
    )


def _likelihood(x: Floats, n: Floats, p: Floats, q: Floats) -> Floats:
    """Of each rate `p` = 1 - `q`, averaged over correlations; the greatest is about 1."""
    kinds, times = np.unique(np.stack((x, n - x)), axis=1, return_counts=True)
    log_p, log_q = np.log(p), np.log(q)
    independent = x.sum() * log_p + (n - x).sum() * log_q + np.log(_INDEPENDENT)
    agree = ((x == 0) | (x == n)).all()
    alike = (x > 0).sum() * log_p + (x == 0).sum() * log_q + np.log(_ALIKE) if agree else np.full_like(p, -np.inf)
    # Between the limits the correlation is the squared sine of an angle. Many clusters tell it well: of a first look over all angles
    # only a few matter, and a closer one follows there.
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
    """Log likelihood (correlations, rates) of clusters; `kinds` (2, K) are passes and failures, of which each stands for `times` clusters."""
    from scipy.special import betaln

    found = np.empty((len(correlations), len(p)))
    for k, size in enumerate((1 - correlations) / correlations):
        a, b = size * p, size * q
        found[k] = times @ (betaln(kinds[0][:, None] + a, kinds[1][:, None] + b) - betaln(a, b))
    return found


def _quantile(density: Floats, logit: Floats, share: float) -> float:
    """The rate below which a `share` lies of a density given at steps of equal width."""
    below = np.concatenate(([0.0], np.cumsum((density[1:] + density[:-1]) / 2)))
    return float(1 / (1 + np.exp(-np.interp(share, below / below[-1], logit))))
