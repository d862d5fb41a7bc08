"""Interactions: pairs of factors whose effects on the failure rate do not add up."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from vastflow.oracles.results.factors import Factor
from vastflow.oracles.statistics.contrast import Contrasts, Tested, contrasts_of
from vastflow.oracles.statistics.effects import Claim, share_of
from vastflow.oracles.statistics.intervals import Floats, Interval, clustered_interval
from vastflow.oracles.statistics.situations import means_of


@dataclass(frozen=True, slots=True)
class LevelPair:
    """Configurations with a pair of levels.

    Attributes:
        rate: Mean failure rate.
        expected: The rate if the factors' effects added up.
        interval: Of `rate`, blocks as clusters; 0..1 for a single block.
    """

    levels: tuple[str, str]
    configurations: int
    rate: float
    expected: float
    interval: Interval


@dataclass(frozen=True, slots=True)
class InteractionEffect:
    """The interaction of two factors: how far their effects on rates do not add up.

    Attributes:
        cells: Existing pairs of levels.
        departure: `rate` - `expected` of the cell where that stands out most.
        claim: Whether they act together.
    """

    names: tuple[str, str]
    cells: tuple[LevelPair, ...]
    departure: float
    share: float
    claim: Claim


def interaction_effect(
    a: Factor,
    b: Factor,
    contrasts: Contrasts,
    model: Floats,
    columns: Mapping[str, Floats],
    fitted: Floats,
    between: float,
) -> InteractionEffect:
    """The interaction of two factors, before adjustment for other tests.

    Args:
        model, columns, fitted: All factors' effects added up: columns of the model and of each factor, fitted rates (m,).
        between: Variance between configurations.
    """
    joint = (columns[a.name][:, :, None] * columns[b.name][:, None, :]).reshape(len(model), -1)
    within, between_situations = sorted((a, b), key=lambda factor: is_between(factor, contrasts.blocks))
    if is_between(between_situations, contrasts.blocks) and not is_between(within, contrasts.blocks):
        tested = _by_situation(within, between_situations, contrasts, columns)
    elif joint.shape[1] * 3 > len(model):
        tested = Tested(None, why="too few configurations")
    else:
        tested = contrasts.test(joint, model)
        if tested.why and tested.degrees == 0:
            tested = replace(tested, why="the two do not vary together")
    cells = []
    for (k, first), (j, second) in product(enumerate(a.levels), enumerate(b.levels)):
        group = (a.codes == k) & (b.codes == j)
        if group.any():
            rate, expected = float(contrasts.response[group].mean()), float(fitted[group].mean())
            interval = _interval_of_mean(contrasts.response[group], contrasts.blocks[group])
            cells.append(LevelPair((first, second), int(group.sum()), rate, expected, interval))
    departures = [(cell.rate - cell.expected) * np.sqrt(cell.configurations) for cell in cells]
    most = cells[int(np.argmax(np.abs(departures)))] if cells else None
    departure = most.rate - most.expected if most else 0.0
    claim = Claim(tested.p_value, tested.why, least=tested.least)
    return InteractionEffect((a.name, b.name), tuple(cells), departure, share_of(tested, between), claim)


def is_between(factor: Factor, blocks: NDArray[np.int64]) -> bool:
    """Whether the factor has one level in every block."""
    return len(np.unique(blocks)) == len(np.unique(np.stack((blocks, factor.codes)), axis=1).T)


def _by_situation(within: Factor, between: Factor, contrasts: Contrasts, columns: Mapping[str, Floats]) -> Tested:
    """Test whether the effect of a factor within blocks depends on one that differs between them.

    Each block's contrasts of the levels of `within` are regressed on all columns that differ between blocks, so that situations
    which respond differently are noise. The smallest p-value counts, times the number of contrasts (Bonferroni).
    """
    levels = len(within.levels)
    means = means_of(contrasts.response, contrasts.blocks, within.codes, levels)
    kept = np.isfinite(means).all(axis=1)
    if not kept.any():
        return Tested(None, why="the two do not vary together")
    _, first = np.unique(contrasts.blocks, return_index=True)
    beside = [
        found[first[kept]]
        for name, found in columns.items()
        if name != between.name and np.array_equal(found, found[first][contrasts.blocks])
    ]
    others, tested = np.column_stack([np.ones(int(kept.sum())), *beside]), columns[between.name][first[kept]]
    found = [
        contrasts_of(means[kept] @ contrast, np.arange(int(kept.sum())), contrasts.draws).test(tested, others)
        for contrast in np.linalg.qr(np.column_stack([np.ones(levels), np.eye(levels)[:, 1:]]))[0].T[1:]
    ]
    p_values = [each.p_value for each in found if each.p_value is not None]
    if len(p_values) < len(found):
        return Tested(None, why=f"cannot be told from {int(kept.sum())} situations")
    variance, least = sum(each.variance for each in found) / levels, len(found) * min(each.least for each in found)
    return Tested(min(1.0, len(found) * min(p_values)), found[0].degrees, variance, least=least)


def _interval_of_mean(rates: Floats, blocks: NDArray[np.int64]) -> Interval:
    _, at = np.unique(blocks, return_inverse=True)
    return clustered_interval(np.bincount(at, weights=rates), np.bincount(at)) or Interval(0.0, 1.0)
