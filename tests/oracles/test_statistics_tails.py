"""Tails of distributions against `scipy.stats`, which reports do without."""

import numpy as np
import pytest
from scipy.stats import binom, chi2, false_discovery_control, hypergeom

from vastflow.oracles.statistics.tails import (
    binomial_at_most,
    binomial_quantile,
    false_discovery,
    hypergeometric,
    log_chi2_tail,
)


@pytest.mark.parametrize("n", [0, 1, 5, 20, 1000])
@pytest.mark.parametrize("p", [0.05, 0.2, 0.5, 0.95])
def test_binomial_tails_agree_with_scipy(n, p):
    x = np.arange(-1.0, n + 1.0)
    assert binomial_at_most(x, np.full(len(x), n), p) == pytest.approx(binom.cdf(x, n, p), rel=1e-9, abs=1e-300)
    for share in (0.05, 0.5, 0.95):
        assert binomial_quantile(share, [n], p) == binom.ppf(share, [n], p)


@pytest.mark.parametrize(
    ("drawn", "failures", "size"), [(5, 3, 12), (5, 9, 12), (5, 0, 12), (5, 12, 12), (400, 90, 900)]
)
def test_hypergeometric_chances_agree_with_scipy(drawn, failures, size):
    expected = hypergeom.pmf(np.arange(drawn + 1), size, failures, drawn)
    assert hypergeometric(drawn, failures, size) == pytest.approx(expected, rel=1e-9, abs=1e-300)


def test_chi_squared_tail_agrees_with_scipy_and_is_silent_where_it_vanishes():
    x = np.array([0.0, 0.5, 40.0, 1e4])
    assert log_chi2_tail(x, 3) == pytest.approx(chi2.logsf(x, 3), rel=1e-9)


def test_adjusted_p_values_agree_with_scipy_for_ties_and_for_none():
    p_values = np.array([0.01, 0.04, 0.04, 0.9, 1.0, 0.0])
    assert false_discovery(p_values) == pytest.approx(false_discovery_control(p_values), rel=1e-12)
    assert false_discovery(np.zeros(0)).shape == (0,)
