"""Trends: how the failure rate changes with a number, per unit of it."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from vastflow.oracles.statistics.contrast import Contrasts, beyond
from vastflow.oracles.statistics.intervals import Floats
from vastflow.oracles.statistics.margins import margins_of

LEAST_VALUES: Final = 3
"""Different values that a trend takes; of two the difference says it all."""


@dataclass(frozen=True, slots=True)
class Trend:
    """The change of the failure rate over a number, other factors held.

    Attributes:
        change: From the smallest to the greatest number, within -1..1.
        change_interval: Of it, blocks as clusters; holds it, and stays within -1..1.
        smallest, greatest: Of the number.
        p_value: Of none; None where it can't be tested.
    """

    change: float
    change_interval: tuple[float, float]
    smallest: float
    greatest: float
    p_value: float | None


def trend_of(contrasts: Contrasts, values: Floats, others: Floats, runs: Floats, error: float) -> Trend | None:
    """The trend of the response over `values`; None where they have fewer than `LEAST_VALUES`, or follow from `others`.

    The rates at both ends are those of least squares beside `others`, as `Margins` has them, so that their difference has a width
    where all blocks agree, too. The test is that of `Contrasts` for one column: a number's bins can't be told apart where each has
    few blocks, and a rise over all of them still can.

    Args:
        values: (m,), NaN where a configuration does not have the number.
        others: (m, p) columns beside which it stands, the constant and one that tells missing values among them.
        runs: (m,) behind each response.
    """
    known = np.isfinite(values)
    if len(np.unique(values[known])) < LEAST_VALUES:
        return None
    smallest, greatest = float(values[known].min()), float(values[known].max())
    column = np.where(known, (values - smallest) / (greatest - smallest), 0.0)[:, None]
    if float((beyond(column, others)[0] ** 2).sum()) < 1e-9 * len(values) or len(contrasts.sizes) < 2:
        return None
    usual = others[known].mean(axis=0)
    margins = margins_of(np.hstack((others, column)), contrasts.response, contrasts.blocks, runs)
    found = margins.at(np.array([[*usual, 0.0], [*usual, 1.0]]), [known, known])
    return Trend(
        float(found.means[1] - found.means[0]),
        found.difference(1, 0, 1 - error),
        smallest,
        greatest,
        contrasts.test(column, others).p_value,
    )
