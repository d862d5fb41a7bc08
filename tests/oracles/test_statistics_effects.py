"""Effects of factors on these situations and on others: levels, trends, interactions, and what few situations cannot show."""

import math
from itertools import combinations, product
from math import comb

import numpy as np
import pytest
from scipy.stats import f_oneway, fisher_exact, linregress, permutation_test
from table import each_row

from vastflow.oracles.page.words import factor_text, powerless_text
from vastflow.oracles.results.factors import factors_of
from vastflow.oracles.statistics.analysis import factor_analysis, holm
from vastflow.oracles.statistics.linear import Contrasts, trend_of
from vastflow.oracles.statistics.matched import Matched, needed, permuted

GRID = [{"a": a, "b": b, "k": k} for a, b, k in product((0, 1), (0, 1, 2), range(4))]
ONE, ALONE, RUNS = np.ones((40, 1)), np.arange(40), np.full(40, 20.0)


def analyzed(rows, failed, runs=20, blocks=None):
    return factor_analysis(factors_of(rows)[0], runs - np.asarray(failed), np.full(len(rows), runs), blocks)


def effect_of(failed, values, runs=5):
    """The effect of one factor, from failures (k, L) of situations at its levels."""
    failed = np.asarray(failed)
    rows = [{"a": values[code]} for _, code in product(range(len(failed)), range(len(values)))]
    return analyzed(rows, failed.ravel(), runs, np.repeat(np.arange(len(failed)), len(values))).factors[0]


# Families of tests


def test_holm_multiplies_by_remaining_tests():
    # S. Holm 1979: 0.01 · 4, 0.02 · 3, then never less than before.
    assert holm([0.02, 0.01, None, 0.04, 0.03]) == pytest.approx([0.06, 0.04, None, 0.06, 0.06])


@each_row(("each", "powerless"), [(3, True), (5, False)])
def test_analysis_names_effects_that_few_situations_cannot_show(each, powerless):
    # `each` short and long paths, and a factor that fails every run, on long paths alone: nothing larger can be.
    rows = [{"length": s % 2, "a": a} for s in range(2 * each) for a in (0, 1)]
    found = analyzed(rows, [20 * row["length"] * row["a"] for row in rows], blocks=np.repeat(np.arange(2 * each), 2))
    # Every division of the paths into two groups, by the F test of clearly different values.
    values = np.r_[np.arange(each), 100.0 + np.arange(each)]
    divisions = [np.isin(np.arange(2 * each), group) for group in combinations(range(2 * each), each)]
    f = np.round([f_oneway(values[short], values[~short]).statistic for short in divisions], 6)
    between = float(np.mean(f == f.max()))
    (pair,) = found.interactions
    effects = {effect.name: effect.others for effect in found.factors}
    assert (pair.claim.least, effects["length"].least) == pytest.approx((between, between))
    assert effects["a"].least == pytest.approx(2.0 / 2.0 ** (2 * each))  # the signs of `2 * each` differences
    assert (pair.claim.powerless, pair.claim.shown) == (powerless, not powerless)
    assert {effect.powerless for effect in effects.values()} == {powerless}
    words = "6 paths are too few to show, for other paths, an effect of length or a, or an interaction, however large."
    assert powerless_text(found, "path").replace("a or length", "length or a") == (words if powerless else "")


def test_needed_situations_are_fewest_that_can_show_effect():
    for levels, tests, most in ((2, 1, 6), (2, 2, 7), (2, 3, 7), (3, 1, 3)):
        assert needed(levels, tests, 0.05) == most
        least, next_least = (math.factorial(levels) ** (1.0 - each) for each in (most, most - 1))
        assert least * tests <= 0.05 < next_least * tests


# These situations


def test_matched_sets_of_two_levels_have_exact_p_values():
    # The README's first campaign: 0.45 m fails 5 of 5 on each of four paths, 0.20 and 0.30 m none of 10.
    found = Matched(np.array([[0.0, 5.0]] * 4), np.array([[10.0, 5.0]] * 4))
    assert found.p_value == pytest.approx((1 / comb(15, 5)) ** 4, rel=1e-9) == pytest.approx(1.2e-14, rel=0.03)
    assert found.difference(1, 0)[0] == 1.0
    for a, b in ((16, 0), (9, 4), (5, 5)):
        one = Matched(np.array([[a, b]], dtype=float), np.array([[25.0, 25.0]]))
        assert one.p_value == pytest.approx(fisher_exact([[a, 25 - a], [b, 25 - b]]).pvalue)
    failed, runs = np.array([[1.0, 3.0], [0.0, 1.0], [2.0, 3.0]]), np.full((3, 2), 5.0)
    drawn = Matched(*(np.column_stack((each, np.zeros(3))) for each in (failed, runs))).p_value
    assert drawn == pytest.approx(Matched(failed, runs).p_value, abs=0.03)


PLACES, FEW, MANY = [[0, 0, 5]] * 4, [[0, 5], [0, 4], [0, 3], [0, 2], [0, 2]], [[0, 2], [1, 4], [0, 3]] * 3


def test_factor_text_distinguishes_these_from_other_paths():
    # The quickstart's noise, 12 of 30 and none of 30, and its boxes per meter, 0, 7 and 11 of 20.
    noise, boxes = [[0, 5], [0, 0], [0, 0], [0, 4], [0, 3], [0, 0]], [[0, 4, 5], [0, 0, 0], [0, 3, 1], [0, 0, 5]]
    for failed, values in ((noise, [0.0, 0.4]), (boxes, [0.0, 0.6, 0.9])):
        these = effect_of(failed, values).these
        assert these.p_value <= 1.05e-4 and these.shown
    for failed, values, these, others in (
        (PLACES, [0.2, 0.3, 0.45], "4 paths: 0.45 fails 20 of 20 runs, 0.2 and 0.3 none of 40", "For other paths: p = 0.012."),
        (FEW, ["in", "out"], "5 paths: out fails 16 of 25 runs, in none of 25", "5 paths cannot show it for other paths; 6 can."),
        (MANY, [1, 2], "9 paths: 2 fails 27 of 45 runs, 1 fails 3 of 45", "For other paths: p = 0.0039."),
    ):  # fmt: skip
        said = f"a matters on these {these} (p ≤ 0.0001). {others}"
        assert factor_text(effect_of(failed, values), "path") == said


# Other situations


def test_permutations_within_situations_agree_with_scipy():
    table = np.random.default_rng(3).random((7, 2)) + np.array([0.0, 0.3])
    expected = permutation_test(
        (table[:, 0], table[:, 1]),
        lambda a, b, axis: a.mean(axis=axis) - b.mean(axis=axis),
        permutation_type="samples",
        vectorized=True,
    )
    assert permuted(table, None) == pytest.approx(expected.pvalue)


def test_contrasts_agree_with_exact_test_and_analysis_of_variance():
    # Of the 20 paths to choose 3 of 6, two are as extreme: Fisher's exact test says 0.1.
    steps = np.array([0.0, 0, 0, 1, 1, 1])
    found = Contrasts(steps, np.arange(6), 4000).test(steps[:, None], np.ones((6, 1)))
    assert found.p_value == pytest.approx(0.1, abs=0.02)
    response = np.random.default_rng(6).normal(size=90) + np.repeat([0.0, 0.2, 0.35], 30)
    columns = np.repeat(np.eye(3)[:, 1:], 30, axis=0)
    found = Contrasts(response, np.arange(90), draws=4000).test(columns, np.ones((90, 1)))
    assert found.p_value == pytest.approx(f_oneway(*response.reshape(3, 30)).pvalue, abs=0.02)


def test_level_rates_and_differences_match_table():
    failed = [(10 if row["a"] else 2) + (k % 3) - 1 for k, row in enumerate(GRID)]
    (effect,) = analyzed([{"a": row["a"]} for row in GRID], failed).factors
    assert (effect.name, effect.highest, effect.lowest) == ("a", "1", "0")
    assert [level.rate for level in effect.levels] == pytest.approx([0.1, 0.5])
    assert effect.difference == pytest.approx(0.4)
    assert effect.difference_interval[0] < 0.4 < effect.difference_interval[1]
    assert effect.others.shown and effect.others.adjusted <= 0.05
    assert analyzed(GRID, failed).factors == analyzed(GRID, failed).factors


def test_unbalanced_levels_are_adjusted_for_other_factors():
    # b alone acts, by 0.5; a = 1 has b = 1 more often, so its plain rate is higher.
    rows = [{"a": a, "b": b} for a, b, n in ((0, 0, 9), (0, 1, 3), (1, 0, 3), (1, 1, 9)) for _ in range(n)]
    by_name = {effect.name: effect for effect in analyzed(rows, [2 + 10 * row["b"] for row in rows]).factors}
    assert by_name["a"].levels[1].rate - by_name["a"].levels[0].rate == pytest.approx(0.25)
    assert by_name["a"].difference == pytest.approx(0.0, abs=1e-9)
    assert by_name["b"].difference == pytest.approx(0.5)


@each_row("failed", [0, 20])
def test_equal_outcomes_show_nothing(failed):
    found = analyzed(GRID, [failed] * len(GRID))
    assert {effect.others.p_value for effect in found.factors} == {1.0}
    assert {pair.claim.p_value for pair in found.interactions} == {1.0}
    assert np.ptp([found.factors[0].levels[0].interval.low, found.factors[0].levels[0].interval.high]) < 0.35
    (factor,) = analyzed([{"length": float(v)} for v in np.linspace(5, 20, 24)], [failed] * 24).factors
    assert factor.trend.change == pytest.approx(0.0, abs=1e-9)
    assert factor.trend.change_interval[0] < 0 < factor.trend.change_interval[1]
    assert (factor.others.p_value, factor.matters) == (1.0, False)
    effect = analyzed(GRID, [20 * row["a"] for row in GRID]).factors[0]
    assert (effect.name, effect.difference, effect.matters) == ("a", pytest.approx(1.0), True)
    assert 0.5 < effect.difference_interval[0] < effect.difference_interval[1] == 1.0


def test_analysis_needs_enough_configurations_and_factors_that_are_not_confounded():
    assert not analyzed([{"a": k // 2} for k in range(4)], [0, 0, 2000, 2000], runs=2000).factors[0].matters
    assert factor_analysis(factors_of([{"a": 1}, {"a": 2}])[0], [3, 0], [5, 0]) is None
    factors, _ = factors_of([{"a": k % 2, "b": k % 3} for k in range(6)])
    found = factor_analysis(factors, [5, 0, 4, 0, 5, 0], [5, 0, 5, 0, 5, 0])
    assert (found.configurations, [effect.name for effect in found.factors]) == (3, ["b"])
    assert found.dropped[-1].reason == "has one level among the judged"
    by_name = {e.name: e for e in analyzed([{"a": k % 3, "b": (k % 3 > 0) * 1} for k in range(12)], range(12)).factors}
    assert (by_name["b"].others.p_value, by_name["b"].others.note) == (None, "cannot be told from other factors")
    assert by_name["a"].others.p_value is not None


def test_variance_of_outcomes_is_divided_without_remainder():
    # Var of a run: p(1 - p) with p = 0.4; of which 0.2² = 0.04 is the factor's.
    rows = [{"a": k % 2} for k in range(400)]
    found = analyzed(rows, np.random.default_rng(5).binomial(20, [0.2 + 0.4 * row["a"] for row in rows])).variance
    assert found.repetition + found.factors + found.interactions + found.unexplained == pytest.approx(1.0)
    assert found.factors == pytest.approx(0.04 / 0.24, abs=0.02)
    assert found.unexplained == pytest.approx(0.0, abs=0.02)


# Interactions


def test_interaction_has_cells_that_do_not_add_up():
    rows = [{"a": a, "b": b} for a, b in product((0, 1), (0, 1)) for _ in range(25)]
    rates = [0.1 + 0.4 * (row["a"] == row["b"]) for row in rows]
    found = analyzed(rows, np.random.default_rng(3).binomial(20, rates))
    (pair,) = found.interactions
    assert pair.claim.shown and not any(effect.matters for effect in found.factors)
    assert abs(pair.departure) == pytest.approx(0.2, abs=0.03)
    assert sum(cell.configurations for cell in pair.cells) == 100
    (apart,) = analyzed([{"a": k % 2} for k in range(6)] + [{"b": k % 2} for k in range(6)], range(12)).interactions
    assert (apart.claim.p_value, apart.cells) == (None, ())


# Trends


def test_trend_is_slope_of_least_squares():
    rng = np.random.default_rng(1)
    lengths = rng.uniform(5, 20, 40)
    rates = 0.02 * lengths + rng.normal(0, 0.05, 40)
    found, expected = trend_of(Contrasts(rates, ALONE, 999), lengths, ONE, RUNS, 0.05), linregress(lengths, rates)
    half = np.ptp(found.change_interval) / 2
    assert half == pytest.approx(2.02 * expected.stderr * np.ptp(lengths), rel=0.35)  # robust, so not the same
    assert (found.smallest, found.greatest) == (lengths.min(), lengths.max())
    assert found.change == pytest.approx(expected.slope * np.ptp(lengths))
    # Long paths on map B, which is harder by 0.3; a meter costs 0.01 on either.
    lengths, b = np.r_[np.linspace(5, 15, 20), np.linspace(10, 20, 20)], np.repeat([0.0, 1.0], 20)
    found = trend_of(Contrasts(0.3 * b + 0.01 * lengths, ALONE, 999), lengths, np.column_stack((ONE, b)), RUNS, 0.05)
    assert found.change == pytest.approx(0.15)
    low, high = found.change_interval
    assert -0.5 < low < 0.15 < high < 0.5  # blocks agree, and say no more than their runs
    lengths = np.r_[np.linspace(5, 15, 30), np.full(10, np.nan)]  # missing numbers are left out
    others = np.column_stack((ONE, np.isnan(lengths)))
    rates = np.r_[0.02 * lengths[:30], np.full(10, 0.9)]
    assert trend_of(Contrasts(rates, ALONE, 999), lengths, others, RUNS, 0.05).change == pytest.approx(0.2)


QUARTERS = np.repeat([5.0, 10.0, 15.0, 20.0], 10)


def test_trend_needs_three_distinct_values():
    rates = Contrasts(np.linspace(0, 1, 40), ALONE, 999)
    for values in ([1.0, 2.0] * 20, [3.0] * 40, [np.nan] * 39 + [1.0]):
        assert trend_of(rates, np.array(values), ONE, RUNS, 0.05) is None
    levels = np.column_stack((ONE, QUARTERS[:, None] == [10.0, 15.0, 20.0]))
    assert trend_of(rates, QUARTERS, levels, RUNS, 0.05) is None  # follows from another factor


@each_row("blocks", [4, 8])
def test_trend_of_total_effect_stays_within_100_points(blocks):
    values = np.tile([1.0, 2.0, 3.0], blocks)
    one, runs = np.ones((len(values), 1)), np.full(len(values), 5.0)
    found = trend_of(Contrasts((values - 1) / 2, np.repeat(np.arange(blocks), 3), 999), values, one, runs, 0.05)
    low, high = found.change_interval
    assert -1 <= low < found.change <= high <= 1


def test_trend_over_eight_paths_of_different_lengths_is_found():
    # Eight blocks of three settings: bins have two blocks each, which show nothing on their own.
    lengths = np.repeat(np.linspace(5, 26, 8), 3)
    failed = np.random.default_rng(2).binomial(20, np.clip((lengths - 4) / 25, 0, 1))
    rows = [{"length": float(v), "setting": k % 3} for k, v in enumerate(lengths)]
    length = next(f for f in analyzed(rows, failed, blocks=np.repeat(np.arange(8), 3)).factors if f.name == "length")
    assert length.others.shown
    assert length.trend.change_interval[0] < 21 / 25 < length.trend.change_interval[1]


def test_levels_and_trend_share_error():
    failed = np.random.default_rng(5).binomial(20, 0.3, 40)
    (factor,) = analyzed([{"length": float(v)} for v in QUARTERS], failed).factors
    levels = (QUARTERS[:, None] == [10.0, 15.0, 20.0]).astype(float)
    of_levels = Contrasts(failed / 20, ALONE, 999).test(levels, ONE).p_value
    assert factor.others.p_value == pytest.approx(min(1.0, 2 * min(of_levels, factor.trend.p_value)))
