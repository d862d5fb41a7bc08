"""Classes of configurations: those that pass reliably, fail systematically, or do either (flaky), where that is shown."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vastflow.oracles.statistics.intervals import Floats, counts

ClassName: TypeAlias = Literal["reliable", "systematic", "flaky", "undecided"]

CLAIMS: Final[tuple[ClassName, ...]] = ("systematic", "flaky", "reliable")
"""What can be claimed of a configuration, by rising success rate."""


@dataclass(frozen=True, slots=True)
class Bounds:
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
        adjusted: (m,) the same, for all configurations together; a claim is made where it is at most `error`.
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


def classify(passed: ArrayLike, judged: ArrayLike, bounds: Bounds | None = None, error: float = 0.05) -> Classes:
    """Classify configurations by exact binomial tests, with the false discovery rate of all claims controlled.

    With X of n runs passed: *systematic* is claimed by rejecting that p > systematic, p-value P(X <= x | p = systematic); *reliable*
    by rejecting p < reliable, P(X >= x | p = reliable); *flaky* by rejecting both p <= systematic and p >= reliable, the
    larger of P(X >= x | systematic) and P(X <= x | reliable) (intersection-union test, Berger 1982). Of the three the claim with
    the smallest p-value is the one that may be made; whatever the true class, each of the wrong claims has to reject the nearer
    bound, so it is made at level a with probability a at most (plus that of the far claim, below 1e-6 from 14 runs on).

    Over configurations these p-values are adjusted by Benjamini and Hochberg (JRSS B 57 (1995) 289): of the claims made, a share of
    `error` is wrong at most, in expectation, a wrong class counting as wrong in either direction (Benjamini and Yekutieli,
    JASA 100 (2005) 71). Configurations with so few judged runs that no outcome could show anything are left out of the
    adjustment (Tarone, Biometrics 46 (1990) 515) and are undecided.

    The number of runs must not depend on their outcome; see `classes_by` for sequential stopping.

    Args:
        passed, judged: (m,) counts, one entry a configuration.
    """
    bounds = bounds or Bounds()
    x, n = counts(passed, judged)
    claims = _p_values(x, n, bounds)
    nearest = claims.argmin(axis=0)
    p_values = np.where(n > 0, claims.min(axis=0), 1.0)
    adjusted = np.ones_like(p_values)
    able = n >= min(runs_for_a_claim(bounds, error).values())
    if able.any():
        adjusted[able] = benjamini_hochberg(p_values[able])
    names: tuple[ClassName, ...] = tuple(
        CLAIMS[k] if q <= error else "undecided" for k, q in zip(nearest, adjusted, strict=True)
    )
    controls = (
        f"of the configurations that are called reliable, systematic or flaky, at most {100 * error:g} % are called so "
        "wrongly, in expectation (exact binomial tests, Benjamini-Hochberg)"
    )
    return Classes(names, p_values, adjusted, error, controls)


def runs_for_a_claim(bounds: Bounds | None = None, error: float = 0.05) -> dict[ClassName, int]:
    """The least number of judged runs with which each class can be shown, without any adjustment.

    At the default bounds and 5 %, 14 that all pass or all fail for *reliable* and *systematic*, and 10 for *flaky*.

    Raises:
        ValueError: a class can't be shown with 10,000 runs.
    """
    bounds = bounds or Bounds()
    found: dict[ClassName, int] = {}
    for n in range(1, 10_001):
        x = np.arange(n + 1.0)
        for claim, p_values in zip(CLAIMS, _p_values(x, np.full(n + 1, float(n)), bounds), strict=True):
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


def benjamini_hochberg(p_values: Floats) -> Floats:
    """p-values adjusted by Benjamini and Hochberg, of the shape they have; none of none."""
    from scipy.stats import false_discovery_control

    if not p_values.size:
        return p_values
    adjusted: Floats = false_discovery_control(p_values.ravel()).reshape(p_values.shape)
    return adjusted


def _p_values(x: Floats, n: Floats, bounds: Bounds) -> Floats:
    """(3, m) p-values of `CLAIMS`."""
    from scipy.special import bdtr, bdtrc

    def at_most(p: float) -> Floats:
        return np.asarray(bdtr(x, n.astype(np.int64), p), dtype=np.float64)

    def at_least(p: float) -> Floats:
        return np.where(x > 0, bdtrc(np.maximum(x - 1, 0), n.astype(np.int64), p), 1.0)

    flaky = np.maximum(at_least(bounds.systematic), at_most(bounds.reliable))
    return np.stack((at_most(bounds.systematic), flaky, at_least(bounds.reliable)))
