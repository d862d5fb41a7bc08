"""Comparison of two campaigns with paired runs."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vastflow.oracles.results.factors import Factor
from vastflow.oracles.statistics.analysis import holm
from vastflow.oracles.statistics.intervals import LEVEL, Floats, mean_interval
from vastflow.oracles.statistics.sequential import interval_at_any_look
from vastflow.oracles.statistics.tails import binomial_at_most, false_discovery

Bools = NDArray[np.bool_]
Codes = NDArray[np.int64]
Target: TypeAlias = Literal["these", "others"]
"""Scope of a difference: these scenarios, run again, or others of their kind."""


@dataclass(frozen=True, eq=False)
class Pairs:
    """Pairs of judged runs of two campaigns with the same situation and noise.

    Attributes:
        configuration: (P,) number of the pair's configuration.
        before, after: (P,) whether the run of each campaign passed.
        block: (P,) number of its block, see `Units`; by default each configuration is one.
        seed: (P,) equal numbers for pairs of one seed, which share their noise; by default none do.
    """

    configuration: Codes = field(repr=False)
    before: Bools = field(repr=False)
    after: Bools = field(repr=False)
    block: Codes | None = field(default=None, repr=False)
    seed: Codes | None = field(default=None, repr=False)

    def __len__(self) -> int:
        return len(self.configuration)

    def of(self, chosen: Bools) -> "Pairs":
        block, seed = (None if each is None else each[chosen] for each in (self.block, self.seed))
        return Pairs(self.configuration[chosen], self.before[chosen], self.after[chosen], block, seed)

    @property
    def paths(self) -> Codes:
        return self.configuration if self.block is None else self.block


@dataclass(frozen=True, slots=True)
class RateDifference:
    """The difference of the rates after and before.

    Attributes:
        paths: Number of blocks.
        lost, gained: Pairs that passed only before, and only after.
        before, after: Shares of passed runs.
        difference: After less before, over pairs; over paths, each counting once, for others of their kind.
        interval: Interval of the difference, within -1..1.
        mcnemar: p-value of McNemar's exact test, for independent pairs.
        p_value: For no difference, blocks as clusters; None for fewer than two configurations.
    """

    pairs: int
    configurations: int
    paths: int
    lost: int
    gained: int
    before: float
    after: float
    difference: float
    interval: tuple[float, float]
    mcnemar: float
    p_value: float | None

    def non_inferior(self, margin: float) -> bool:
        """Whether the interval rules out a loss of `margin` or more."""
        return self.interval[0] > -margin


@dataclass(frozen=True, slots=True)
class Change:
    """A configuration with changed outcomes.

    Attributes:
        before, after: Passes, of `pairs` each.
        p_value: McNemar's exact test of its pairs.
        adjusted: By Benjamini and Hochberg over all configurations.
        shown: Whether `adjusted` is at most the requested error.
    """

    configuration: int
    pairs: int
    before: int
    after: int
    lost: int
    gained: int
    p_value: float
    adjusted: float
    shown: bool

    @property
    def worse(self) -> bool:
        return self.after < self.before


@dataclass(frozen=True, slots=True)
class LevelDifference:
    """The difference at one level of a factor.

    Attributes:
        adjusted: p-value by Holm over all levels of all factors: McNemar's for these scenarios, clustered for others.
    """

    factor: str
    level: str
    difference: RateDifference
    adjusted: float | None


def mcnemar(lost: ArrayLike, gained: ArrayLike) -> Floats:
    """Two-sided p-values of McNemar's exact test; 1 without discordant pairs."""
    p_values: Floats = np.minimum(1.0, 2.0 * binomial_at_most(np.minimum(lost, gained), np.add(lost, gained), 0.5))
    return p_values


def difference(
    pairs: Pairs, target: Target = "these", level: float = LEVEL, *, at_any_look: bool = False
) -> RateDifference | None:
    """The difference of all `pairs`; None without any.

    A gained pair counts +1, a lost one -1, others 0. For `these` scenarios pairs are independent, and the interval is that of their mean
    (`mean_interval`); for `others` each path is one draw, the mean of its pairs. `at_any_look` gives the interval for these scenarios that
    holds although the runs ended by what they showed.

    The p-value has blocks as clusters, or configurations for one block: V = m/(m - 1) Σ (d_i - D n_i)² / N² over the m sums d_i of n_i pairs
    (ratio estimator, Cochran 1977, §6.3), with Student's t at m - 1 degrees of freedom. V is no less than that of Agresti and Min for
    independent pairs (Statistics in Medicine 24 (2005) 729).
    """
    n = len(pairs)
    if n == 0:
        return None
    change = pairs.after.astype(np.float64) - pairs.before
    lost, gained = int((change < 0).sum()), int((change > 0).sum())
    _, path = np.unique(pairs.paths, return_inverse=True)
    of_path = np.bincount(path, weights=change) / np.bincount(path)
    drawn = of_path if target == "others" else change
    return RateDifference(
        pairs=n,
        configurations=len(np.unique(pairs.configuration)),
        paths=len(of_path),
        lost=lost,
        gained=gained,
        before=float(pairs.before.mean()),
        after=float(pairs.after.mean()),
        difference=float(drawn.mean()),
        interval=interval_at_any_look(change, pairs.seed, level) if at_any_look else mean_interval(drawn, level),
        mcnemar=float(mcnemar(lost, gained)),
        p_value=_p_value(pairs, change),
    )


def _p_value(pairs: Pairs, change: Floats) -> float | None:
    n, d = len(change), float(change.mean())
    single = (pairs.paths == pairs.paths[:1]).all()
    _, at = np.unique(pairs.configuration if single else pairs.paths, return_inverse=True)
    sums, sizes = np.bincount(at, weights=change), np.bincount(at)
    m = len(sizes)
    if m < 2:
        return None
    from scipy.special import stdtr

    variance = m / (m - 1) * float(((sums - d * sizes) ** 2).sum()) / n**2
    adjusted_d = float(change.sum()) / (n + 2)
    independent = ((float(np.abs(change).sum()) + 1) / (n + 2) - adjusted_d**2) / (n + 2)
    return 2.0 * float(stdtr(m - 1, -abs(d) / math.sqrt(max(variance, independent))))


def changes(pairs: Pairs, error: float = 0.05) -> list[Change]:
    """Configurations with a discordant pair, the most certain first, then the largest change.

    Those `shown` are newly failing or newly passing: McNemar's exact test of their own pairs, adjusted by Benjamini and Hochberg over the
    configurations with enough discordant pairs to show anything (six at 5 %, see `classify`).
    """
    if not len(pairs):
        return []
    known, at = np.unique(pairs.configuration, return_inverse=True)
    lost = np.bincount(at[pairs.before & ~pairs.after], minlength=len(known))
    gained = np.bincount(at[~pairs.before & pairs.after], minlength=len(known))
    sizes, before = np.bincount(at), np.bincount(at[pairs.before], minlength=len(known))
    p_values = mcnemar(lost, gained)
    adjusted = np.ones_like(p_values)
    able = 2.0 * 0.5 ** (lost + gained) <= error
    adjusted[able] = false_discovery(p_values[able])
    columns = (known, sizes, before, before - lost + gained, lost, gained, p_values, adjusted, adjusted <= error)
    discordant = lost + gained > 0
    found = [Change(*row) for row in zip(*(column[discordant].tolist() for column in columns), strict=True)]
    return sorted(found, key=lambda one: (one.adjusted, one.p_value, -abs(one.after - one.before), one.configuration))


def by_level(
    factors: Sequence[Factor], pairs: Pairs, target: Target = "these", *, at_any_look: bool = False
) -> list[LevelDifference]:
    """The difference at each level of each factor, given its codes (m,) by configuration."""
    found = [
        (factor.name, name, one)
        for factor in factors
        for k, name in enumerate(factor.levels)
        if (one := difference(pairs.of(factor.codes[pairs.configuration] == k), target, at_any_look=at_any_look))
        is not None
    ]
    adjusted = holm([one.mcnemar if target == "these" else one.p_value for _, _, one in found])
    return [LevelDifference(*row, p) for row, p in zip(found, adjusted, strict=True)]
