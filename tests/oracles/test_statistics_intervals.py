"""Intervals of rates and of means of bounded quantities, against scipy and published tables."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binomtest
from table import each_row

from vastflow.oracles.statistics.intervals import (
    clopper_pearson_intervals,
    mean_interval,
    needed,
    normal_quantile,
    wilson_intervals,
)

METHODS = (("wilson", wilson_intervals), ("exact", clopper_pearson_intervals))


@given(st.integers(1, 300), st.floats(0, 1), st.sampled_from([0.8, 0.95, 0.99]))
def test_intervals_agree_with_scipy(n, share, level):
    passed = round(n * share)
    for method, ours in METHODS:
        expected = binomtest(passed, n).proportion_ci(level, method=method)
        low, high = ours(passed, n, level)
        assert (low, high) == pytest.approx((expected.low, expected.high), abs=1e-9)
        assert 0.0 <= low <= passed / n <= high <= 1.0


def test_intervals_are_published_ones():
    # R. G. Newcombe, Statistics in Medicine 17 (1998) 857, table I, methods 3 and 5.
    passed, judged = [81, 15, 0, 1], [263, 148, 20, 29]
    wilson = [[0.2553, 0.3662], [0.0624, 0.1605], [0.0, 0.1611], [0.0061, 0.1718]]
    exact = [[0.2527, 0.3676], [0.0578, 0.1617], [0.0, 0.1684], [0.0009, 0.1776]]
    assert wilson_intervals(passed, judged) == pytest.approx(np.array(wilson), abs=5e-5)
    assert clopper_pearson_intervals(passed, judged) == pytest.approx(np.array(exact), abs=5e-5)


def test_intervals_end_exactly_at_zero_and_one():
    # (a/2)^(1/n) and 1 - (a/2)^(1/n) by hand; n / (n + z²) and 1 - that.
    edge, z = 0.025 ** (1 / 20), normal_quantile(0.95)
    assert clopper_pearson_intervals([20, 0], [20, 20]) == pytest.approx(np.array([[edge, 1.0], [0.0, 1 - edge]]))
    low, high = wilson_intervals([5, 0], [5, 5])
    assert (low[1], high[0]) == (1.0, 0.0)
    assert (low[0], 1 - high[1]) == pytest.approx((5 / (5 + z * z),) * 2)
    for _, ours in METHODS:
        assert ours([0], [0]).tolist() == [[0.0, 1.0]]


def test_intervals_of_many_configurations_take_one_call_and_refuse_impossible_counts():
    intervals = wilson_intervals(np.arange(5480) % 21, np.full(5480, 20))
    assert intervals.shape == (5480, 2)
    assert intervals[7] == pytest.approx(wilson_intervals(7, 20))
    for _, ours in METHODS:
        with pytest.raises(ValueError, match=r"0\.\.n, got 6 of 5"):
            ours([1, 6, 7], [5, 5, 5])


@given(st.integers(0, 400), st.integers(0, 400))
def test_mean_interval_of_extreme_values_is_exact_interval_of_rate(worst, best):
    if n := worst + best:
        expected = binomtest(best, n).proportion_ci(0.95, "exact")
        found = mean_interval(np.repeat([-1.0, 1.0], [worst, best]))
        assert found == pytest.approx((2 * expected.low - 1, 2 * expected.high - 1), abs=1e-5)


@each_row("values", [[0.0, 0.0], [0.3, -0.2, 0.5], [0.0] * 20 + [-1.0], [0.25] * 4, list(np.linspace(-0.2, 0.1, 40))])
def test_mean_interval_is_quantile_under_dirichlet_weights(values):
    weights = np.random.default_rng(5).dirichlet(np.ones(len(values) + 1), 100_000)
    seen, unseen = weights[:, 1:] @ np.array(values), weights[:, 0]
    low, high = mean_interval(values)
    # Shares of draws have a standard error of sqrt(0.025 · 0.975 / 100,000) = 0.0005.
    assert np.mean(seen - unseen < low) == pytest.approx(0.025, abs=0.0025)
    assert np.mean(seen + unseen > high) == pytest.approx(0.025, abs=0.0025)


@given(st.lists(st.floats(-1, 1), min_size=1, max_size=40))
def test_mean_interval_holds_mean_within_bounds(values):
    low, high = mean_interval(values)
    assert -1.0 <= low <= np.mean(values) + 1e-9
    assert np.mean(values) - 1e-9 <= high <= 1.0


def test_mean_interval_of_many_values_is_normal():
    values = np.random.default_rng(6).choice([-1.0, 0.0, 1.0], 109_600, p=[0.1, 0.85, 0.05])
    half = 1.96 * values.std() / len(values) ** 0.5
    assert mean_interval(values) == pytest.approx((values.mean() - half, values.mean() + half), abs=2e-5)


def test_mean_interval_refuses_values_beyond_one():
    for values in ([0.5, 1.5], []):
        with pytest.raises(ValueError, match=r"values within -1\.\.1, got \["):
            mean_interval(values)


def test_needed_zeros_are_fewest_that_rule_out_margin():
    for margin in (0.005, 0.02, 0.1, 0.5):
        least = needed(margin)
        assert mean_interval(np.zeros(least))[0] > -margin > mean_interval(np.zeros(least - 1))[0]
    assert (needed(0.0), needed(1.0)) == (None, 1)
