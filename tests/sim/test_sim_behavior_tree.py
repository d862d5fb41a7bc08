"""Scenario files from their text to their verdict, in simulated time: what each construct means, and when it ends."""

import math
import textwrap
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from py_trees.common import Status
from recorded import bodies
from table import each_row

from vastflow.sim.model.faults import ScenarioError
from vastflow.sim.scenario.language.parameters import bound
from vastflow.sim.scenario.language.reading import read_text
from vastflow.sim.scenario.tree.action import Action
from vastflow.sim.scenario.tree.helpers import HELPERS, helper_functions
from vastflow.sim.scenario.tree.stand_ins import stand_ins
from vastflow.sim.scenario.tree.tree import ScenarioTree

HEAD = """\
import osc.helpers
import osc.x11
action deed:
    lasts: float = 0.0
    fails: bool = false
actor rover:
    namespace: string = 'north'
action rover.drive inherits deed
scenario visit:
"""


class Deed(Action):
    """Takes some seconds and ends as told."""

    def __init__(self, situation):
        self.situation = situation

    def enter(self, arguments):
        self.arguments = arguments
        self.end_s = self.situation.clock.now_s + arguments["lasts"]
        self.message = ""

    def update(self):
        if self.situation.clock.now_s < self.end_s - 1e-9:
            return Status.RUNNING
        if self.arguments["fails"]:
            self.message, self.error_code = "goal rejected", 203
            return Status.FAILURE
        return Status.SUCCESS

    def wakes_s(self):
        return self.end_s


@pytest.fixture
def journal():
    return []


@pytest.fixture
def noted(journal):
    """A deed that notes in the journal what is done to it."""

    def note(deed, what):
        journal.append((deed.situation.clock.now_s, deed.situation.label, what))

    class Noted(Deed):
        def enter(self, arguments):
            super().enter(arguments)
            note(self, "enters")

        def cancel(self):
            note(self, "is cancelled")

        def shutdown(self):
            note(self, "is shut down")

    return Noted


def tree_of(text, actions, functions=None, period_s=0.1, **values):
    definition = read_text(text, "visit.osc", Path())[0]
    functions = functions or helper_functions(np.random.default_rng(1), "/config", "/out")
    known = {**HELPERS, **stand_ins({}), **actions}
    return ScenarioTree(definition, bound(definition, values), known, functions, period_s=period_s)


@pytest.fixture
def tree(noted):
    """Builds the tree of a scenario with a body, with deeds that write into the journal."""

    def build(body, *, actions=None, **options):
        known = {"deed": noted, "rover.drive": noted, **(actions or {})}
        return tree_of(HEAD + textwrap.indent(textwrap.dedent(body), "    "), known, **options)

    return build


def ended(under_way):
    while not under_way.ended and under_way.number < 200:
        under_way.tick()
    return under_way


def came_to(under_way):
    """Verdict and end; None where it does not end in 200 ticks."""
    return (under_way.passed, under_way.now_s) if ended(under_way).ended else None


def test_scenario_ends_as_described(golden, tree, journal):
    def told(body):
        """Return what is done to the deeds, and the end."""
        del journal[:]
        under_way = tree(body)
        end = came_to(under_way)
        reason = under_way.reason
        code = f" ({reason.error_code})" if reason.error_code else ""
        why = f": {reason.cause}, {reason.message}{code}" if reason.message else ""
        deeds = [f"{t_s} s: {who} {what}".replace(":  ", ": ") for t_s, who, what in journal]
        return [*deeds, f"{end[1]} s: {'passed' if end[0] else 'failed'}{why}" if end else "does not end"]

    golden("scenarios", "ends", told, key="told")


def test_noise_of_floats_does_not_decide_when_a_wait_ends(tree):
    for tenths in range(1, 150):
        assert came_to(tree(f"do wait elapsed({tenths / 10}s)")) == (True, (tenths + 1) / 10)


@each_row(
    ("modifier", "success", "failure", "running"),
    [
        ("inverter", (False, 0.1), (True, 0.1), (False, 0.4)),
        ("failure_is_success", (True, 0.1), (True, 0.1), (True, 0.4)),
        ("failure_is_running", (True, 0.1), None, (True, 0.4)),
        ("running_is_failure", (True, 0.1), (False, 0.1), (False, 0.1)),
        ("running_is_success", (True, 0.1), (False, 0.1), (True, 0.1)),
        ("success_is_failure", (False, 0.1), (False, 0.1), (False, 0.4)),
        ("success_is_running", None, (False, 0.1), None),
    ],
)
def test_modifier_maps_status(tree, modifier, success, failure, running):
    for deed, end in (("deed()", success), ("deed(fails: true)", failure), ("deed(0.3)", running)):
        modified = tree(f"do {deed} with:\n  {modifier}()")
        assert modified.changes[1].class_name == modifier.title().replace("_", "")
        assert came_to(modified) == end


@each_row(
    ("body", "message", "tick"),
    [
        ("var n: float = 0.0\ndo log(1 / n)", r"visit\.osc:11:14: .*zero", 1),
        ("var n: float = 0.0\ndo wait elapsed(1s / n)", r"visit\.osc:11:24: .*zero", 1),
        ("var n: float = 0.0\ndo deed() with:\n  timeout(1s / n)", r"visit\.osc:12:18: .*zero", 1),
        ("var n: float = 0.0\ndo deed(9.0) with:\n  until (1 / n > 2)", r"visit\.osc:12:16: .*zero", 1),
        ("do serial:\n  wait elapsed(0.5s)\n  log(random.get_int(6, 1))", "the lower bound comes first", 6),
    ],
)
def test_expression_without_value_ends_run_with_place(tree, body, message, tick):
    broken = tree(body)
    with pytest.raises(ScenarioError, match=message):
        ended(broken)
    assert broken.number == tick


def test_declaration_without_a_value_is_refused_with_its_place(tree):
    with pytest.raises(ScenarioError, match=r"visit\.osc:10:26: .*zero"):
        tree("var share: float = 1 / 0\ndo log('x')")


def test_action_of_an_actor_sees_the_actors_members_and_its_name(tree, noted):
    seen = []

    class Look(noted):
        def enter(self, arguments):
            super().enter(arguments)
            seen.append(self.situation.actor)

    ended(tree("bot: rover\ndo bot.drive()", actions={"rover.drive": Look}))
    assert seen == [{"namespace": "north", "name": "bot"}]


def test_exception_of_an_action_is_passed_on_after_each_shutdown(tree, journal, noted):
    class Broken(noted):
        def update(self):
            raise OSError("no such simulator")

    under_way = tree("bot: rover\ndo parallel:\n  a: deed(9.0)\n  b: bot.drive()", actions={"rover.drive": Broken})
    with pytest.raises(OSError, match="no such simulator"):
        under_way.tick()
    under_way.shutdown()
    under_way.shutdown()
    assert [(who, what) for _, who, what in journal[2:]] == [("a", "is shut down"), ("b", "is shut down")]


def test_exception_in_shutdown_does_not_skip_other_shutdowns(tree, journal, noted):
    class Stuck(noted):
        def shutdown(self):
            super().shutdown()
            raise OSError("does not stop")

    under_way = tree("bot: rover\ndo serial:\n  a: bot.drive()\n  b: deed()", actions={"rover.drive": Stuck})
    with pytest.raises(OSError, match="does not stop"):
        under_way.shutdown()
    assert sorted(who for _, who, _ in journal) == ["a", "b"]


def test_node_status_is_recorded_initially_and_on_change(tree):
    under_way = ended(tree("do body: serial:\n  wait elapsed(0.2s)\n  log('over')"))
    rows = [(row.t_s, row.behavior, row.parent, row.child_index, row.name, row.status) for row in under_way.changes]
    assert rows == [
        (0.0, 0, -1, 0, "visit", "INVALID"),
        (0.0, 1, 0, 0, "body", "INVALID"),
        (0.0, 2, 1, 0, "wait elapsed", "INVALID"),
        (0.0, 3, 1, 1, "log", "INVALID"),
        (0.1, 0, -1, 0, "visit", "RUNNING"),
        (0.1, 1, 0, 0, "body", "RUNNING"),
        (0.1, 2, 1, 0, "wait elapsed", "RUNNING"),
        (0.3, 0, -1, 0, "visit", "SUCCESS"),
        (0.3, 1, 0, 0, "body", "SUCCESS"),
        (0.3, 2, 1, 0, "wait elapsed", "SUCCESS"),
        (0.3, 3, 1, 1, "log", "SUCCESS"),
    ]
    assert under_way.changes[-1].message == "over"
    assert [row.class_name for row in under_way.changes[:4]] == ["Sequence", "Sequence", "Waiting", "Log"]


def test_parallel_trees_are_independent(tree):
    one, other = (tree("event go\ndo serial:\n  wait @go\n  emit end") for _ in range(2))
    for under_way in (tree("event go\ndo serial:\n  emit go\n  wait elapsed(0.1s)"), one, other):
        under_way.tick()
    assert not one.ended and not other.ended


def test_tick_is_not_made_twice_or_after_the_end(tree):
    under_way = tree("do wait elapsed(0.3s)")
    under_way.tick(2)
    with pytest.raises(ValueError, match=r"tick 2 can't be made: the scenario is at tick 2"):
        under_way.tick(2)
    ended(under_way)
    with pytest.raises(ValueError, match=r"tick 9 can't be made: the scenario ended at tick 5"):
        under_way.tick(9)


def test_period_is_a_whole_number_of_microseconds(tree):
    for period_s in (0.0, -0.1, 1 / 3, math.nan, math.inf):
        with pytest.raises(ValueError, match="whole number of microseconds"):
            tree("do log('x')", period_s=period_s)
    assert ended(tree("do wait elapsed(1s)", period_s=0.05)).now_s == 1.05


def test_unimplemented_action_is_refused_with_place(tree):
    with pytest.raises(ValueError, match=r"visit\.osc:10:8: nothing implements the action run_process"):
        tree("do run_process('x')")


TICKS = 120
RANDOM = (
    "import osc.helpers\naction timed:\n    lasts: float\n    fails: bool = false\n    counts: bool = false\n"
    + "".join(f"action {name} inherits timed\n" for name in ("lingering", "watching", "mission"))
    + "scenario random:\n    var n: float = 0.0\n    var mission_end_s: float = 9.0\n    event red\n    event green\n    do serial:\n"
)


class Timed(Deed):
    """Ends after a given time, and says so; may change a variable when it does."""

    def update(self):
        status = super().update()
        if self.arguments["counts"] and status is not Status.RUNNING:
            self.situation.variables["n"] += 1
        return status


class Lingering(Timed):
    """Changes a variable once its time is over, and runs on."""

    def update(self):
        if self.situation.clock.now_s >= self.end_s:
            self.situation.variables["n"] += 1
            self.end_s = math.inf
        return Status.RUNNING


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


ACTIONS = {"timed": Timed, "lingering": Lingering, "watching": Watching, "mission": Mission}

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


def random_tree(body, mission_end_s=9.0):
    return tree_of(RANDOM.replace("9.0", str(mission_end_s)) + textwrap.indent(body, " " * 8) + "\n", ACTIONS)


@settings(max_examples=60, deadline=None)
@given(BODIES, st.integers(1, TICKS))
def test_skipped_ticks_change_no_outcome(body, mission_end):
    every, leaping = random_tree(body, mission_end / 10), random_tree(body, mission_end / 10)
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


def test_ticks_are_left_out_while_all_wait_for_time_or_a_mission():
    waiting = random_tree("parallel:\n    wait elapsed(4s)\n    wait elapsed(7s)\nwith:\n    timeout(5s)")
    made = []
    while not waiting.ended:
        waiting.tick(int(waiting.next_tick()))
        made.append(waiting.number)
    assert made == [1, 2, 41, 42, 52]
    driving = random_tree("mission(0.0)")
    driving.tick()
    driving.tick()
    assert driving.next_tick() == math.inf
