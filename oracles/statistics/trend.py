"""Trends: how the failure rate changes with a number, per unit of it."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from vastflow.oracles.statistics.contrast import Contrasts, beyond
from vastflow.oracles.statistics.intervals import Floats

LEAST_VALUES: Final = 3
"""Different values that a trend takes; of two the difference says it all."""


@dataclass(frozen=True, slots=True)
class Trend:
    """The slope of the failure rate over a number, other factors held.

    Attributes:
        per_unit: Change of the failure rate where the number is greater by one.
        interval: Of it, blocks as clusters.
        smallest, greatest: Of the number.
        p_value: Of none; None where it can't be tested.
    """

    per_unit: float
    interval: tuple[float, float]
    smallest: float
    greatest: float
    p_value: float | None

    @property
    def change(self) -> float:
        """Change of the failure rate from the smallest to the greatest number."""
        return self.per_unit * (self.greatest - self.smallest)

    @property
    def change_interval(self) -> tuple[float, float]:
        """Of `change`, within -1..1."""
        low, high = (end * (self.greatest - self.smallest) for end in self.interval)
        return max(-1.0, low), min(1.0, high)


def trend_of(contrasts: Contrasts, values: Floats, others: Floats, error: float) -> Trend | None:
    """The trend of the response over `values`; None where they have fewer than `LEAST_VALUES`, or follow from `others`.

    The slope is that of least squares beside `others`. Its interval has Student's t at one less than the blocks, or the degrees of freedom
    that remain if these are fewer, and the same residuals as of `Margins` (HC2). The test is that of `Contrasts` for one column: a
    number's bins can't be told apart where each has few blocks, and a rise over all of them still can.

    Args:
        values: (m,), NaN where a configuration does not have the number.
        others: (m, p) columns beside which it stands, the constant and one that tells missing values among them.
    """
    known = np.isfinite(values)
    if len(np.unique(values[known])) < LEAST_VALUES:
        return None
    scale = float(values[known].std())
    column = np.where(known, (values - values[known].mean()) / scale, 0.0)[:, None]
    left, basis = beyond(column, others)
    steep = left[:, 0]
    weight = float(steep @ steep)
    if weight < 1e-9 * len(values):
        return None
    slope = float(steep @ contrasts.response) / weight
    residual = contrasts.response - basis @ (basis.T @ contrasts.response) - steep * slope
    leverage = (basis**2).sum(axis=1) + steep**2 / weight
    scores = steep * residual / np.sqrt(np.maximum(1.0 - leverage, 0.05))
    blocks = len(contrasts.sizes)
    freedom = min(len(values) - basis.shape[1] - 1, blocks - 1)
    if freedom < 1:
        return None
    sums = np.bincount(contrasts.blocks, weights=scores, minlength=blocks)
    deviation = float(np.sqrt((sums @ sums) * blocks / (blocks - 1))) / weight
    from scipy.special import stdtrit

    half = float(stdtrit(freedom, 1 - error / 2)) * deviation
    ends = (slope - half) / scale, (slope + half) / scale
    smallest, greatest = float(values[known].min()), float(values[known].max())
    return Trend(slope / scale, ends, smallest, greatest, contrasts.test(column, others).p_value)
