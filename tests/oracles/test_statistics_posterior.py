"""How likely a configuration's success rate reaches a bound."""

import numpy as np
import pytest

from vastflow.oracles.statistics.dispersion import chance_of_at_least, dispersion


def test_of_configurations_that_differ_like_a_planted_beta_so_many_reach_the_bound_as_is_said():
    rng = np.random.default_rng(18)
    p = rng.beta(1.5, 0.5, 4000)
    judged = np.full(4000, 6)
    passed = rng.binomial(judged, p)
    chance = chance_of_at_least(0.8, passed, judged, dispersion(passed, judged))
    for x in range(7):
        of = passed == x
        assert chance[of].mean() == pytest.approx((p[of] >= 0.8).mean(), abs=4 / np.sqrt(of.sum()) * 0.5)
    assert chance.mean() == pytest.approx((p >= 0.8).mean(), abs=0.03)


def test_more_passes_of_as_many_runs_are_a_greater_chance():
    chance = chance_of_at_least(0.8, np.arange(6), np.full(6, 5), None)
    assert np.all(np.diff(chance) > 0) and chance[0] < 0.001 and chance[-1] > 0.7


def test_without_a_fit_the_prior_is_that_of_jeffreys():
    # Of no run: 1 - (2/π) arcsin √0.8.
    assert chance_of_at_least(0.8, [0], [0], None)[0] == pytest.approx(1 - 2 / np.pi * np.arcsin(np.sqrt(0.8)))
