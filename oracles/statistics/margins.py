"""Margins: means of a linear model at chosen points, with intervals that allow for blocks, and trends."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vastflow.oracles.statistics.contrast import Contrasts, beyond
from vastflow.oracles.statistics.intervals import Floats, Interval, few_clusters, interval, wilson_intervals


@dataclass(frozen=True, eq=False)
class MarginalMeans:
    """Means of k points of a model of rates.

    Attributes:
        means: (k,) within 0..1.
        covariance: (k, k), blocks as clusters.
        units: (k,) blocks at each point's level.
        most: (k,) their runs, which bound the effective number.
    """

    means: Floats
    covariance: Floats = field(repr=False)
    units: Floats
    most: Floats

    def intervals(self, level: float) -> list[Interval]:
        """Wilson intervals at the effective number of independent runs.

        That is p(1 - p)/V, reduced by (z/t)² for the few blocks behind V (Korn and Graubard, Survey Methodology 24 (1998) 193). Where a
        level always or never fails, V is zero and each block counts once.
        """
        p, variance = self.means, np.diagonal(self.covariance)
        inside = (p > 0) & (p < 1)
        few = few_clusters(self.units, level)
        known = inside & (variance > 1e-15)
        effective = np.where(
            known, p * (1 - p) / np.where(known, variance, 1.0) * few, np.where(inside, self.most, self.units)
        )
        n = np.minimum(effective, self.most)
        return [interval(ends) for ends in wilson_intervals(n * p, n, level)]

    def difference(self, a: int, b: int, level: float) -> tuple[float, float]:
        """Interval of means[a] - means[b] (Newcombe 1998, method 10; Zou and Donner, Stat. in Medicine 27 (2008) 1693)."""
        one, two = (self.intervals(level)[k] for k in (a, b))
        p, q = float(self.means[a]), float(self.means[b])
        scale = float(np.sqrt(self.covariance[a, a] * self.covariance[b, b]))
        together = float(np.clip(self.covariance[a, b] / scale, -1.0, 1.0)) if scale > 1e-15 else 0.0

        def reach(first: float, second: float) -> float:
            return float(np.sqrt(max(0.0, first**2 + second**2 - 2 * together * first * second)))

        down, up = reach(p - one.low, two.high - q), reach(one.high - p, q - two.low)
        return max(-1.0, p - q - down), min(1.0, p - q + up)


class Margins:
    """A linear model of `response` (m,) on the columns of `model` (m, columns), which may be dependent; residuals are HC2's.

    Args:
        blocks: (m,) 0..G - 1.
        runs: (m,) behind each response.

    Attributes:
        fitted: (m,).
        explained: Variance of `fitted` beyond that of as many columns of noise.
    """

    def __init__(self, model: Floats, response: Floats, blocks: NDArray[np.int64], runs: Floats) -> None:
        self._model, self._response, self._blocks, self._runs = model, response, blocks, runs
        self._inverse = np.linalg.pinv(model.T @ model, rcond=1e-10, hermitian=True).astype(np.float64)
        self.fitted: Floats = model @ (self._inverse @ (model.T @ response))
        leverage = np.einsum("ij,jk,ik->i", model, self._inverse, model, optimize=True)
        residual: Floats = response - self.fitted
        rank = round(float(leverage.sum()))
        left = len(response) - rank
        noise = float(residual @ residual) / left if left > 0 else float(response.var())
        self.explained = max(0.0, float(self.fitted.var()) - (rank - 1) * noise / len(response))
        self._weighted: Floats = residual / np.sqrt(np.maximum(1.0 - leverage, 0.05))

    def at(self, points: Floats, groups: Sequence[NDArray[np.bool_]]) -> MarginalMeans:
        """Means at `points` (k, columns); `groups` are the rows with each point's level.

        A point that the model cannot estimate, because its level is confounded, has the plain mean of its group.
        """
        combined = points @ self._inverse  # (k, columns)
        told = np.abs(combined @ (self._model.T @ self._model) - points).max(axis=1) < 1e-6
        weights = combined @ self._model.T  # (k, m): means are sums of these times responses
        for k, group in enumerate(groups):
            if not told[k]:
                weights[k] = group / group.sum()
        count = int(self._blocks.max()) + 1
        sums = np.zeros((len(points), count))
        for k in range(len(points)):
            residual = self._weighted if told[k] else self._response - self._response[groups[k]].mean()
            sums[k] = np.bincount(self._blocks, weights=weights[k] * residual, minlength=count)
        covariance = sums @ sums.T * (count / max(count - 1, 1))
        units = np.array([len(np.unique(self._blocks[group])) for group in groups], dtype=np.float64)
        most = np.array([self._runs[group].sum() for group in groups])
        means = np.clip(weights @ self._response, 0.0, 1.0)
        means = np.where(means < 1e-9, 0.0, np.where(means > 1 - 1e-9, 1.0, means))  # rounding is no failure
        return MarginalMeans(means, covariance, units, most)


LEAST_VALUES: Final = 3
"""Distinct values that a trend requires."""


@dataclass(frozen=True, slots=True)
class Trend:
    """The change of the failure rate over a number, other factors held.

    Attributes:
        change: From the smallest to the greatest number, within -1..1; its interval has blocks as clusters.
        smallest, greatest: Of the number.
        p_value: For zero slope; None where it cannot be tested.
        least: As of `Tested`.
    """

    change: float
    change_interval: tuple[float, float]
    smallest: float
    greatest: float
    p_value: float | None
    least: float = 0.0


def trend_of(contrasts: Contrasts, values: Floats, others: Floats, runs: Floats, error: float) -> Trend | None:
    """The trend of the response over `values`; None for fewer than `LEAST_VALUES`, or if they follow from `others`.

    The rates at both ends are `Margins` beside `others`; the test is that of `Contrasts` for one column.

    Args:
        values: (m,), NaN where a configuration lacks the number.
        others: (m, p) columns held, the constant and one that marks missing values among them.
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
    margins = Margins(np.hstack((others, column)), contrasts.response, contrasts.blocks, runs)
    found = margins.at(np.array([[*usual, 0.0], [*usual, 1.0]]), [known, known])
    tested = contrasts.test(column, others)
    return Trend(
        float(found.means[1] - found.means[0]),
        found.difference(1, 0, 1 - error),
        smallest,
        greatest,
        tested.p_value,
        tested.least,
    )
