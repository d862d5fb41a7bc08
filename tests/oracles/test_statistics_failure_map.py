"""Failure maps: visits, failures, intervals, and marked cells."""

import numpy as np
import pytest
from table import each_row

from vastflow.oracles.statistics.failure_map import FailureGrid, FailureMap, empty_map, failure_map, grid_over
from vastflow.oracles.statistics.intervals import wilson_intervals

GRID = grid_over(0.0, 0.0, 4.0, 1.0, cell_m=1.0)


def along(*x_m):
    return np.array([(x, 0.5) for x in x_m]).reshape(-1, 2)


def mapped(*ways, failed, **given):
    starts = np.r_[0, np.cumsum([len(way) for way in ways])].astype(int)
    return failure_map(GRID, np.concatenate(ways), starts, failed, **given)


def drawn(rng, configurations, rates):
    """A row of cells with ten visits of each configuration, whose rates are spread around those of the cells."""
    visits = np.full((configurations, 1, len(rates)), 10)
    failures = rng.binomial(10, rng.beta(2 * rates, 2 * (1 - rates), visits.shape))
    squares = np.stack([(failures**2).sum(0), (failures * visits).sum(0), (visits**2).sum(0)])
    came = np.full((1, len(rates)), configurations)
    return FailureMap(FailureGrid((0.0, 0.0), 0.25, came.shape), visits.sum(0), failures.sum(0), came, squares)


@each_row(
    ("ways", "failed", "visits", "failures"),
    [
        ([along(0.2, 0.8, 1.2, 0.8, 0.2, 1.4)], [False], [1, 1, 0, 0], [0, 0, 0, 0]),  # a cell is visited once
        ([along(0.5, 0.9, 1.3, 1.7, 2.1), along(0.5, 1.5)], [True, False], [2, 2, 1, 0], [0, 1, 1, 0]),
        ([along(0.9, 1.1, 1.4, 1.1, 1.4)], [True], [1, 1, 0, 0], [0, 1, 0, 0]),  # path, not distance
        ([along(2.5, 2.5, 2.5)], [True], [0, 0, 1, 0], [0, 0, 1, 0]),  # never moved
        ([along(-0.5, 0.5), along(), along(9.0)], [False, True, True], [1, 0, 0, 0], [0, 0, 0, 0]),  # off the grid
    ],
)
def test_failure_map_counts_visits_and_last_half_meter(ways, failed, visits, failures):
    found = mapped(*ways, failed=failed)
    assert (found.visits.tolist(), found.failures.tolist()) == ([visits], [failures])


def test_rate_needs_visits_and_maps_add_up():
    found = mapped(*[along(0.5)] * 4, along(0.5, 1.5), failed=[True, False, False, False, False])
    assert found.rate(5)[0, 0] == pytest.approx(0.2)
    assert np.isnan(found.rate(5)[0, 1:]).all()
    ways, failed = [along(0.5, 1.5), along(0.5), along(0.5, 1.5), along(1.5)], [True, False, False, True]
    together = mapped(*ways, failed=failed, configurations=[0, 0, 1, 1])
    added = empty_map(GRID) + mapped(*ways[:2], failed=failed[:2]) + mapped(*ways[2:], failed=failed[2:])
    for name in ("visits", "failures", "configurations", "squares"):
        assert np.array_equal(getattr(added, name), getattr(together, name))


def test_intervals_have_configurations_as_clusters():
    failures, visits = [3, 0, 4, 1], [5, 5, 5, 4]
    failed = [k < f for f, v in zip(failures, visits, strict=True) for k in range(v)]
    found = mapped(*[along(0.5)] * sum(visits), failed=failed, configurations=np.repeat(np.arange(4), visits))
    # p = 8/19, x - p n = 17/19, -40/19, 36/19, -13/19: V = 4/3 · 3354/19² / 19² = 0.034315, so p(1 - p)/V = 7.1034 visits;
    # t with 3 degrees of freedom is 3.182446.
    effective = 7.1034 * (1.959964 / 3.182446) ** 2
    assert found.intervals()[0, 0] == pytest.approx(wilson_intervals(8 / 19 * effective, effective), abs=1e-4)
    one = mapped(*[along(0.5)] * 20, failed=[True] * 20).intervals()
    assert one[0, 0] == pytest.approx(wilson_intervals(1, 1))
    assert one[0, 3] == pytest.approx([0.0, 1.0])


def test_hot_marks_planted_cell_alone():
    rng = np.random.default_rng(2)
    found = empty_map(GRID)
    for _ in range(60):
        bad = rng.random(10) < 0.4
        ways = [along(0.5, 1.5, 2.5) if fails else along(0.5, 1.5, 2.5, 3.5) for fails in bad]
        found += mapped(*ways, failed=bad.tolist())
    assert found.hot().tolist() == [[False, False, True, False]]
    rates = np.r_[np.full(10, 0.8), np.full(190, 0.1)]
    hot = drawn(np.random.default_rng(3), 20, rates).hot().ravel()
    assert hot[:10].mean() >= 0.9 and hot[10:].sum() <= 1
    assert not mapped(*[along(0.5)] * 9, failed=[False] * 9).hot().any()
    assert not empty_map(GRID).hot().any()


@each_row("configurations", [1, 2, 3, 5, 12])
def test_hot_rarely_marks_cells_that_fail_like_others(configurations):
    # Configurations differ much: rates from B(0.4, 1.6), mean 0.2, the same in every cell, so that each mark is a false one.
    rng = np.random.default_rng(3)
    marked = sum(drawn(rng, configurations, np.full(200, 0.2)).hot().any() for _ in range(100))
    assert marked / 100 <= 0.05 + 4 * (0.05 * 0.95 / 100) ** 0.5
    grid = grid_over(-1.0, 2.0, 1.1, 3.0, cell_m=0.5)
    assert (grid.shape, grid.extent_m) == ((2, 5), (-1.0, 1.5, 2.0, 3.0))
