"""Intervals that hold at every look, and the wealth behind them."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vastflow.oracles.statistics.intervals import mean_interval, needed
from vastflow.oracles.statistics.sequential import interval_at_any_look, log_wealth, needed_at_any_look

SHARES = st.tuples(*[st.floats(0.01, 1.0)] * 3).map(lambda each: np.array(each) / sum(each))
"""Probabilities of a lost pair, of one that ends alike, and of a gained one."""


@given(st.lists(SHARES, min_size=1, max_size=3), st.integers(1, 2))
def test_wealth_never_grows_in_expectation_for_unequal_configurations(configurations, rounds):
    chances = configurations * rounds
    bound = float(np.mean([share @ (-1, 0, 1) for share in configurations]))
    expected = 0.0
    for outcome in product(range(3), repeat=len(chances)):
        chance = np.prod([share[k] for share, k in zip(chances, outcome, strict=True)])
        expected += chance * np.exp(log_wealth(np.array(outcome) - 1.0, np.ones(len(outcome)), bound))
    assert expected <= 1.0 + 1e-9


def test_wealth_is_expected_to_grow_where_the_mean_is_higher():
    pairs = list(product((-1, 0, 1), repeat=2))
    chances = [np.prod([{-1: 0.1, 0: 0.5, 1: 0.4}[value] for value in pair]) for pair in pairs]
    assert sum(p * np.exp(log_wealth(pair, [1, 1], 0.2)) for p, pair in zip(chances, pairs, strict=True)) > 1.01


@pytest.mark.parametrize("shares", [(0.2, 0.6, 0.2), (0.02, 0.96, 0.02), (0.5, 0.0, 0.5), (0.02, 0.98, 0.0)])
def test_wealth_ever_excludes_the_mean_in_one_of_40_cases_at_most(shares):
    lost, alike, gained = shares
    going, wrong = {(0, 0): 1.0}, 0.0
    for look in range(1, 81):
        after: dict[tuple[int, int], float] = {}
        for (down, up), chance in going.items():
            for state, share in (((down + 1, up), lost), ((down, up), alike), ((down, up + 1), gained)):
                after[state] = after.get(state, 0.0) + chance * share
        excluded = {
            (down, up)
            for down, up in after
            if log_wealth((-1, 0, 1), (down, look - down - up, up), gained - lost) >= np.log(40)
        }
        wrong += sum(after[state] for state in excluded)
        going = {state: chance for state, chance in after.items() if state not in excluded}
    assert 0.0 <= wrong <= 0.025


@given(st.lists(st.sampled_from((-1.0, -0.5, 0.0, 1.0)), min_size=1, max_size=60))
def test_interval_has_the_mean_and_is_mirrored(values):
    low, high = interval_at_any_look(values)
    assert -1.0 <= low <= np.mean(values) <= high <= 1.0
    assert interval_at_any_look(np.negative(values)) == pytest.approx((-high, -low), abs=1e-9)


@given(st.lists(st.sampled_from((-1.0, 0.0, 1.0)), min_size=1, max_size=80), st.floats(-0.9, 0.9))
def test_interval_ends_where_the_wealth_against_a_bound_is_40(values, bound):
    excluded = log_wealth(values, np.ones(len(values)), bound) >= np.log(40)
    assert excluded == (interval_at_any_look(values)[0] > bound)


def test_interval_is_wider_than_that_of_a_fixed_number_of_runs():
    values = [0.0] * 80 + [-1.0] * 12 + [1.0] * 3
    (low, high), fixed = interval_at_any_look(values), mean_interval(values)
    assert low < fixed[0] < fixed[1] < high


def test_needed_pairs_without_a_change_rule_out_the_margin():
    for margin in (0.005, 0.02, 0.1, 0.5):
        least = needed_at_any_look(margin)
        assert interval_at_any_look([0.0] * least)[0] > -margin >= interval_at_any_look([0.0] * (least - 1))[0]
        assert needed(margin) < least < 1.5 * needed(margin)
    assert (needed_at_any_look(0.0), needed_at_any_look(1.0)) == (None, 1)


@pytest.mark.parametrize("values", [[], [0.0, 1.5], [float("nan")]])
def test_interval_refuses_values_beyond_one(values):
    with pytest.raises(ValueError, match=r"expected values within -1\.\.1, got"):
        interval_at_any_look(values)
