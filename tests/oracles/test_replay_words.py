"""Words and choices of a replay: captions, times, highlights."""

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st
from table import each_row

from vastflow.oracles.replay import story
from vastflow.sim.model.faults import UserError
from vastflow.sim.model.pose import Pose
from vastflow.sim.model.recording import Event, Run
from vastflow.sim.replay import Moment


def a_run(*events, outcome="succeeded"):
    return Run(0, "1:2:0", outcome, 0, "", 60.0, 5.0, 0, 0, events)


def a_moment(**changes):
    poses = {"true": Pose(1.0, 1.0), "estimate": Pose(1.0, 1.12)}
    moving = {"tick": 40, "activity": "following", "speed_mps": 0.25, "yaw_rate_radps": 0.5}
    usual = {"stopped": False, "planned": True, "no_command_s": 0.0, "no_progress_s": 0.0, "recoveries": 0, "goal": 0}
    return Moment(**{**poses, **moving, **usual, **changes})


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
def test_doing_is_told_in_words(changes, words):
    assert story.doing(a_moment(**changes), a_run()) == words


def test_doing_and_numbers_tell_ending_and_motion():
    assert story.doing(a_moment(activity="ended"), a_run(outcome="aborted")) == "mission given up"
    assert story.numbers(a_moment(recoveries=1)) == "0.25 m/s, 29°/s · localization 12 cm off · 1 recovery"
    assert story.numbers(a_moment(speed_mps=-0.001, yaw_rate_radps=0.0)).startswith("0.00 m/s ·")


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
def test_happening_is_told_in_words(kind, what, value, words):
    assert story.happening(Event(1.0, kind, 0.0, 0.0, what, value)) == words


def test_tick_of_contact_is_after_it():
    assert story.tick_of(Event(1.35, "recovery", 0.0, 0.0, "spin")) == 27
    assert story.tick_of(Event(1.36, "contact", 0.0, 0.0, "wall")) == 28


def test_highlights_are_spread_and_prefer_contacts():
    chosen = story.highlights(a_run(), 0, 700)
    assert (len(chosen), chosen[0], chosen[-1]) == (story.FEWEST, 0, 700)
    assert max(b - a for a, b in pairwise(chosen)) <= 700 // 4
    crowd = [Event(0.5 * k, "recovery", 0.0, 0.0, "spin") for k in range(1, 100)]
    contact = Event(20.26, "contact", 0.0, 0.0, "wall")
    assert story.tick_of(contact) in story.highlights(a_run(*crowd, contact), 0, 1000)
    at_once = [Event(10.0 + 0.05 * k, "recovery", 0.0, 0.0, "spin") for k in range(4)]
    assert len({*range(200, 204)} & {*story.highlights(a_run(*at_once), 0, 1000)}) == 1
    moved = Event(20.0, "obstacle_moved", 0.0, 0.0, "box", 0.1)
    assert 400 not in story.highlights(a_run(moved), 0, 701)


KINDS = st.sampled_from(["contact", "recovery", "plan_failed", "other"])


@given(st.integers(0, 400), st.integers(0, 1200), st.lists(st.tuples(st.floats(0, 60), KINDS)))
def test_highlights_increase_within_span(first, length, events):
    run = a_run(*(Event(t_s, kind, 0.0, 0.0, "wait") for t_s, kind in events))
    chosen = story.highlights(run, first, first + length)
    assert len(chosen) <= story.FRAMES
    assert chosen == sorted(set(chosen))
    assert (chosen[0], chosen[-1]) == (first, first + length)


def test_times_become_ticks_and_impossible_ones_are_refused():
    assert story.whole_run(2.0) == story.Span(0, 39)
    whole = story.whole_run(30.0)
    assert [story.tick_at("--at", t_s, whole) for t_s in (0.0, 12.35, 12.37, 29.99, 30.0)] == [0, 247, 247, 599, 599]
    assert story.span_of(1.0, 2.0, whole).every(story.step_of(0.3)) == [20, 26, 32, 38, 40]
    assert story.rounded("--at", [12.35, 12.37]) == ["--at 12.37: the nearest tick of 50 ms is 12.35 s"]
    odd = float("nan"), float("inf")
    for make, values, message in (
        (
            lambda t_s: story.tick_at("--at", t_s, whole),
            (-0.1, 30.1, *odd),
            r"a time of the run, from 0 to 30\.00 s, got",
        ),
        (lambda to_s: story.span_of(9.0, to_s, whole), (4.0,), "--to: expected a time after --from 9, got 4"),
        (story.step_of, (0.0, -1.0, *odd), "--every: expected a time above 0 s, got"),
    ):
        for value in values:
            with pytest.raises(UserError, match=message):
                make(value)
