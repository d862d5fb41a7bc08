import numpy as np
import pytest
from scipy.stats import betabinom
from table import each_row

from vastflow.oracles.statistics.dispersion import dispersion
from vastflow.oracles.statistics.intervals import clustered_interval

# Boys among the first 12 children of 6115 families with 13 (Saxony, A. Geißler 1889; Lindsey and Altham 1998).
FAMILIES = np.repeat(np.arange(13), [3, 24, 104, 286, 670, 1033, 1343, 1112, 829, 478, 181, 45, 7])
# Rat pups that lived of those born, 16 treated litters (C. S. Weil, Food Cosmet. Toxicol. 8 (1970) 177).
ALIVE = [12, 11, 10, 9, 10, 9, 9, 8, 8, 4, 7, 4, 5, 3, 3, 0]
BORN = [12, 11, 10, 9, 11, 10, 10, 9, 9, 5, 9, 7, 10, 6, 10, 7]


def test_fit_of_geisslers_families_is_the_published_one() -> None:
    found = dispersion(FAMILIES, np.full(len(FAMILIES), 12))
    assert found is not None
    assert (found.alpha, found.beta) == pytest.approx((34.1, 31.58), abs=0.02)
    assert found.icc == pytest.approx(0.0150, abs=5e-5)
    assert found.p_value < 1e-9


def test_fit_of_weils_litters_is_the_published_one() -> None:
    # D. A. Williams, Biometrics 31 (1975) 949: mean 0.74, theta = 1/(alpha + beta) = 0.465.
    found = dispersion(ALIVE, BORN)
    assert found is not None
    assert found.alpha is not None and found.beta is not None
    assert 1 / (found.alpha + found.beta) == pytest.approx(0.465, abs=5e-4)
    assert found.alpha / (found.alpha + found.beta) == pytest.approx(0.74, abs=5e-3)
    best = betabinom.logpmf(ALIVE, BORN, found.alpha, found.beta).sum()
    for a, b in ((1.02, 1.0), (0.98, 1.0), (1.0, 1.02), (1.0, 0.98)):
        assert betabinom.logpmf(ALIVE, BORN, a * found.alpha, b * found.beta).sum() < best


def test_configurations_that_agree_with_themselves_have_an_intraclass_correlation_of_one() -> None:
    found = dispersion([20, 0, 20], [20, 20, 20])
    assert found is not None
    assert (found.icc, found.icc_moments, found.alpha) == (1.0, 1.0, None)
    assert found.design_effect == pytest.approx(20.0)


def test_configurations_that_do_not_differ_have_none() -> None:
    found = dispersion([5, 5, 5, 5], [10, 10, 10, 10])
    assert found is not None
    # Analysis of variance by hand: nothing between, 20 · (1/4) · 2 / 36 within: -1/9.
    assert (found.icc, found.icc_moments) == (0.0, pytest.approx(-1 / 9))
    assert found.p_value > 0.9


@each_row("passed", [0, 20])
def test_where_all_runs_end_alike_nothing_is_over_dispersed(passed: int) -> None:
    found = dispersion([passed] * 3, [20] * 3)
    assert found is not None
    assert (found.icc, found.p_value, found.design_effect) == (0.0, 1.0, 1.0)


def test_one_run_a_configuration_says_nothing_of_repetition() -> None:
    found = dispersion([0, 1, 1], [1, 1, 1])
    assert found is not None
    assert (found.icc, found.icc_moments, found.design_effect) == (None, None, None)


def test_one_configuration_has_a_rate_and_no_interval_for_others() -> None:
    found = dispersion([3, 0], [20, 0])
    assert found is not None
    assert (found.configurations, found.mean, found.interval) == (1, 0.15, None)


def test_without_a_judged_run_there_is_nothing_to_say() -> None:
    assert dispersion([0, 0], [0, 0]) is None
    assert dispersion([], []) is None


def test_planted_distribution_is_recovered_and_the_pooled_interval_is_wide_enough() -> None:
    rng = np.random.default_rng(1)
    passed, judged = rng.binomial(20, rng.beta(0.6, 0.3, 5480)), np.full(5480, 20)
    found = dispersion(passed, judged)
    assert found is not None and found.interval is not None
    assert (found.alpha, found.beta) == pytest.approx((0.6, 0.3), abs=0.02)
    assert found.icc == pytest.approx(1 / 1.9, abs=0.01)
    assert found.interval == clustered_interval(passed, judged)
    assert found.interval.low < 2 / 3 < found.interval.high
