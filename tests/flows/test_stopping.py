"""Numbers of runs wanted, from the verdicts so far."""

import json

from hypothesis import given, settings
from hypothesis import strategies as st

from vastflow.flows.request.run_request import SEQUENTIAL
from vastflow.flows.request.stopping import Stopping, stopping_of
from vastflow.oracles.evidence.findings import STOPPING, stopping_rule
from vastflow.oracles.statistics.classes import ClassBounds, StoppingRule
from vastflow.oracles.statistics.looks import MOST_ROUNDS
from vastflow.producers.campaign_file.sections import Sequential, Stop

USUAL = Stopping(StoppingRule())
RULES = [USUAL, Stopping(StoppingRule(2, 40)), Stopping(StoppingRule(1, 12, ClassBounds(0.4, 0.6), 0.3))]

SAID = st.sampled_from(["pass", "fail", "not judged"])
RUNS = st.one_of(*(st.lists(said, max_size=45) for said in (SAID, st.just("pass"), st.sampled_from(["pass", "fail"]))))


def known(said):
    return dict(enumerate(said))


def stop(stopping, said):
    """Return the number of runs at which rounds end."""
    runs = 0
    while (wanted := stopping.wanted(known(said[:runs]))) > runs:
        runs = wanted
    return runs


def test_looks_are_few_and_include_minimum_and_maximum():
    assert USUAL.looks == tuple(range(5, 21))
    for rule in (StoppingRule(5, 60), StoppingRule(5, 200), StoppingRule(3, 3)):
        looks = Stopping(rule).looks
        assert (looks[0], looks[-1]) == (rule.min_runs, rule.max_runs)
        assert len(looks) <= MOST_ROUNDS + 1


@given(st.sampled_from(RULES), RUNS)
@settings(max_examples=60, deadline=None)
def test_runs_end_at_first_deciding_look(stopping, said):
    said = (said + ["not judged"] * stopping.most)[: stopping.most]

    def decided(look):
        passed, failed = said[:look].count("pass"), said[:look].count("fail")
        return stopping.rule.decision(passed, passed + failed) not in (None, "undecided")

    first = next((look for look in stopping.looks if decided(look)), stopping.most)
    assert stop(stopping, said) == stopping.wanted(known(said)) == first


@given(st.sampled_from(RULES), RUNS, RUNS)
@settings(max_examples=60, deadline=None)
def test_wanted_runs_grow_only_with_earlier_runs(stopping, said, later):
    wanted = stopping.wanted(known(said))
    assert stopping.rule.min_runs <= wanted <= stopping.most
    assert wanted <= stopping.wanted(known(said + later))
    if wanted <= len(said):
        assert stopping.wanted(known(said + later)) == stopping.wanted(known(said[:wanted])) == wanted


@given(RUNS, st.integers(1, 20))
@settings(max_examples=60, deadline=None)
def test_blocks_beyond_a_gap_do_not_count(said, gap):
    beyond = {run: each for run, each in known(said + ["fail"] * 20).items() if run != gap - 1}
    assert USUAL.wanted(beyond) == USUAL.wanted({run: each for run, each in beyond.items() if run < gap})


def test_rule_of_file_is_in_metadata():
    stopping = stopping_of(Sequential(min=4, max=30, stop=Stop(error=0.1, systematic=0.3, reliable=0.9)))
    row = json.loads(json.dumps(stopping.as_json))
    assert row == {"min": 4, "max": 30, "error": 0.1, "systematic": 0.3, "reliable": 0.9}
    assert STOPPING == SEQUENTIAL
    assert stopping_rule({SEQUENTIAL: row}) == stopping.rule == StoppingRule(4, 30, ClassBounds(0.3, 0.9), 0.1)
