"""Classes of configurations: those that pass reliably, fail systematically, or do either (flaky), where that is shown."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Final, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vastflow.oracles.statistics.intervals import Floats, counts

ClassName: TypeAlias = Literal["reliable", "systematic", "flaky", "undecided"]

CLAIMS: Final[tuple[ClassName, ...]] = ("systematic", "flaky", "reliable")
"""What can be claimed of a configuration, by rising success rate."""

_CANDIDATE: Final = 0.95
"""How likely a configuration at the bound is a candidate for the claim that it is beyond, at least."""


@dataclass(frozen=True, slots=True)
class ClassBounds:
    """Where the classes end, as success rates; those of the paper by default (§ on the number of runs).

    A configuration is *systematic* where its success rate p is at most `systematic`, *reliable* where it is at least `reliable`,
    and *flaky* between the two.
    """

    systematic: float = 0.2
    reliable: float = 0.8

    def __post_init__(self) -> None:
        if not 0.0 < self.systematic < self.reliable < 1.0:
            raise ValueError(f"0 < systematic < reliable < 1 must hold, got {self.systematic} and {self.reliable}")

    def of(self, p: Floats) -> NDArray[np.intp]:
        """Index in `CLAIMS` of the class of success rates `p`."""
        return np.where(p <= self.systematic, 0, np.where(p < self.reliable, 1, 2))


@dataclass(frozen=True, eq=False)
class Classes:
    """The class of each configuration, in the order they were given.

    Attributes:
        names: (m,) what is claimed of it; `undecided` where its runs show nothing at the stated error.
        p_values: (m,) of the claim that is nearest to being made; NaN where they do not apply.
        adjusted: (m,) the same, for all configurations that might have the class; the claim is made where it is at most `error`.
        error: The rate of errors that is controlled.
        controls: A sentence that says which errors these are.
    """

    names: tuple[ClassName, ...] = field(repr=False)
    p_values: Floats = field(repr=False)
    adjusted: Floats = field(repr=False)
    error: float
    controls: str

    def count(self, name: ClassName) -> int:
        """How many configurations have a class."""
        return self.names.count(name)


@dataclass(frozen=True, slots=True)
class TotalFailures:
    """Failures of configurations all of whose judged runs fail (the paper: total-failure variants).

    Attributes:
        configurations: How many there are.
        failures: Their failed runs.
        of_failures: Failed runs of all configurations.
    """

    configurations: int
    failures: int
    of_failures: int

    @property
    def share(self) -> float | None:
        """Share of all failures; None where nothing failed."""
        return self.failures / self.of_failures if self.of_failures else None


def classify(passed: ArrayLike, judged: ArrayLike, bounds: ClassBounds | None = None, error: float = 0.05) -> Classes:
    """Classify configurations by exact binomial tests, with the false discovery rate of each class controlled.

    With X of n runs passed: *systematic* is claimed by rejecting that p > systematic, p-value P(X <= x | p = systematic); *reliable*
    by rejecting p < reliable, P(X >= x | p = reliable); *flaky* by rejecting both p <= systematic and p >= reliable, the
    larger of P(X >= x | systematic) and P(X <= x | reliable) (intersection-union test, Berger 1982).

    Each claim is a family of tests of its own, so that a reader of the list of systematic configurations knows of that list that a share of
    `error` is wrong at most, in expectation (Benjamini and Hochberg, JRSS B 57 (1995) 289). Adjusted together, clear cases of one class
    would pay for doubtful ones of another: of those called systematic most can be wrong then. Configurations far on the other side of a bound
    can't be wrong claims and should not count as tests: a count that is beyond the
    95 % quantile of the bound leaves the family, and the others' p-values are divided by the probability of not being so at the bound,
    which keeps them p-values, binomial tails being uniformly conservative (Zhao, Small and Su, JASA 114 (2019) 1291; Ellis, Pecanka and
    Goeman, Biostatistics 21 (2020) e65).

    Configurations with so few judged runs that no outcome could show the class are left out of its family too (Tarone, Biometrics 46
    (1990) 515). The number of runs must not depend on their outcome; see `classes_by` for sequential stopping.

    Args:
        passed, judged: (m,) counts, one entry a configuration.
    """
    bounds = bounds or ClassBounds()
    x, n = counts(passed, judged)
    claims = _p_values(x, n, bounds)
    nearest = claims.argmin(axis=0)
    least = runs_for_a_claim(bounds, error)
    able = np.stack([n >= least[claim] for claim in CLAIMS])
    adjusted = np.stack([_adjusted(given) for given in np.where(able, _given(x, n, bounds), np.inf)])
    of_nearest = np.take_along_axis(adjusted, nearest[None, :], axis=0)[0]
    names: tuple[ClassName, ...] = tuple(
        CLAIMS[k] if q <= error else "undecided" for k, q in zip(nearest, of_nearest, strict=True)
    )
    controls = (
        f"of the configurations that are called reliable, at most {100 * error:g} % are called so wrongly, in expectation; likewise "
        "of those called systematic, and of those called flaky (exact binomial tests, Benjamini-Hochberg)"
    )
    return Classes(names, np.where(n > 0, claims.min(axis=0), 1.0), of_nearest, error, controls)


def runs_for_a_claim(bounds: ClassBounds | None = None, error: float = 0.05) -> dict[ClassName, int]:
    """The least number of judged runs with which each class can be shown, of a configuration alone.

    At the default bounds and 5 %, 14 that all pass or all fail for *reliable* and *systematic*, and 10 for *flaky*.

    Raises:
        ValueError: a class can't be shown with 10,000 runs.
    """
    return dict(_least_runs(bounds or ClassBounds(), error))


def passes_that_show(
    runs: int, bounds: ClassBounds | None = None, error: float = 0.05
) -> dict[ClassName, tuple[int, int]]:
    """Least and most passes of `runs` judged runs that show each class of a configuration alone; what can't be shown is left out."""
    names = [classify([x], [runs], bounds, error).names[0] for x in range(runs + 1)]
    shown = {name: [x for x, called in enumerate(names) if called == name] for name in CLAIMS}
    return {name: (passes[0], passes[-1]) for name, passes in shown.items() if passes}


@cache
def _least_runs(bounds: ClassBounds, error: float) -> Mapping[ClassName, int]:
    found: dict[ClassName, int] = {}
    for n in range(1, 10_001):
        x = np.arange(n + 1.0)
        for claim, p_values in zip(CLAIMS, _given(x, np.full(n + 1, float(n)), bounds), strict=True):
            if p_values.min() <= error:
                found.setdefault(claim, n)
        if len(found) == len(CLAIMS):
            return found
    raise ValueError(f"with 10,000 runs no claim but {', '.join(found) or 'none'} is possible at an error of {error}")


def total_failures(passed: ArrayLike, judged: ArrayLike) -> TotalFailures:
    """The share of failures that comes from configurations which never pass, as the paper states it (its § Dataset Analysis)."""
    x, n = counts(passed, judged)
    total = (n > 0) & (x == 0)
    return TotalFailures(int(total.sum()), int(n[total].sum()), int((n - x).sum()))


def shares(names: Sequence[ClassName]) -> dict[ClassName, int]:
    """How many configurations each class has, all classes named."""
    return {name: names.count(name) for name in (*CLAIMS, "undecided")}


@dataclass(frozen=True, eq=False)
class _Tail:
    """Of one bound: p-values (m,), and the largest that a candidate may have, which is how likely a candidate is there."""

    p_values: Floats
    candidates: Floats

    def given(self) -> Floats:
        """The p-values (m,), given that it is a candidate; infinite where it is none."""
        return np.where(self.p_values <= self.candidates, self.p_values / self.candidates, np.inf)


def _adjusted(given: Floats) -> Floats:
    """(m,) p-values of one claim, adjusted; 1 for those that are no candidates."""
    from scipy.stats import false_discovery_control

    adjusted, chosen = np.ones_like(given), np.isfinite(given)
    adjusted[chosen] = false_discovery_control(given[chosen])
    return adjusted


def _given(x: Floats, n: Floats, bounds: ClassBounds) -> Floats:
    """(3, m) p-values of `CLAIMS` among their candidates."""
    return np.stack([np.max([tail.given() for tail in tails], axis=0) for tails in _tails(x, n, bounds)])


def _p_values(x: Floats, n: Floats, bounds: ClassBounds) -> Floats:
    """(3, m) p-values of `CLAIMS`."""
    return np.stack([np.max([tail.p_values for tail in tails], axis=0) for tails in _tails(x, n, bounds)])


def _tails(x: Floats, n: Floats, bounds: ClassBounds) -> tuple[tuple[_Tail, ...], ...]:
    """The bounds that each of `CLAIMS` has to reject."""
    s, r = bounds.systematic, bounds.reliable
    above_s, below_r = _at_most(n - x, n, 1 - s), _at_most(x, n, r)
    return (_at_most(x, n, s),), (above_s, below_r), (_at_most(n - x, n, 1 - r),)


def _at_most(x: Floats, n: Floats, p: float) -> _Tail:
    """Of P(X <= x | p); candidates are counts up to the quantile `_CANDIDATE`."""
    from scipy.stats import binom

    return _Tail(binom.cdf(x, n, p), binom.cdf(binom.ppf(_CANDIDATE, n, p), n, p))
