"""Words and choices of a replay: captions, times, highlights."""

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st
from table import each_row

from vastflow.oracles.replay.story import FEWEST, FRAMES, doing, happening, highlights, numbers, tick_of
from vastflow.oracles.replay.times import Span, rounded, span_of, step_of, tick_at, whole_run
from vastflow.sim.model.faults import UserError
from vastflow.sim.model.pose import Pose
from vastflow.sim.model.recording import Event, Run
from vastflow.sim.replay.snapshot import Moment


def a_run(*events, outcome="succeeded"):
    return Run(0, "1:2:0", outcome, 0, "", 60.0, 5.0, 0, 0, events)


def a_moment(**changes):
    said = {
        "tick": 40,
        "activity": "following",
        "true": Pose(1.0, 1.0),
        "estimate": Pose(1.0, 1.12),
        "speed_mps": 0.25,
        "yaw_rate_radps": 0.5,
        "stopped": False,
        "planned": True,
        "no_command_s": 0.0,
        "no_progress_s": 0.0,
        "recoveries": 0,
        "goal": 0,
    }
    return Moment(**{**said, **changes})


@each_row(
    ("changes", "words"),
    [
        ({}, "following the plan"),
        ({"planned": False}, "waiting for a plan"),
        ({"stopped": True}, "stopped by the collision monitor"),
        ({"no_command_s": 0.15}, "no valid command for 0.15 s"),
        ({"no_progress_s": 7.2}, "following, no progress for 7 s"),
        ({"activity": "spin"}, "recovery: spin"),
        ({"activity": "back up", "stopped": True}, "recovery: back up, held by the collision monitor"),
        ({"activity": "resting"}, "without a mission"),
        ({"activity": "ended"}, "mission succeeded"),
    ],
)
def test_what_the_robot_is_doing_is_said_in_words(changes, words):
    assert doing(a_moment(**changes), a_run()) == words


def test_mission_that_is_over_was_given_up_where_it_was_aborted():
    assert doing(a_moment(activity="ended"), a_run(outcome="aborted")) == "mission given up"


def test_numbers_are_speed_turning_localization_and_recoveries():
    assert numbers(a_moment(recoveries=1)) == "0.25 m/s, 29°/s · localization 12 cm off · 1 recovery"


def test_robot_that_stands_has_no_negative_speed():
    assert numbers(a_moment(speed_mps=-0.001, yaw_rate_radps=0.0)).startswith("0.00 m/s ·")


@each_row(
    ("kind", "what", "value", "words"),
    [
        ("contact", "wall", 0.314, "touches wall at 0.31 m/s"),
        ("spawned", "box 3", 0.2, "box 3 appears"),
        ("deleted", "box 3", 0.0, "box 3 disappears"),
        ("recovery", "spin", 0.0, "recovery: spin"),
        ("plan_failed", "208", 0.0, "no path to the goal"),
        ("control_failed", "999", 0.0, "error 999"),
        ("goal_reached", "1", 0.0, "goal 2 reached"),
        ("goal_missed", "0", 0.0, "goal 1 given up"),
        ("stopped_by_monitor", "0", 0.0, "stopped by the collision monitor"),
        ("obstacle_moved", "box 3", 0.2, None),
    ],
)
def test_event_is_said_in_a_few_words(kind, what, value, words):
    assert happening(Event(1.0, kind, 0.0, 0.0, what, value)) == words


def test_tick_knows_of_events_at_its_time_and_of_contacts_before_it():
    assert tick_of(Event(1.35, "recovery", 0.0, 0.0, "spin")) == 27
    assert tick_of(Event(1.36, "contact", 0.0, 0.0, "wall")) == 28


def test_without_events_the_pictures_are_spread_over_the_run():
    chosen = highlights(a_run(), 0, 700)
    assert len(chosen) == FEWEST
    assert (chosen[0], chosen[-1]) == (0, 700)
    assert max(b - a for a, b in pairwise(chosen)) <= 700 // 4


def test_contacts_are_shown_before_anything_else():
    crowd = [Event(0.5 * k, "recovery", 0.0, 0.0, "spin") for k in range(1, 100)]
    contact = Event(20.26, "contact", 0.0, 0.0, "wall")
    assert tick_of(contact) in highlights(a_run(*crowd, contact), 0, 1000)


def test_what_happens_at_once_makes_one_picture():
    events = [Event(10.0 + 0.05 * k, "recovery", 0.0, 0.0, "spin") for k in range(4)]
    chosen = highlights(a_run(*events), 0, 1000)
    assert len({*range(200, 204)} & {*chosen}) == 1


def test_moved_obstacle_is_no_highlight():
    moved = Event(20.0, "obstacle_moved", 0.0, 0.0, "box", 0.1)
    assert 400 not in highlights(a_run(moved), 0, 701)


@given(
    st.integers(0, 400),
    st.integers(0, 1200),
    st.lists(st.tuples(st.floats(0, 60), st.sampled_from(["contact", "recovery", "plan_failed", "other"]))),
)
def test_highlights_are_few_increasing_and_within_the_span(first, length, events):
    run = a_run(*(Event(t_s, kind, 0.0, 0.0, "wait") for t_s, kind in events))
    chosen = highlights(run, first, first + length)
    assert len(chosen) <= FRAMES
    assert chosen == sorted(set(chosen))
    assert (chosen[0], chosen[-1]) == (first, first + length)


def test_run_of_two_seconds_has_forty_ticks():
    assert whole_run(2.0) == Span(0, 39)


def test_time_becomes_the_nearest_tick_and_the_end_the_last():
    whole = whole_run(30.0)
    assert [tick_at("--at", t_s, whole) for t_s in (0.0, 12.35, 12.37, 29.99, 30.0)] == [0, 247, 247, 599, 599]


@each_row("t_s", [-0.1, 30.1, float("nan"), float("inf")])
def test_time_outside_the_run_is_refused(t_s):
    with pytest.raises(UserError, match=r"--at .*: outside the run, which goes from 0 to 30\.00 s"):
        tick_at("--at", t_s, whole_run(30.0))


def test_span_that_ends_before_it_begins_is_refused():
    with pytest.raises(UserError, match="--from 9 --to 4: ends before it begins"):
        span_of(9.0, 4.0, whole_run(30.0))


@each_row("every_s", [0.0, -1.0, float("nan"), float("inf")])
def test_step_that_is_no_positive_time_is_refused(every_s):
    with pytest.raises(UserError, match=r"--every .*: a time greater than 0 s"):
        step_of(every_s)


def test_pictures_at_regular_times_include_the_end():
    assert span_of(1.0, 2.0, whole_run(30.0)).every(step_of(0.3)) == [20, 26, 32, 38, 40]


def test_times_that_no_tick_has_are_said():
    assert rounded("--at", [12.35, 12.37]) == ["--at 12.37: the nearest tick of 50 ms is 12.35 s"]
