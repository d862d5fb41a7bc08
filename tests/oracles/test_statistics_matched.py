"""What two tests say of a factor: on these situations, and on others."""

from itertools import product
from math import comb

import numpy as np
import pytest
from scipy.stats import fisher_exact, permutation_test

from vastflow.oracles.page.words import factor_text
from vastflow.oracles.results.factors import factors_of
from vastflow.oracles.statistics.analysis import factor_analysis
from vastflow.oracles.statistics.effects import FactorEffect, Matched
from vastflow.oracles.statistics.situations import needed, permuted, smallest


def effect_of(failed, values, runs=5) -> FactorEffect:
    """Of failures (k, L) of situations at the levels of one factor."""
    failed = np.asarray(failed)
    rows = [{"a": values[code]} for _, code in product(range(len(failed)), range(len(values)))]
    n = np.full(failed.size, runs)
    found = factor_analysis(factors_of(rows)[0], n - failed.ravel(), n, np.repeat(np.arange(len(failed)), len(values)))
    assert found is not None
    return found.factors[0]


def test_two_levels_are_told_exactly() -> None:
    # The README's first campaign: 0.45 m fails 5 of 5 on each of four paths, 0.20 and 0.30 m none of 10.
    found = Matched(np.array([[0.0, 5.0]] * 4), np.array([[10.0, 5.0]] * 4))
    assert found.p_value == pytest.approx((1 / comb(15, 5)) ** 4, rel=1e-9) == pytest.approx(1.2e-14, rel=0.03)
    assert found.difference(1, 0)[0] == 1.0  # type: ignore[index]


def test_one_matched_set_has_the_p_value_of_fishers_exact_test() -> None:
    for a, b in ((16, 0), (9, 4), (5, 5)):
        found = Matched(np.array([[a, b]], dtype=float), np.array([[25.0, 25.0]]))
        assert found.p_value == pytest.approx(fisher_exact([[a, 25 - a], [b, 25 - b]]).pvalue)


@pytest.mark.parametrize(
    ("failed", "values"),
    [
        ([[0, 5], [0, 0], [0, 0], [0, 4], [0, 3], [0, 0]], [0.0, 0.4]),  # quickstart's noise: 12 of 30 and none of 30
        ([[0, 4, 5], [0, 0, 0], [0, 3, 1], [0, 0, 5]], [0.0, 0.6, 0.9]),  # its boxes per meter: 0, 7 and 11 of 20
    ],
)
def test_effects_of_the_quickstart_are_shown_on_its_paths(failed, values) -> None:
    these = effect_of(failed, values).these
    assert these.p_value is not None and these.p_value <= 1.05e-4 and these.shown


def test_drawn_p_values_are_those_of_the_exact_test_where_there_are_two_levels() -> None:
    failed = np.array([[1.0, 3.0], [0.0, 1.0], [2.0, 3.0]])
    exact = Matched(failed, np.full((3, 2), 5.0)).p_value
    third = np.column_stack((failed, np.zeros(3)))
    drawn = Matched(third, np.column_stack((np.full((3, 2), 5.0), np.zeros(3)))).p_value
    assert drawn == pytest.approx(exact, abs=0.03)


def test_permutations_within_situations_are_those_of_scipy() -> None:
    table = np.random.default_rng(3).random((7, 2)) + np.array([0.0, 0.3])
    expected = permutation_test(
        (table[:, 0], table[:, 1]),
        lambda a, b, axis: a.mean(axis=axis) - b.mean(axis=axis),
        permutation_type="samples",
        vectorized=True,
    )
    assert permuted(table, None) == pytest.approx(expected.pvalue)


@pytest.mark.parametrize(("levels", "tests", "most"), [(2, 1, 6), (2, 2, 7), (2, 3, 7), (3, 1, 3)])
def test_needed_situations_are_the_fewest_that_can_show_an_effect(levels, tests, most) -> None:
    assert needed(levels, tests, 0.05) == most
    assert smallest(most, levels) * tests <= 0.05 < smallest(most - 1, levels) * tests


@pytest.mark.parametrize(
    ("failed", "values", "said"),
    [
        (
            [[0, 0, 5]] * 4,
            [0.2, 0.3, 0.45],
            "a matters on these 4 paths: 0.45 fails 20 of 20 runs, 0.2 and 0.3 none of 40 (p ≤ 0.0001). For other paths: p = 0.012.",
        ),
        (
            [[0, 5], [0, 4], [0, 3], [0, 2], [0, 2]],
            ["in", "out"],
            "a matters on these 5 paths: out fails 16 of 25 runs, in none of 25 (p ≤ 0.0001). 5 paths cannot show it for other paths; 6 can.",
        ),
        (
            [[0, 2], [1, 4], [0, 3]] * 3,
            [1, 2],
            "a matters on these 9 paths: 2 fails 27 of 45 runs, 1 fails 3 of 45 (p ≤ 0.0001). For other paths: p = 0.0039.",
        ),
    ],
)
def test_sentence_says_what_is_shown_on_these_and_on_other_paths(failed, values, said) -> None:
    assert factor_text(effect_of(failed, values), "path") == said


def test_situations_that_respond_differently_show_no_interaction_with_what_they_differ_by() -> None:
    rng, false = np.random.default_rng(8), 0
    rows = [{"length": 5 * (1 + s % 2), "a": a, "b": b} for s, a, b in product(range(12), range(2), range(4))]
    for _ in range(60):
        slope = np.repeat(rng.uniform(-0.4, 0.4, 12), 8)
        failed = rng.binomial(10, 0.5 + slope * np.array([row["a"] for row in rows]))
        found = factor_analysis(factors_of(rows)[0], 10 - failed, np.full(96, 10), np.repeat(np.arange(12), 8))
        assert found is not None
        false += any(pair.claim.shown for pair in found.interactions)
    assert false <= 8  # of 60 at 5 %, more in 1 % of cases
