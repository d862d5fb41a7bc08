"""Ticks that change nothing may be left out: the outcome is the same as when each is made."""

import math
import textwrap
from pathlib import Path

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from py_trees.common import Status
from recorded import bodies

from vastflow.sim.scenario.language.reading import read_text
from vastflow.sim.scenario.tree.action import Action
from vastflow.sim.scenario.tree.helpers import HELPERS, helper_functions
from vastflow.sim.scenario.tree.tree import ScenarioTree

TICKS = 120
HEAD = (
    "import osc.helpers\naction timed:\n    lasts: float\n    fails: bool = false\n    counts: bool = false\n"
    + "".join(f"action {name} inherits timed\n" for name in ("lingering", "watching", "mission"))
    + "scenario random:\n    var n: float = 0.0\n    var mission_end_s: float = 9.0\n    event red\n    event green\n    do serial:\n"
)


class Timed(Action):
    """Ends after a given time, and says so; may change a variable when it does."""

    def __init__(self, situation):
        self.situation = situation

    def enter(self, arguments):
        self.arguments = arguments
        self.end_s = self.situation.clock.now_s + arguments["lasts"]

    def update(self):
        if self.situation.clock.now_s < self.end_s:
            return Status.RUNNING
        if self.arguments["counts"]:
            self.situation.variables["n"] += 1
        return Status.FAILURE if self.arguments["fails"] else Status.SUCCESS

    def wakes_s(self):
        return self.end_s


class Lingering(Timed):
    """Changes a variable once its time is over, and runs on."""

    def enter(self, arguments):
        super().enter(arguments)
        self.is_over = False

    def update(self):
        if not self.is_over and self.situation.clock.now_s >= self.end_s:
            self.situation.variables["n"] += 1
            self.is_over = True
        return Status.RUNNING

    def wakes_s(self):
        return math.inf if self.is_over else self.end_s


class Watching(Timed):
    """Ends after a given time, and says nothing of when."""

    def wakes_s(self):
        return -math.inf


class Mission(Timed):
    """Ends when the mission does, which nobody knows beforehand."""

    def update(self):
        over = self.situation.clock.now_s >= self.situation.variables["mission_end_s"]
        return Status.RUNNING if not over else Status.FAILURE if self.arguments["fails"] else Status.SUCCESS

    def wakes_s(self):
        return math.inf


ACTIONS = {**HELPERS, "timed": Timed, "lingering": Lingering, "watching": Watching, "mission": Mission}

seconds = st.sampled_from([0.0, 0.05, 0.1, 0.25, 0.3, 0.7, 1.0, 1.1, 2.0]) | st.integers(0, 300).map(lambda n: n / 100)
conditions = st.integers(0, 4).map("(n >= {}.0)".format) | st.sampled_from([0.5, 0.9, 0.97]).map(
    "(random.get_float(0.0, 1.0) > {})".format
)
events = st.sampled_from(["@red", "@green"])
awaited = st.one_of(
    seconds.map("elapsed({}s)".format), events, st.builds("({} if {})".format, events, conditions), conditions
)
leaves = st.one_of(
    st.builds(
        "{}({}, {}, {})".format,
        st.sampled_from(["timed", "timed", "lingering", "watching", "mission"]),
        seconds,
        st.sampled_from(["false", "false", "false", "true"]),
        st.sampled_from(["false", "true"]),
    ),
    awaited.map("wait {}".format),
    st.sampled_from(["emit red", "emit green", "emit red", "emit green", "emit end", "emit fail", "increment(n)"]),
)
BODIES = bodies(leaves, seconds, awaited, max_leaves=12)


def tree_of(body, mission_end_s=9.0):
    head = HEAD.replace("9.0", str(mission_end_s))
    (definition,) = read_text(head + textwrap.indent(body, " " * 8) + "\n", "random.osc", Path())
    return ScenarioTree(definition, {}, ACTIONS, helper_functions(np.random.default_rng(1), "/config", "/out"))


@settings(max_examples=60, deadline=None)
@given(BODIES, st.integers(1, TICKS))
def test_leaving_out_ticks_that_change_nothing_changes_no_outcome(body, mission_end):
    every, leaping = tree_of(body, mission_end / 10), tree_of(body, mission_end / 10)
    while not every.ended and every.number < TICKS:
        every.tick()
    while not leaping.ended and leaping.number < every.number:
        number = min(leaping.next_tick(), every.number)
        leaping.tick(int(min(number, mission_end) if leaping.number < mission_end else number))
    assert leaping.changes == every.changes
    assert (leaping.ended, leaping.passed, leaping.number) == (every.ended, every.passed, every.number)
    assert (leaping.reason.message, leaping.reason.cause) == (every.reason.message, every.reason.cause)
    if every.ended:
        assert leaping.next_tick() == math.inf


def test_ticks_are_left_out_while_all_wait_for_time():
    tree = tree_of("parallel:\n    wait elapsed(4s)\n    wait elapsed(7s)\nwith:\n    timeout(5s)")
    made = []
    while not tree.ended:
        tree.tick(int(tree.next_tick()))
        made.append(tree.number)
    assert made == [1, 2, 41, 42, 52]
    assert not tree.passed


def test_scenario_that_waits_for_the_mission_alone_is_woken_by_nothing():
    tree = tree_of("mission(0.0)")
    tree.tick()
    tree.tick()
    assert tree.next_tick() == math.inf


def test_variable_that_a_running_action_changes_is_seen_at_the_next_tick():
    tree = tree_of("one_of:\n    wait n >= 1.0\n    lingering(3.0)")
    while not tree.ended:
        tree.tick(int(tree.next_tick()))
    assert (tree.passed, tree.now_s) == (True, 3.2)
