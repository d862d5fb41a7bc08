"""Classes of configurations: reliable, systematic, or flaky, where their runs show it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Final, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vastflow.oracles.statistics.intervals import Floats, counts

ClassName: TypeAlias = Literal["reliable", "systematic", "flaky", "undecided"]

CLAIMS: Final[tuple[ClassName, ...]] = ("systematic", "flaky", "reliable")
"""Classes that can be shown, by rising success rate."""

_CANDIDATE: Final = 0.95
"""Smallest probability that a configuration at the bound is a candidate for the claim that it is beyond."""


@dataclass(frozen=True, slots=True)
class ClassBounds:
    """Bounds of the classes as success rates, by default the paper's (§ on the number of runs).

    *Systematic* up to `systematic`, *reliable* from `reliable` on, *flaky* between the two.
    """

    systematic: float = 0.2
    reliable: float = 0.8

    def __post_init__(self) -> None:
        if not 0.0 < self.systematic < self.reliable < 1.0:
            raise ValueError(f"0 < systematic < reliable < 1 must hold, got {self.systematic} and {self.reliable}")

    def of(self, p: Floats) -> NDArray[np.intp]:
        """Index in `CLAIMS` of the class of each success rate in `p`."""
        return np.where(p <= self.systematic, 0, np.where(p < self.reliable, 1, 2))


@dataclass(frozen=True, eq=False)
class Classes:
    """The class of each configuration, in the given order.

    Attributes:
        names: (m,) its class, or `undecided`.
        p_values: (m,) of the nearest claim; NaN where they do not apply.
        adjusted: (m,) for all configurations that might have the class; the claim is made where it is at most `error`.
        error: The controlled rate of errors, which the sentence `controls` describes.
    """

    names: tuple[ClassName, ...] = field(repr=False)
    p_values: Floats = field(repr=False)
    adjusted: Floats = field(repr=False)
    error: float
    controls: str

    def count(self, name: ClassName) -> int:
        return self.names.count(name)

    @property
    def counts(self) -> dict[ClassName, int]:
        """Number of configurations of every class."""
        return {name: self.count(name) for name in (*CLAIMS, "undecided")}


@dataclass(frozen=True, slots=True)
class TotalFailures:
    """Failures of configurations without a passed run (the paper's total-failure variants).

    Attributes:
        configurations: Their number.
        failures: Their failed runs.
        of_failures: Failed runs of all configurations.
    """

    configurations: int
    failures: int
    of_failures: int

    @property
    def share(self) -> float | None:
        return self.failures / self.of_failures if self.of_failures else None


def classify(passed: ArrayLike, judged: ArrayLike, bounds: ClassBounds | None = None, error: float = 0.05) -> Classes:
    """Classify configurations by exact binomial tests, controlling the false discovery rate of each class.

    *Systematic* rejects p > systematic and *reliable* p < reliable by binomial tails; *flaky* rejects both with the larger tail
    (intersection-union test, Berger 1982). Each class is a family adjusted by Benjamini and Hochberg (JRSS B 57 (1995) 289). Counts beyond the
    95 % quantile of the bound leave the family, and the other p-values are divided by the probability of staying in it (Zhao, Small and Su,
    JASA 114 (2019) 1291; Ellis, Pecanka and Goeman, Biostatistics 21 (2020) e65); so do counts of runs too small to show the class (Tarone,
    Biometrics 46 (1990) 515). The number of runs must not depend on outcomes; see `classes_by` for sequential stopping.

    Args:
        passed, judged: (m,) counts, one entry a configuration.
    """
    from scipy.stats import false_discovery_control

    bounds = bounds or ClassBounds()
    x, n = counts(passed, judged)
    claims = _tails(x, n, bounds, given=False)
    nearest = claims.argmin(axis=0)
    least = runs_for_a_claim(bounds, error)
    able = np.stack([n >= least[claim] for claim in CLAIMS])
    among_candidates = np.where(able, _tails(x, n, bounds, given=True), np.inf)
    adjusted = np.ones_like(among_candidates)
    for given, found in zip(among_candidates, adjusted, strict=True):
        found[np.isfinite(given)] = false_discovery_control(given[np.isfinite(given)])
    of_nearest = np.take_along_axis(adjusted, nearest[None, :], axis=0)[0]
    names: tuple[ClassName, ...] = tuple(
        CLAIMS[k] if q <= error else "undecided" for k, q in zip(nearest, of_nearest, strict=True)
    )
    controls = (
        f"of the configurations that are called reliable, at most {100 * error:g} % are called so wrongly, in expectation; likewise "
        "of those called systematic, and of those called flaky (exact binomial tests, Benjamini-Hochberg)"
    )
    return Classes(names, np.where(n > 0, claims.min(axis=0), 1.0), of_nearest, error, controls)


@cache
def runs_for_a_claim(bounds: ClassBounds | None = None, error: float = 0.05) -> Mapping[ClassName, int]:
    """Smallest number of judged runs that can show each class of a single configuration.

    Raises:
        ValueError: a class cannot be shown with 10,000 runs.
    """
    found: dict[ClassName, int] = {}
    for n in range(1, 10_001):
        tails = _tails(np.arange(n + 1.0), np.full(n + 1, float(n)), bounds or ClassBounds(), given=True)
        for claim, p_values in zip(CLAIMS, tails, strict=True):
            if p_values.min() <= error:
                found.setdefault(claim, n)
        if len(found) == len(CLAIMS):
            return found
    raise ValueError(f"10,000 runs can show only {', '.join(found) or 'no class'} at an error of {error}")


def passes_that_show(
    runs: int, bounds: ClassBounds | None = None, error: float = 0.05
) -> dict[ClassName, tuple[int, int]]:
    """Fewest and most passes of `runs` judged runs that show each class of a single configuration, if any do."""
    names = [classify([x], [runs], bounds, error).names[0] for x in range(runs + 1)]
    shown = {name: [x for x, called in enumerate(names) if called == name] for name in CLAIMS}
    return {name: (passes[0], passes[-1]) for name, passes in shown.items() if passes}


def total_failures(passed: ArrayLike, judged: ArrayLike) -> TotalFailures:
    """Failures of configurations that never pass, as in the paper's § Dataset Analysis."""
    x, n = counts(passed, judged)
    total = (n > 0) & (x == 0)
    return TotalFailures(int(total.sum()), int(n[total].sum()), int((n - x).sum()))


def _tails(x: Floats, n: Floats, bounds: ClassBounds, *, given: bool) -> Floats:
    """p-values (3, m) of `CLAIMS`; with `given` among their candidates, infinite for others."""
    from scipy.stats import binom

    def at_most(x: Floats, p: float) -> Floats:
        """P(X <= x | p); candidates are counts up to the quantile `_CANDIDATE`."""
        p_values = binom.cdf(x, n, p)
        candidates = binom.cdf(binom.ppf(_CANDIDATE, n, p), n, p) if given else np.ones_like(n)
        return np.where(p_values <= candidates, p_values / candidates, np.inf)

    s, r = bounds.systematic, bounds.reliable
    flaky = np.maximum(at_most(n - x, 1 - s), at_most(x, r))
    return np.stack([at_most(x, s), flaky, at_most(n - x, 1 - r)])
