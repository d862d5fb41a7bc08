"""The oracle `social`, and the encounters of a trace."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from table import each_row

from vastflow.oracles.judgment.cause import cause_of
from vastflow.oracles.judgment.registry import oracle_of
from vastflow.oracles.observation.observe import encounters
from vastflow.oracles.observation.obstacle_tracks import obstacle_tracks_of
from vastflow.oracles.observation.situation import Situation
from vastflow.oracles.observation.trace import NOWHERE_MM, NoReference, Trace
from vastflow.sim.model.recording import Event, Run
from vastflow.sim.model.shape import Disc

ROBOT_M, BODY_M = 0.2, 0.3
SITUATION = Situation(None, (), (), circumscribed_radius_m=ROBOT_M, movers={"cart": Disc(BODY_M)})


def trace_with(robot_mps, cart_m, cart_mps, contact_s=None, seconds=1.0):
    """A robot from (0, 0) and a cart, each at constant velocity; rows every 0.1 s."""
    t_s = np.arange(round(seconds / 0.1) + 1) * 0.1
    robot_m, at_m = np.outer(t_s, robot_mps), np.array(cart_m) + np.outer(t_s, cart_mps)
    columns = {"t_s": t_s, "x_m": robot_m[:, 0], "y_m": robot_m[:, 1]}
    columns |= {"mover_x_m/cart": at_m[:, 0], "mover_y_m/cart": at_m[:, 1], "mover_yaw_rad/cart": 0 * t_s}
    events = () if contact_s is None else (Event(contact_s, "contact", 0.0, 0.0, "cart", 1.0),)
    run = Run(0, "0", "succeeded", 0, "", seconds, 1.0, 0, 0, events)
    tracks = obstacle_tracks_of(SITUATION, run, columns)
    t_ms = np.rint(t_s * 1000).astype(np.int32)
    columns["moving_clearance_m"] = tracks[0].clearance_m(t_ms, robot_m)
    found = encounters(tracks, t_ms, robot_m, ROBOT_M)
    time_ms = found["time_to_collision_ms"]
    columns["time_to_collision_s"] = np.where(time_ms == NOWHERE_MM, np.inf, time_ms * 1e-3)
    columns["personal_space_intrusions"] = found["personal_space_intrusions"].astype(float)
    return Trace(run, columns, NoReference("none is needed"))


def judged(trace, **parameters):
    verdict = oracle_of("social", parameters).judge(trace, SITUATION)
    return verdict, {name: metric.value for name, metric in verdict.metrics.items()}


@each_row(
    ("robot_mps", "cart_m", "cart_mps", "by"),
    [
        ((0.5, 0.0), (0.9, 0.0), (0.0, 0.0), "robot"),
        ((0.5, 0.0), (0.9, 0.0), (0.3, 0.0), "robot"),  # it catches up
        ((0.5, 0.0), (0.9, 0.1), (0.0, 0.6), "robot"),  # the cart crosses, and goes away
        ((0.0, 0.0), (1.4, 0.0), (-1.0, 0.0), "body"),
        ((0.0, 0.4), (0.5, 0.0), (0.0, 0.4), None),  # side by side: neither
        ((0.3, 0.0), (-1.3, 0.0), (1.3, 0.0), "body"),  # from behind
        ((0.5, 0.0), (1.8, 0.0), (-1.0, 0.0), "both"),
        ((0.04, 0.0), (1.4, 0.0), (-1.0, 0.0), "body"),  # below the speed that counts
    ],
)
def test_contact_says_who_moved_into_whom(robot_mps, cart_m, cart_mps, by):
    verdict, found = judged(trace_with(robot_mps, cart_m, cart_mps, contact_s=0.85))
    counts = {who: found[f"contacts_by_{who}"] for who in ("robot", "body", "both")}
    assert counts == {who: int(who == by) for who in counts}
    assert (found["contacts"], verdict.judgment) == (1, "fail")
    who = {"robot": "the robot moved into the other", "body": "the body moved into the other"}.get(
        by, f"{by or 'neither'} moved"
    )
    assert verdict.reason == f"touched 'cart' at 0.85 s, and {who}"


@each_row(
    ("fail_on_contact", "cart_mps", "judgment"),
    [("any", -1.0, "fail"), ("robot", -1.0, "pass"), ("none", -1.0, "pass")],
)
def test_contact_fails_as_asked(fail_on_contact, cart_mps, judgment):
    trace = trace_with((0.0, 0.0), (1.4, 0.0), (cart_mps, 0.0), contact_s=0.85)
    assert judged(trace, fail_on_contact=fail_on_contact)[0].judgment == judgment


def test_contact_of_the_robot_fails_where_only_those_count():
    trace = trace_with((0.5, 0.0), (0.9, 0.0), (0.0, 0.0), contact_s=0.85)
    assert judged(trace, fail_on_contact="robot")[0].judgment == "fail"


def test_touches_in_quick_succession_are_one_contact():
    once = trace_with((0.2, 0.0), (0.9, 0.0), (0.0, 0.0), contact_s=0.85, seconds=4.0)
    events = [Event(t_s, "contact", 0.0, 0.0, "cart", 1.0) for t_s in (0.85, 1.2, 1.65, 2.2)]
    verdict, found = judged(
        replace(once, run=replace(once.run, events=(*events, Event(3.0, "contact", 0, 0, "wall", 1))))
    )
    assert (found["contacts"], found["contacts_by_robot"]) == (2, 2)
    assert verdict.reason.startswith("touched 'cart' at 0.85 s")


def test_touches_of_two_bodies_at_once_are_two_contacts():
    once = trace_with((0.2, 0.0), (0.9, 0.0), (0.0, 0.0), seconds=2.0)
    columns = {**once.columns} | {
        f"mover_{x}/other": once.columns[f"mover_{x}/cart"] for x in ("x_m", "y_m", "yaw_rad")
    }
    events = tuple(
        Event(t_s, "contact", 0.0, 0.0, what, 1.0) for t_s, what in ((0.8, "cart"), (0.9, "other"), (1.0, "cart"))
    )
    both = replace(SITUATION, movers={"cart": Disc(BODY_M), "other": Disc(BODY_M)})
    verdict = oracle_of("social", {}).judge(replace(once, columns=columns, run=replace(once.run, events=events)), both)
    assert verdict.metrics["contacts"].value == 2


def test_shares_of_time_are_those_within_hall_distances():
    # The gap falls from 2.0 m at 1 m/s: within 1.2 m from 0.8 s on, within 0.45 m from 1.55 s on, 0 at 2 s.
    trace = trace_with((0.0, 0.0), (2.5, 0.0), (-1.0, 0.0), seconds=2.0)
    verdict, found = judged(trace)
    assert verdict.judgment == "pass"
    assert found["smallest_distance"] == pytest.approx(0.0)
    assert found["personal_share"] == pytest.approx(1.2 / 2.0, abs=0.03)
    assert found["intimate_share"] == pytest.approx(0.45 / 2.0, abs=0.03)
    assert (found["contacts"], found["smallest_time_to_collision"]) == (0, pytest.approx(0.1, abs=0.01))
    assert trace["personal_space_intrusions"].tolist() == (trace["moving_clearance_m"] - ROBOT_M < 1.2).tolist()


@each_row(("most", "judgment"), [(0.3, "pass"), (0.1, "fail")])
def test_long_closeness_fails_as_asked(most, judgment):
    verdict, _ = judged(trace_with((0.0, 0.0), (2.5, 0.0), (-1.0, 0.0), seconds=2.0), most_intimate_share=most)
    assert verdict.judgment == judgment
    if judgment == "fail":
        assert verdict.reason.startswith("closer than 0.45 m to a mover for 2")


def test_run_without_movers_passes_and_one_without_rows_is_not_judged():
    run = Run(0, "0", "succeeded", 0, "", 1.0, 1.0, 0, 0)
    empty = Trace(run, {}, NoReference("none is needed"))
    without = oracle_of("social", {}).judge(empty, Situation(None, (), ()))
    assert (without.judgment, {metric.value for metric in without.metrics.values()}) == ("pass", {None})
    verdict = oracle_of("social", {}).judge(empty, SITUATION)
    assert (verdict.judgment, verdict.reason) == ("not judged", "the recording has no two rows with movers")


velocities = st.tuples(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0))


@given(velocities, st.tuples(st.floats(-5.0, 5.0), st.floats(-5.0, 5.0)), velocities)
def test_time_to_collision_is_that_of_the_discs(robot_mps, cart_m, cart_mps):
    time_s = float(trace_with(robot_mps, cart_m, cart_mps)["time_to_collision_s"][1])
    apart = complex(*cart_m) + 0.1 * (complex(*cart_mps) - complex(*robot_mps))
    closing = complex(*cart_mps) - complex(*robot_mps)
    distances = np.abs(apart + closing * np.arange(0.0, 60.0, 0.002))
    if np.isfinite(time_s) and time_s < 59.0:
        assert abs(apart + closing * time_s) == pytest.approx(ROBOT_M + BODY_M, abs=0.005) or (
            time_s == 0.0 and abs(apart) < ROBOT_M + BODY_M + 0.001
        )
        assert distances[: int(time_s / 0.002)].min(initial=9.0) > ROBOT_M + BODY_M - 0.005
    elif not np.isfinite(time_s):
        assert distances.min() > ROBOT_M + BODY_M - 0.005


def test_trace_without_movers_has_no_encounters():
    assert encounters([], np.arange(3, dtype=np.int32), np.zeros((3, 2)), 0.2) == {}


def test_cause_of_a_failure_is_the_contact_or_the_nearness():
    touching = trace_with((0.5, 0.0), (0.9, 0.0), (0.0, 0.0), contact_s=0.85)
    near = trace_with((0.0, 0.0), (0.7, 0.0), (0.0, 0.0))
    for trace in (touching, near):
        trace.columns["localization_error_m"] = np.full(len(trace), 0.9)  # which fails no run for what is near
    verdict, _ = judged(touching)
    assert (verdict.judgment, cause_of(touching, [verdict])) == ("fail", "contact")
    verdict, _ = judged(near, most_intimate_share=0.5)
    assert (verdict.judgment, cause_of(near, [verdict])) == ("fail", "too close")
