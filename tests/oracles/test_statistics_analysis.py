from itertools import combinations, product

import numpy as np
import pytest
from table import each_row

from vastflow.oracles.page.words import powerless_text
from vastflow.oracles.results.factors import factors_of
from vastflow.oracles.statistics.analysis import FactorAnalysis, factor_analysis, holm
from vastflow.oracles.statistics.contrast import contrasts_of


def analyzed(rows, failed, runs=20, blocks=None) -> FactorAnalysis:
    failed = np.asarray(failed)
    found = factor_analysis(factors_of(rows)[0], runs - failed, np.full(len(rows), runs), blocks)
    assert found is not None
    return found


GRID = [{"a": a, "b": b, "k": k} for a, b, k in product((0, 1), (0, 1, 2), range(4))]


def test_holm_multiplies_by_the_tests_that_are_left() -> None:
    # S. Holm 1979: 0.01 · 4, 0.02 · 3, then never less than before.
    assert holm([0.02, 0.01, None, 0.04, 0.03]) == pytest.approx([0.06, 0.04, None, 0.06, 0.06])


def test_rates_and_differences_of_levels_are_those_of_the_table() -> None:
    failed = [10 if row["a"] else 2 for row in GRID]
    (effect,) = analyzed([{"a": row["a"]} for row in GRID], [f + (k % 3) - 1 for k, f in enumerate(failed)]).factors
    assert (effect.name, effect.highest, effect.lowest) == ("a", "1", "0")
    assert [level.rate for level in effect.levels] == pytest.approx([0.1, 0.5])
    assert effect.difference == pytest.approx(0.4)
    low, high = effect.difference_interval
    assert low < 0.4 < high
    assert effect.others.shown and effect.others.adjusted is not None and effect.others.adjusted <= 0.05


def test_unbalanced_levels_are_adjusted_for_the_other_factors() -> None:
    # b alone acts, by 0.5; a = 1 has b = 1 more often, so its plain rate is higher.
    rows = [{"a": a, "b": b} for a, b, n in ((0, 0, 9), (0, 1, 3), (1, 0, 3), (1, 1, 9)) for _ in range(n)]
    found = analyzed(rows, [2 + 10 * row["b"] for row in rows])
    by_name = {effect.name: effect for effect in found.factors}
    assert by_name["a"].levels[1].rate - by_name["a"].levels[0].rate == pytest.approx(0.25)
    assert by_name["a"].difference == pytest.approx(0.0, abs=1e-9)
    assert by_name["b"].difference == pytest.approx(0.5)


def test_interaction_has_cells_that_do_not_add_up() -> None:
    rng = np.random.default_rng(3)
    rows = [{"a": a, "b": b} for a, b in product((0, 1), (0, 1)) for _ in range(25)]
    found = analyzed(rows, rng.binomial(20, [0.1 + 0.4 * (row["a"] == row["b"]) for row in rows]))
    (pair,) = found.interactions
    assert pair.claim.shown
    assert not any(effect.matters for effect in found.factors)
    assert abs(pair.departure) == pytest.approx(0.2, abs=0.03)
    assert sum(cell.configurations for cell in pair.cells) == 100


@each_row("failed", [0, 20])
def test_where_all_runs_end_alike_no_factor_matters(failed: int) -> None:
    found = analyzed(GRID, [failed] * len(GRID))
    assert {effect.others.p_value for effect in found.factors} == {1.0}
    assert {pair.claim.p_value for pair in found.interactions} == {1.0}
    assert found.factors[0].levels[0].interval.high - found.factors[0].levels[0].interval.low < 0.35


def test_level_that_always_fails_breaks_nothing_and_is_found() -> None:
    found = analyzed(GRID, [20 * row["a"] for row in GRID])
    effect = found.factors[0]
    assert (effect.name, effect.difference, effect.matters) == ("a", pytest.approx(1.0), True)
    low, high = effect.difference_interval
    assert 0.5 < low < 1.0 and high == 1.0


def test_two_configurations_of_each_level_show_nothing_for_others_however_often_they_run() -> None:
    rows = [{"a": k // 2} for k in range(4)]
    assert not analyzed(rows, [0, 0, 2000, 2000], runs=2000).factors[0].matters


def test_one_judged_configuration_is_no_analysis() -> None:
    factors, _ = factors_of([{"a": 1}, {"a": 2}])
    assert factor_analysis(factors, [3, 0], [5, 0]) is None


def test_level_without_judged_runs_drops_out() -> None:
    factors, _ = factors_of([{"a": k % 2, "b": k % 3} for k in range(6)])
    found = factor_analysis(factors, [5, 0, 4, 0, 5, 0], [5, 0, 5, 0, 5, 0])
    assert found is not None
    assert (found.configurations, [effect.name for effect in found.factors]) == (3, ["b"])
    assert found.dropped[-1].reason == "has one level among the judged"


def test_factor_that_comes_with_another_alone_can_not_be_told_from_it() -> None:
    rows = [{"a": k % 3, "b": (k % 3 > 0) * 1} for k in range(12)]
    by_name = {effect.name: effect for effect in analyzed(rows, range(12)).factors}
    assert (by_name["b"].others.p_value, by_name["b"].others.note) == (None, "cannot be told from other factors")
    assert by_name["a"].others.p_value is not None


def test_levels_of_factors_that_never_meet_are_no_interaction() -> None:
    rows = [{"a": k % 2} for k in range(6)] + [{"b": k % 2} for k in range(6)]
    (pair,) = analyzed(rows, range(12)).interactions
    assert (pair.claim.p_value, pair.cells) == (None, ())


def test_configurations_on_one_path_do_not_count_as_many_where_paths_are_compared() -> None:
    # Two maps of three paths, twenty settings each: what the maps differ by is what paths differ by.
    rng = np.random.default_rng(4)
    rows = [{"map": p // 3, "setting": s} for p in range(6) for s in range(20)]
    path = np.repeat(np.arange(6), 20)
    rates = np.array([0.9, 0.1, 0.5, 0.1, 0.2, 0.1])[path]
    failed = rng.binomial(20, rates)
    blocked, alone = analyzed(rows, failed, blocks=path), analyzed(rows, failed)
    maps = [next(effect for effect in found.factors if effect.name == "map") for found in (blocked, alone)]
    assert alone.blocks == 120 and blocked.blocks == 6
    assert maps[1].others.shown and not maps[0].matters
    low, high = maps[0].difference_interval
    assert low < 0.0 < high


def test_variance_of_outcomes_is_divided_without_remainder() -> None:
    rng = np.random.default_rng(5)
    rows = [{"a": k % 2} for k in range(400)]
    # Var of a run: p(1 - p) with p = 0.4; of which 0.2² = 0.04 is the factor's.
    found = analyzed(rows, rng.binomial(20, [0.2 + 0.4 * row["a"] for row in rows])).variance
    assert found.repetition + found.factors + found.interactions + found.unexplained == pytest.approx(1.0)
    assert found.factors == pytest.approx(0.04 / 0.24, abs=0.02)
    assert found.unexplained == pytest.approx(0.0, abs=0.02)


def test_permutations_of_few_values_give_the_exact_p_value() -> None:
    # Of the 20 paths to choose 3 of 6, two are as extreme: Fisher's exact test says 0.1.
    found = contrasts_of(np.array([0.0, 0, 0, 1, 1, 1]), np.arange(6), draws=4000).test(
        np.array([[0.0], [0], [0], [1], [1], [1]]), np.ones((6, 1))
    )
    assert found.p_value == pytest.approx(0.1, abs=0.02)


def test_p_value_of_many_configurations_is_that_of_analysis_of_variance() -> None:
    from scipy.stats import f_oneway

    rng = np.random.default_rng(6)
    response = rng.normal(size=90) + np.repeat([0.0, 0.2, 0.35], 30)
    columns = np.repeat(np.eye(3)[:, 1:], 30, axis=0)
    found = contrasts_of(response, np.arange(90), draws=4000).test(columns, np.ones((90, 1)))
    expected = f_oneway(*response.reshape(3, 30)).pvalue
    assert found.p_value == pytest.approx(expected, abs=0.02)


def test_same_data_give_the_same_p_values() -> None:
    failed = np.random.default_rng(8).binomial(20, 0.3, len(GRID))
    assert analyzed(GRID, failed).factors == analyzed(GRID, failed).factors


@each_row(("each", "powerless"), [(3, True), (5, False)])
def test_analysis_names_effects_that_so_few_situations_cannot_show(each: int, powerless: bool) -> None:
    # `each` short and long paths, and a factor that fails every run, on long paths alone: nothing larger can be.
    from scipy.stats import f_oneway

    rows = [{"length": s % 2, "a": a} for s in range(2 * each) for a in (0, 1)]
    found = analyzed(rows, [20 * row["length"] * row["a"] for row in rows], blocks=np.repeat(np.arange(2 * each), 2))
    # Every division of the paths into two groups, by the F test of clearly different values.
    values = np.r_[np.arange(each), 100.0 + np.arange(each)]
    divisions = [np.isin(np.arange(2 * each), group) for group in combinations(range(2 * each), each)]
    f = np.round([f_oneway(values[short], values[~short]).statistic for short in divisions], 6)
    between = float(np.mean(f == f.max()))
    (pair,) = found.interactions
    effects = {effect.name: effect.others for effect in found.factors}
    assert pair.claim.least == pytest.approx(between)
    assert effects["length"].least == pytest.approx(between)
    assert effects["a"].least == pytest.approx(2.0 / 2.0 ** (2 * each))  # the signs of `2 * each` differences
    assert (pair.claim.powerless, pair.claim.shown) == (powerless, not powerless)
    assert {effect.powerless for effect in effects.values()} == {powerless}
    words = "6 paths are too few to show, for other paths, an effect of length or a, or an interaction, however large."
    assert powerless_text(found, "path").replace("a or length", "length or a") == (words if powerless else "")
