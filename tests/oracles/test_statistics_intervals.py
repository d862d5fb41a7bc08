"""Intervals of rates, of means of bounded quantities, and of clustered runs, and over-dispersion."""

import clustered_coverage as proof
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import betabinom, binomtest
from table import each_row

from vastflow.oracles.statistics import intervals
from vastflow.oracles.statistics.dispersion import chance_of_at_least, dispersion

METHODS = (("wilson", intervals.wilson_intervals), ("exact", intervals.clopper_pearson_intervals))


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
    assert intervals.wilson_intervals(passed, judged) == pytest.approx(np.array(wilson), abs=5e-5)
    assert intervals.clopper_pearson_intervals(passed, judged) == pytest.approx(np.array(exact), abs=5e-5)


def test_intervals_of_many_configurations_take_one_call_and_refuse_impossible_counts():
    many = intervals.wilson_intervals(np.arange(5480) % 21, np.full(5480, 20))
    assert many.shape == (5480, 2)
    assert many[7] == pytest.approx(intervals.wilson_intervals(7, 20))
    for _, ours in METHODS:
        assert ours([0], [0]).tolist() == [[0.0, 1.0]]
        with pytest.raises(ValueError, match=r"0\.\.n, got 6 of 5"):
            ours([1, 6, 7], [5, 5, 5])


@given(st.integers(0, 400), st.integers(0, 400))
def test_mean_interval_of_extreme_values_is_exact_interval_of_rate(worst, best):
    if n := worst + best:
        expected = binomtest(best, n).proportion_ci(0.95, "exact")
        found = intervals.mean_interval(np.repeat([-1.0, 1.0], [worst, best]))
        assert found == pytest.approx((2 * expected.low - 1, 2 * expected.high - 1), abs=1e-5)


@each_row("values", [[0.0, 0.0], [0.3, -0.2, 0.5], [0.0] * 20 + [-1.0], [0.25] * 4, list(np.linspace(-0.2, 0.1, 40))])
def test_mean_interval_is_quantile_under_dirichlet_weights(values):
    weights = np.random.default_rng(5).dirichlet(np.ones(len(values) + 1), 100_000)
    seen, unseen = weights[:, 1:] @ np.array(values), weights[:, 0]
    low, high = intervals.mean_interval(values)
    # Shares of draws have a standard error of sqrt(0.025 · 0.975 / 100,000) = 0.0005.
    assert np.mean(seen - unseen < low) == pytest.approx(0.025, abs=0.0025)
    assert np.mean(seen + unseen > high) == pytest.approx(0.025, abs=0.0025)


@given(st.lists(st.floats(-1, 1), min_size=1, max_size=40))
def test_mean_interval_holds_mean_within_bounds(values):
    low, high = intervals.mean_interval(values)
    assert -1.0 <= low <= np.mean(values) + 1e-9
    assert np.mean(values) - 1e-9 <= high <= 1.0


def test_mean_interval_of_many_values_is_normal():
    values = np.random.default_rng(6).choice([-1.0, 0.0, 1.0], 109_600, p=[0.1, 0.85, 0.05])
    half = 1.96 * values.std() / len(values) ** 0.5
    assert intervals.mean_interval(values) == pytest.approx((values.mean() - half, values.mean() + half), abs=2e-5)


def test_mean_interval_refuses_values_beyond_one_and_zeros_rule_out_margin():
    for values in ([0.5, 1.5], []):
        with pytest.raises(ValueError, match=r"values within -1\.\.1, got \["):
            intervals.mean_interval(values)
    for margin in (0.005, 0.02, 0.1, 0.5):
        least = intervals.needed(margin)
        assert intervals.mean_interval(np.zeros(least))[0] > -margin > intervals.mean_interval(np.zeros(least - 1))[0]
    assert (intervals.needed(0.0), intervals.needed(1.0)) == (None, 1)


# Boys among the first 12 children of 6115 families with 13 (Saxony, A. Geißler 1889; Lindsey and Altham 1998).
FAMILIES = np.repeat(np.arange(13), [3, 24, 104, 286, 670, 1033, 1343, 1112, 829, 478, 181, 45, 7])
# Rat pups that lived of those born, 16 treated litters (C. S. Weil, Food Cosmet. Toxicol. 8 (1970) 177).
ALIVE = [12, 11, 10, 9, 10, 9, 9, 8, 8, 4, 7, 4, 5, 3, 3, 0]
BORN = [12, 11, 10, 9, 11, 10, 10, 9, 9, 5, 9, 7, 10, 6, 10, 7]


def test_dispersion_is_published_one():
    found = dispersion(FAMILIES, np.full(len(FAMILIES), 12))
    assert (found.alpha, found.beta) == pytest.approx((34.1, 31.58), abs=0.02)
    assert found.icc == pytest.approx(0.0150, abs=5e-5)
    assert found.p_value < 1e-9
    # D. A. Williams, Biometrics 31 (1975) 949: mean 0.74, theta = 1/(alpha + beta) = 0.465.
    found = dispersion(ALIVE, BORN)
    assert 1 / (found.alpha + found.beta) == pytest.approx(0.465, abs=5e-4)
    assert found.alpha / (found.alpha + found.beta) == pytest.approx(0.74, abs=5e-3)
    best = betabinom.logpmf(ALIVE, BORN, found.alpha, found.beta).sum()
    for a, b in ((1.02, 1.0), (0.98, 1.0), (1.0, 1.02), (1.0, 0.98)):
        assert betabinom.logpmf(ALIVE, BORN, a * found.alpha, b * found.beta).sum() < best


@each_row(
    ("passed", "judged", "expected"),
    [
        ([20, 0, 20], [20] * 3, {"icc": 1.0, "icc_moments": 1.0, "alpha": None, "design_effect": pytest.approx(20.0)}),
        # Analysis of variance by hand: nothing between, 20 · (1/4) · 2 / 36 within: -1/9.
        ([5] * 4, [10] * 4, {"icc": 0.0, "icc_moments": pytest.approx(-1 / 9)}),
        ([0] * 3, [20] * 3, {"icc": 0.0, "p_value": 1.0, "design_effect": 1.0}),
        ([20] * 3, [20] * 3, {"icc": 0.0, "p_value": 1.0, "design_effect": 1.0}),
        ([0, 1, 1], [1] * 3, {"icc": None, "icc_moments": None, "design_effect": None}),
        ([3, 0], [20, 0], {"configurations": 1, "mean": 0.15}),
    ],
)
def test_dispersion_has_known_limits(passed, judged, expected):
    found = dispersion(passed, judged)
    assert {name: getattr(found, name) for name in expected} == expected


def test_dispersion_of_equal_configurations_is_zero():
    assert dispersion([0, 0], [0, 0]) is dispersion([], []) is None
    assert dispersion([5] * 4, [10] * 4).p_value > 0.9


def test_dispersion_recovers_planted_distribution():
    rng = np.random.default_rng(1)
    passed, judged = rng.binomial(20, rng.beta(0.6, 0.3, 5480)), np.full(5480, 20)
    found = dispersion(passed, judged)
    assert (found.alpha, found.beta) == pytest.approx((0.6, 0.3), abs=0.02)
    assert found.icc == pytest.approx(1 / 1.9, abs=0.01)


def test_chance_of_at_least_is_share_of_planted_rates():
    rng = np.random.default_rng(18)
    p = rng.beta(1.5, 0.5, 4000)
    judged = np.full(4000, 6)
    passed = rng.binomial(judged, p)
    chance = chance_of_at_least(0.8, passed, judged, dispersion(passed, judged))
    for x in range(7):
        of = passed == x
        assert chance[of].mean() == pytest.approx((p[of] >= 0.8).mean(), abs=4 / np.sqrt(of.sum()) * 0.5)
    assert chance.mean() == pytest.approx((p >= 0.8).mean(), abs=0.03)
    # Without a fit it rises with passes from Jeffreys' prior.
    chance = chance_of_at_least(0.8, np.arange(6), np.full(6, 5), None)
    assert np.all(np.diff(chance) > 0) and chance[0] < 0.001 and chance[-1] > 0.7
    # Without a run: 1 - (2/π) arcsin √0.8.
    assert chance_of_at_least(0.8, [0], [0], None)[0] == pytest.approx(1 - 2 / np.pi * np.arcsin(np.sqrt(0.8)))


rows = st.integers(2, 30).flatmap(
    lambda runs: st.lists(st.integers(0, runs), min_size=2, max_size=12).map(lambda passed: (passed, runs))
)


def ends(passed, judged):
    found = intervals.clustered_interval(passed, judged)
    return found.low, found.high


@pytest.mark.slow
def test_clustered_interval_covers_rates_of_good_systems():
    # With the variance of clusters estimated, 82 to 87 % did: rates of 0.95 and 0.98, 10 and 30 clusters.
    assert proof.cells(400, 7, [10, 30], [0.95, 0.98], [0.0, 0.2, 0.5, 1.0]).good.all()
    assert (proof.cells(200, 8, [30], [0.5, 0.8, 0.9, 0.95], [0.0]).width <= 1.2).all()


@pytest.mark.slow
@pytest.mark.parametrize("clusters", [2, 3, 4])
def test_clustered_interval_covers_rates_of_few_clusters(clusters):
    assert proof.cells(400, 9, [clusters], [0.6, 0.9], [0.0, 1 / 3, 1.0]).good.all()


@pytest.mark.slow
@given(rows)
def test_clustered_interval_lies_between_limits_and_mirrors_failures(row):
    passed, runs = np.array(row[0]), row[1]
    low, high = ends(passed, np.full(len(passed), runs))
    of_runs = intervals.clopper_pearson_intervals(passed.sum(), runs * len(passed))
    of_clusters = intervals.clopper_pearson_intervals(passed.sum() / runs, len(passed))
    assert of_clusters[0] - 1e-9 <= low <= of_runs[0] + 1e-9
    assert of_runs[1] - 1e-9 <= high <= of_clusters[1] + 1e-9
    assert ends(runs - passed, np.full(len(passed), runs)) == pytest.approx((1 - high, 1 - low), abs=1e-9)


@each_row(
    ("passed", "judged", "expected", "within"),
    [
        ([20] * 9 + [0], [20] * 10, intervals.clopper_pearson_intervals(9, 10), 0.02),  # clusters that agree count once
        ([20] * 6, [20] * 6, (0.025 ** (1 / 6), 1.0), 1e-9),
        ([1] * 27 + [0] * 3, [1] * 30, intervals.clopper_pearson_intervals(27, 30), 1e-3),  # single runs
    ],
)
@pytest.mark.slow
def test_clustered_interval_has_known_limits(passed, judged, expected, within):
    assert ends(passed, judged) == pytest.approx(tuple(expected), abs=within)


@pytest.mark.slow
def test_clustered_interval_of_unequal_clusters_is_wide():
    # Ten clusters, one run failed: as independent runs the rate would be above 0.972.
    assert ends([20] * 9 + [19], [20] * 10)[0] < 0.9
    low, high = ends([1000, 0, 0, 0], [1000, 10, 10, 10])
    assert low < 0.25 and high > 1000 / 1030
    assert intervals.clustered_interval([4, 0], [5, 0]) is None
    assert ends([4, 3, 0], [5, 5, 0]) == ends([4, 3], [5, 5])


@pytest.mark.slow
def test_clustered_interval_of_many_clusters_is_as_narrow_as_their_spread():
    passed, judged = np.random.default_rng(4).binomial(20, 0.85, 5480), np.full(5480, 20)
    of_runs = intervals.clopper_pearson_intervals(passed.sum(), 5480 * 20)
    assert np.ptp(ends(passed, judged)) == pytest.approx(np.ptp(of_runs), rel=0.05)
