"""Classes of configurations, with a fixed number of runs and with sequential stopping."""

import itertools
import math

import numpy as np
import pytest
from scipy.stats import binom
from table import each_row

from vastflow.oracles.statistics import classes


@each_row(
    ("passed", "judged", "names"),
    [
        ([20, 0, 10], [20, 20, 20], ("reliable", "systematic", "flaky")),
        ([19], [20], ("undecided",)),  # does not show a rate of four in five
        ([2, 0, 1], [2, 2, 2], ("undecided",) * 3),
        ([], [], ()),
        ([20, 0, 0, 2], [20, 0, 0, 2], ("reliable", "undecided", "undecided", "undecided")),
        # Two of forty never pass; 16 to 18 of 20 show nothing.
        ([0] * 2 + [16, 17, 18] * 12 + [17] * 2, [20] * 40, ("systematic",) * 2 + ("undecided",) * 38),
        # 1 of 20 at 0.2 has p = 0.069, none of 20 has 0.012: one in thirty is no evidence.
        ([0] + [4] * 29, [20] * 30, ("undecided",) * 30),
        ([0] + [4] * 29 + [20] * 500, [20] * 530, ("undecided",) * 30 + ("reliable",) * 500),
    ],
)
def test_classify_names_classes(passed, judged, names):
    assert classes.classify(passed, judged).names == names


def test_classify_takes_binomial_tails_and_adjusts_candidates_by_benjamini_and_hochberg():
    found = classes.classify([19, 1, 9], [20, 20, 20])
    flaky = max(binom.sf(8, 20, 0.2), binom.cdf(9, 20, 0.8))
    assert found.p_values == pytest.approx([binom.sf(18, 20, 0.8), binom.cdf(1, 20, 0.2), flaky])
    assert found.p_values[0] == pytest.approx(0.0692, abs=5e-5)  # 0.8^20 + 20 · 0.2 · 0.8^19, by hand
    # 0.8^20 = 0.0115, given that 13 or more of 20 pass: / 0.9679. One of ten is above 5 %, seven of ten are below.
    given = 0.8**20 / binom.sf(12, 20, 0.8)
    assert classes.classify([20] + [17] * 9, [20] * 10).count("reliable") == 0
    found = classes.classify([20] * 7 + [17] * 3, [20] * 10)
    assert (found.count("reliable"), found.adjusted[0]) == (7, pytest.approx(given * 10 / 7))
    assert classes.classify([20, 0, 0, 2], [20, 0, 0, 2]).adjusted[0] == pytest.approx(given)


SPREADS = ((0.2001, 0.5, 0.7999), (1, 1, 1)), ((0.0, 0.2001, 0.7999, 1.0), (1, 9, 9, 1)), ((0.0, 0.21, 1.0), (1, 2, 3))


@each_row(("rates", "weights"), SPREADS)
@each_row("runs", [20, 60])
def test_classify_makes_few_wrong_claims_of_each_class(rates, weights, runs):
    rng = np.random.default_rng(2)
    campaigns, m = 200, 60
    drawn = rng.choice(len(rates), (campaigns, m), p=np.array(weights) / sum(weights))
    true = np.array([classes.CLAIMS[k] for k in classes.ClassBounds().of(np.array(rates))])
    wrong = dict.fromkeys(classes.CLAIMS, 0.0)
    for kinds in drawn:
        names = np.array(classes.classify(rng.binomial(runs, np.array(rates)[kinds]), np.full(m, runs)).names)
        for claim in classes.CLAIMS:
            called = names == claim
            wrong[claim] += float((called & (true[kinds] != claim)).sum() / max(called.sum(), 1))
    assert max(wrong.values()) / campaigns <= 0.05 + 4 * (0.05 * 0.95 / campaigns) ** 0.5


def test_runs_and_passes_that_show_classes_agree_with_tails():
    # 0.8^13 = 0.055, 0.8^14 = 0.044; 0.9^28 = 0.052, 0.9^29 = 0.047.
    assert classes.runs_for_a_claim() == {"systematic": 14, "flaky": 10, "reliable": 14}
    assert classes.runs_for_a_claim(classes.ClassBounds(0.5, 0.9), error=0.05)["reliable"] == 29
    assert classes.passes_that_show(20) == {"systematic": (0, 0), "flaky": (8, 12), "reliable": (20, 20)}
    assert classes.passes_that_show(10) == {"flaky": (5, 5)}
    assert classes.passes_that_show(2) == classes.passes_that_show(0) == {}
    found = classes.total_failures([0, 0, 10, 20, 0], [20, 20, 20, 20, 0])
    assert (found.configurations, found.failures, found.of_failures) == (2, 40, 50)
    assert found.share == pytest.approx(0.8)
    assert classes.total_failures([5, 5], [5, 5]).share is None
    assert [*classes.classify([20, 0, 10], [20, 20, 20]).counts.values()] == [1, 1, 1, 0]


def test_impossible_bounds_and_rules_are_refused():
    for make, message in (
        (lambda: classes.ClassBounds(0.8, 0.2), r"0 < systematic < reliable < 1 must hold, got 0\.8 and 0\.2"),
        (lambda: classes.StoppingRule(5, 3), r"1 <= min_runs <= max_runs must hold, got 5 and 3"),
        (lambda: classes.StoppingRule(error=0.7), r"error must be between 0 and 0\.5, got 0\.7"),
    ):
        with pytest.raises(ValueError, match=message):
            make()


def test_stopping_rule_decides():
    # 0.8^14 = 0.044 is the chance of so many passes at the bound; one failure among twenty would add more than 0.05 allows.
    decisions = {(13, 13): None, (14, 14): "reliable", (0, 14): "systematic", (15, 19): None, (16, 20): "undecided"}
    assert {counts: classes.StoppingRule().decision(*counts) for counts in decisions} == decisions
    assert classes.StoppingRule(min_runs=16).decisions([15, 16], [15, 16]) == [None, "reliable"]
    # Thresholds come near Wald's ln(1/error), from below: the exact error of a truncated test is smaller than his bound.
    systematic, _, reliable = classes.StoppingRule(1, 400).thresholds
    assert reliable == pytest.approx(systematic)
    assert 2.8 < reliable <= math.log(20)
    assert (classes.StoppingRule(2, 10).decidable, classes.StoppingRule(2, 20).decidable) == (
        ("flaky",),
        classes.CLAIMS,
    )


def test_operating_characteristics_are_those_of_all_sequences_of_runs():
    rule = classes.StoppingRule(2, 10, classes.ClassBounds(0.4, 0.6), error=0.2)
    assert len(rule.decidable) >= 2
    said = {(n, x): rule.decision(x, n) for n in range(1, 11) for x in range(n + 1)}
    for p in (0.3, 0.5, 0.9):
        ends, runs = dict.fromkeys((*classes.CLAIMS, "undecided"), 0.0), 0.0
        for outcomes in itertools.product((0, 1), repeat=10):
            chance = math.prod(p if outcome else 1 - p for outcome in outcomes)
            n, name = next((n, name) for n in range(1, 11) if (name := said[n, sum(outcomes[:n])]) is not None)
            ends[name] += chance
            runs += n * chance
        found = rule.operating_characteristics(p)
        ours = [found.systematic[0], found.flaky[0], found.reliable[0], found.undecided[0], found.expected_runs[0]]
        assert ours == pytest.approx([*ends.values(), runs])


@each_row(
    "rule",
    [
        classes.StoppingRule(),
        classes.StoppingRule(5, 60),
        classes.StoppingRule(1, 30, classes.ClassBounds(0.45, 0.55), 0.1),
    ],
)
def test_stopping_rule_holds_its_error_at_all_success_rates(rule):
    assert rule.operating_characteristics(np.linspace(0, 1, 997)).wrong.max() <= rule.error
    assert 0.5 * rule.error < rule.worst_error <= rule.error
    each, rounds = (rule.operating_characteristics([0.2, 0.5, 1.0], runs_per_look) for runs_per_look in (1, 5))
    assert (rounds.wrong <= each.wrong + 1e-12).all()
    assert (rounds.expected_runs >= each.expected_runs).all()


def test_classes_and_savings_of_stopped_campaign_follow_its_rule():
    found = classes.classes_by(classes.StoppingRule(), [14, 0, 16, 3], [14, 14, 20, 3])
    assert found.names == ("reliable", "systematic", "undecided", "undecided")
    assert "at most 5 %" in found.controls
    saved = classes.runs_saved(classes.StoppingRule(), [14, 14, 20, 20])
    assert (saved.runs, saved.saved, saved.share) == (68, 12, pytest.approx(0.15))
    assert classes.runs_saved(classes.StoppingRule(), []).share == 0.0
