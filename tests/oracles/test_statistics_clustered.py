"""The interval for others: between that of all runs and that of whole clusters, and as sure as it says."""

import clustered_coverage as proof
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vastflow.oracles.statistics.intervals import clopper_pearson_intervals, clustered_interval

pytestmark = pytest.mark.slow

rows = st.integers(2, 30).flatmap(
    lambda runs: st.lists(st.integers(0, runs), min_size=2, max_size=12).map(lambda passed: (passed, runs))
)


def test_ninety_three_of_a_hundred_intervals_hold_the_rate_of_their_kind_where_systems_are_good() -> None:
    # With the variance of clusters estimated, 82 to 87 % did: rates of 0.95 and 0.98, 10 and 30 clusters.
    found = list(proof.cells(400, 7, [10, 30], [0.95, 0.98], [0.0, 0.2, 0.5, 1.0]))
    assert [each for each in found if not each.good] == []


def test_independent_runs_of_thirty_clusters_have_hardly_a_wider_interval_than_if_it_were_known() -> None:
    for each in proof.cells(200, 8, [30], [0.5, 0.8, 0.9, 0.95], [0.0]):
        assert each.width <= 1.2


@pytest.mark.parametrize("clusters", [2, 3, 4])
def test_interval_holds_the_rate_however_few_clusters_there_are(clusters: int) -> None:
    for each in proof.cells(400, 9, [clusters], [0.6, 0.9], [0.0, 1 / 3, 1.0]):
        assert each.good


@given(rows)
def test_it_lies_between_the_interval_of_all_runs_and_that_of_whole_clusters(row: tuple[list[int], int]) -> None:
    passed, runs = row
    found = clustered_interval(passed, [runs] * len(passed))
    of_runs = clopper_pearson_intervals(sum(passed), runs * len(passed))
    of_clusters = clopper_pearson_intervals(sum(passed) / runs, len(passed))
    assert found is not None
    assert of_clusters[0] - 1e-9 <= found.low <= of_runs[0] + 1e-9
    assert of_runs[1] - 1e-9 <= found.high <= of_clusters[1] + 1e-9


@given(rows)
def test_failures_have_the_interval_that_passes_leave(row: tuple[list[int], int]) -> None:
    passed, runs = np.array(row[0]), row[1]
    of_passes = clustered_interval(passed, np.full(len(passed), runs))
    of_failures = clustered_interval(runs - passed, np.full(len(passed), runs))
    assert of_passes is not None and of_failures is not None
    assert (of_failures.low, of_failures.high) == pytest.approx((1 - of_passes.high, 1 - of_passes.low), abs=1e-9)


def test_clusters_that_agree_in_themselves_count_once_each() -> None:
    found = clustered_interval([20] * 9 + [0], [20] * 10)
    assert found is not None
    assert (found.low, found.high) == pytest.approx(tuple(clopper_pearson_intervals(9, 10)), abs=0.02)


def test_where_all_pass_each_cluster_counts_once() -> None:
    found = clustered_interval([20] * 6, [20] * 6)
    assert found is not None
    assert (found.low, found.high) == pytest.approx((0.025 ** (1 / 6), 1.0))


def test_one_failure_does_not_make_runs_independent() -> None:
    # Ten clusters, one run failed: as independent runs the rate would be above 0.972.
    found = clustered_interval([20] * 9 + [19], [20] * 10)
    assert found is not None
    assert found.low < 0.9


def test_single_runs_are_clusters_of_their_own() -> None:
    found = clustered_interval([1] * 27 + [0] * 3, [1] * 30)
    assert found is not None
    assert (found.low, found.high) == pytest.approx(tuple(clopper_pearson_intervals(27, 30)), abs=1e-3)


def test_very_many_runs_have_an_interval_as_narrow_as_theirs() -> None:
    passed = np.random.default_rng(4).binomial(20, 0.85, 5480)
    found = clustered_interval(passed, np.full(5480, 20))
    of_runs = clopper_pearson_intervals(passed.sum(), 5480 * 20)
    assert found is not None
    assert found.high - found.low == pytest.approx(of_runs[1] - of_runs[0], rel=0.05)


def test_very_many_clusters_tell_the_correlation_and_so_the_rate_as_well_as_their_spread_does() -> None:
    # Of 5,480 clusters of B(0.6, 0.3) the mean has a standard error of sqrt(2/9 · (0.526 + 0.474/20) / 5480) = 0.0047.
    passed = np.random.default_rng(1).binomial(20, np.random.default_rng(2).beta(0.6, 0.3, 5480))
    found = clustered_interval(passed, np.full(5480, 20))
    assert found is not None
    assert (found.low + found.high) / 2 == pytest.approx(passed.mean() / 20, abs=0.003)
    assert found.high - found.low == pytest.approx(2 * 1.96 * 0.0047, rel=0.1)


def test_it_holds_the_pooled_rate_where_clusters_differ_in_size() -> None:
    found = clustered_interval([1000, 0, 0, 0], [1000, 10, 10, 10])
    assert found is not None
    assert found.low < 0.25 and found.high > 1000 / 1030


def test_configurations_without_judged_runs_are_no_clusters() -> None:
    assert clustered_interval([4, 0], [5, 0]) is None
    assert clustered_interval([4, 3, 0], [5, 5, 0]) == clustered_interval([4, 3], [5, 5])
