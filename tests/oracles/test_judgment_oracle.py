"""Oracles found by name and by file, their contract, and the form of verdicts."""

import itertools
import pickle
import random
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from table import each_row

from vastflow.oracles.catalog.safety import Safety
from vastflow.oracles.judgment import verdict
from vastflow.oracles.judgment.conformance import CHECKS, check_oracle, sample_runs
from vastflow.oracles.judgment.oracle import Oracle, Parameters
from vastflow.oracles.judgment.registry import OracleError, known_oracles, oracle_of, oracles_of
from vastflow.sim.model.faults import message_of

OWN = """
from vastflow.oracles.judgment.oracle import Oracle, Parameters


class Limit(Parameters):
    seconds: float = 10.0


class Quick(Oracle[Limit]):
    Parameters = Limit
    metrics = {"time": "s"}

    def judge(self, trace, situation):
        if trace.run.simulated_s <= self.parameters.seconds:
            return self.passed(trace, time=trace.run.simulated_s)
        return self.failed(trace, "too slow", time=trace.run.simulated_s)


class NoOracle:
    pass
"""


@pytest.fixture
def own_oracle(tmp_path):
    (tmp_path / "own.py").write_text(OWN)
    (tmp_path / "broken.py").write_text("1 / 0")
    return tmp_path


def test_oracles_of_campaign_begin_with_success():
    assert isinstance(oracle_of("safety", {}), Safety)
    assert [oracle.name for oracle in oracles_of([("safety", {})])] == ["success", "safety"]
    success, safety = oracles_of([("safety", {}), ("success", {"allow_missed": True})])
    assert (success.name, success.parameters.allow_missed, safety.name) == ("success", True, "safety")


def test_wrong_parameters_are_reported_at_their_places():
    with pytest.raises(OracleError, match="max_deceleration_mps2") as caught:
        oracle_of("safety", {"robot_radius": 0.2, "max_deceleration_mps2": 0})
    faults = {fault.location: message_of(fault.problem, fault.expected) for fault in caught.value.faults}
    assert faults == {
        ("robot_radius",): "Unknown key 'robot_radius'. Did you mean 'robot_radius_m'?",
        ("max_deceleration_mps2",): "expected greater than 0, got 0",
    }


@each_row(
    ("name", "message"),
    [
        ("absent.py:Quick", "There is no file"),
        ("own.py:Slow", "has no class 'Slow'"),
        ("own.py:NoOracle", "is not an oracle"),
        ("broken.py:Quick", "can't be imported: ZeroDivisionError"),
    ],
)
def test_unusable_name_is_refused(own_oracle, name, message):
    with pytest.raises(OracleError, match=message) as caught:
        oracle_of(name, {}, own_oracle)
    assert [fault.location for fault in caught.value.faults] == [()]


def test_oracle_of_file_is_frozen_and_can_be_pickled(own_oracle):
    before = oracle_of("own.py:Quick", {"seconds": 3}, own_oracle)
    (own_oracle / "own.py").write_text(OWN.replace("= 10.0", "= 20.0"))
    assert (before.parameters.seconds, oracle_of("own.py:Quick", {}, own_oracle).parameters.seconds) == (3.0, 20.0)
    assert pickle.loads(pickle.dumps(before)).parameters == before.parameters
    check_oracle(oracle_of("own.py:Quick", {}, own_oracle))


@each_row("check", CHECKS)
@each_row("name", known_oracles())
def test_installed_oracles_keep_contract(name, check):
    check(oracle_of(name, {}), sample_runs())


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


def measuring(final_x):
    return {"judge": lambda self, trace, situation: self.passed(trace, final_x=final_x(trace))}


def answering(verdict):
    return {"judge": lambda self, trace, situation: verdict(self, trace)}


def changing(self, trace, situation):
    if len(trace):
        trace["x_m"][:] = 5.0
    return self.passed(trace, final_x=5.0)


COUNT = itertools.count()


@each_row(
    ("broken", "message"),
    [
        (measuring(lambda trace: float(trace["x_m"][-1])), "judge 'no rows', or say `not_judged`, and not raise IndexError"),
        (
            measuring(lambda trace: float(trace["wall_clearance_m"].sum()) if len(trace) else 0.0),
            "judge 'an empty corridor without wall_clearance_m', or say `not_judged`, and not raise KeyError",
        ),
        (measuring(lambda trace: np.inf), "final_x of 'an empty corridor' must be a finite number or None, not inf"),
        (answering(lambda self, trace: self.failed(trace, " ")), "say why 'an empty corridor' is 'fail'"),
        (answering(lambda self, trace: replace(self.passed(trace), metrics={})), "have all of its metrics in each verdict"),
        (answering(lambda self, trace: replace(self.passed(trace), oracle="yours")), "its own name and the run's index"),
        (answering(lambda self, trace: True), "give a Verdict on .*, not bool"),
        ({"metrics": {"final_x": ""}}, "declare the unit of 'final_x', '1' for a count"),
        (measuring(lambda trace: float(next(COUNT))), "say the same of the same run"),
        (measuring(lambda trace: random.Random(1).random() + 0 * random.random()), "not use a global generator"),
        (
            {"judge_all": lambda self, traces, situation: [self.judge(traces[0], situation) for _ in traces]},
            "judge 'an empty corridor' together as alone",
        ),
        ({"judge": changing}, "not change the trace of 'an empty corridor'"),
    ],
)  # fmt: skip
def test_conformance_finds_broken_contract(broken, message):
    check_oracle(an_oracle())
    with pytest.raises(AssertionError, match=message):
        check_oracle(an_oracle(**broken))


VERDICTS = [
    verdict.Verdict(
        "success", 0, "pass", "", {"time": verdict.Metric(12.5, "s"), "final_distance": verdict.Metric(None, "m")}
    ),
    verdict.Verdict("performance", 0, "not judged", "no reference path: the scenario has no map", {}),
]


def test_verdicts_have_one_written_form():
    written = verdict.write_verdicts(VERDICTS)
    assert written == (
        rb'[{"judgment":"pass","metrics":"{\"final_distance\":{\"value\":null,\"unit\":\"m\"},'
        rb'\"time\":{\"value\":12.5,\"unit\":\"s\"}}","oracle":"success","reason":"","run_index":0},'
        rb'{"judgment":"not judged","metrics":"{}","oracle":"performance",'
        rb'"reason":"no reference path: the scenario has no map","run_index":0}]'
    )
    read = verdict.read_verdicts(written)
    assert read == VERDICTS and verdict.write_verdicts(read) == written
    assert read[0].metrics["time"] == verdict.Metric(12.5, "s") and list(read[0].metrics) == ["final_distance", "time"]
    assert repr(read[1].metrics) == "{}" and VERDICTS[0].metrics == read[0].metrics != VERDICTS[1].metrics
    said = [verdict.Verdict("success", 0, "fail", "a program wrote \ud800")]
    assert verdict.read_verdicts(verdict.write_verdicts(said)) == said
    with pytest.raises(ValueError, match="not JSON compliant"):
        verdict.write_verdicts([verdict.Verdict("success", 0, "pass", "", {"time": verdict.Metric(float("nan"), "s")})])


@each_row(
    ("judgments", "together"),
    [
        (["pass", "pass"], "pass"),
        (["pass", "fail"], "fail"),
        (["not judged", "fail"], "fail"),
        (["pass", "not judged"], "not judged"),
        ([], "not judged"),
    ],
)
def test_run_judgment_joins_oracles(judgments, together):
    assert verdict.run_judgment(judgments) == together


@each_row(
    ("quantity", "samples", "value"),
    [
        (verdict.RunQuantity(), [1.0, 0.0], 0.5),
        (verdict.RunQuantity("success"), [1.0, 0.0], 0.5),
        (verdict.RunQuantity("success", "time"), [4.0, 1.0, 2.0], 7 / 3),
        (verdict.RunQuantity("success", "time", "median"), [4.0, 1.0, 2.0], 2.0),
        (verdict.RunQuantity("success", "time", "min"), [4.0, 1.0, 2.0], 1.0),
        (verdict.RunQuantity("success", "time", "max"), [4.0, 1.0, 2.0], 4.0),
        (verdict.RunQuantity("success", "time", "quantile", 0.25), [4.0, 1.0, 2.0], 1.5),
        (verdict.RunQuantity("success", "distance"), [], None),
    ],
)
def test_run_quantity_aggregates_runs_that_have_it(quantity, samples, value):
    judgments = {0: ("fail", 4.0), 1: ("pass", 1.0), 2: ("not judged", 2.0), 9: ("fail", 8.0)}
    verdicts = [
        verdict.Verdict("success", run, judgment, "", {"time": verdict.Metric(time_s, "s")})
        for run, (judgment, time_s) in judgments.items()
    ]
    assert quantity.samples(verdicts, range(3)) == samples
    assert quantity.value(samples) == (None if value is None else pytest.approx(value))
