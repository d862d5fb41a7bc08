"""Rates in which a configuration counts as often as it was asked for."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from table import each_row

from vastflow.oracles.evidence.findings import weighted_counts, weighted_rate, weights_of
from vastflow.oracles.evidence.rates import Counts, Interval, clustered, pooled, wilson

judged = st.integers(0, 20).flatmap(lambda n: st.integers(0, n).map(lambda x: Counts(x, n - x)))


def test_configuration_weighs_itself_and_its_duplicates():
    rows = [("a-1", None), ("a-2", None), ("a-3", "a-1"), ("b-1", "a-1"), ("b-2", None)]
    assert weights_of(rows) == {"a-1": 3, "a-2": 1, "b-2": 1}


def test_runs_count_as_often_as_their_configuration():
    found = weighted_rate({"a": Counts(2, 0), "b": Counts(0, 2, 1)}, {"a": 6})
    assert found.counts == Counts(12, 2, 1)
    assert found.rate == 12 / 14


def test_weights_make_no_more_runs_than_there_were():
    """Kish: (6 x 2 + 1 x 2)² / (36 x 2 + 1 x 2) = 196 / 74 effective runs of the four."""
    found = weighted_rate({"a": Counts(2, 0), "b": Counts(0, 2)}, {"a": 6})
    effective = 196 / 74
    assert found.interval == wilson(12 / 14 * effective, effective)


@given(st.dictionaries(st.sampled_from("abcdef"), judged, max_size=6))
def test_equal_weights_change_nothing(counts):
    plain, heavy = weighted_rate(counts, {}), weighted_rate(counts, dict.fromkeys(counts, 4))
    whole = pooled(counts.values())
    assert plain.counts == whole
    assert heavy.rate == plain.rate == whole.rate
    for found in (plain, heavy):
        assert (found.interval.low, found.interval.high) == pytest.approx((whole.interval.low, whole.interval.high))
    assert plain.clustered == clustered(list(counts.values()))


def test_one_configuration_says_nothing_of_others():
    assert weighted_rate({"a": Counts(3, 1)}, {"a": 5}).clustered is None


@each_row("counts", [{}, {"a": Counts(0, 0, 3)}])
def test_without_judged_runs_there_is_no_rate(counts):
    found = weighted_rate(counts, {"a": 2})
    assert (found.rate, found.interval, found.clustered) == (None, Interval(0.0, 1.0), None)


def test_all_pass_and_all_fail_have_intervals_that_end_there():
    assert weighted_rate({"a": Counts(4, 0), "b": Counts(4, 0)}, {"a": 3}).interval.high == 1.0
    assert weighted_rate({"a": Counts(0, 4), "b": Counts(0, 4)}, {"a": 3}).interval.low == 0.0


def test_weight_of_what_was_not_run_is_of_no_account():
    assert weighted_counts({"a": Counts(1, 0)}, {"a": 2, "gone": 9}) == {"a": Counts(2, 0)}
