"""Analysis of factors and of their pairs: effects on the failure rate, and whether these are shown."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vastflow.oracles.results.factors import Dropped, Factor
from vastflow.oracles.statistics.contrast import Contrasts, contrasts_of
from vastflow.oracles.statistics.effects import Claim, FactorEffect, Runs, factor_effect, runs_of
from vastflow.oracles.statistics.interactions import InteractionEffect, interaction_effect
from vastflow.oracles.statistics.intervals import Floats, counts
from vastflow.oracles.statistics.margins import Margins, margins_of, trend_of
from vastflow.oracles.statistics.situations import needed, smallest

LEAST_DRAWS: Final = 999
MOST_DRAWS: Final = 9999


@dataclass(frozen=True, slots=True)
class Variance:
    """Shares of the variance of a run's outcome, which sum to 1.

    Attributes:
        repetition: Differences between runs of one configuration.
        factors: Differences between configurations by the factors, effects added up.
        interactions: By the significant pairs beyond that.
        unexplained: Other differences between configurations.
    """

    repetition: float
    factors: float
    interactions: float
    unexplained: float


@dataclass(frozen=True, eq=False)
class FactorAnalysis:
    """The effects of all factors and pairs, the most certain first.

    Attributes:
        path_properties: Numbers that follow from choices, each beside all factors and adjusted among themselves.
        dropped: Varying keys that were not analyzed.
        configurations, blocks: Numbers of those analyzed.
        error: Largest probability of any false claim: on these situations, on others, and of pairs.
    """

    factors: tuple[FactorEffect, ...]
    interactions: tuple[InteractionEffect, ...]
    path_properties: tuple[FactorEffect, ...]
    dropped: tuple[Dropped, ...]
    variance: Variance = field(repr=False)
    configurations: int
    blocks: int
    error: float

    @property
    def powerless(self) -> tuple[tuple[str, ...], int]:
        """Factors and number of pairs whose effect on other situations cannot be shown, however large it is."""
        return tuple(each.name for each in self.factors if each.others.powerless), sum(
            pair.claim.powerless for pair in self.interactions
        )


def factor_analysis(
    factors: Sequence[Factor],
    passed: ArrayLike,
    judged: ArrayLike,
    blocks: ArrayLike | None = None,
    dropped: Iterable[Dropped] = (),
    error: float = 0.05,
    path_properties: Sequence[Factor] = (),
    sets: Mapping[str, ArrayLike] | None = None,
    first: tuple[ArrayLike, ArrayLike] | None = None,
) -> FactorAnalysis | None:
    """Analyze the effects of factors on the failure rate; None for fewer than two judged configurations.

    The response is each configuration's share of failed runs, so that each counts once (analysis of cluster means, Donner and Klar 2000,
    ch. 6). Effects are differences of failure rates in a linear model with a column for each level; effects that multiply are
    interactions. A factor has two tests: on these situations, by `Matched` sets of runs; and for others like them, by permutations within
    situations, or by `Contrasts` beyond all other factors where these are not balanced. Both, and the pairs, are families adjusted by
    Holm (Scand. J. Statist. 6 (1979) 65).

    `path_properties` follow from the choices, as a narrow passage does from the number of obstacles. Factors are not held against them: each is
    tested beside all factors, in a family of their own.

    Args:
        factors, path_properties: (m,) codes each, see `factors_of`.
        passed, judged: (m,) counts.
        blocks: (m,) equal numbers for dependent configurations, see `blocks_of`; by default each is a block.
        sets: Factor to (m,) numbers, equal for configurations that are equal in all but the factor; by default those of a block that
            are equal in all other factors.
        first: (m,) passed and judged counts of as many runs of each as a stopping rule allows; by default of all.
    """
    x, n = counts(passed, judged)
    some = n > 0
    if some.sum() < 2:
        return None
    rates = 1.0 - x[some] / n[some]
    block = np.arange(len(rates)) if blocks is None else np.asarray(blocks)[some]
    present, seen = ([f for each in of if (f := _present(each, some)) is not None] for of in (factors, path_properties))
    pairs = list(combinations(present, 2))
    # The lowest p-value, 1 / draws, doubled for a number, must stay below the error when Holm multiplies it by all tests.
    draws = int(np.clip(3 * (len(present) + len(pairs)) / error, LEAST_DRAWS, MOST_DRAWS))
    contrasts = contrasts_of(rates, block, draws)
    columns = {factor.name: _columns(factor) for factor in present}
    # Configurations without a factor have a column of their own and are in no comparison of its levels.
    missing = [(factor.codes < 0).astype(np.float64) for factor in present if (factor.codes < 0).any()]
    constant = np.column_stack([np.ones(len(rates)), *missing])
    model = np.column_stack([constant, *columns.values()])
    margins = margins_of(model, rates, contrasts.blocks, n[some])
    between = _between(rates, n[some])
    mains: list[FactorEffect] = []
    first_passed, first_judged = counts(*(first or (passed, judged)))
    looked_at = (first_judged - first_passed)[some], first_judged[some]
    for factor in present:
        others = np.column_stack([constant, *(found for name, found in columns.items() if name != factor.name)])
        tested = contrasts.test(columns[factor.name], others)
        trend = None if factor.values is None else trend_of(contrasts, factor.values, others, n[some], error)
        alike = _alike(contrasts.blocks, present, factor) if sets is None else np.asarray(sets[factor.name])[some]
        runs = runs_of(factor, rates, looked_at, contrasts.blocks, alike)
        effect = factor_effect(factor, tested, margins, columns, constant, between, error, runs, trend)
        if runs.table is not None and smallest(len(runs.table), len(factor.levels)) * len(present) > error:
            effect = replace(effect, needed=needed(len(factor.levels), len(present), error))
        mains.append(effect)
    effects = [interaction_effect(*pair, contrasts, model, columns, margins.fitted, between) for pair in pairs]
    around = _beside(seen, present, contrasts, n[some], error)
    these = _told([effect.these for effect in mains], error)
    for_others = _told([effect.others for effect in mains], error)
    mains = [replace(e, these=one, others=two) for e, one, two in zip(mains, these, for_others, strict=True)]
    claims = _told([effect.claim for effect in effects], error)
    effects = [replace(effect, claim=claim) for effect, claim in zip(effects, claims, strict=True)]
    varying = {each.name for each in (*present, *seen)}
    lost = [
        Dropped(f.name, "has one level among the judged") for f in (*factors, *path_properties) if f.name not in varying
    ]
    return FactorAnalysis(
        tuple(sorted(mains, key=lambda e: (_certainty(e.these), _certainty(e.others), -e.difference))),
        tuple(sorted(effects, key=lambda effect: (_certainty(effect.claim), -abs(effect.departure)))),
        tuple(sorted(around, key=lambda effect: (_certainty(effect.others), -effect.difference))),
        (*dropped, *lost),
        _variance(rates, n[some], between, margins, effects),
        len(rates),
        len(contrasts.sizes),
        error,
    )


def _beside(
    tested: Sequence[Factor], held: Sequence[Factor], contrasts: Contrasts, runs: Floats, error: float
) -> list[FactorEffect]:
    """The effect of each of `tested` beside the factors `held`, adjusted among them."""
    effects = []
    between = _between(contrasts.response, runs)
    for factor in tested:
        everything = (*held, factor)
        missing = [(each.codes < 0).astype(np.float64) for each in everything if (each.codes < 0).any()]
        constant = np.column_stack([np.ones(len(runs)), *missing])
        columns = {each.name: _columns(each) for each in everything}
        others = np.column_stack([constant, *(columns[each.name] for each in held)])
        margins = margins_of(np.column_stack([constant, *columns.values()]), contrasts.response, contrasts.blocks, runs)
        trend = None if factor.values is None else trend_of(contrasts, factor.values, others, runs, error)
        found = contrasts.test(columns[factor.name], others)
        alone = Runs(runs * contrasts.response, runs, contrasts.blocks, None, None)
        effects.append(factor_effect(factor, found, margins, columns, constant, between, error, alone, trend))
    claims = _told([effect.others for effect in effects], error)
    return [replace(effect, others=claim) for effect, claim in zip(effects, claims, strict=True)]


def _alike(blocks: NDArray[np.int64], factors: Sequence[Factor], factor: Factor) -> NDArray[np.int64]:
    """Numbers (m,) that are equal for configurations of a block that are equal in all other factors."""
    rest = np.column_stack([blocks, *(other.codes for other in factors if other.name != factor.name)])
    return np.unique(rest, axis=0, return_inverse=True)[1].reshape(-1).astype(np.int64)


def _told(claims: Sequence[Claim], error: float) -> list[Claim]:
    """Adjust claims by Holm; a claim whose lowest p-value, adjusted likewise, exceeds the error is powerless."""
    adjusted = holm([claim.p_value for claim in claims])
    least = holm([None if claim.p_value is None else claim.least for claim in claims])
    return [
        replace(claim, adjusted=p, shown=p is not None and p <= error, powerless=low is not None and low > error)
        for claim, p, low in zip(claims, adjusted, least, strict=True)
    ]


def holm(p_values: Sequence[float | None]) -> list[float | None]:
    """p-values adjusted by Holm over those that are not None."""
    order = sorted((p, k) for k, p in enumerate(p_values) if p is not None)
    adjusted: list[float | None] = [None] * len(p_values)
    least = 0.0
    for rank, (p, k) in enumerate(order):
        least = max(least, min(1.0, (len(order) - rank) * p))
        adjusted[k] = least
    return adjusted


def _certainty(claim: Claim) -> float:
    return 2.0 if claim.p_value is None else claim.p_value


def _present(factor: Factor, some: NDArray[np.bool_]) -> Factor | None:
    """The factor among the judged configurations; None if it does not vary there."""
    codes = factor.codes[some]
    used = np.unique(codes[codes >= 0])
    if len(used) < 2:
        return None
    levels = tuple(factor.levels[k] for k in used)
    values = None if factor.values is None else factor.values[some]
    return Factor(factor.name, levels, np.where(codes >= 0, np.searchsorted(used, codes), -1).astype(np.int64), values)


def _columns(factor: Factor) -> Floats:
    """A column for each level but the first, (m, L - 1)."""
    columns: Floats = (factor.codes[:, None] == np.arange(1, len(factor.levels))).astype(np.float64)
    return columns


def _between(rates: Floats, n: Floats) -> float:
    """Variance, at least 0, of the true rates of configurations, without the noise of repetitions."""
    noise = _repetition(rates, n) / n
    return max(0.0, float(rates.var(ddof=1)) - float(noise.mean()))


def _repetition(rates: Floats, n: Floats) -> Floats:
    """Unbiased variance of one run of each configuration; for a single run the largest possible."""
    unknown = float(rates.mean() * (1 - rates.mean()))
    noise: Floats = np.where(n > 1, rates * (1 - rates) * n / np.maximum(n - 1, 1), unknown)
    return noise


def _variance(
    rates: Floats, n: Floats, between: float, margins: Margins, pairs: Sequence[InteractionEffect]
) -> Variance:
    repetition = float(_repetition(rates, n).mean())
    whole = repetition + between
    if whole <= 0.0:
        return Variance(0.0, 0.0, 0.0, 0.0)
    by_factors = min(between, margins.explained)
    by_pairs = min(between - by_factors, sum(pair.share for pair in pairs if pair.claim.shown) * between)
    return Variance(
        repetition / whole, by_factors / whole, by_pairs / whole, max(0.0, between - by_factors - by_pairs) / whole
    )
