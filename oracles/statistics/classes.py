"""Classes of configurations: reliable, systematic, or flaky, where a fixed number of runs or a stopping rule shows it."""

from bisect import bisect_left
from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property
from typing import Final, Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vastflow.oracles.statistics.intervals import Floats, counts
from vastflow.oracles.statistics.tails import binomial_at_most, binomial_quantile, false_discovery

ClassName: TypeAlias = Literal["reliable", "systematic", "flaky", "undecided"]

CLAIMS: Final[tuple[ClassName, ...]] = ("systematic", "flaky", "reliable")
"""Classes that can be shown, by rising rate of passing."""

_CANDIDATE: Final = 0.95
"""Smallest probability that a configuration at the bound is a candidate for the claim that it is beyond."""


@dataclass(frozen=True, slots=True)
class ClassBounds:
    """Bounds of the classes as rates of passing, by default the paper's (§ on the number of runs).

    *Systematic* up to `systematic`, *reliable* from `reliable` on, *flaky* between the two.
    """

    systematic: float = 0.2
    reliable: float = 0.8

    def __post_init__(self) -> None:
        if not 0.0 < self.systematic < self.reliable < 1.0:
            raise ValueError(f"0 < systematic < reliable < 1 must hold, got {self.systematic} and {self.reliable}")

    def of(self, p: Floats) -> NDArray[np.intp]:
        """Index in `CLAIMS` of the class of each rate in `p`."""
        return np.where(p <= self.systematic, 0, np.where(p < self.reliable, 1, 2))


@dataclass(frozen=True, eq=False)
class Classes:
    """The class of each configuration, in the given order.

    Attributes:
        names: (m,) its class, or `undecided`.
        adjusted: (m,) p-values of the nearest claim, for all configurations that might have the class; it is made where they are at most
            `error`. NaN where they do not apply.
        error: The controlled rate of errors, which the sentence `controls` describes.
    """

    names: tuple[ClassName, ...] = field(repr=False)
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
    bounds = bounds or ClassBounds()
    x, n = counts(passed, judged)
    claims = _tails(x, n, bounds, given=False)
    nearest = claims.argmin(axis=0)
    least = runs_for_a_claim(bounds, error)
    able = np.stack([n >= least[claim] for claim in CLAIMS])
    among_candidates = np.where(able, _tails(x, n, bounds, given=True), np.inf)
    adjusted = np.ones_like(among_candidates)
    for given, found in zip(among_candidates, adjusted, strict=True):
        found[np.isfinite(given)] = false_discovery(given[np.isfinite(given)])
    of_nearest = np.take_along_axis(adjusted, nearest[None, :], axis=0)[0]
    names: tuple[ClassName, ...] = tuple(
        CLAIMS[k] if q <= error else "undecided" for k, q in zip(nearest, of_nearest, strict=True)
    )
    controls = (
        f"of the configurations that are called reliable, at most {100 * error:g} % are called so wrongly, in expectation; likewise "
        "of those called systematic, and of those called flaky (exact binomial tests, Benjamini-Hochberg)"
    )
    return Classes(names, of_nearest, error, controls)


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


def passes_that_show(runs: int) -> dict[ClassName, tuple[int, int]]:
    """Fewest and most passes of `runs` judged runs that show each class of a single configuration, if any do."""
    names = [classify([x], [runs]).names[0] for x in range(runs + 1)]
    shown = {name: [x for x, called in enumerate(names) if called == name] for name in CLAIMS}
    return {name: (passes[0], passes[-1]) for name, passes in shown.items() if passes}


def total_failures(passed: ArrayLike, judged: ArrayLike) -> TotalFailures:
    """Failures of configurations that never pass, as in the paper's § Dataset Analysis."""
    x, n = counts(passed, judged)
    total = (n > 0) & (x == 0)
    return TotalFailures(int(total.sum()), int(n[total].sum()), int((n - x).sum()))


def _tails(x: Floats, n: Floats, bounds: ClassBounds, *, given: bool) -> Floats:
    """p-values (3, m) of `CLAIMS`; with `given` among their candidates, infinite for others."""

    def at_most(x: Floats, p: float) -> Floats:
        """P(X <= x | p); candidates are counts up to the quantile `_CANDIDATE`."""
        p_values = binomial_at_most(x, n, p)
        candidates = binomial_at_most(binomial_quantile(_CANDIDATE, n, p), n, p) if given else np.ones_like(n)
        return np.where(p_values <= candidates, p_values / candidates, np.inf)

    s, r = bounds.systematic, bounds.reliable
    flaky = np.maximum(at_most(n - x, 1 - s), at_most(x, r))
    return np.stack([at_most(x, s), flaky, at_most(n - x, 1 - r)])


_OPEN: Final = -1
"""No claim; other values are indices in `CLAIMS`."""


class OperatingCharacteristics(NamedTuple):
    """Operating characteristics of a rule at k known rates of passing.

    Attributes:
        ends: (k,) probability of each class, and of `undecided`.
        wrong: (k,) probability of claiming a wrong class.
        expected_runs: (k,) mean number of runs.
    """

    ends: Mapping[ClassName, Floats]
    wrong: Floats
    expected_runs: Floats


@dataclass(frozen=True)
class StoppingRule:
    """End the runs of a configuration when its class is decided.

    Truncated sequential probability ratio tests (Wald 1947), two at each bound, combined to three classes (Sobel and Wald, Ann. Math.
    Statist. 20 (1949) 502). With x passes of n judged runs, L(a, b) = x ln(b/a) + (n - x) ln((1 - b)/(1 - a)) is the evidence for the
    rate b against a. With bounds s and r and m = (s + r) / 2, a configuration is

        systematic  where L(s, s/2) >= A,
        reliable    where L(r, (1 + r)/2) >= B,
        flaky       where L(s, m) >= C and L(r, m) >= C.

    A, B and C are the smallest values at which a false claim at the bound has a probability of at most `error` when looked at after every
    run from `min_runs` to `max_runs`, by exact dynamic programming over (n, x). Looking less often makes fewer errors.

    Attributes:
        min_runs: Judged runs before any decision.
        max_runs: Runs after which an open configuration is undecided.
        error: Largest probability of a false claim, whatever the rate.
    """

    min_runs: int = 5
    max_runs: int = 20
    bounds: ClassBounds = field(default_factory=ClassBounds)
    error: float = 0.05

    def __post_init__(self) -> None:
        if not 1 <= self.min_runs <= self.max_runs:
            raise ValueError(f"1 <= min_runs <= max_runs must hold, got {self.min_runs} and {self.max_runs}")
        if not 0.0 < self.error < 0.5:
            raise ValueError(f"error must be between 0 and 0.5, got {self.error}")

    def decision(self, passed: int, judged: int) -> ClassName | None:
        """The class after `judged` runs; None while it is open and runs are left."""
        return self.decisions([passed], [judged])[0]

    def decisions(self, passed: ArrayLike, judged: ArrayLike) -> list[ClassName | None]:
        """`decision` of many configurations, (m,) counts each."""
        x, n = counts(passed, judged)
        claims = np.where(n >= self.min_runs, self._claims(x, n, self.thresholds), _OPEN)
        return [
            CLAIMS[claim] if claim != _OPEN else "undecided" if runs >= self.max_runs else None
            for claim, runs in zip(claims.tolist(), n.tolist(), strict=True)
        ]

    @cached_property
    def decidable(self) -> tuple[ClassName, ...]:
        """Classes that `max_runs` can show."""
        return tuple(CLAIMS[claim] for claim in np.unique(self._lattice) if claim != _OPEN)

    @cached_property
    def decided(self) -> NDArray[np.bool_]:
        """(max_runs + 1, max_runs + 1) whether a class is decided, by judged runs and passes."""
        return np.asarray(np.stack(self._lattice) != _OPEN)

    def operating_characteristics(self, p: ArrayLike, runs_per_look: int = 1) -> OperatingCharacteristics:
        """Exact operating characteristics at rates `p` (k,), with `runs_per_look` runs between two looks."""
        looks = {*range(self.min_runs, self.max_runs, runs_per_look), self.max_runs}
        rates = np.atleast_1d(np.asarray(p, dtype=np.float64))
        return _characteristics(self._lattice, looks, rates, self.bounds)

    @cached_property
    def worst_error(self) -> float:
        """Largest probability of a false claim over all rates, with a look after every run."""
        return self._worst_error(self._lattice)

    @cached_property
    def thresholds(self) -> Floats:
        """Evidence A, C, B that each of `CLAIMS` requires; infinite where `max_runs` cannot show it."""
        s, r = self.bounds.systematic, self.bounds.reliable
        nominal = self.error
        while True:
            at = ((s,), (s, r), (r,))
            found = np.array([self._calibrated(claim, nulls, nominal) for claim, nulls in enumerate(at)])
            worst = self._worst_error(self._claims_by(found))
            if worst <= self.error:
                return found
            nominal *= 0.95 * self.error / worst  # bounds so close that a configuration may err in both directions

    def _worst_error(self, lattice: Sequence[NDArray[np.intp]]) -> float:
        s, r, near = self.bounds.systematic, self.bounds.reliable, 1e-9
        grid = np.concatenate((np.linspace(0.0, 1.0, 201), [s, s + near, r - near, r]))
        return float(_characteristics(lattice, range(self.min_runs, self.max_runs + 1), grid, self.bounds).wrong.max())

    @cached_property
    def _lattice(self) -> list[NDArray[np.intp]]:
        return self._claims_by(self.thresholds)

    def _claims_by(self, thresholds: Floats) -> list[NDArray[np.intp]]:
        """Claims at each (n, x), by n; entries x > n are open."""
        n, x = self._grid
        claims = self._claims(np.minimum(x, n), n, thresholds)
        return list(np.where((x <= n) & (n >= self.min_runs), claims, _OPEN))

    @property
    def _grid(self) -> tuple[Floats, Floats]:
        numbers = np.arange(self.max_runs + 1.0)
        n, x = np.meshgrid(numbers, numbers, indexing="ij")
        return n, x

    def _claims(self, x: Floats, n: Floats, thresholds: Floats) -> NDArray[np.intp]:
        # Close bounds allow two claims at once: the one that exceeds its threshold by more counts.
        excess = self._evidence(x, n) - thresholds.reshape(-1, *[1] * x.ndim)
        return np.where(excess.max(axis=0) >= 0.0, excess.argmax(axis=0), _OPEN)

    def _evidence(self, x: Floats, n: Floats) -> Floats:
        """Evidence for each of `CLAIMS`, (3, …)."""

        def evidence(null: float, alternative: float) -> Floats:
            """Log likelihood ratio of `alternative` against `null`."""
            return np.asarray(x * np.log(alternative / null) + (n - x) * np.log((1 - alternative) / (1 - null)))

        s, r = self.bounds.systematic, self.bounds.reliable
        middle = (s + r) / 2
        return np.stack(
            (evidence(s, s / 2), np.minimum(evidence(s, middle), evidence(r, middle)), evidence(r, (1 + r) / 2))
        )

    def _calibrated(self, claim: int, nulls: Sequence[float], error: float) -> float:
        """Smallest threshold reached with a probability of at most `error` at each of `nulls`."""
        n, x = self._grid
        evidence = self._evidence(np.minimum(x, n), n)[claim]
        evidence[(x > n) | (n < self.min_runs)] = -np.inf
        # Sums of logarithms that are equal on paper differ in the last digits.
        candidates = np.unique(np.round(evidence[np.isfinite(evidence)], 9)) - 1e-9

        def is_enough(k: int) -> bool:
            claims = list(np.where(evidence >= candidates[k], claim, _OPEN))
            open_ = _characteristics(claims, range(len(claims)), np.array(nulls), self.bounds).ends["undecided"]
            return bool((1.0 - open_).max() <= error)

        first = bisect_left(range(len(candidates)), True, key=is_enough)
        return float(candidates[first]) if first < len(candidates) else np.inf


def classes_by(rule: StoppingRule, passed: ArrayLike, judged: ArrayLike) -> Classes:
    """Classes of configurations with runs stopped by `rule`; others are undecided."""
    names = tuple(found or "undecided" for found in rule.decisions(passed, judged))
    controls = (
        f"of each configuration, a class that is not its own is claimed with a probability of at most {100 * rule.worst_error:.2g} % "
        f"(sequential tests, {rule.min_runs} to {rule.max_runs} runs)"
    )
    return Classes(names, np.full(len(names), np.nan), rule.error, controls)


def _characteristics(
    lattice: Sequence[NDArray[np.intp]], looks: Container[int], rates: Floats, bounds: ClassBounds
) -> OperatingCharacteristics:
    """Propagate the probabilities of (n, x) through the claims `lattice`, with looks after `looks` runs."""
    alive = np.zeros((len(rates), len(lattice)))
    alive[:, 0] = 1.0
    ends = np.zeros((len(CLAIMS), len(rates)))
    expected = np.zeros(len(rates))
    for n in range(1, len(lattice)):
        expected += alive.sum(axis=1)
        passes = alive[:, :-1] * rates[:, None]
        alive = alive * (1 - rates)[:, None]
        alive[:, 1:] += passes
        if n in looks:
            for claim in range(len(CLAIMS)):
                there = np.flatnonzero(lattice[n] == claim)
                ends[claim] += alive[:, there].sum(axis=1)
                alive[:, there] = 0.0
    wrong = ends.sum(axis=0) - ends[bounds.of(rates), np.arange(len(rates))]
    found = dict(zip((*CLAIMS, "undecided"), (*ends, alive.sum(axis=1)), strict=True))
    return OperatingCharacteristics(found, wrong, expected)
