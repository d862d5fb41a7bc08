"""Intervals that hold at every look, and the wealth behind them."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sequential_comparison import Planted, measured

from vastflow.oracles.statistics.intervals import mean_interval
from vastflow.oracles.statistics.sequential import interval_at_any_look, log_wealth

SHARES = st.tuples(*[st.floats(0.01, 1.0)] * 3).map(lambda each: np.array(each) / sum(each))
"""Probabilities of a lost pair, of one that ends alike, and of a gained one."""
VALUES = (-1.0, 0.0, 1.0)


@given(st.lists(st.tuples(SHARES, st.integers(1, 4)), min_size=1, max_size=3), st.integers(1, 2))
def test_wealth_never_grows_in_expectation_for_unequal_configurations(seeds, rounds):
    bets, sizes = seeds * rounds, np.array([size for _, size in seeds * rounds])
    bound = sum(size * (share @ (-1, 0, 1)) for share, size in seeds) / sum(size for _, size in seeds)
    expected = 0.0
    for outcome in product(range(3), repeat=len(bets)):
        chance = np.prod([share[k] for (share, _), k in zip(bets, outcome, strict=True)])
        sums = sizes * (np.array(outcome) - 1.0)
        expected += chance * np.exp(log_wealth(sums, sizes, np.ones(len(sums)), bound))
    assert expected <= 1.0 + 1e-9


def test_wealth_grows_in_expectation_where_the_mean_is_higher():
    pairs = list(product((-1, 0, 1), repeat=2))
    chances = [np.prod([{-1: 0.1, 0: 0.5, 1: 0.4}[value] for value in pair]) for pair in pairs]
    wealth = [np.exp(log_wealth(pair, (1, 1), (1, 1), 0.2)) for pair in pairs]
    assert np.dot(chances, wealth) > 1.01


@pytest.mark.parametrize("shares", [(0.2, 0.6, 0.2), (0.02, 0.96, 0.02), (0.5, 0.0, 0.5), (0.05, 0.95, 0.0)])
def test_wealth_ever_excludes_the_mean_in_one_of_40_cases_at_most(shares):
    mean, wrong, going = shares[2] - shares[0], 0.0, np.ones((1, 1))
    for look in range(1, 121):
        after = np.zeros((look + 1, look + 1))
        after[1:, :-1] += shares[0] * going
        after[:-1, :-1] += shares[1] * going
        after[:-1, 1:] += shares[2] * going
        lost, gained = np.indices(after.shape)
        alike = np.maximum(look - lost - gained, 0)
        excluded = log_wealth(VALUES, (1, 1, 1), np.stack((lost, alike, gained), axis=-1), mean) >= np.log(40)
        wrong += after[excluded].sum()
        going = np.where(excluded, 0.0, after)
    assert 0.001 < wrong <= 0.025


@given(st.lists(st.sampled_from((-1.0, -0.5, 0.0, 1.0)), min_size=1, max_size=60))
def test_interval_has_the_mean_and_is_mirrored(values):
    low, high = interval_at_any_look(values)
    assert -1.0 <= low <= np.mean(values) <= high <= 1.0
    assert interval_at_any_look(np.negative(values)) == pytest.approx((-high, -low), abs=1e-9)


@given(st.lists(st.sampled_from((-1.0, 0.0, 1.0)), min_size=1, max_size=80), st.floats(-0.9, 0.9))
def test_interval_ends_where_the_wealth_against_a_bound_is_40(values, bound):
    excluded = log_wealth(values, np.ones(len(values)), np.ones(len(values)), bound) >= np.log(40)
    assert excluded == (interval_at_any_look(values)[0] > bound)


def test_interval_is_wider_than_that_of_a_fixed_number_of_runs():
    values = [0.0] * 80 + [-1.0] * 12 + [1.0] * 3
    (low, high), fixed = interval_at_any_look(values), mean_interval(values)
    assert low < fixed[0] < fixed[1] < high


def test_interval_rules_out_two_points_after_227_unchanged_seeds():
    assert interval_at_any_look([0.0] * 227)[0] > -0.02 > interval_at_any_look([0.0] * 226)[0]
    assert interval_at_any_look([0.0] * 908, np.arange(908) // 4)[0] > -0.02
    assert interval_at_any_look([0.0] * 904, np.arange(904) // 4)[0] < -0.02


@given(st.lists(st.sampled_from(VALUES), min_size=1, max_size=40), st.integers(2, 4))
def test_interval_learns_nothing_from_copies_with_the_same_noise(values, copies):
    alone = interval_at_any_look(values)
    copied = interval_at_any_look(np.repeat(values, copies), np.repeat(np.arange(len(values)), copies))
    assert copied == pytest.approx(alone, abs=1e-9)


def test_claims_are_rarely_false_unless_shared_noise_is_ignored():
    false = {}
    for kind in ("spread", "shared", "ignored"):
        found = measured(Planted(kind, 50, 20, 0.05, -0.05), 200, np.random.default_rng(7))
        false[kind] = found.false
    assert max(false["spread"], false["shared"]) <= 0.025
    assert false["ignored"] > 0.1


@pytest.mark.parametrize("values", [[], [0.0, 1.5], [float("nan")]])
def test_interval_refuses_values_beyond_one(values):
    with pytest.raises(ValueError, match=r"expected values within -1\.\.1, got"):
        interval_at_any_look(values)
