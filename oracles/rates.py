"""Success rates and how sure they are."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from statistics import NormalDist
from typing import Final

from vastflow.oracles.verdict import Judgement

LEVEL: Final = 0.95
"""Confidence of every interval of the report."""


@dataclass(frozen=True, slots=True)
class Interval:
    """A confidence interval of a rate, within [0, 1]."""

    low: float
    high: float


@dataclass(frozen=True, slots=True)
class Counts:
    """How often a judgement was made. What was not judged is in no rate."""

    passed: int = 0
    failed: int = 0
    not_judged: int = 0

    @property
    def judged(self) -> int:
        """n of the rate."""
        return self.passed + self.failed

    @property
    def rate(self) -> float | None:
        """Share of passes among the judged; None where nothing was judged."""
        return self.passed / self.judged if self.judged else None

    @property
    def interval(self) -> Interval:
        """Wilson interval of the rate, as if each run were drawn anew from these same configurations."""
        return wilson(self.passed, self.judged)


def counts_of(judgements: Iterable[Judgement]) -> Counts:
    """Count `judgements`."""
    said = list(judgements)
    return Counts(said.count("pass"), said.count("fail"), said.count("not judged"))


def pooled(clusters: Iterable[Counts]) -> Counts:
    """The sum of `clusters`."""
    clusters = list(clusters)
    return Counts(sum(c.passed for c in clusters), sum(c.failed for c in clusters), sum(c.not_judged for c in clusters))


def wilson(passed: float, n: float, level: float = LEVEL) -> Interval:
    """Wilson's score interval of a binomial proportion (E. B. Wilson, JASA 22 (1927) 209).

    With p = passed / n and z the (1 + level) / 2 quantile of the normal distribution:
    (p + z²/2n ± z sqrt(p(1 - p)/n + z²/4n²)) / (1 + z²/n). Nothing is known at n = 0: 0..1.

    Args:
        passed, n: 0 <= passed <= n; not necessarily whole, for effective sample sizes.
    """
    if not 0 <= passed <= n:
        raise ValueError(f"passed must be in 0..n, got {passed} of {n}")
    if n == 0:
        return Interval(0.0, 1.0)
    z = NormalDist().inv_cdf((1 + level) / 2)
    p = passed / n
    centre = p + z * z / (2 * n)
    half = z * math.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    scale = 1 + z * z / n
    # At p = 0 and p = 1 one end is exact; rounding must not push it inside or outside.
    low = 0.0 if passed == 0 else (centre - half) / scale
    high = 1.0 if passed == n else (centre + half) / scale
    return Interval(low, high)


def clustered(clusters: Sequence[Counts], level: float = LEVEL) -> Interval | None:
    """Interval of the rate among configurations *like* these, which are themselves a sample (clusters).

    Runs of one configuration resemble each other, so pooled runs tell less of other configurations than
    as many independent ones. With m configurations of n_i judged runs, x_i passes, N = Σ n_i, p = Σ x_i / N: the variance of
    the ratio estimator is V = m/(m - 1) Σ (x_i - p n_i)² / N² (Cochran, Sampling Techniques, 1977, §6.3), the effective
    sample size N p(1 - p)/N / V, at most N; Wilson's interval is taken at that size (Korn and Graubard 1998 do so
    with Clopper-Pearson). Where all runs agree V says nothing, and each configuration counts once. Simulated coverage at 95 %: 0.92
    to 0.97 for 6 to 200 configurations of 5 to 20 runs.

    None for fewer than two configurations with judged runs: one says nothing of others.
    """
    clusters = [cluster for cluster in clusters if cluster.judged]
    m, total = len(clusters), pooled(clusters)
    if m < 2:
        return None
    n, p = total.judged, total.passed / total.judged
    if total.passed in (0, n):
        return wilson(p * m, m, level)
    squares = sum((c.passed - p * c.judged) ** 2 for c in clusters)
    variance = m / (m - 1) * squares / n**2
    effective = min(n, p * (1 - p) / variance) if variance > 0 else n
    return wilson(p * effective, effective, level)
