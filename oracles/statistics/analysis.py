"""Analysis of factors and of their pairs: effects on the failure rate, and whether these are shown."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import TYPE_CHECKING, Any, Final, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vastflow.oracles.results.factors import Dropped, Factor
from vastflow.oracles.statistics.effects import Claim, FactorEffect, FactorModel, InteractionEffect
from vastflow.oracles.statistics.intervals import counts
from vastflow.oracles.statistics.linear import Contrasts

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

E = TypeVar("E", bound="DataclassInstance")
LEAST_DRAWS: Final = 999
MOST_DRAWS: Final = 9999


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
    configurations: int
    blocks: int
    error: float

    @property
    def powerless(self) -> tuple[tuple[str, ...], int]:
        """Factors, and number of pairs, whose effect on other situations can't be shown at any size."""
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
        blocks: (m,) equal numbers for dependent configurations, see `Units`; by default each is a block.
        sets: Factor to (m,) numbers, equal for configurations that are equal in all but the factor; by default those of a block that
            are equal in all other factors.
        first: (m,) passed and judged counts of as many runs of each as a stopping rule allows; by default of all.
    """
    x, n = counts(passed, judged)
    some = n > 0
    if some.sum() < 2:
        return None
    rates, runs = 1.0 - x[some] / n[some], n[some]
    present, seen = ([f for each in of if (f := _present(each, some)) is not None] for of in (factors, path_properties))
    pairs = list(combinations(present, 2))
    # The lowest p-value, 1 / draws, doubled for a number, must stay below the error when Holm multiplies it by all tests.
    draws = int(np.clip(3 * (len(present) + len(pairs)) / error, LEAST_DRAWS, MOST_DRAWS))
    contrasts = Contrasts(rates, np.arange(len(rates)) if blocks is None else np.asarray(blocks)[some], draws)
    model = FactorModel(present, contrasts, runs, error)
    first_passed, first_judged = counts(*(first or (passed, judged)))
    looked_at = (first_judged - first_passed)[some], first_judged[some]
    mains = []
    for factor in present:
        if sets is None:
            rest = [other.codes for other in present if other.name != factor.name]
            alike = np.unique(np.column_stack([contrasts.blocks, *rest]), axis=0, return_inverse=True)[1].reshape(-1)
        else:
            alike = np.asarray(sets[factor.name])[some]
        mains.append(model.effect(factor, looked_at, alike))
    mains = adjusted_claims(adjusted_claims(mains, "these", error), "others", error)
    effects = adjusted_claims([model.interaction(*pair) for pair in pairs], "claim", error)
    beside = (FactorModel((*present, each), contrasts, runs, error).effect(each, (runs * rates, runs)) for each in seen)
    around = adjusted_claims(list(beside), "others", error)
    varying = {each.name for each in (*present, *seen)}
    lost = [
        Dropped(f.name, "has one level among the judged") for f in (*factors, *path_properties) if f.name not in varying
    ]
    return FactorAnalysis(
        tuple(sorted(mains, key=lambda e: (_certainty(e.these), _certainty(e.others), -e.difference))),
        tuple(sorted(effects, key=lambda effect: (_certainty(effect.claim), -abs(effect.departure)))),
        tuple(sorted(around, key=lambda effect: (_certainty(effect.others), -effect.difference))),
        (*dropped, *lost),
        len(rates),
        len(contrasts.sizes),
        error,
    )


def adjusted_claims(effects: Sequence[E], name: str, error: float) -> list[E]:
    """Adjust the claims `name` by Holm; a claim is powerless if its lowest possible p-value stays too high."""
    claims: list[Claim] = [getattr(effect, name) for effect in effects]
    adjusted = holm([claim.p_value for claim in claims])
    least = holm([None if claim.p_value is None else claim.least for claim in claims])
    told = []
    for effect, claim, p, low in zip(effects, claims, adjusted, least, strict=True):
        shown, powerless = p is not None and p <= error, low is not None and low > error
        changed: dict[str, Any] = {name: replace(claim, adjusted=p, shown=shown, powerless=powerless)}
        told.append(replace(effect, **changed))
    return told


def holm(p_values: Sequence[float | None]) -> list[float | None]:
    """p-values adjusted by Holm; None stays None and does not count."""
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
