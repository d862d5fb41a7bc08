"""Rates of configurations whose runs end by a rule, and intervals of their mean."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from truth_headline import POPULATIONS, measured

from vastflow.oracles.evidence.headline import Headline
from vastflow.oracles.statistics.classes import StoppingRule
from vastflow.oracles.statistics.intervals import Interval, wilson
from vastflow.oracles.statistics.looks import Looks, mean_rate

LOOKS = Looks(StoppingRule(5, 60))


def test_rates_after_one_look_at_two_runs_are_those_by_hand():
    # A rule that ends after one run where it passes, and after two where it does not: ends are P, FP, FF.
    looks = Looks(StoppingRule(1, 2))
    looks.rule.__dict__["decided"] = np.array([[False] * 3, [False, True, False], [False] * 3])
    assert looks.rates([1, 1, 0], [1, 2, 2]).tolist() == [1.0, 0.0, 0.0]
    assert np.isnan(looks.rates([0], [0])).all()


@given(st.floats(0.0, 1.0))
def test_rates_are_unbiased_whatever_the_true_rate(p):
    ends, reach = LOOKS._ends, LOOKS._reach[0]
    n, x = np.nonzero(ends & (reach > 0))
    chance = reach[n, x] * 2.0**n * p**x * (1 - p) ** (n - x)
    assert chance.sum() == pytest.approx(1.0)
    assert chance @ LOOKS.rates(x, n) == pytest.approx(p, abs=1e-9)
    if 0.6 < p < 0.7:
        assert chance @ (x / n) < p - 0.02


@given(st.integers(1, 30), st.lists(st.integers(0, 30), min_size=1, max_size=8))
def test_mean_rate_of_equal_runs_is_pooled_rate_with_wilson_interval(runs, passes):
    x = np.minimum(passes, runs)
    rate, interval = mean_rate(x / runs, np.full(len(x), runs))
    whole = wilson(int(x.sum()), runs * len(x))
    assert rate == pytest.approx(x.sum() / (runs * len(x)))
    assert (interval.low, interval.high) == pytest.approx((whole.low, whole.high), abs=1e-9)


def test_fixed_runs_are_a_rule_whose_effective_runs_are_their_number():
    looks = Looks(StoppingRule(20, 20))
    assert looks.effective_runs(0.3, [20, 20]).tolist() == pytest.approx([20.0, 20.0])
    assert looks.effective_runs(0.3, [4]).tolist() == [4]  # of 20 runs 16 were not judged
    assert looks.rates([3], [20]).tolist() == [0.15]


def test_mean_rate_leaves_out_configurations_without_judged_runs():
    assert mean_rate([np.nan], [0]) is None
    assert mean_rate([0.5, np.nan], [10, 0]) == mean_rate([0.5], [10])


@pytest.mark.parametrize(
    ("headline", "text"),
    [
        (Headline(0.76, Interval(0.69, 0.81), Interval(0.37, 0.94), 24), "76 % passed; 69–81 % for these configurations, 37–94 % for others of their kind"),
        (Headline(0.76, Interval(0.69, 0.81), Interval(0.37, 0.94), 24, kind="other paths on these maps"), "76 % passed; 69–81 % for these configurations, 37–94 % for other paths on these maps"),
        (Headline(1.0, Interval(0.72, 1.0), None, 1), "100 % passed; 72–100 % for this configuration"),
        (Headline(0.5, Interval(0.2, 0.8), None, 2, 1), "50 % passed; 20–80 % for these configurations; 1 configuration has no judged run"),
        (Headline(None, left_out=3), "nothing was judged"),
        (Headline(None), "nothing was run"),
        (Headline(None, finding="point-7: confirmed."), "point-7: confirmed."),
    ],
)  # fmt: skip
def test_headline_says_no_more_than_follows(headline, text):
    assert headline.text == text


@pytest.mark.slow
@pytest.mark.parametrize("population", list(POPULATIONS)[:3])
@pytest.mark.parametrize(("rule", "configurations"), [("5…12 at 0.15", 6), ("5…60", 40), ("5…60", 200)])
def test_headline_holds_the_mean_of_true_rates_where_runs_stop_early(population, rule, configurations):
    cell = measured(population, rule, configurations, campaigns=100)
    assert cell.good, str(cell)


def test_headline_holds_the_mean_of_true_rates_of_few_hard_configurations():
    cell = measured("80 % at 1, 20 % at 0.8", "5…60", 40, campaigns=60)
    assert cell.these >= 0.9 and abs(cell.bias) < 0.01 and cell.pooled_bias < -0.03
