"""The checks for oracles: the built-in ones keep the contract, and what breaks it is found."""

import itertools
import random
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from table import each_row

from vastflow.oracles.judgement.conformance import CHECKS, check_oracle, sample_runs
from vastflow.oracles.judgement.oracle import Oracle, Parameters, known_oracles, oracle_of


@each_row("check", CHECKS)
@each_row("name", known_oracles())
def test_every_installed_oracle_keeps_the_contract(name, check):
    check(oracle_of(name, {}), sample_runs())


def test_all_of_our_oracles_are_installed():
    assert {"navigation", "performance", "robustness", "safety", "success"} <= set(known_oracles())


class Arrived(Oracle):
    """Fails where the robot is not at x = 5 m in the end."""

    Parameters = Parameters
    metrics = {"final_x": "m"}  # noqa: RUF012 - never changed

    def judge(self, trace, situation):
        if not len(trace):
            return self.not_judged(trace, "the recording has no rows")
        final_x = float(trace["x_m"][-1])
        return self.passed(trace, final_x=final_x) if final_x >= 5 else self.failed(trace, "no", final_x=final_x)


def an_oracle(**broken):
    kind = type("Mine", (Arrived,), broken)
    kind.__module__, kind.__qualname__ = __name__, "Mine"
    globals()["Mine"] = kind
    return kind(Parameters(), "mine", Path())


def test_oracle_that_keeps_the_contract_passes():
    check_oracle(an_oracle())


def judging(judge):
    return {"judge": judge}


COUNT = itertools.count()
BREAKS = {
    "raises without rows": (
        judging(lambda self, trace, situation: self.passed(trace, final_x=float(trace["x_m"][-1]))),
        "Mine must judge 'no rows', or say `not_judged`, and not raise IndexError",
    ),
    "reads what may be missing": (
        judging(
            lambda self, trace, situation: (
                self.passed(trace, final_x=float(trace["wall_clearance_m"].sum()))
                if len(trace)
                else self.not_judged(trace, "no rows")
            )
        ),
        "Mine must judge 'an empty corridor without wall_clearance_m', or say `not_judged`, and not raise KeyError",
    ),
    "a metric that is infinite": (
        judging(lambda self, trace, situation: self.passed(trace, final_x=np.inf)),
        "Mine's final_x of 'an empty corridor' must be a finite number or None, not inf",
    ),
    "a failure without a reason": (
        judging(lambda self, trace, situation: self.failed(trace, " ")),
        "Mine must say why 'an empty corridor' is 'fail'",
    ),
    "a verdict without its metrics": (
        judging(lambda self, trace, situation: replace(self.passed(trace), metrics={})),
        "Mine must have all of its metrics in each verdict",
    ),
    "another one's verdict": (
        judging(lambda self, trace, situation: replace(self.passed(trace), oracle="yours")),
        "Mine must give its own name and the run's index",
    ),
    "no verdict": (judging(lambda self, trace, situation: True), "Mine must give a Verdict on .*, not bool"),
    "a metric without a unit": (
        {"metrics": {"final_x": ""}},
        "Mine must declare the unit of 'final_x', '1' for a count",
    ),
    "state": (
        judging(lambda self, trace, situation, count=COUNT: self.passed(trace, final_x=float(next(count)))),
        "Mine must say the same of the same run",
    ),
    "a global generator": (
        judging(
            lambda self, trace, situation: self.passed(trace, final_x=random.Random(1).random() + 0 * random.random())
        ),
        "Mine must not use a global generator",
    ),
    "what depends on the other runs": (
        {"judge_all": lambda self, traces, situation: [self.judge(traces[0], situation) for _ in traces]},
        "Mine must judge 'an empty corridor' together as alone",
    ),
}


def changes_its_trace(self, trace, situation):
    if len(trace):
        trace["x_m"][:] = 5.0
    return self.passed(trace, final_x=5.0)


BREAKS["a changed trace"] = (judging(changes_its_trace), "Mine must not change the trace of 'an empty corridor'")


@each_row("what", BREAKS)
def test_oracle_that_breaks_the_contract_is_found(what):
    broken, message = BREAKS[what]
    with pytest.raises(AssertionError, match=message):
        check_oracle(an_oracle(**broken))
