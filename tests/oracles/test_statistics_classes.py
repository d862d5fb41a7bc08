from collections.abc import Sequence

import numpy as np
import pytest
from scipy.stats import binom
from table import each_row

from vastflow.oracles.statistics.classes import (
    CLAIMS,
    ClassBounds,
    classify,
    passes_that_show,
    runs_for_a_claim,
    shares,
    total_failures,
)


def test_configuration_that_passes_all_of_20_runs_is_reliable_and_one_that_passes_none_systematic() -> None:
    found = classify([20, 0, 10], [20, 20, 20])
    assert found.names == ("reliable", "systematic", "flaky")


def test_p_values_are_binomial_tails_at_the_bounds() -> None:
    found = classify([19, 1, 9], [20, 20, 20])
    flaky = max(binom.sf(8, 20, 0.2), binom.cdf(9, 20, 0.8))
    assert found.p_values == pytest.approx([binom.sf(18, 20, 0.8), binom.cdf(1, 20, 0.2), flaky])
    assert found.p_values[0] == pytest.approx(0.0692, abs=5e-5)  # 0.8^20 + 20 · 0.2 · 0.8^19, by hand


def test_19_of_20_do_not_show_a_rate_of_four_in_five() -> None:
    assert classify([19], [20]).names == ("undecided",)


def test_claims_are_adjusted_by_benjamini_and_hochberg() -> None:
    # One of ten has p = 0.8^20 = 0.0115: times ten it is above 5 %; seven of ten have 0.0115 · 10 / 7. Given that 13 or more of 20
    # pass, 0.0115 is 0.0115 / 0.9679.
    assert classify([20] + [17] * 9, [20] * 10).count("reliable") == 0
    found = classify([20] * 7 + [17] * 3, [20] * 10)
    assert found.count("reliable") == 7
    assert found.adjusted[0] == pytest.approx(0.8**20 / binom.sf(12, 20, 0.8) * 10 / 7)


def test_without_judged_runs_a_configuration_is_undecided_and_costs_the_others_nothing() -> None:
    found = classify([20, 0, 0, 2], [20, 0, 0, 2])
    assert found.names == ("reliable", "undecided", "undecided", "undecided")
    assert found.adjusted[0] == pytest.approx(0.8**20 / binom.sf(12, 20, 0.8))


def test_total_failures_are_systematic_however_many_configurations_pass_more_often_than_not() -> None:
    # Two of forty never pass, and the others do in 16 to 18 of 20 runs, of which nothing can be shown.
    found = classify([0] * 2 + [16, 17, 18] * 12 + [17] * 2, [20] * 40)
    assert found.count("systematic") == 2
    assert found.count("undecided") == 38


def test_clear_cases_of_one_class_do_not_pay_for_doubtful_ones_of_another() -> None:
    # 1 of 20 at a rate of 0.2 has p = 0.069, and none of 20 has 0.012: one in thirty that may be systematic is no evidence.
    doubtful = [0] + [4] * 29
    assert classify(doubtful + [20] * 500, [20] * 530).names[0] == "undecided"
    assert classify(doubtful, [20] * 30).names[0] == "undecided"


@each_row(
    ("rates", "weights"),
    [
        ((0.2001, 0.5, 0.7999), (1, 1, 1)),
        ((0.0, 0.2001, 0.7999, 1.0), (1, 9, 9, 1)),
        ((0.0, 0.21, 1.0), (1, 2, 3)),
    ],
)
@each_row("runs", [20, 60])
def test_of_each_class_few_claims_are_wrong_in_expectation(
    rates: Sequence[float], weights: Sequence[int], runs: int
) -> None:
    rng = np.random.default_rng(2)
    campaigns, m = 200, 60
    drawn = rng.choice(len(rates), (campaigns, m), p=np.array(weights) / sum(weights))
    true = np.array([CLAIMS[k] for k in ClassBounds().of(np.array(rates))])
    shares = {claim: 0.0 for claim in CLAIMS}
    for kinds in drawn:
        names = np.array(classify(rng.binomial(runs, np.array(rates)[kinds]), np.full(m, runs)).names)
        for claim in CLAIMS:
            called = names == claim
            shares[claim] += float((called & (true[kinds] != claim)).sum() / max(called.sum(), 1))
    for share in shares.values():
        assert share / campaigns <= 0.05 + 4 * (0.05 * 0.95 / campaigns) ** 0.5


def test_nothing_can_be_claimed_of_two_runs_each() -> None:
    assert set(classify([2, 0, 1], [2, 2, 2]).names) == {"undecided"}


def test_no_configurations_have_no_classes() -> None:
    assert classify([], []).names == ()


def test_fourteen_runs_that_agree_are_the_least_for_reliable_and_systematic() -> None:
    # 0.8^13 = 0.055, 0.8^14 = 0.044.
    assert runs_for_a_claim() == {"systematic": 14, "flaky": 10, "reliable": 14}
    assert runs_for_a_claim(ClassBounds(0.5, 0.9), error=0.05)["reliable"] == 29  # 0.9^28 = 0.052, 0.9^29 = 0.047


def test_of_twenty_runs_all_none_or_about_half_have_to_pass() -> None:
    assert passes_that_show(20) == {"systematic": (0, 0), "flaky": (8, 12), "reliable": (20, 20)}
    assert passes_that_show(10) == {"flaky": (5, 5)}
    assert passes_that_show(2) == passes_that_show(0) == {}


def test_bounds_that_leave_no_room_are_refused() -> None:
    with pytest.raises(ValueError, match=r"0 < systematic < reliable < 1 must hold, got 0\.8 and 0\.2"):
        ClassBounds(0.8, 0.2)


def test_total_failures_are_counted_as_the_paper_counts_them() -> None:
    found = total_failures([0, 0, 10, 20, 0], [20, 20, 20, 20, 0])
    assert (found.configurations, found.failures, found.of_failures) == (2, 40, 50)
    assert found.share == pytest.approx(0.8)


def test_without_a_failure_there_is_no_share_of_failures() -> None:
    assert total_failures([5, 5], [5, 5]).share is None


def test_shares_name_every_class() -> None:
    assert shares(["flaky", "flaky", "undecided"]) == {"systematic": 0, "flaky": 2, "reliable": 0, "undecided": 1}


def test_wrong_claims_stay_rare_where_every_configuration_is_on_a_bound() -> None:
    rng = np.random.default_rng(5)
    wrong = 0
    for _ in range(400):
        names = classify(rng.binomial(30, [0.2] * 20 + [0.8] * 20), np.full(40, 30)).names
        wrong += any(name not in ("systematic", "undecided") for name in names[:20]) or any(
            name not in ("reliable", "undecided") for name in names[20:]
        )
    assert wrong / 400 <= 0.05 + 4 * (0.05 * 0.95 / 400) ** 0.5
