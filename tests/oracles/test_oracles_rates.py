import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binomtest
from table import each_row

from vastflow.oracles.evidence.rates import Counts, Interval, clustered, counts_of, pooled, wilson
from vastflow.oracles.statistics.intervals import clopper_pearson_intervals, interval


@each_row(("passed", "n"), [(0, 5), (1, 20), (5, 5), (10, 20), (81, 263), (97, 100), (5300, 5480)])
def test_wilson_is_scipys_wilson(passed: int, n: int) -> None:
    expected = binomtest(passed, n).proportion_ci(0.95, method="wilson")
    assert (wilson(passed, n).low, wilson(passed, n).high) == pytest.approx((expected.low, expected.high), abs=1e-12)


def test_wilson_is_the_published_interval_of_81_in_263() -> None:
    # R. G. Newcombe, Statistics in Medicine 17 (1998) 857, table I, method 3: 0.2553 to 0.3662.
    assert wilson(81, 263).low == pytest.approx(0.2553, abs=5e-5)
    assert wilson(81, 263).high == pytest.approx(0.3662, abs=5e-5)


def test_wilson_knows_nothing_without_a_run() -> None:
    assert wilson(0, 0) == Interval(0.0, 1.0)


def test_wilson_ends_at_one_exactly_where_all_pass() -> None:
    assert wilson(5, 5).high == 1.0
    assert wilson(5, 5).low == pytest.approx(5 / (5 + 1.959963984540054**2))


def test_wilson_begins_at_zero_exactly_where_all_fail() -> None:
    assert wilson(0, 5).low == 0.0
    assert wilson(0, 5).high == pytest.approx(1 - wilson(5, 5).low)


def test_wilson_refuses_more_passes_than_runs() -> None:
    with pytest.raises(ValueError, match=r"0\.\.n, got 6 of 5"):
        wilson(6, 5)


@given(st.integers(0, 200), st.integers(0, 200))
def test_wilson_holds_the_rate_and_stays_within_zero_and_one(passed: int, failed: int) -> None:
    interval = wilson(passed, passed + failed)
    assert 0.0 <= interval.low <= interval.high <= 1.0
    if passed + failed:
        assert interval.low <= passed / (passed + failed) <= interval.high


def test_what_was_not_judged_is_in_no_rate() -> None:
    counts = counts_of(["pass", "not judged", "fail", "pass", "not judged"])
    assert counts == Counts(passed=2, failed=1, not_judged=2)
    assert counts.rate == pytest.approx(2 / 3)


def test_there_is_no_rate_without_a_judged_run() -> None:
    assert Counts(not_judged=5).rate is None
    assert Counts(not_judged=5).interval == Interval(0.0, 1.0)


def test_pooled_counts_are_sums() -> None:
    assert pooled([Counts(1, 2, 3), Counts(4, 5, 6)]) == Counts(5, 7, 9)


def test_one_configuration_says_nothing_of_others() -> None:
    assert clustered([Counts(4, 1), Counts(not_judged=5)]) is None


def test_configurations_of_one_block_are_one_cluster_where_there_are_several_blocks() -> None:
    paths = [Counts(9, 1), Counts(8, 2), Counts(1, 9), Counts(2, 8)]
    assert clustered(paths, blocks=[7, 7, 3, 3]) == clustered([Counts(17, 3), Counts(3, 17)])


def test_within_one_block_its_configurations_are_the_clusters() -> None:
    settings = [Counts(9, 1), Counts(8, 2), Counts(1, 9)]
    assert clustered(settings, blocks=[4, 4, 4]) == clustered(settings)


def test_block_without_judged_runs_is_no_cluster() -> None:
    settings = [Counts(9, 1), Counts(8, 2), Counts(not_judged=5)]
    assert clustered(settings, blocks=[4, 4, 9]) == clustered(settings[:2])


def test_where_every_run_passes_each_configuration_counts_once() -> None:
    assert clustered([Counts(20, 0)] * 6) == interval(clopper_pearson_intervals(6, 6))


def test_where_every_run_fails_each_configuration_counts_once() -> None:
    assert clustered([Counts(0, 20)] * 6) == interval(clopper_pearson_intervals(0, 6))


@given(st.lists(st.tuples(st.integers(0, 20), st.integers(0, 20)), min_size=2, max_size=12))
def test_interval_for_others_is_never_narrower_than_that_of_pooled_runs(runs: list[tuple[int, int]]) -> None:
    clusters = [Counts(passed, failed) for passed, failed in runs]
    found, whole = clustered(clusters), pooled(clusters)
    if found is not None:
        low, high = clopper_pearson_intervals(whole.passed, whole.judged)
        assert found.low <= low + 1e-9 and high - 1e-9 <= found.high
