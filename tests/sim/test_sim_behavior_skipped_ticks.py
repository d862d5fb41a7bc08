"""Ticks that change nothing may be left out: the outcome is the same as when each is made."""

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from py_trees.common import Status

from vastflow.sim.model.faults import Place
from vastflow.sim.scenario.definition import (
    Call,
    Composition,
    Constant,
    Elapsed,
    Emit,
    External,
    Field,
    Happened,
    Holds,
    Modified,
    Name,
    Operation,
    ScenarioDefinition,
    Type,
    Until,
    Wait,
)
from vastflow.sim.scenario.tree.action import Action
from vastflow.sim.scenario.tree.helpers import HELPERS, helper_functions
from vastflow.sim.scenario.tree.tree import ScenarioTree

PLACE = Place("random.osc", 1, 1)
TICKS = 120


def constant(value):
    return Constant(value, PLACE)


COUNT = Name(("count",), PLACE)
SHARE = External("random.get_float", (constant(0.0), constant(1.0)), PLACE)


class Timed(Action):
    """Ends after a given time, and says so; may change a variable when it does."""

    def __init__(self, situation):
        self.situation = situation

    def enter(self, arguments):
        self.arguments = arguments
        self.end_s = self.situation.clock.now_s + arguments["lasts_s"]

    def update(self):
        if self.situation.clock.now_s < self.end_s:
            return Status.RUNNING
        if self.arguments["counts"]:
            self.situation.variables["count"] += 1
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
            self.situation.variables["count"] += 1
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

seconds = st.sampled_from([0.0, 0.05, 0.1, 0.25, 0.3, 0.7, 1.0, 1.1, 2.0]) | st.floats(0.0, 3.0)
counts = st.integers(0, 4)
events = st.sampled_from(["red", "green"])
conditions = st.builds(lambda n: Operation(">=", (COUNT, constant(n)), PLACE), counts) | st.builds(
    lambda share: Operation(">", (SHARE, constant(share)), PLACE), st.sampled_from([0.5, 0.9, 0.97])
)
awaited = st.one_of(
    st.builds(lambda s: Elapsed(constant(s), PLACE), seconds),
    st.builds(lambda e, c: Happened(e, c, PLACE), events, st.none() | conditions),
    st.builds(lambda c: Holds(c, PLACE), conditions),
)
calls = st.builds(
    lambda action, s, fails, counts: Call(
        action, "", {"lasts_s": constant(s), "fails": constant(fails), "counts": constant(counts)}, "", PLACE
    ),
    st.sampled_from(["timed", "timed", "lingering", "watching", "mission"]),
    seconds,
    st.sampled_from([False, False, False, True]),
    st.booleans(),
)
leaves = st.one_of(
    calls,
    calls,
    st.builds(lambda a: Wait(a, "", PLACE), awaited),
    st.builds(lambda e: Emit(e, "", PLACE), st.sampled_from(["red", "green", "red", "green", "end", "fail"])),
    st.just(Call("increment", "", {"target_variable": constant("count")}, "", PLACE)),
)


def nodes(below):
    def modified(modifier, name, values):
        return st.builds(lambda v, c: Modified(modifier, {name: constant(v)}, c, PLACE), values, below)

    plain = ["inverter", "failure_is_running", "failure_is_success", "running_is_failure"]
    plain += ["running_is_success", "success_is_failure", "success_is_running"]
    composed = st.builds(
        lambda kind, children: Composition(kind, tuple(children), "", PLACE),
        st.sampled_from(["serial", "serial", "parallel", "one_of"]),
        st.lists(below, max_size=4),
    )
    return st.one_of(
        composed,
        composed,
        modified("timeout", "duration", seconds),
        modified("repeat", "count", st.sampled_from([-1, 1, 2, 3])),
        modified("retry", "count", st.sampled_from([1, 2, 3])),
        st.builds(lambda name, c: Modified(name, {}, c, PLACE), st.sampled_from(plain), below),
        st.builds(lambda a, c: Until(a, c, PLACE), awaited, below),
    )


trees = st.recursive(leaves, nodes, max_leaves=12)


def tree_of(root, mission_end_s):
    variables = tuple(
        Field(name, Type("float", "basic"), constant(value), PLACE)
        for name, value in (("count", 0), ("mission_end_s", mission_end_s))
    )
    definition = ScenarioDefinition("random", (), variables, (), ("red", "green"), root, PLACE, {}, {}, {})
    functions = helper_functions(np.random.default_rng(1), "/config", "/out")
    return ScenarioTree(definition, {}, ACTIONS, functions)


@settings(max_examples=60, deadline=None)
@given(trees, st.integers(1, TICKS))
def test_leaving_out_ticks_that_change_nothing_changes_no_outcome(root, mission_end):
    every, leaping = tree_of(root, mission_end / 10), tree_of(root, mission_end / 10)
    while not every.ended and every.number < TICKS:
        every.tick()
    while not leaping.ended and leaping.number < every.number:
        number = min(leaping.next_tick(), every.number)
        leaping.tick(int(min(number, mission_end) if leaping.number < mission_end else number))
    assert leaping.changes == every.changes
    assert (leaping.ended, leaping.passed, leaping.number) == (every.ended, every.passed, every.number)
    assert (leaping.message, leaping.cause) == (every.message, every.cause)
    if every.ended:
        assert leaping.next_tick() == math.inf


def test_ticks_are_left_out_while_all_wait_for_time():
    waiting = Composition(
        "parallel", tuple(Wait(Elapsed(constant(s), PLACE), "", PLACE) for s in (4.0, 7.0)), "", PLACE
    )
    tree = tree_of(Modified("timeout", {"duration": constant(5.0)}, waiting, PLACE), 9.0)
    made = []
    while not tree.ended:
        tree.tick(int(tree.next_tick()))
        made.append(tree.number)
    assert made == [1, 2, 41, 42, 52]
    assert not tree.passed


def test_nothing_wakes_a_scenario_that_waits_for_the_mission_alone():
    arguments = {"lasts_s": constant(0.0), "fails": constant(False), "counts": constant(False)}
    tree = tree_of(Call("mission", "", arguments, "", PLACE), 9.0)
    tree.tick()
    tree.tick()
    assert tree.next_tick() == math.inf


def test_variable_that_a_running_action_changes_is_seen_to_its_left_at_the_next_tick():
    seen = Wait(Holds(Operation(">=", (COUNT, constant(1)), PLACE), PLACE), "", PLACE)
    arguments = {"lasts_s": constant(3.0), "fails": constant(False), "counts": constant(False)}
    changing = Call("lingering", "", arguments, "", PLACE)
    tree = tree_of(Composition("one_of", (seen, changing), "", PLACE), 9.0)
    while not tree.ended:
        tree.tick(int(tree.next_tick()))
    assert (tree.passed, tree.now_s) == (True, 3.2)
