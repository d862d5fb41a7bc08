"""Failure maps: the rate of failures of the runs that visit each place."""

from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vastflow.oracles.statistics.intervals import LEVEL, Floats, few_clusters, wilson_intervals
from vastflow.oracles.statistics.tails import false_discovery

MINIMUM_VISITS: Final = 5
"""Fewest visits for a rate."""
LAST_M: Final = 0.5
"""Length of the end of a path where a run failed."""


@dataclass(frozen=True, slots=True)
class FailureGrid:
    """Square cells in the map frame.

    Attributes:
        origin_xy_m: The lowest corner of cell (0, 0).
        shape: Rows (along y) and columns (along x).
    """

    origin_xy_m: tuple[float, float]
    cell_m: float
    shape: tuple[int, int]

    @property
    def extent_m(self) -> tuple[float, float, float, float]:
        (x0, y0), (rows, columns) = self.origin_xy_m, self.shape
        return x0, x0 + columns * self.cell_m, y0, y0 + rows * self.cell_m

    def cells(self, xy_m: Floats) -> NDArray[np.int64]:
        """Index row · columns + column of the cell of each position (N, 2); -1 outside."""
        rows, columns = self.shape
        column, row = np.floor((xy_m - np.array(self.origin_xy_m)) / self.cell_m).astype(np.int64).T
        inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
        return np.where(inside, row * columns + column, -1)


@dataclass(frozen=True, eq=False)
class FailureMap:
    """Visits and failures of each cell of a grid, (H, W) each.

    A run visits a cell once. A failed run is one failure in each cell of its last half meter. Configurations are clusters: for m of them with
    n_i visits and x_i failures, N = Σ n_i and p = Σ x_i / N, the variance is V = m/(m - 1) Σ (x_i - p n_i)² / N² (Cochran, Sampling
    Techniques, 1977, §6.3) and the effective number of visits p(1 - p) / V, at most N. Maps of different configurations on one grid can be added.

    Attributes:
        visits, failures: Numbers of runs.
        configurations: Number that visited the cell.
        squares: (3, H, W) sums over configurations of failures², failures · visits and visits².
    """

    grid: FailureGrid
    visits: NDArray[np.int64] = field(repr=False)
    failures: NDArray[np.int64] = field(repr=False)
    configurations: NDArray[np.int64] = field(repr=False)
    squares: NDArray[np.int64] = field(repr=False)

    def __add__(self, other: "FailureMap") -> "FailureMap":
        return FailureMap(
            self.grid,
            self.visits + other.visits,
            self.failures + other.failures,
            self.configurations + other.configurations,
            self.squares + other.squares,
        )

    def rate(self, minimum_visits: int = MINIMUM_VISITS) -> Floats:
        """Failures over visits (H, W); NaN below `minimum_visits` visits."""
        known = self.visits >= max(minimum_visits, 1)
        return np.where(known, self.failures / np.maximum(self.visits, 1), np.nan)

    def effective_visits(self) -> Floats:
        n, m = np.maximum(self.visits, 1).astype(np.float64), self.configurations.astype(np.float64)
        p = self.failures / n
        failures2, both, visits2 = self.squares.astype(np.float64)
        spread = np.maximum(failures2 - 2 * p * both + p * p * visits2, 0.0)
        variance = np.where(m > 1, m / np.maximum(m - 1, 1) * spread / n**2, 0.0)
        varies = (variance > 1e-15) & (p > 0) & (p < 1)
        mixed = (p > 0) & (p < 1) & (m > 1)
        effective = np.where(varies, p * (1 - p) / np.where(varies, variance, 1.0), n)
        effective = np.where(mixed, effective, m)  # all or none: each configuration counts once
        return np.where(self.visits > 0, np.minimum(effective, n), 0.0)

    def intervals(self, level: float = LEVEL) -> Floats:
        """Wilson intervals (H, W, 2) of the rates at the effective number of visits times (z/t)²; 0..1 without visits.

        Student's t has m - 1 degrees of freedom (Korn and Graubard, Survey Methodology 24 (1998) 193). Too narrow where failures are rare.
        """
        n, m = self.effective_visits(), self.configurations
        mixed = (self.failures > 0) & (self.failures < self.visits) & (m > 1)
        n = np.where(mixed, n * few_clusters(m, level), n)
        return wilson_intervals(n * self.failures / np.maximum(self.visits, 1), n, level)

    def hot(self) -> NDArray[np.bool_]:
        """Cells (H, W) shown to fail more often than all visits do, at a false discovery rate of 5 %.

        One-sided t tests over the larger standard error of the cell's rate and of that of all, with m - 1 degrees of freedom for m visiting
        configurations; where every visit fails, the p-value is the rate of all to the power of m.
        """
        found = np.zeros(self.grid.shape, dtype=bool)
        usual = float(self.failures.sum()) / max(int(self.visits.sum()), 1)
        if not 0.0 < usual < 1.0:
            return found
        from scipy.special import stdtr

        tested = self.visits >= MINIMUM_VISITS
        n, p, m = self.effective_visits()[tested], self.rate(1)[tested], self.configurations[tested]
        scores = (p - usual) / np.sqrt(np.maximum(usual * (1 - usual), p * (1 - p)) / n)
        p_values = np.where(p == 1.0, usual**m, stdtr(np.maximum(m - 1, 1), -scores))
        found[tested] = false_discovery(p_values) <= 0.05
        return found


def grid_over(x0_m: float, y0_m: float, x1_m: float, y1_m: float, cell_m: float = 0.25) -> FailureGrid:
    """The grid from (x0, y0) that covers the rectangle up to (x1, y1)."""
    columns, rows = (max(1, int(np.ceil((high - low) / cell_m - 1e-9))) for low, high in ((x0_m, x1_m), (y0_m, y1_m)))
    return FailureGrid((x0_m, y0_m), cell_m, (rows, columns))


def empty_map(grid: FailureGrid) -> FailureMap:
    zeros = np.zeros(grid.shape, dtype=np.int64)
    return FailureMap(grid, zeros, zeros, zeros, np.zeros((3, *grid.shape), dtype=np.int64))


def failure_map(
    grid: FailureGrid, xy_m: Floats, starts: ArrayLike, failed: ArrayLike, configurations: ArrayLike | None = None
) -> FailureMap:
    """Count visits and failures.

    Args:
        xy_m: (N, 2) positions of all runs one after another, closer together than a cell.
        starts: (R + 1,) index of each run's first position, and N.
        failed: (R,) whether the run failed; only judged runs.
        configurations: (R,) number of each run's configuration; by default one.
    """
    import pandas as pd  # takes a third of a second

    begin = np.asarray(starts, dtype=np.int64)
    bad = np.asarray(failed, dtype=bool)
    runs = len(bad)
    of = np.zeros(runs, dtype=np.int64) if configurations is None else np.asarray(configurations, dtype=np.int64)
    run = np.repeat(np.arange(runs), np.diff(begin))
    cell = grid.cells(np.asarray(xy_m, dtype=np.float64))
    steps = np.zeros(len(xy_m))
    steps[1:] = np.hypot(*np.diff(xy_m, axis=0).T)
    along = np.cumsum(steps)
    left = along[np.maximum(begin[run + 1] - 1, 0)] - along if runs else along
    ended = bad[run] & (left <= LAST_M) if runs else np.zeros(0, dtype=bool)
    cells, here = grid.shape[0] * grid.shape[1], cell >= 0
    # In each cell each run that visited it, and whether it failed there; of these, how many of each configuration.
    failed_there = pd.Series(ended[here]).groupby(run[here] * cells + cell[here]).any()
    keys = failed_there.index.to_numpy(np.int64)
    counted = failed_there.groupby(of[keys // cells] * cells + keys % cells).agg(["size", "sum"])
    at, came, fell = (values.to_numpy(np.int64) for values in (counted.index % cells, counted["size"], counted["sum"]))

    def total(values: NDArray[np.int64]) -> NDArray[np.int64]:
        return np.bincount(at, weights=values, minlength=cells).astype(np.int64).reshape(grid.shape)

    squares = np.stack([total(fell * fell), total(fell * came), total(came * came)])
    return FailureMap(grid, total(came), total(fell), total(np.ones_like(came)), squares)
