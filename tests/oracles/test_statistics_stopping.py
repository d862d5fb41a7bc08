import itertools
import math

import numpy as np
import pytest
from table import each_row

from vastflow.oracles.statistics.classes import CLAIMS, ClassBounds
from vastflow.oracles.statistics.stopping import StoppingRule, classes_by, runs_saved


def test_configuration_is_reliable_after_fourteen_passes_in_a_row() -> None:
    # 0.8^14 = 0.044 is the chance of so many at the bound; one failure among twenty would add more than 0.05 allows.
    rule = StoppingRule()
    assert rule.decision(13, 13) is None
    assert rule.decision(14, 14) == "reliable"
    assert rule.decision(0, 14) == "systematic"


def test_what_is_open_at_the_most_runs_is_undecided() -> None:
    rule = StoppingRule()
    assert rule.decision(15, 19) is None
    assert rule.decision(16, 20) == "undecided"


def test_nothing_is_decided_before_the_least_runs() -> None:
    rule = StoppingRule(min_runs=16)
    assert rule.decision(15, 15) is None
    assert rule.decision(16, 16) == "reliable"


def test_thresholds_of_many_runs_come_near_walds() -> None:
    # ln(1/error), from below: the exact error of a truncated test is smaller than Wald's bound.
    systematic, _, reliable = StoppingRule(1, 400).thresholds
    assert reliable == pytest.approx(systematic)
    assert 2.8 < reliable <= math.log(20)


def test_characteristics_are_those_of_every_sequence_of_runs() -> None:
    rule = StoppingRule(2, 10, ClassBounds(0.4, 0.6), error=0.2)
    assert len(rule.decidable) >= 2
    said = {(n, x): rule.decision(x, n) for n in range(1, 11) for x in range(n + 1)}
    for p in (0.3, 0.5, 0.9):
        ends = dict.fromkeys((*CLAIMS, "undecided"), 0.0)
        runs = 0.0
        for outcomes in itertools.product((0, 1), repeat=10):
            chance = math.prod(p if outcome else 1 - p for outcome in outcomes)
            n, name = next((n, name) for n in range(1, 11) if (name := said[n, sum(outcomes[:n])]) is not None)
            ends[name] += chance
            runs += n * chance
        found = rule.operating_characteristics(p)
        assert [found.systematic[0], found.flaky[0], found.reliable[0], found.undecided[0]] == pytest.approx(
            list(ends.values())
        )
        assert found.expected_runs[0] == pytest.approx(runs)


@each_row("rule", [StoppingRule(), StoppingRule(5, 60), StoppingRule(1, 30, ClassBounds(0.45, 0.55), 0.1)])
def test_no_success_rate_makes_a_false_claim_likelier_than_stated(rule: StoppingRule) -> None:
    rates = np.linspace(0, 1, 997)
    assert rule.operating_characteristics(rates).wrong.max() <= rule.error
    assert 0.5 * rule.error < rule.worst_error <= rule.error


def test_errors_and_runs_of_drawn_configurations_are_the_computed_ones() -> None:
    rule, configurations = StoppingRule(5, 40), 3000
    rng = np.random.default_rng(11)
    for p in (0.02, 0.2, 0.5):
        passed = np.cumsum(rng.random((configurations, 40)) < p, axis=1)
        names = np.array([rule.decisions(passed[:, n - 1], np.full(configurations, n)) for n in range(1, 41)]).T
        ended = np.not_equal(names, None).argmax(axis=1)
        last = names[np.arange(configurations), ended]
        expected = rule.operating_characteristics(p)
        assert (ended + 1).mean() == pytest.approx(expected.expected_runs[0], abs=0.5)
        for name in CLAIMS:
            chance = getattr(expected, name)[0]
            noise = 4 * math.sqrt(max(chance * (1 - chance), 1e-3) / configurations)
            assert (last == name).mean() == pytest.approx(chance, abs=noise)


def test_looking_after_rounds_makes_fewer_errors_and_more_runs() -> None:
    rule = StoppingRule(5, 40)
    each, rounds = (rule.operating_characteristics([0.2, 0.5, 1.0], runs_per_look) for runs_per_look in (1, 5))
    assert (rounds.wrong <= each.wrong + 1e-12).all()
    assert (rounds.expected_runs >= each.expected_runs).all()


def test_class_that_the_most_runs_cant_show_is_not_decidable() -> None:
    assert StoppingRule(2, 10).decidable == ("flaky",)
    assert StoppingRule(2, 20).decidable == CLAIMS


def test_rule_that_ends_before_it_begins_is_refused() -> None:
    with pytest.raises(ValueError, match=r"1 <= min_runs <= max_runs must hold, got 5 and 3"):
        StoppingRule(5, 3)
    with pytest.raises(ValueError, match=r"error must be between 0 and 0\.5, got 0\.7"):
        StoppingRule(error=0.7)


def test_classes_of_a_stopped_campaign_are_the_rules_and_say_what_they_control() -> None:
    found = classes_by(StoppingRule(), [14, 0, 16, 3], [14, 14, 20, 3])
    assert found.names == ("reliable", "systematic", "undecided", "undecided")
    assert "at most 5 %" in found.controls


def test_runs_saved_are_those_below_the_most() -> None:
    saved = runs_saved(StoppingRule(), [14, 14, 20, 20])
    assert (saved.runs, saved.saved, saved.share) == (68, 12, pytest.approx(0.15))
    assert runs_saved(StoppingRule(), []).share == 0.0
