"""The oracles on hand-computed runs."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from table import each_row

from vastflow.oracles.catalog.performance import path_rmse_m, resampled
from vastflow.oracles.judgement.oracle import oracle_of
from vastflow.oracles.judgement.verdict import Verdict
from vastflow.oracles.observation.situation import Situation
from vastflow.oracles.observation.trace import MaybeReference, NoReference, Reference, Trace
from vastflow.sim.model.obstacle import Obstacle
from vastflow.sim.model.pose import Pose
from vastflow.sim.model.recording import Event, Run

GOAL = Pose(10.0, 0.0)
STRAIGHT = Reference(np.array([[0.0, 0.0], [10.0, 0.0]]), 10.0)


def along(y_m: float, to_x_m: float = 10.0, rows: int = 101) -> np.ndarray:
    """A straight way in x at constant y."""
    return np.column_stack((np.linspace(0.0, to_x_m, rows), np.full(rows, y_m)))


def a_trace(
    xy_m: np.ndarray,
    *,
    outcome: str = "succeeded",
    reason: str = "",
    missed_goals: int = 0,
    events: tuple[Event, ...] = (),
    reference: MaybeReference = STRAIGHT,
    columns: Mapping[str, Any] | None = None,
) -> Trace:
    run = Run(3, "0", outcome, 0, reason, 20.0, 10.0, 2, missed_goals, events)  # type: ignore[arg-type]
    signals = {"t_s": np.arange(len(xy_m)) * 0.1, "x_m": xy_m[:, 0], "y_m": xy_m[:, 1], **(columns or {})}
    return Trace(run, signals, reference)


def judged(oracle: str, trace: Trace, *obstacles: Obstacle, **parameters: Any) -> Verdict:
    return oracle_of(oracle, parameters).judge(
        trace, Situation(Pose(0.0, 0.0), (GOAL,), obstacles, circumscribed_radius_m=0.15)
    )


def value(verdict: Verdict, metric: str) -> float | None:
    return verdict.metrics[metric].value


# success


def test_mission_that_succeeded_passes_with_its_numbers() -> None:
    verdict = judged("success", a_trace(along(0.2)))
    assert (verdict.judgement, verdict.reason, verdict.run_index) == ("pass", "", 3)
    assert value(verdict, "final_distance") == pytest.approx(0.2)
    assert (value(verdict, "time"), value(verdict, "distance"), value(verdict, "recoveries")) == (20.0, 10.0, 2)


@each_row(("outcome", "words"), [("aborted", "mission aborted"), ("timed_out", "mission timed out")])
def test_mission_that_did_not_succeed_fails_with_the_reason(outcome: str, words: str) -> None:
    verdict = judged("success", a_trace(along(0.0), outcome=outcome, reason="no path"))
    assert (verdict.judgement, verdict.reason) == ("fail", f"{words}: no path")


def test_waypoint_mission_that_gave_a_goal_up_fails() -> None:
    assert judged("success", a_trace(along(0.0), missed_goals=1)).reason == "gave up 1 of 1 goals"


def test_waypoint_mission_may_be_allowed_to_give_a_goal_up() -> None:
    assert judged("success", a_trace(along(0.0), missed_goals=1), allow_missed=True).judgement == "pass"


def test_success_is_judged_even_without_a_row() -> None:
    verdict = judged("success", a_trace(np.empty((0, 2)), outcome="aborted"))
    assert (verdict.judgement, value(verdict, "final_distance")) == ("fail", None)


# performance


def test_straight_way_offset_by_0_3_m_has_an_rmse_of_0_3_m() -> None:
    verdict = judged("performance", a_trace(along(0.3)))
    assert value(verdict, "rmse") == pytest.approx(0.3)
    assert value(verdict, "length_ratio") == pytest.approx(1.0)


def test_bound_is_path_length_times_local_radius() -> None:
    verdict = judged("performance", a_trace(along(0.3)))
    assert (verdict.judgement, value(verdict, "threshold")) == ("pass", pytest.approx(2.2))


@each_row(("offset_m", "judgement"), [(0.3, "pass"), (0.301, "fail")])
def test_exactly_the_bound_passes(offset_m: float, judgement: str) -> None:
    assert judged("performance", a_trace(along(offset_m)), local_robot_radius_m=0.03).judgement == judgement


def test_way_beyond_the_bound_fails_and_says_by_how_much() -> None:
    verdict = judged("performance", a_trace(along(0.3)), local_robot_radius_m=0.029)
    assert verdict.judgement == "fail"
    assert verdict.reason == "RMSE 0.30 m to the reference path, more than 0.29 m"


def test_robot_that_never_moved_is_compared_with_the_whole_reference() -> None:
    # Distances to 11 points at 0, 1, .., 10 m: mean square 385 / 11 = 35.
    verdict = judged("performance", a_trace(np.zeros((5, 2)), outcome="aborted"), samples=11)
    assert value(verdict, "rmse") == pytest.approx(35**0.5)
    assert (verdict.judgement, value(verdict, "length_ratio")) == ("fail", 0.0)


def test_what_was_not_driven_counts_as_error() -> None:
    # Half way: at fraction f the robot is at 5f m, the reference at 10f m: 5² mean of f² = 25 · 0.35.
    verdict = judged("performance", a_trace(along(0.0, to_x_m=5.0), outcome="timed_out"), samples=11)
    assert value(verdict, "rmse") == pytest.approx((25 * 0.35) ** 0.5)
    assert verdict.judgement == "fail"


def test_run_without_a_reference_is_not_judged() -> None:
    verdict = judged("performance", a_trace(along(0.0), reference=NoReference("the scenario has no map")))
    assert verdict.judgement == "not judged"
    assert verdict.reason == "no reference path: the scenario has no map"
    assert set(verdict.metrics) == {"rmse", "threshold", "reference_length", "length_ratio"}


def test_reference_without_length_is_not_judged() -> None:
    verdict = judged("performance", a_trace(along(0.0), reference=Reference(np.zeros((1, 2)), 0.0)))
    assert (verdict.judgement, verdict.reason) == ("not judged", "the reference path has no length")


def test_recording_without_rows_is_not_judged() -> None:
    assert judged("performance", a_trace(np.empty((0, 2)))).judgement == "not judged"


def test_resampling_goes_by_arc_length_and_not_by_rows() -> None:
    crowded = np.array([[0.0, 0.0], [0.1, 0.0], [0.2, 0.0], [2.0, 0.0], [2.0, 2.0]])
    np.testing.assert_allclose(resampled(crowded, 5), [[0, 0], [1, 0], [2, 0], [2, 1], [2, 2]])


def test_way_compared_with_itself_has_no_error() -> None:
    assert path_rmse_m(along(0.0), along(0.0, rows=7), 100) == pytest.approx(0.0, abs=1e-12)


# safety


def box(edge_m: float) -> Obstacle:
    return Obstacle("box", "box", Pose(5.0, 0.0), edge_m, edge_m)


def passing(separation_m: dict[Obstacle, float], events: tuple[Event, ...] = ()) -> Trace:
    columns = {f"separation_m/{o.size_class}": np.array([max(3.0, s), s, max(3.0, s)]) for o, s in separation_m.items()}
    return a_trace(along(0.0, rows=3), columns=columns, events=events)


def never_there(obstacle: Obstacle) -> dict[str, np.ndarray]:
    return {f"separation_m/{obstacle.size_class}": np.full(3, np.inf)}


@each_row(("edge_m", "required_m"), [(0.5, 0.554), (0.8, 0.766)])
def test_cube_asks_for_the_papers_separation(edge_m: float, required_m: float) -> None:
    obstacle = box(edge_m)
    verdict = judged("safety", passing({obstacle: 1.0}), obstacle)
    assert value(verdict, "margin") == pytest.approx(1.0 - required_m, abs=5e-4)


@each_row(("edge_m", "required_m"), [(0.5, 0.633), (0.8, 0.893)])
def test_cube_read_in_space_asks_for_its_own_corner(edge_m: float, required_m: float) -> None:
    verdict = judged("safety", passing({box(edge_m): required_m + 1e-3}), box(edge_m), obstacle_radius="cube")
    assert (verdict.judgement, value(verdict, "margin")) == ("pass", pytest.approx(0.001, abs=5e-4))
    assert (
        judged("safety", passing({box(edge_m): required_m - 1e-3}), box(edge_m), obstacle_radius="cube").judgement
        == "fail"
    )


@each_row("reading", ["footprint", "cube"])
def test_margins_of_both_readings_stand_beside_the_one_that_judges(reading: str) -> None:
    verdict = judged("safety", passing({box(0.8): 0.8}), box(0.8), obstacle_radius=reading)
    assert value(verdict, "footprint_margin") == pytest.approx(0.8 - 0.766, abs=5e-4)
    assert value(verdict, "cube_margin") == pytest.approx(0.8 - 0.893, abs=5e-4)
    assert value(verdict, "margin") == value(verdict, f"{reading}_margin")
    assert verdict.judgement == ("pass" if reading == "footprint" else "fail")


def test_cylinder_has_one_radius() -> None:
    drum = Obstacle("drum", "cylinder", Pose(0.0, 0.0), 0.6, 0.6)
    verdict = judged("safety", passing({drum: 1.0}), drum, obstacle_radius="cube")
    assert value(verdict, "cube_margin") == value(verdict, "footprint_margin") == pytest.approx(1.0 - 0.3 - 0.2)


@each_row(("separation_m", "judgement"), [(0.553, "fail"), (0.554, "pass")])
def test_robot_fails_where_it_comes_closer_than_that(separation_m: float, judgement: str) -> None:
    assert judged("safety", passing({box(0.5): separation_m}), box(0.5)).judgement == judgement


def test_worst_obstacle_is_the_one_with_the_smallest_margin_not_the_nearest() -> None:
    # 0.60 - 0.554 > 0 for the small cube, 0.70 - 0.766 < 0 for the large one.
    verdict = judged("safety", passing({box(0.5): 0.60, box(0.8): 0.70}), box(0.5), box(0.8))
    assert verdict.judgement == "fail"
    assert verdict.reason == "0.700 m from the center of a box 0.8 x 0.8 m, less than 0.766 m"
    assert value(verdict, "smallest_separation") == pytest.approx(0.60)


def test_stopping_distance_follows_speed_and_deceleration() -> None:
    verdict = judged("safety", passing({box(0.5): 1.0}), box(0.5), max_speed_mps=1.0, max_deceleration_mps2=1.0)
    assert value(verdict, "margin") == pytest.approx(1.0 - (2**0.5 * 0.25 + 0.15 + 0.5))


def test_scenario_without_obstacles_is_safe_and_has_no_separation() -> None:
    verdict = judged("safety", passing({}))
    assert (verdict.judgement, value(verdict, "smallest_separation"), value(verdict, "margin")) == ("pass", None, None)


def test_obstacle_that_never_appeared_counts_for_nothing() -> None:
    verdict = judged("safety", passing({box(0.8): np.inf, box(0.5): 1.0}), box(0.5), box(0.8))
    assert (verdict.judgement, value(verdict, "smallest_separation")) == ("pass", pytest.approx(1.0))
    assert value(verdict, "margin") == pytest.approx(1.0 - 0.554, abs=5e-4)


def test_run_in_which_no_obstacle_appeared_is_safe_and_has_no_separation() -> None:
    verdict = judged("safety", a_trace(along(0.0, rows=3), columns=never_there(box(0.5))), box(0.5))
    assert (verdict.judgement, value(verdict, "smallest_separation"), value(verdict, "margin")) == ("pass", None, None)


def test_contacts_are_counted_and_other_events_are_not() -> None:
    events = (Event(1.0, "contact", 0, 0, "wall", 0.1), Event(2.0, "recovery", 0, 0, "spin"))
    assert value(judged("safety", passing({}, events)), "contacts") == 1.0


def test_recording_without_rows_says_nothing_of_safety() -> None:
    assert judged("safety", a_trace(np.empty((0, 2))), box(0.5)).judgement == "not judged"
