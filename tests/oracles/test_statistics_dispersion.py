"""Over-dispersion against published fits, and the probability of reaching a bound."""

import numpy as np
import pytest
from scipy.stats import betabinom
from table import each_row

from vastflow.oracles.statistics.dispersion import chance_of_at_least, dispersion
from vastflow.oracles.statistics.intervals import clustered_interval

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
        ([3, 0], [20, 0], {"configurations": 1, "mean": 0.15, "interval": None}),
    ],
)
def test_dispersion_has_known_limits(passed, judged, expected):
    found = dispersion(passed, judged)
    assert {name: getattr(found, name) for name in expected} == expected


def test_dispersion_needs_judged_runs_and_finds_no_difference_between_equals():
    assert dispersion([0, 0], [0, 0]) is dispersion([], []) is None
    assert dispersion([5] * 4, [10] * 4).p_value > 0.9


def test_dispersion_recovers_planted_distribution():
    rng = np.random.default_rng(1)
    passed, judged = rng.binomial(20, rng.beta(0.6, 0.3, 5480)), np.full(5480, 20)
    found = dispersion(passed, judged)
    assert (found.alpha, found.beta) == pytest.approx((0.6, 0.3), abs=0.02)
    assert found.icc == pytest.approx(1 / 1.9, abs=0.01)
    assert found.interval == clustered_interval(passed, judged)
    assert found.interval.low < 2 / 3 < found.interval.high


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


def test_chance_of_at_least_rises_with_passes_from_jeffreys_prior():
    chance = chance_of_at_least(0.8, np.arange(6), np.full(6, 5), None)
    assert np.all(np.diff(chance) > 0) and chance[0] < 0.001 and chance[-1] > 0.7
    # Without a run: 1 - (2/π) arcsin √0.8.
    assert chance_of_at_least(0.8, [0], [0], None)[0] == pytest.approx(1 - 2 / np.pi * np.arcsin(np.sqrt(0.8)))
