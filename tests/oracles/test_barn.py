"""The oracle `barn` on hand-computed runs: a robot drives 10 m along x, at a speed of its own."""

import numpy as np
import pytest
from table import each_row

from vastflow.oracles.judgment.registry import oracle_of
from vastflow.oracles.observation.situation import Situation
from vastflow.oracles.observation.trace import NoReference, Trace
from vastflow.sim.model.pose import Pose
from vastflow.sim.model.recording import Event, Run

START, GOAL = Pose(0.0, 0.0), Pose(10.0, 0.0)


def judged(x_m, *touched_s, outcome="succeeded", length_m=12.0):
    """The verdict on a robot that is at `x_m` every 0.1 s, as judgment, reason, and values of metrics."""
    x_m = np.asarray(x_m, dtype=float)
    events = tuple(Event(t_s, "contact", 0.0, 0.0, f"circle {k}") for k, t_s in enumerate(touched_s, 1))
    run = Run(3, "0", outcome, 0, "", len(x_m) * 0.1, 10.0, 0, 0, events)
    columns = {"t_s": np.arange(len(x_m)) * 0.1, "x_m": x_m, "y_m": 0.0 * x_m}
    situation = Situation(START, (GOAL,), (), reference_length_m=length_m)
    verdict = oracle_of("barn", {}).judge(Trace(run, columns, NoReference("no map")), situation)
    return verdict.judgment, verdict.reason, {name: metric.value for name, metric in verdict.metrics.items()}


def at(speed_mps, waits_s=0.0, to_m=10.0, seconds=150.0):
    """Places of a robot that waits and then drives."""
    t_s = np.arange(0.0, seconds, 0.1)
    return np.clip((t_s - waits_s) * speed_mps, 0.0, to_m)


# Of 12 m the optimal time is 6 s: scores are bounded by 12 s or 24 s, and by 48 s.


@each_row(
    ("speed_mps", "time_s", "score_2_8", "score_4_8"),
    [
        (1.0, 8.9, 0.5, 0.25),
        (0.5, 17.8, 6 / 17.8, 0.25),
        (0.25, 35.6, 6 / 35.6, 6 / 35.6),
        (0.1, 89.0, 0.125, 0.125),
    ],
)
def test_barn_scores_optimal_by_actual_time_within_bounds(speed_mps, time_s, score_2_8, score_4_8):
    judgment, reason, metrics = judged(at(speed_mps, waits_s=2.0))
    assert (judgment, reason) == ("pass", "")
    arrived = {"arrived": 1.0, "collided": 0.0, "timed_out": 0.0}
    assert metrics == pytest.approx({**arrived, "time": time_s, "score_2_8": score_2_8, "score_4_8": score_4_8})


def test_barn_without_reference_length_has_no_score():
    metrics = judged(at(1.0), length_m=None)[2]
    assert (metrics["arrived"], metrics["score_2_8"], metrics["score_4_8"]) == (1.0, None, None)


@each_row(
    ("x_m", "touched_s", "outcome", "what", "reason"),
    [
        (at(1.0), (9.5,), "succeeded", "arrived", ""),  # it has arrived at 9.0 s
        (at(1.0), (8.95, 8.97), "succeeded", "collided", "touched 'circle 1' 8.8 s after it left its start"),
        (at(1.0), (9.0,), "succeeded", "collided", "touched 'circle 1' 8.9 s"),
        (at(1.0, waits_s=2.0), (1.0,), "succeeded", "arrived", ""),  # a contact before the clock starts
        (at(0.5, to_m=6.0, seconds=20.0), (), "aborted", "timed_out", "not within 1 m of the goal 100.0 s after it left"),
        (at(0.5, to_m=6.0), (101.0,), "timed_out", "timed_out", "not within 1 m of the goal 100.0 s"),
        (at(0.0), (), "timed_out", "timed_out", "not within 1 m of the goal: the robot never left its start"),
        (at(0.0, seconds=5.0), (), "aborted", "timed_out", "the robot never left its start"),
    ],
)  # fmt: skip
def test_barn_takes_first_of_arrival_contact_and_limit(x_m, touched_s, outcome, what, reason):
    judgment, said, metrics = judged(x_m, *touched_s, outcome=outcome)
    assert judgment == ("pass" if what == "arrived" else "fail")
    assert reason in said
    assert [name for name in ("arrived", "collided", "timed_out") if metrics[name]] == [what]
    assert (metrics["score_2_8"] > 0) == (metrics["score_4_8"] > 0) == (what == "arrived")


def test_barn_time_of_robot_that_gives_up_is_the_limit():
    assert judged(at(0.5, to_m=6.0, seconds=20.0), outcome="aborted")[2]["time"] == 100.0
    assert judged(at(0.0), outcome="timed_out")[2]["time"] is None


@each_row("x_m", [at(0.5, to_m=6.0, seconds=99.0), at(0.0, seconds=99.0), []])
def test_barn_does_not_judge_run_that_was_cut(x_m):
    judgment, reason, metrics = judged(x_m, outcome="timed_out")
    assert judgment == "not judged"
    assert reason and set(metrics.values()) == {None}
