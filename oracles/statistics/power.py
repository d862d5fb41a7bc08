"""Power: the least effect on the failure rate that a campaign of a size shows in eight of ten cases."""

from bisect import bisect_left
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np

from vastflow.oracles.statistics.intervals import Floats
from vastflow.oracles.statistics.matched import needed

POWER: Final = 0.8
USUAL: Final = 0.3
"""Effect that `Needed.enough` is about."""

_CAMPAIGNS: Final = 250
_ORDERS: Final = 399
_MANY: Final = 25
"""Situations from which sums over random orders are taken as normal."""
_STEPS: Final = np.linspace(0.05, 1.0, 20).tolist()
_MOST: Final = 200
_SIZES: Final = (*range(2, 20), *range(20, 50, 5), 50, 75, 100, _MOST)


@dataclass(frozen=True, slots=True)
class Power:
    """Least effect on the failure rate that is shown with a probability of `POWER`.

    Attributes:
        these, others: On these situations, and for others.
    """

    these: float | None
    others: float | None


@dataclass(frozen=True, slots=True)
class Needed:
    """Situations that show an effect for others.

    Attributes:
        fewest: If all agree.
        enough: With a probability of `POWER`, where the effect is `USUAL`; None for more than 200.
    """

    fewest: int
    enough: int | None


@cache
def power_of(situations: int, levels: int, runs: int, tests: int = 1, error: float = 0.05) -> Power:
    """Simulate the tests of a factor in campaigns of which one level fails more in all situations.

    Failure rates of situations at the other levels are beta distributed (1, 4): 0.2 on average.

    Args:
        runs: Number of runs of each situation at each level.
        tests: Number of factors, over which p-values are adjusted; as if by Bonferroni.
    """

    def least(is_shown: Callable[[Floats, int, float], float]) -> float | None:
        def is_enough(effect: float) -> bool:
            failed = _failed(min(situations, _MOST), levels, runs, effect)
            return is_shown(failed, runs, error / tests) >= POWER

        found = bisect_left(_STEPS, True, key=is_enough)
        return round(_STEPS[found], 2) if found < len(_STEPS) else None

    few = situations < needed(levels, tests, error)
    return Power(least(_share_on_these), None if few else least(_share_for_others))


@cache
def needed_for(levels: int, runs: int, tests: int = 1, error: float = 0.05) -> Needed:
    """Number of situations needed; arguments as of `power_of`."""
    fewest = needed(levels, tests, error)
    sizes = [size for size in _SIZES if size >= fewest]

    def is_enough(size: int) -> bool:
        return _share_for_others(_failed(size, levels, runs, USUAL), runs, error / tests) >= POWER

    found = bisect_left(sizes, True, key=is_enough)
    return Needed(fewest, sizes[found] if found < len(sizes) else None)


def _failed(situations: int, levels: int, runs: int, effect: float) -> Floats:
    rng = np.random.default_rng(80)
    base = rng.beta(1.0, 4.0, (_CAMPAIGNS, situations, 1)) + effect * (np.arange(levels) == levels - 1)
    return np.asarray(rng.binomial(runs, np.minimum(base, 1.0)), dtype=np.float64)


def _share_on_these(failed: Floats, runs: int, allowed: float) -> float:
    from scipy.special import chdtrc

    levels = failed.shape[2]
    total, whole = failed.sum(axis=2), runs * levels
    scale = (total * (whole - total)).sum(axis=1) * runs * runs * levels / (whole**2 * max(whole - 1, 1))
    away = np.abs(failed.sum(axis=1) - total.sum(axis=1)[:, None] / levels)
    statistic = (np.maximum(away - 0.5, 0.0) ** 2).sum(axis=1) / np.maximum(scale, 1e-9)  # Yates' correction
    return float((chdtrc(levels - 1, statistic) <= allowed).mean())


def _share_for_others(failed: Floats, runs: int, allowed: float) -> float:
    from scipy.special import chdtrc

    campaigns, count, levels = failed.shape
    away = (failed - failed.mean(axis=2, keepdims=True)) / runs
    observed = (away.sum(axis=1) ** 2).sum(axis=1)
    if count > _MANY:
        scale = (away**2).sum(axis=(1, 2)) / (levels - 1)
        return float((chdtrc(levels - 1, observed / np.maximum(scale, 1e-9)) <= allowed).mean())
    rng, larger = np.random.default_rng(81), np.zeros(campaigns)
    order = np.broadcast_to(np.arange(levels), (count, levels))
    for _ in range(_ORDERS):
        sums = np.take_along_axis(away, rng.permuted(order, axis=1)[None], axis=2).sum(axis=1)
        larger += (sums**2).sum(axis=1) >= observed - 1e-9
    return float(((1 + larger) / (1 + _ORDERS) <= allowed).mean())
