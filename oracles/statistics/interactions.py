"""Interactions: pairs of factors whose effects on the failure rate do not add up."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vastflow.oracles.statistics.clustered import clustered_interval
from vastflow.oracles.statistics.contrast import Contrasts, Tested
from vastflow.oracles.statistics.effects import share_of
from vastflow.oracles.statistics.factors import Factor
from vastflow.oracles.statistics.intervals import Floats, Interval


@dataclass(frozen=True, slots=True)
class LevelPair:
    """Configurations with a pair of levels.

    Attributes:
        rate: Mean failure rate.
        expected: What it would be if the factors' effects added up.
        interval: Of `rate`, blocks as clusters; 0..1 for a single block.
    """

    levels: tuple[str, str]
    configurations: int
    rate: float
    expected: float
    interval: Interval


@dataclass(frozen=True, slots=True)
class InteractionEffect:
    """How far the effects of two factors do not add up, on the scale of rates.

    Attributes:
        cells: Pairs of levels that there are.
        departure: `rate` - `expected` of the cell where that stands out most.
        p_value, adjusted, significant, note: As of a factor.
    """

    names: tuple[str, str]
    cells: tuple[LevelPair, ...]
    departure: float
    share: float
    p_value: float | None
    adjusted: float | None = None
    significant: bool = False
    note: str = ""


def interaction_effect(
    a: Factor,
    b: Factor,
    contrasts: Contrasts,
    model: Floats,
    columns: Mapping[str, Floats],
    fitted: Floats,
    between: float,
) -> InteractionEffect:
    """The interaction of two factors, not yet adjusted for the others that are tested.

    Args:
        model, columns, fitted: All factors' effects added up: columns of the model, those of each factor, fitted rates (m,).
        between: Variance between configurations.
    """
    products = (columns[a.name][:, :, None] * columns[b.name][:, None, :]).reshape(len(model), -1)
    if products.shape[1] * 3 > len(model):
        tested = Tested(None, why="too few configurations")
    else:
        tested = contrasts.test(products, model)
        if tested.why and tested.degrees == 0:
            tested = replace(tested, why="the two do not vary together")
    cells, departures = [], []
    for k, first in enumerate(a.levels):
        for j, second in enumerate(b.levels):
            group = (a.codes == k) & (b.codes == j)
            if group.any():
                rate, expected = float(contrasts.response[group].mean()), float(fitted[group].mean())
                interval = _interval_of_mean(contrasts.response[group], contrasts.blocks[group])
                cells.append(LevelPair((first, second), int(group.sum()), rate, expected, interval))
                departures.append((rate - expected) * np.sqrt(group.sum()))
    most = int(np.argmax(np.abs(departures))) if cells else 0
    departure = cells[most].rate - cells[most].expected if cells else 0.0
    return InteractionEffect(
        (a.name, b.name), tuple(cells), departure, share_of(tested, between), tested.p_value, note=tested.why
    )


def _interval_of_mean(rates: Floats, blocks: NDArray[np.int64]) -> Interval:
    _, at = np.unique(blocks, return_inverse=True)
    return clustered_interval(np.bincount(at, weights=rates), np.bincount(at)) or Interval(0.0, 1.0)
