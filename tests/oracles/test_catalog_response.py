"""Responses to obstacles that appear, and violations of the separation, by the oracle `safety`."""

import math

import numpy as np
import pytest
from table import each_row

from vastflow.oracles.judgement.oracle import oracle_of
from vastflow.oracles.observation.obstacle_tracks import obstacle_tracks_of
from vastflow.oracles.observation.situation import Situation
from vastflow.oracles.observation.trace import NoReference, Trace
from vastflow.sim.model.obstacle import Obstacle, Trigger
from vastflow.sim.model.pose import Pose
from vastflow.sim.model.recording import Event, Run

STEP_S = 0.1


def carton(x_m, name="carton", *, appears=True, edge_m=0.5):
    return Obstacle(name, "box", Pose(x_m, 0.0), edge_m, edge_m, Trigger(x_m, 0.0, 1.0) if appears else None)


def judged(speed_mps, obstacles, appears_s, **parameters):
    """The verdict on a robot that drives along x from 0; separations and clearances are observed from the events."""
    speed = np.asarray(speed_mps, dtype=float)
    x_m = np.r_[0.0, np.cumsum(speed[1:] * STEP_S)]
    xy_m = np.column_stack((x_m, 0 * x_m))
    t_s = np.arange(len(speed)) * STEP_S
    events = [
        Event(appears_s[o.name], "spawned", o.pose.x_m, o.pose.y_m, o.name) for o in obstacles if o.name in appears_s
    ]
    run = Run(0, "0", "succeeded", 0, "", 1.0, 1.0, 0, 0, tuple(events))
    situation = Situation(None, (), tuple(obstacles), circumscribed_radius_m=0.15)
    t_ms = np.rint(t_s * 1000).astype(np.int32)
    columns = {"t_s": t_s, "x_m": x_m, "y_m": 0 * x_m, "speed_mps": speed}
    for each in obstacle_tracks_of(situation, run):
        for name, apart_m in (
            (f"separation_m/{each.obstacle.size_class}", np.hypot(*(xy_m - each.at(t_ms)).T)),
            ("appearing_clearance_m", each.clearance_m(t_ms, xy_m)),
        ):
            columns[name] = np.minimum(columns.get(name, math.inf), apart_m)
    verdict = oracle_of("safety", parameters).judge(Trace(run, columns, NoReference("none is needed")), situation)
    return verdict.judgement, {name: metric.value for name, metric in verdict.metrics.items()}


CRUISE, BRAKE = [0.5] * 11, [0.4, 0.2, 0.0]  # rows 0..10, then at 1 and 2 m/s²
SLOWLY = [*CRUISE, *np.arange(0.485, 0.1, -0.015)]
GENTLY = [*CRUISE, *np.arange(0.49, 0.005, -0.01), 0.0, 0.0]
TWO = [carton(2.0, "near"), carton(4.0, "far", edge_m=0.8)]


@each_row(
    ("speed_mps", "obstacles", "appears_s", "parameters", "response_s", "unanswered"),
    [
        # It appears at 0.7 s; the speed begins to fall after the row at 1.0 s.
        ([*CRUISE, *BRAKE, 0.0], [carton(2.0)], 0.7, {}, 0.3, 0),
        # Braking loses 0.1 m/s within 0.5 s, or what the campaign file says.
        ([*CRUISE, 0.48, 0.46, 0.44, 0.42, *[0.4] * 5], [carton(2.0)], 0.7, {}, 0.3, 0),
        ([*CRUISE, 0.48, 0.46, 0.44, 0.42, *[0.401] * 5], [carton(2.0)], 0.7, {}, None, 1),
        (SLOWLY, [carton(4.0)], 0.7, {}, None, 1),
        (SLOWLY, [carton(4.0)], 0.7, {"braking_mps": 0.03, "braking_s": 0.2}, 0.3, 0),
        ([0.5, 0.45, 0.5, 0.42] * 5, [carton(1.2)], 0.2, {}, None, 1),  # uneven driving
        (GENTLY, [carton(4.0)], 0.5, {"stopped_speed_mps": 0.0}, (len(GENTLY) - 3) * STEP_S - 0.5, 0),
        ([*CRUISE, *BRAKE, 0.0], [carton(2.0)], 1.0, {}, 0.0, 0),  # brakes already
        ([0.0, 0.0, 0.2, 0.4], [carton(1.5)], 0.1, {}, 0.0, 0),  # stands, and drives on
        ([0.5] * 20, [carton(0.95)], 0.7, {}, None, 1),  # runs into it
        ([*[0.5] * 30, 0.0], [carton(0.6)], 0.2, {}, None, 1),  # brakes after it is passed
        ([0.5] * 30, [carton(-1.0)], 0.2, {}, None, 0),  # behind the robot
        ([*CRUISE, *BRAKE, *CRUISE, *BRAKE, 0.0], TWO, {"near": 0.9, "far": 1.6}, {}, 0.8, 0),  # the slowest counts
        ([*CRUISE, *BRAKE], [carton(2.0, appears=False)], {}, {}, None, 0),
        (CRUISE, [carton(2.0)], 9.0, {}, None, 0),  # after the last row
    ],
)
def test_response_time_is_until_braking_begins(speed_mps, obstacles, appears_s, parameters, response_s, unanswered):
    times = appears_s if isinstance(appears_s, dict) else {"carton": appears_s}
    _, metrics = judged(speed_mps, obstacles, times, **parameters)
    expected = None if response_s is None else pytest.approx(response_s)
    assert (metrics["response_time"], metrics["unanswered"] or 0) == (expected, unanswered)


DRUM = Obstacle("drum", "cylinder", Pose(0.45, 0.0), 0.5, 0.5)


@each_row(
    ("speed_mps", "obstacle", "appears_s", "judgement", "metrics"),
    [
        # The required separation from a cube of 0.5 m is 0.5536 m. Centers 0.60, 0.55, 0.50, 0.50, 0.50 m apart: 3.5 steps.
        ([0.5, 0.5, 0.5, 0.0, 0.0], carton(0.6, appears=False), {}, "fail", {"violation_time": 0.35, "violation_clearance": 0.1}),
        ([0.0, 0.0], carton(0.3, appears=False), {}, "fail", {"violation_clearance": 0.3 - 0.25 - 0.15}),
        ([0.0, 0.0], carton(1.0, appears=False), {}, "pass", {"violation_time": 0.0, "violation_clearance": None}),
        ([0.0] * 11, carton(0.5), {"carton": 0.6}, "fail", {"violation_time": 0.45}),
        # 0.25 + 0.15 + 0.05 = 0.45 m, which floating-point sums miss by 1e-17.
        ([0.0, 0.0], DRUM, {}, "pass", {"margin": 0.0}),
    ],
)  # fmt: skip
def test_violation_has_duration_and_clearance(speed_mps, obstacle, appears_s, judgement, metrics):
    said, found = judged(speed_mps, [obstacle], appears_s)
    assert (said, {name: found[name] for name in metrics}) == (judgement, pytest.approx(metrics))
