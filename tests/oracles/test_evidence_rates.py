"""Rates of pooled, clustered, and weighted configurations, and the words on a search's best point."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from table import each_row

from vastflow.oracles.evidence.findings import weighted_counts, weighted_rate, weights_of
from vastflow.oracles.evidence.rates import Counts, Interval, clustered, counts_of, pooled, wilson
from vastflow.oracles.evidence.searched import found_text
from vastflow.oracles.statistics.intervals import clopper_pearson_intervals, interval

judged = st.integers(0, 20).flatmap(lambda n: st.integers(0, n).map(lambda x: Counts(x, n - x)))


def test_counts_leave_unjudged_runs_out_of_rates():
    counts = counts_of(["pass", "not judged", "fail", "pass", "not judged"])
    assert (counts, counts.rate) == (Counts(passed=2, failed=1, not_judged=2), pytest.approx(2 / 3))
    assert (Counts(not_judged=5).rate, Counts(not_judged=5).interval) == (None, Interval(0.0, 1.0))
    assert pooled([Counts(1, 2, 3), Counts(4, 5, 6)]) == Counts(5, 7, 9)


SETTINGS = [Counts(9, 1), Counts(8, 2), Counts(1, 9)]


@each_row(
    ("configurations", "blocks", "expected"),
    [
        ([Counts(4, 1), Counts(not_judged=5)], None, None),
        ([*SETTINGS, Counts(2, 8)], [7, 7, 3, 3], clustered([Counts(17, 3), Counts(3, 17)])),
        (SETTINGS, [4, 4, 4], clustered(SETTINGS)),
        ([*SETTINGS[:2], Counts(not_judged=5)], [4, 4, 9], clustered(SETTINGS[:2])),
        ([Counts(20, 0)] * 6, None, interval(clopper_pearson_intervals(6, 6))),
        ([Counts(0, 20)] * 6, None, interval(clopper_pearson_intervals(0, 6))),
    ],
)
def test_clustered_takes_blocks_or_configurations_as_clusters(configurations, blocks, expected):
    assert clustered(configurations, blocks=blocks) == expected


@given(st.lists(judged, min_size=2, max_size=12))
def test_clustered_is_never_narrower_than_interval_of_pooled_runs(clusters):
    whole = pooled(clusters)
    if (found := clustered(clusters)) is not None:
        low, high = clopper_pearson_intervals(whole.passed, whole.judged)
        assert found.low <= low + 1e-9 and high - 1e-9 <= found.high


def test_weights_count_configurations_with_their_duplicates():
    rows = [("a-1", None), ("a-2", None), ("a-3", "a-1"), ("b-1", "a-1"), ("b-2", None)]
    assert weights_of(rows) == {"a-1": 3, "a-2": 1, "b-2": 1}
    assert weighted_counts({"a": Counts(1, 0)}, {"a": 2, "gone": 9}) == {"a": Counts(2, 0)}
    assert weighted_rate({"a": Counts(2, 0), "b": Counts(0, 2, 1)}, {"a": 6}).counts == Counts(12, 2, 1)
    # Kish: (6 · 2 + 1 · 2)² / (36 · 2 + 1 · 2) = 196 / 74 effective runs of the four.
    effective = 196 / 74
    found = weighted_rate({"a": Counts(2, 0), "b": Counts(0, 2)}, {"a": 6})
    assert found.interval == wilson(12 / 14 * effective, effective)
    assert weighted_rate({"a": Counts(3, 1)}, {"a": 5}).clustered is None
    assert weighted_rate({"a": Counts(4, 0), "b": Counts(4, 0)}, {"a": 3}).interval.high == 1.0
    assert weighted_rate({"a": Counts(0, 4), "b": Counts(0, 4)}, {"a": 3}).interval.low == 0.0


@given(st.dictionaries(st.sampled_from("abcdef"), judged, max_size=6))
def test_equal_weights_change_nothing(counts):
    plain, heavy = weighted_rate(counts, {}), weighted_rate(counts, dict.fromkeys(counts, 4))
    whole = pooled(counts.values())
    assert plain.counts == whole
    assert heavy.rate == plain.rate == whole.rate
    for found in (plain, heavy):
        assert (found.interval.low, found.interval.high) == pytest.approx((whole.interval.low, whole.interval.high))
    assert plain.clustered == clustered(list(counts.values()))


@each_row("counts", [{}, {"a": Counts(0, 0, 3)}])
def test_weighted_rate_needs_judged_runs(counts):
    found = weighted_rate(counts, {"a": 2})
    assert (found.rate, found.interval, found.clustered) == (None, Interval(0.0, 1.0), None)


def said(**parts):
    best = {"configuration": "point-0007", "point": {}, "objective": 0.9, "runs": 10}
    confirmation = {"runs": 60, "samples": [1.0] * 42 + [0.0] * 18, "found": 0.9}
    return {"objective": "failure_rate", "is_rate": True, "best": best, "confirmation": confirmation, **parts}


def beside(as_good):
    best = {"configuration": "random-0003", "point": {}, "objective": 0.4, "runs": 10}
    runs = {"runs": 500, "runs_until_best": 43, "runs_until_as_good": as_good}
    return {"baseline": {"strategy": "random", "best": best, **runs}}


CONFIRMED = "point-0007: failure rate found at 90 %, confirmed at 70 % [56, 82] on 60 fresh runs."


@each_row(
    ("parts", "text"),
    [
        ({}, CONFIRMED),
        ({"confirmation": None}, "point-0007: failure rate found at 90 % on 10 runs; not confirmed."),
        ({"best": None}, "No point was judged."),
        ({"is_rate": False, "objective": "time"}, "point-0007: time found at 0.9; the mean of 60 fresh runs is 0.7."),
        (beside(428), f"{CONFIRMED} Found after 43 runs, by random search after 428."),
        (beside(None), f"{CONFIRMED} Found after 43 runs; random search comes to 40 % in 500 runs."),
    ],
)
def test_found_text_confirms_best_point(parts, text):
    assert found_text(said(**parts)) == text


def test_interval_of_fresh_runs_covers_rate_after_selection():
    # 200 searches among 100 points: the best of 5 runs each looks worse than it is, its fresh runs do not.
    draws = np.random.default_rng(1)
    covered, excess = 0, []
    for _ in range(200):
        rates = draws.uniform(0.0, 0.6, 100)
        failed = draws.binomial(5, rates)
        best = int(np.argmax(failed))
        low, high = clopper_pearson_intervals(draws.binomial(60, rates[best]), 60)
        covered += low <= rates[best] <= high
        excess.append(failed[best] / 5 - rates[best])
    assert covered >= 190 - 3 * (200 * 0.05 * 0.95) ** 0.5
    assert np.mean(excess) > 0.3
