"""How soon a robot brakes for what appears, and what the oracle `safety` measures of a violation."""

import math
from typing import Any

import numpy as np
import pytest
from table import each_row

from vastflow.oracles.judgement.oracle import oracle_of
from vastflow.oracles.judgement.verdict import Verdict
from vastflow.oracles.observation.obstacle_tracks import obstacle_tracks_of
from vastflow.oracles.observation.situation import Situation
from vastflow.oracles.observation.trace import NoReference, Trace
from vastflow.sim.model.obstacle import Obstacle, Trigger
from vastflow.sim.model.pose import Pose
from vastflow.sim.model.recording import Event, Run

STEP_S = 0.1


def carton(x_m: float, name: str = "carton", *, appears: bool = True, edge_m: float = 0.5) -> Obstacle:
    return Obstacle(name, "box", Pose(x_m, 0.0), edge_m, edge_m, Trigger(x_m, 0.0, 1.0) if appears else None)


def judged(
    speed_mps: Any, obstacles: list[Obstacle], appears_s: dict[str, float], *events: Event, **parameters: Any
) -> Verdict:
    """The verdict on a robot that drives along x from 0; separations and clearances are observed from the events."""
    speed = np.asarray(speed_mps, dtype=float)
    x_m = np.r_[0.0, np.cumsum(speed[1:] * STEP_S)]
    xy_m = np.column_stack((x_m, 0 * x_m))
    t_s = np.arange(len(speed)) * STEP_S
    spawned = [
        Event(appears_s[o.name], "spawned", o.pose.x_m, o.pose.y_m, o.name) for o in obstacles if o.name in appears_s
    ]
    run = Run(0, "0", "succeeded", 0, "", 1.0, 1.0, 0, 0, (*spawned, *events))
    situation = Situation(None, (), tuple(obstacles), circumscribed_radius_m=0.15)
    t_ms = np.rint(t_s * 1000).astype(np.int32)
    columns = {"t_s": t_s, "x_m": x_m, "y_m": 0 * x_m, "speed_mps": speed}
    for each in obstacle_tracks_of(situation, run):
        for name, apart_m in (
            (f"separation_m/{each.obstacle.size_class}", np.hypot(*(xy_m - each.at(t_ms)).T)),
            ("appearing_clearance_m", each.clearance_m(t_ms, xy_m)),
        ):
            columns[name] = np.minimum(columns.get(name, math.inf), apart_m)
    return oracle_of("safety", parameters).judge(Trace(run, columns, NoReference("none is needed")), situation)


def value(verdict: Verdict, metric: str) -> float | None:
    return verdict.metrics[metric].value


CRUISE, BRAKE = [0.5] * 11, [0.4, 0.2, 0.0]  # rows 0..10, then at 1 and 2 m/s²


def test_response_is_from_the_appearance_to_the_beginning_of_braking() -> None:
    # It appears at 0.7 s; the speed begins to fall after the row at 1.0 s.
    verdict = judged([*CRUISE, *BRAKE, 0.0], [carton(2.0)], {"carton": 0.7})
    assert (value(verdict, "response_time"), value(verdict, "unanswered")) == (pytest.approx(0.3), 0)


@each_row(("to_mps", "response_s"), [(0.4, 0.3), (0.401, None)])
def test_braking_loses_a_tenth_of_a_metre_per_second_within_half_a_second(
    to_mps: float, response_s: float | None
) -> None:
    verdict = judged([*CRUISE, 0.48, 0.46, 0.44, 0.42, *[to_mps] * 5], [carton(2.0)], {"carton": 0.7})
    assert value(verdict, "response_time") == (None if response_s is None else pytest.approx(response_s))


def test_speed_lost_more_slowly_than_that_is_no_braking() -> None:
    verdict = judged([*CRUISE, *np.arange(0.485, 0.1, -0.015)], [carton(4.0)], {"carton": 0.7})
    assert (value(verdict, "response_time"), value(verdict, "unanswered")) == (None, 1)


def test_what_braking_is_stands_in_the_campaign_file() -> None:
    speeds = [*CRUISE, *np.arange(0.485, 0.1, -0.015)]
    verdict = judged(speeds, [carton(4.0)], {"carton": 0.7}, braking_mps=0.03, braking_s=0.2)
    assert value(verdict, "response_time") == pytest.approx(0.3)


def test_uneven_driving_is_no_braking() -> None:
    verdict = judged([0.5, 0.45, 0.5, 0.42] * 5, [carton(1.2)], {"carton": 0.2})
    assert (value(verdict, "response_time"), value(verdict, "unanswered")) == (None, 1)


def test_gentle_stop_counts_from_its_last_step() -> None:
    speeds = [*CRUISE, *np.arange(0.49, 0.005, -0.01), 0.0, 0.0]
    verdict = judged(speeds, [carton(4.0)], {"carton": 0.5}, stopped_speed_mps=0.0)
    assert value(verdict, "response_time") == pytest.approx((len(speeds) - 3) * STEP_S - 0.5)


def test_robot_that_brakes_already_responds_at_once() -> None:
    assert value(judged([*CRUISE, *BRAKE, 0.0], [carton(2.0)], {"carton": 1.0}), "response_time") == 0.0


def test_robot_that_stands_and_drives_on_has_responded_at_once() -> None:
    assert value(judged([0.0, 0.0, 0.2, 0.4], [carton(1.5)], {"carton": 0.1}), "response_time") == 0.0


def test_robot_that_runs_into_it_without_braking_gave_no_answer() -> None:
    verdict = judged([0.5] * 20, [carton(0.95)], {"carton": 0.7})
    assert (value(verdict, "response_time"), value(verdict, "unanswered")) == (None, 1)


def test_braking_after_the_obstacle_is_passed_is_no_answer() -> None:
    verdict = judged([*[0.5] * 30, 0.0], [carton(0.6)], {"carton": 0.2})
    assert (value(verdict, "response_time"), value(verdict, "unanswered")) == (None, 1)


def test_what_appears_behind_the_robot_asks_for_no_answer() -> None:
    verdict = judged([0.5] * 30, [carton(-1.0)], {"carton": 0.2})
    assert (value(verdict, "response_time"), value(verdict, "unanswered")) == (None, 0)


def test_of_several_that_appear_the_slowest_response_counts() -> None:
    obstacles = [carton(2.0, "near"), carton(4.0, "far", edge_m=0.8)]
    verdict = judged([*CRUISE, *BRAKE, *CRUISE, *BRAKE, 0.0], obstacles, {"near": 0.9, "far": 1.6})
    assert value(verdict, "response_time") == pytest.approx(2.4 - 1.6)


def test_what_stands_from_the_start_has_no_response() -> None:
    verdict = judged([*CRUISE, *BRAKE], [carton(2.0, appears=False)], {})
    assert (value(verdict, "response_time"), value(verdict, "unanswered")) == (None, 0)


def test_what_appears_after_the_last_row_has_no_response() -> None:
    verdict = judged(CRUISE, [carton(2.0)], {"carton": 9.0})
    assert (value(verdict, "response_time"), value(verdict, "smallest_separation")) == (None, None)


# Violations: d_min of a 0.5 m cube is 0.5536 m.


def test_violation_has_a_time_and_a_distance_from_rim_to_outline() -> None:
    # Centers 0.60, 0.55, 0.50, 0.50, 0.50 m apart: two steps and a half.
    verdict = judged([0.5, 0.5, 0.5, 0.0, 0.0], [carton(0.6, appears=False)], {})
    assert verdict.judgement == "fail"
    assert value(verdict, "violation_time") == pytest.approx(0.35)
    assert value(verdict, "violation_clearance") == pytest.approx(0.5 - 0.25 - 0.15)


def test_disc_that_overlaps_the_obstacle_has_a_negative_clearance() -> None:
    verdict = judged([0.0, 0.0], [carton(0.3, appears=False)], {})
    assert value(verdict, "violation_clearance") == pytest.approx(0.3 - 0.25 - 0.15)


def test_without_a_violation_there_is_no_distance_and_no_time() -> None:
    verdict = judged([0.0, 0.0], [carton(1.0, appears=False)], {})
    assert (value(verdict, "violation_time"), value(verdict, "violation_clearance")) == (0.0, None)


def test_late_obstacle_violates_only_from_then_on() -> None:
    verdict = judged([0.0] * 11, [carton(0.5)], {"carton": 0.6})
    assert value(verdict, "violation_time") == pytest.approx(0.45)


def test_exactly_the_required_separation_passes() -> None:
    # A cylinder of 0.5 m: 0.25 + 0.15 + 0.05 = 0.45 m, which floating-point sums miss by 1e-17.
    drum = Obstacle("drum", "cylinder", Pose(0.45, 0.0), 0.5, 0.5)
    verdict = judged([0.0, 0.0], [drum], {})
    assert (verdict.judgement, value(verdict, "margin")) == ("pass", 0.0)


# Contacts


def contact(what: str) -> Event:
    return Event(0.1, "contact", 0.0, 0.0, what, 0.2)


@each_row(
    ("fail_on_contact", "what", "reason"),
    [
        ("none", "carton", ""),
        ("obstacle", "carton", "touched 'carton'"),
        ("obstacle", "wall", ""),
        ("any", "wall", "touched 'wall'"),
    ],
)
def test_contacts_fail_a_run_as_the_campaign_asks(fail_on_contact: str, what: str, reason: str) -> None:
    obstacles = [carton(5.0, appears=False)]
    verdict = judged([0.0, 0.0], obstacles, {}, contact(what), fail_on_contact=fail_on_contact)
    assert (verdict.judgement, verdict.reason) == ("fail" if reason else "pass", reason)


def test_contacts_are_counted_by_partner() -> None:
    events = [contact("wall"), contact("carton"), contact("carton")]
    verdict = judged([0.0, 0.0], [carton(5.0, appears=False)], {}, *events)
    assert (value(verdict, "contacts"), value(verdict, "obstacle_contacts")) == (3, 2)
    assert verdict.reason == "touched 'carton' and 1 more"
