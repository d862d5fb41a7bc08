"""The interval for other configurations, between that of all runs and that of whole clusters."""

import clustered_coverage as proof
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from table import each_row

from vastflow.oracles.statistics.intervals import clopper_pearson_intervals, clustered_interval

pytestmark = pytest.mark.slow

rows = st.integers(2, 30).flatmap(
    lambda runs: st.lists(st.integers(0, runs), min_size=2, max_size=12).map(lambda passed: (passed, runs))
)


def ends(passed, judged):
    found = clustered_interval(passed, judged)
    return found.low, found.high


def test_clustered_interval_covers_rates_of_good_systems():
    # With the variance of clusters estimated, 82 to 87 % did: rates of 0.95 and 0.98, 10 and 30 clusters.
    assert [each for each in proof.cells(400, 7, [10, 30], [0.95, 0.98], [0.0, 0.2, 0.5, 1.0]) if not each.good] == []
    for each in proof.cells(200, 8, [30], [0.5, 0.8, 0.9, 0.95], [0.0]):
        assert each.width <= 1.2


@pytest.mark.parametrize("clusters", [2, 3, 4])
def test_clustered_interval_covers_rates_of_few_clusters(clusters):
    assert all(each.good for each in proof.cells(400, 9, [clusters], [0.6, 0.9], [0.0, 1 / 3, 1.0]))


@given(rows)
def test_clustered_interval_lies_between_limits_and_mirrors_failures(row):
    passed, runs = np.array(row[0]), row[1]
    low, high = ends(passed, np.full(len(passed), runs))
    of_runs = clopper_pearson_intervals(passed.sum(), runs * len(passed))
    of_clusters = clopper_pearson_intervals(passed.sum() / runs, len(passed))
    assert of_clusters[0] - 1e-9 <= low <= of_runs[0] + 1e-9
    assert of_runs[1] - 1e-9 <= high <= of_clusters[1] + 1e-9
    assert ends(runs - passed, np.full(len(passed), runs)) == pytest.approx((1 - high, 1 - low), abs=1e-9)


@each_row(
    ("passed", "judged", "expected", "within"),
    [
        ([20] * 9 + [0], [20] * 10, clopper_pearson_intervals(9, 10), 0.02),  # clusters that agree count once
        ([20] * 6, [20] * 6, (0.025 ** (1 / 6), 1.0), 1e-9),
        ([1] * 27 + [0] * 3, [1] * 30, clopper_pearson_intervals(27, 30), 1e-3),  # single runs
    ],
)
def test_clustered_interval_has_known_limits(passed, judged, expected, within):
    assert ends(passed, judged) == pytest.approx(tuple(expected), abs=within)


def test_clustered_interval_of_unequal_clusters_is_wide():
    # Ten clusters, one run failed: as independent runs the rate would be above 0.972.
    assert ends([20] * 9 + [19], [20] * 10)[0] < 0.9
    low, high = ends([1000, 0, 0, 0], [1000, 10, 10, 10])
    assert low < 0.25 and high > 1000 / 1030
    assert clustered_interval([4, 0], [5, 0]) is None
    assert ends([4, 3, 0], [5, 5, 0]) == ends([4, 3], [5, 5])


def test_clustered_interval_of_many_clusters_is_as_narrow_as_their_spread():
    passed, judged = np.random.default_rng(4).binomial(20, 0.85, 5480), np.full(5480, 20)
    of_runs = clopper_pearson_intervals(passed.sum(), 5480 * 20)
    assert np.ptp(ends(passed, judged)) == pytest.approx(np.ptp(of_runs), rel=0.05)
    # Of 5,480 clusters of B(0.6, 0.3) the mean has a standard error of sqrt(2/9 · (0.526 + 0.474/20) / 5480) = 0.0047.
    passed = np.random.default_rng(1).binomial(20, np.random.default_rng(2).beta(0.6, 0.3, 5480))
    assert np.mean(ends(passed, judged)) == pytest.approx(passed.mean() / 20, abs=0.003)
    assert np.ptp(ends(passed, judged)) == pytest.approx(2 * 1.96 * 0.0047, rel=0.1)
