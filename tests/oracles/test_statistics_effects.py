"""Effects of factors on these situations and on others: levels, trends, interactions, and what few situations cannot show."""

import math
from itertools import combinations, product
from math import comb

import numpy as np
import pytest
from scipy.stats import f_oneway, fisher_exact, linregress, permutation_test, t
from table import each_row

from vastflow.oracles.page.words import class_needs_text, factor_text, metric_text, power_text, powerless_text
from vastflow.oracles.results.factors import factors_of
from vastflow.oracles.results.units import Units
from vastflow.oracles.statistics import matched
from vastflow.oracles.statistics.analysis import factor_analysis, holm
from vastflow.oracles.statistics.linear import Contrasts, trend_of
from vastflow.oracles.statistics.matched import Matched, needed, permuted
from vastflow.oracles.statistics.measured import Runs, metric_effects
from vastflow.oracles.statistics.power import Power, needed_for, power_of

GRID = [{"a": a, "b": b, "k": k} for a, b, k in product((0, 1), (0, 1, 2), range(4))]
PATHS = Units(np.arange(1), "path", "paths on this map")
ONE, ALONE, RUNS = np.ones((40, 1)), np.arange(40), np.full(40, 1e6)


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
    words = "6 paths are too few to show, for other paths on this map, an effect of length or a, or an interaction, however large."
    assert powerless_text(found, PATHS).replace("a or length", "length or a") == (words if powerless else "")


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
        (PLACES, [0.2, 0.3, 0.45], "4 paths: 0.45 fails 20 of 20 runs, 0.2 and 0.3 none of 40", "For other paths on this map: p = 0.012."),
        (FEW, ["in", "out"], "5 paths: out fails 16 of 25 runs, in none of 25", "5 paths cannot show it for other paths on this map; 6 only if all agree, and about 11 show 30 points in 8 of 10 campaigns."),
        (MANY, [1, 2], "9 paths: 2 fails 27 of 45 runs, 1 fails 3 of 45", "For other paths on this map: p = 0.0039."),
    ):  # fmt: skip
        said = f"a matters on these {these} (p ≤ 0.0001). {others}"
        assert factor_text(effect_of(failed, values), PATHS) == said


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
    (factor,) = analyzed([{"length": float(v)} for v in np.linspace(5, 20, 24)], [failed] * 24).factors
    assert factor.trend.change == pytest.approx(0.0, abs=1e-9)
    assert factor.trend.change_interval[0] < 0 < factor.trend.change_interval[1]
    assert (factor.others.p_value, factor.matters) == (1.0, False)
    effect = analyzed(GRID, [20 * row["a"] for row in GRID]).factors[0]
    assert (effect.name, effect.difference, effect.matters) == ("a", pytest.approx(1.0), True)


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


@each_row(("blocks", "harm"), [(4, 1.0), (8, 1.0), (6, 0.97)])
def test_trend_of_total_effect_holds_it(blocks, harm):
    held, rng = 0, np.random.default_rng(7)
    values, one, runs = np.tile([1.0, 2.0, 3.0], blocks), np.ones((3 * blocks, 1)), np.full(3 * blocks, 5.0)
    for _ in range(100):
        rates = rng.binomial(5, harm * (values - 1) / 2) / 5
        found = trend_of(Contrasts(rates, np.repeat(np.arange(blocks), 3), 199), values, one, runs, 0.05)
        assert -1 <= found.change_interval[0] <= found.change <= found.change_interval[1] <= 1
        held += found.change_interval[0] <= harm <= found.change_interval[1]
    assert held >= 90


def test_trend_over_paths_is_interval_of_their_slopes():
    # Door widths at 18 paths: a t-interval of the paths' own slopes.
    rng, values = np.random.default_rng(3), np.tile([0.0, 1.0, 2.0], 18)
    rates = np.clip(np.repeat(rng.uniform(0, 0.3, 18), 3) + np.repeat(rng.uniform(0.1, 0.4, 18), 3) * values, 0, 1)
    slopes = rates.reshape(18, 3)[:, 2] - rates.reshape(18, 3)[:, 0]
    contrasts, one = Contrasts(rates, np.repeat(np.arange(18), 3), 999), np.ones((54, 1))
    found = trend_of(contrasts, values, one, np.full(54, 1e6), 0.05)
    expected = t.interval(0.95, 17, slopes.mean(), slopes.std(ddof=1) / math.sqrt(18))
    assert found.change_interval == pytest.approx(expected, abs=0.01)
    assert found.shown and found.p_value < 0.01


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


# Metrics


def three_controllers(rng, slower_s, reached=None):
    """Seven paths, two clutters, three controllers, three runs each: the factors, sets, paths, and runs."""
    cells = np.array(list(product(range(7), range(2), range(3))))
    path, clutter, controller = cells.T
    of_run = np.repeat(np.arange(len(cells)), 3)
    time_s = 18.0 + rng.uniform(-4, 4, 7)[path] + slower_s * (controller == 0)
    values_s = time_s[of_run] + rng.normal(0, 1, len(of_run))
    runs = Runs(
        of_run,
        np.tile(np.arange(3), len(cells)),
        np.ones(len(of_run), dtype=bool) if reached is None else reached(controller[of_run], path[of_run]),
        {"time": ("s", values_s), "recoveries": ("1", np.zeros(len(of_run)))},
    )
    rows = [{"controller": ("mppi", "dwb", "rpp")[c], "amount_per_m": 0.4 * b} for _, b, c in cells.tolist()]
    sets = {"controller": path * 2 + clutter, "amount_per_m": path * 3 + controller}
    return factors_of(rows)[0], sets, path, runs


def test_slower_controller_is_shown_by_times_of_same_situations():
    effect, clutter = metric_effects(*three_controllers(np.random.default_rng(1), 18.0))
    assert (effect.name, effect.metric, effect.situations) == ("controller", "time", 7)
    assert (effect.above, effect.sets, effect.rounds, effect.of) == (14, 14, 42, 42)
    assert effect.these.shown and effect.others.shown
    assert effect.interval[0] < 18.0 < effect.interval[1]
    said = metric_text(effect, PATHS)
    assert said.startswith("controller matters for the time on these 7 paths: mppi ")
    assert "mppi is above " in said and " in 14 of 14 situations, by " in said
    assert "Compared where all reached the goal: 42 of 42 rounds." in said
    assert (clutter.name, clutter.matters) == ("amount_per_m", False)  # recoveries are equal, and not tested


def test_metrics_are_compared_where_all_levels_reached_the_goal():
    # The first controller fails on the four hard paths, and its time there is that of giving up at once.
    def reached(controller, path):
        return ~((controller == 0) & (path >= 3))

    factors, sets, path, runs = three_controllers(np.random.default_rng(2), 0.0, reached)
    runs.metrics["time"][1][~runs.reached] = 0.0
    (left,) = (each for each in metric_effects(factors, sets, path, runs) if each.name == "controller")
    assert (left.levels, left.left_out, left.rounds, left.matters) == (("dwb", "rpp"), ("mppi",), 42, False)
    assert ", without mppi, where fewer than half of the runs did, or have a known time." in metric_text(left, PATHS)
    factors, sets, path, runs = three_controllers(np.random.default_rng(2), 0.0, lambda c, p: (c > 0) | (p < 5))
    runs.metrics["time"][1][~runs.reached] = 0.0
    (whole,) = (each for each in metric_effects(factors, sets, path, runs) if each.name == "controller")
    assert (whole.levels, whole.rounds, whole.of, whole.matters) == (("mppi", "dwb", "rpp"), 30, 42, False)


def test_metrics_without_missions_that_reached_the_goal_have_no_effects():
    assert metric_effects(*three_controllers(np.random.default_rng(3), 18.0, lambda c, _: c > 5)) == ()


def test_large_table_agrees_with_its_random_orders(monkeypatch):
    rng = np.random.default_rng(4)
    table = rng.normal(size=(400, 3)) + np.array([0.0, 0.1, 0.15])
    of_normal_sums = permuted(table, None)
    monkeypatch.setattr(matched, "_LARGE", table.size)
    assert of_normal_sums == pytest.approx(permuted(table, None), abs=0.02)


# Power


def test_power_needs_situations_that_can_show_an_effect():
    assert power_of(4, 2, 5).others is None
    assert power_text(Power(0.35, None), PATHS) == (
        "So many runs show 35 points on these paths in 8 of 10 campaigns, and none, however large, for other paths on this map."
    )
    few, many = power_of(6, 2, 5), power_of(20, 2, 5)
    assert many.these <= 0.25 and few.these >= 0.35
    assert many.others <= 0.25 and few.others >= 0.5
    assert (needed_for(2, 5).fewest, needed_for(3, 5).fewest) == (6, 3)
    assert 9 <= needed_for(2, 5).enough <= 12


def test_class_needs_name_each_class_with_its_runs():
    needs = {"systematic": 14, "flaky": 10, "reliable": 14}
    said = (
        "3 runs of a configuration cannot show that it is flaky (at least 10), or reliable or systematic (at least 14)."
    )
    assert class_needs_text(3, needs) == said
    said = "12 runs of a configuration cannot show that it is reliable or systematic (at least 14)."
    assert (class_needs_text(12, needs), class_needs_text(14, needs), class_needs_text(3, {})) == (said, "", "")
