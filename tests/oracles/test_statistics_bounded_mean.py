"""The mean of a bounded quantity: its interval where the worst was not seen."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binomtest
from table import each_row

from vastflow.oracles.statistics.intervals import mean_interval, needed


@given(st.integers(0, 400), st.integers(0, 400))
def test_of_all_or_nothing_it_is_the_exact_interval_of_a_rate(worst: int, best: int) -> None:
    n = worst + best
    if n:
        expected = binomtest(best, n).proportion_ci(0.95, "exact")
        found = mean_interval(np.repeat([-1.0, 1.0], [worst, best]))
        assert found == pytest.approx((2 * expected.low - 1, 2 * expected.high - 1), abs=1e-5)


@each_row("values", [[0.0, 0.0], [0.3, -0.2, 0.5], [0.0] * 20 + [-1.0], [0.25] * 4, list(np.linspace(-0.2, 0.1, 40))])
def test_it_is_the_quantile_of_means_under_random_gaps(values: list[float]) -> None:
    weights = np.random.default_rng(5).dirichlet(np.ones(len(values) + 1), 100_000)
    seen, unseen = weights[:, 1:] @ np.array(values), weights[:, 0]
    low, high = mean_interval(values)
    # Shares of draws have a standard error of sqrt(0.025 · 0.975 / 100,000) = 0.0005.
    assert np.mean(seen - unseen < low) == pytest.approx(0.025, abs=0.0025)
    assert np.mean(seen + unseen > high) == pytest.approx(0.025, abs=0.0025)


@given(st.lists(st.floats(-1, 1), min_size=1, max_size=40))
def test_it_holds_the_mean_and_lies_within_what_can_be(values: list[float]) -> None:
    low, high = mean_interval(values)
    assert -1.0 <= low <= np.mean(values) + 1e-9
    assert np.mean(values) - 1e-9 <= high <= 1.0


def test_of_many_it_is_that_of_the_normal_distribution() -> None:
    values = np.random.default_rng(6).choice([-1.0, 0.0, 1.0], 109_600, p=[0.1, 0.85, 0.05])
    half = 1.96 * values.std() / len(values) ** 0.5
    assert mean_interval(values) == pytest.approx((values.mean() - half, values.mean() + half), abs=2e-5)


@each_row("margin", [0.005, 0.02, 0.1, 0.5])
def test_as_many_zeros_as_are_needed_rule_a_margin_out_and_one_less_does_not(margin: float) -> None:
    least = needed(margin)
    assert least is not None
    assert mean_interval(np.zeros(least))[0] > -margin > mean_interval(np.zeros(least - 1))[0]


def test_no_number_of_zeros_rules_out_every_loss_and_one_a_loss_of_more_than_all() -> None:
    assert needed(0.0) is None
    assert needed(1.0) == 1


def test_value_that_cant_be_is_refused() -> None:
    with pytest.raises(ValueError, match=r"values within -1\.\.1, got \[0\.5, 1\.5\]"):
        mean_interval([0.5, 1.5])
    with pytest.raises(ValueError, match=r"values within -1\.\.1, got \[\]"):
        mean_interval([])
