"""The oracle `navigation` on hand-computed runs."""

import math
from typing import Any

import numpy as np
import pytest
from table import each_row

from vastflow.oracles.catalog.navigation import stops
from vastflow.oracles.judgement.oracle import oracle_of
from vastflow.oracles.observation.situation import Situation
from vastflow.oracles.observation.trace import MaybeReference, NoReference, Reference, Trace
from vastflow.sim.model.pose import Pose
from vastflow.sim.model.recording import Event, Run

STRAIGHT = Reference(np.array([[0.0, 0.0], [10.0, 0.0]]), 10.0)


def measured(
    xy_m: Any,
    *,
    outcome: str = "succeeded",
    missed: int = 0,
    events: tuple[Event, ...] = (),
    reference: MaybeReference = STRAIGHT,
    **columns: Any,
) -> dict[str, float | None]:
    xy = np.asarray(xy_m, dtype=float).reshape(-1, 2)
    run = Run(0, "0", outcome, 0, "", 30.0, 0.0, 2, missed, events)  # type: ignore[arg-type]
    signals = {"t_s": np.arange(len(xy)) * 0.1, "x_m": xy[:, 0], "y_m": xy[:, 1]}
    signals |= {name: np.asarray(values, dtype=float) for name, values in columns.items()}
    situation = Situation(Pose(0.0, 0.0), (Pose(10.0, 0.0),), ())
    verdict = oracle_of("navigation", {}).judge(Trace(run, signals, reference), situation)
    assert verdict.judgement == "pass"
    return {name: metric.value for name, metric in verdict.metrics.items()}


DETOUR = [(0, 0), (0, 1.25), (10, 1.25), (10, 0)]  # 12.5 m


def test_success_is_weighted_by_path_length() -> None:
    found = measured(DETOUR)
    assert (found["spl"], found["path_efficiency"]) == (pytest.approx(0.8), pytest.approx(0.8))


@each_row("failure", [{"outcome": "aborted"}, {"outcome": "timed_out"}, {"missed": 1}])
def test_mission_that_failed_has_an_spl_of_nought_and_no_efficiency(failure: dict[str, Any]) -> None:
    found = measured(DETOUR, **failure)
    assert (found["spl"], found["path_efficiency"], found["time_to_goal"]) == (0.0, None, None)


def test_way_shorter_than_the_octile_one_has_an_spl_of_one() -> None:
    found = measured([(0, 0), (8, 0)])
    assert (found["spl"], found["path_efficiency"]) == (1.0, pytest.approx(1.25))


def test_robot_that_succeeds_without_moving_has_an_spl_of_one_and_no_efficiency() -> None:
    found = measured([(0, 0), (0, 0)])
    assert (found["spl"], found["path_efficiency"], found["turning"]) == (1.0, None, None)


def test_without_a_reference_there_is_no_spl() -> None:
    found = measured(DETOUR, reference=NoReference("the scenario has no map"))
    assert (found["spl"], found["path_efficiency"]) == (None, None)


def test_time_to_the_goal_is_that_of_the_last_one_reached() -> None:
    reached = tuple(Event(t_s, "goal_reached", 0, 0, "0") for t_s in (8.0, 21.5))
    assert measured(DETOUR, events=reached)["time_to_goal"] == 21.5
    assert measured(DETOUR)["time_to_goal"] == 30.0


def test_minimum_clearance_is_to_the_nearest_of_all_there_is() -> None:
    found = measured(DETOUR, wall_clearance_m=[1, 0.6, 1, 1], appearing_clearance_m=[math.inf, math.inf, 0.4, 2])
    assert found["minimum_clearance"] == 0.4
    assert measured(DETOUR, appearing_clearance_m=[math.inf] * 4)["minimum_clearance"] is None
    assert measured(DETOUR)["minimum_clearance"] is None


def test_turning_is_the_curvature_of_a_circle_whatever_the_sense() -> None:
    angle = np.linspace(0.0, 2 * math.pi, 2001)
    circle = 2.0 * np.column_stack((np.cos(angle), np.sin(angle)))
    for sense in (1.0, -1.0):
        yaw_rad = (sense * angle + math.pi) % (2 * math.pi) - math.pi
        assert measured(circle, yaw_rad=yaw_rad)["turning"] == pytest.approx(1 / 2.0, rel=1e-5)


def test_straight_way_does_not_turn() -> None:
    assert measured([(0, 0), (5, 0), (10, 0)], yaw_rad=[0, 0, 0])["turning"] == 0.0


def test_smoothness_is_that_of_the_speed_at_equal_steps() -> None:
    t_s = np.arange(-1.0, 1.0, 0.1)
    found = measured(np.column_stack((t_s, 0 * t_s)), speed_mps=np.exp(-5 * t_s**2))
    assert found["smoothness"] == pytest.approx(-1.414, abs=0.01)  # at a tenth of the published example's rate


def test_stops_are_between_driving_and_driving() -> None:
    stopped = np.array([1] * 20 + [0] * 5 + [1] * 11 + [0] * 5 + [1] * 2 + [0] * 5 + [1] * 30)
    found = measured(np.zeros((len(stopped), 2)), stopped=stopped)
    assert (found["stops"], found["stopped_time"]) == (1, 1.0)


@each_row(("rows", "count"), [(5, 0), (6, 1)])
def test_stop_lasts_for_half_a_second_or_more(rows: int, count: int) -> None:
    stopped = np.array([0] + [1] * rows + [0]) > 0
    assert len(stops(np.arange(len(stopped)) * 0.1, stopped, 0.5)) == count


def test_robot_that_never_moves_makes_no_stops() -> None:
    found = measured(np.zeros((30, 2)), stopped=np.ones(30), speed_mps=np.zeros(30))
    assert (found["stops"], found["smoothness"]) == (0, None)


def test_run_without_rows_has_its_recoveries_alone() -> None:
    found = measured([])
    assert found.pop("recoveries") == 2
    assert set(found.values()) == {None}


def test_run_without_a_robot_has_no_measures() -> None:
    trace = Trace(Run(0, "0", "succeeded", 0, "", 1.0, 0.0, 0, 0), {}, NoReference("no robot"))
    verdict = oracle_of("navigation", {}).judge(trace, Situation(None, (), ()))
    assert {metric.value for metric in verdict.metrics.values()} == {None}
