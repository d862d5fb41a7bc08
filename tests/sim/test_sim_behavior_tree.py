"""A scenario's tree in simulated time: what each construct means, and when it ends."""

import math
from typing import ClassVar

import pytest
from py_trees.common import Status
from table import each_row

from vastflow.sim.model.faults import Place, ScenarioError
from vastflow.sim.scenario.definition import (
    Actor,
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
from vastflow.sim.scenario.tree.helpers import HELPERS
from vastflow.sim.scenario.tree.tree import ScenarioTree

PLACE = Place("visit.osc", 8, 5)


def at(line):
    return Place("visit.osc", line, 9)


def value(of):
    return of if isinstance(of, Name | Operation | External) else Constant(of, PLACE)


def name(*path):
    return Name(path, PLACE)


def operation(operator, *operands):
    return Operation(operator, tuple(map(value, operands)), PLACE)


def serial(*children, label=""):
    return Composition("serial", children, label, PLACE)


def parallel(*children):
    return Composition("parallel", children, "", PLACE)


def one_of(*children):
    return Composition("one_of", children, "", PLACE)


def elapsed(duration_s):
    return Wait(Elapsed(value(duration_s), PLACE), "", PLACE)


def event(what, condition=None):
    return Wait(Happened(what, condition, PLACE), "", PLACE)


def holds(condition):
    return Wait(Holds(condition, PLACE), "", PLACE)


def emit(what, line=8):
    return Emit(what, "", at(line))


def call(action, actor="", label="", line=8, **arguments):
    return Call(action, actor, {key: value(of) for key, of in arguments.items()}, label, at(line))


def log(message="here"):
    return call("log", msg=message)


def modified(modifier, child, **arguments):
    return Modified(modifier, {key: value(of) for key, of in arguments.items()}, child, PLACE)


def timeout(duration_s, child):
    return modified("timeout", child, duration=duration_s)


def repeat(count, child):
    return modified("repeat", child, count=count)


def until(awaited, child):
    return Until(awaited, child, PLACE)


class Deed(Action):
    """Takes some seconds and ends as told; notes in a journal what is done to it."""

    journal: list

    def __init__(self, situation):
        self.situation = situation
        self.who = situation.label

    def enter(self, arguments):
        self.arguments = arguments
        self.end_s = self.situation.clock.now_s + arguments.get("lasts_s", 0.0)
        self.message = ""
        self.note("enters")

    def update(self):
        if self.situation.clock.now_s < self.end_s - 1e-9:
            return Status.RUNNING
        if self.arguments.get("fails", False):
            self.message, self.error_code = "goal rejected", 203
            return Status.FAILURE
        return Status.SUCCESS

    def cancel(self):
        self.note("is cancelled")

    def shutdown(self):
        self.note("is shut down")

    def wakes_s(self):
        return self.end_s

    def note(self, what):
        self.journal.append((self.situation.clock.now_s, self.who, what))


@pytest.fixture
def journal():
    return []


@pytest.fixture
def tree(journal):
    """Builds the tree of one behavior, with deeds that write into the journal."""

    class Noted(Deed):
        pass

    Noted.journal = journal

    def build(root, *, actions=(), functions=None, values=None, variables=(), actors=(), period_s=0.1, lines=None):
        definition = ScenarioDefinition("visit", (), variables, actors, (), root, at(1), {}, {}, {})
        known = {**HELPERS, "do": Noted, "robot.drive": Noted, **dict(actions)}
        keep = journal.append if lines is None else lines.append
        return ScenarioTree(definition, values or {}, known, functions or {}, period_s=period_s, log=keep)

    return build


@pytest.fixture
def outcome(tree):
    """Verdict and end of a behavior; None where it does not end in 200 ticks."""

    def run(root, **more):
        under_way = tree(root, **more)
        while not under_way.ended and under_way.number < 200:
            under_way.tick()
        return (under_way.passed, under_way.now_s) if under_way.ended else None

    return run


def ended(under_way):
    while not under_way.ended:
        under_way.tick()
    return under_way


def counter(initial=0):
    return (Field("count", Type("int", "basic"), Constant(initial, PLACE), PLACE),)


def do(seconds=0.0, fails=False, **more):
    return call("do", lasts_s=seconds, fails=fails, **more)


def test_wait_of_one_second_that_begins_at_the_first_tick_ends_at_1_1(outcome):
    assert outcome(elapsed(1.0)) == (True, 1.1)


def test_timeout_of_two_seconds_over_a_longer_wait_fails_at_2_2(outcome):
    assert outcome(timeout(2.0, elapsed(5.0))) == (False, 2.2)


def test_wait_as_long_as_its_timeout_passes_at_2_1(outcome):
    assert outcome(timeout(2.0, elapsed(2.0))) == (True, 2.1)


def test_wait_of_one_second_three_times_over_ends_at_3_3(outcome):
    assert outcome(repeat(3, elapsed(1.0))) == (True, 3.3)


def test_lone_log_ends_at_the_first_tick(outcome):
    assert outcome(log()) == (True, 0.1)


def test_no_noise_of_floats_decides_when_a_wait_ends(outcome):
    for tenths in range(1, 150):
        assert outcome(elapsed(tenths / 10)) == (True, (tenths + 1) / 10)


def test_duration_may_be_a_parameter_or_what_a_function_says(outcome):
    assert outcome(elapsed(name("patience")), values={"patience": 0.5}) == (True, 0.6)
    drawn = External("random.get_float", (), PLACE)
    assert outcome(elapsed(drawn), functions={"random.get_float": lambda: 0.7}) == (True, 0.8)


def test_serial_starts_the_next_child_in_the_tick_in_which_one_succeeds(outcome, journal):
    assert outcome(serial(do(0.2, label="a"), do(0.0, label="b"), do(0.3, label="c"))) == (True, 0.6)
    assert journal == [(0.1, "a", "enters"), (0.3, "b", "enters"), (0.3, "c", "enters")]


def test_serial_fails_with_the_first_failure_and_never_begins_the_rest(outcome, journal):
    assert outcome(serial(do(0.2, fails=True), do(label="rest"))) == (False, 0.3)
    assert len(journal) == 1


def test_parallel_succeeds_when_all_have_and_does_not_begin_finished_ones_again(outcome, journal):
    assert outcome(parallel(do(0.1, label="a"), do(0.5, label="b"))) == (True, 0.6)
    assert journal == [(0.1, "a", "enters"), (0.1, "b", "enters")]


def test_parallel_fails_as_soon_as_one_branch_does_and_cancels_the_others(outcome, journal):
    assert outcome(parallel(do(9.0, label="a"), do(0.3, fails=True, label="b"), do(9.0, label="c"))) == (False, 0.4)
    assert journal[3:] == [(0.4, "a", "is cancelled"), (0.4, "c", "is cancelled")]


def test_one_of_succeeds_with_the_first_success_and_cancels_the_others(outcome, journal):
    assert outcome(one_of(do(9.0, label="a"), do(0.3, label="b"))) == (True, 0.4)
    assert journal[2:] == [(0.4, "a", "is cancelled")]


def test_one_failure_fails_one_of_even_beside_a_success_in_the_same_tick(outcome):
    assert outcome(one_of(do(0.3), do(0.3, fails=True))) == (False, 0.4)


def test_event_is_heard_in_the_same_tick_to_the_right_and_in_the_next_to_the_left(outcome, journal):
    heard = [serial(event("go"), do(label=side)) for side in ("left", "right")]
    assert outcome(parallel(heard[0], serial(elapsed(0.3), emit("go")), heard[1])) == (True, 0.5)
    assert journal == [(0.4, "right", "enters"), (0.5, "left", "enters")]


def test_event_stays_for_the_rest_of_the_run(outcome):
    assert outcome(serial(emit("go"), elapsed(0.5), event("go"), event("go"))) == (True, 0.6)


def test_event_with_a_condition_waits_for_both(outcome):
    late = event("go", operation("==", name("count"), 2))
    counting = serial(emit("go"), repeat(2, serial(elapsed(0.1), call("increment", target_variable="count"))))
    assert outcome(parallel(counting, late), variables=counter()) == (True, 0.4)


def test_condition_is_evaluated_again_at_each_tick(outcome):
    counting = repeat(3, call("increment", target_variable="count"))
    assert outcome(parallel(counting, holds(operation(">=", name("count"), 3))), variables=counter()) == (True, 0.3)


def test_emit_end_ends_siblings_that_would_run_on(outcome):
    assert outcome(parallel(do(9.0), serial(elapsed(0.5), emit("end")))) == (True, 0.6)


def test_children_after_emit_end_are_still_entered_in_that_tick(outcome, journal):
    assert outcome(serial(emit("end"), do(label="after"))) == (True, 0.1)
    assert journal == [(0.1, "after", "enters")]


def test_emit_fail_fails_the_scenario_and_wins_over_end_in_the_same_tick(outcome, tree):
    assert outcome(serial(emit("fail"), elapsed(3.0))) == (False, 0.1)
    assert outcome(parallel(emit("end"), emit("fail"))) == (False, 0.1)
    failed = ended(tree(parallel(do(9.0), serial(elapsed(0.5), emit("fail", line=12)))))
    assert (failed.cause, failed.message) == ("emit", "emit fail at visit.osc:12:9")


def test_failed_root_wins_over_emit_end_in_the_same_tick(outcome):
    assert outcome(parallel(emit("end"), do(fails=True))) == (False, 0.1)


def test_timeout_fails_even_if_the_child_succeeds_in_that_very_tick(tree):
    failed = ended(tree(timeout(0.25, do(0.3))))
    assert (failed.now_s, failed.cause) == (0.4, "timeout")
    assert failed.message == "timeout(0.25 s) at visit.osc:8:5 ran out in the tick in which do succeeded"


def test_timeout_cancels_what_runs_below_it_and_says_what_that_was(tree, journal):
    running = parallel(call("robot.drive", "bot", lasts_s=9.0), elapsed(5.0))
    failed = ended(tree(timeout(2.0, serial(running)), actors=(Actor("bot", ("robot",), {}, (), PLACE),)))
    assert failed.message == "timeout(2 s) at visit.osc:8:5 ran out while drive was running"
    assert (failed.cause, failed.error_code, failed.now_s) == ("timeout", 0, 2.2)
    assert journal[-1] == (2.2, "", "is cancelled")


def test_innermost_of_two_timeouts_is_the_cause(tree):
    failed = ended(tree(timeout(9.0, timeout(1.0, elapsed(5.0)))))
    assert failed.message == "timeout(1 s) at visit.osc:8:5 ran out while wait elapsed was running"


def test_repeat_begins_its_child_again_at_the_next_tick(outcome, journal):
    assert outcome(repeat(3, do(label="again"))) == (True, 0.3)
    assert [t_s for t_s, *_ in journal] == [0.1, 0.2, 0.3]


def test_failure_ends_repeat_with_failure(outcome):
    assert outcome(repeat(-1, serial(elapsed(0.2), do(fails=True)))) == (False, 0.3)


def test_repeat_without_a_count_goes_on_until_something_else_ends_the_scenario(outcome):
    watchdog = repeat(-1, serial(elapsed(1.0), log()))
    assert outcome(watchdog) is None
    assert outcome(parallel(watchdog, serial(elapsed(4.0), emit("end")))) == (True, 4.1)


def test_retry_begins_again_at_the_next_tick_and_fails_with_the_last_failure(outcome, journal, tree):
    assert outcome(modified("retry", do(0.2, fails=True), count=3)) == (False, 0.9)
    assert [t_s for t_s, *_ in journal] == [0.1, 0.4, 0.7]
    assert outcome(modified("retry", do(0.2), count=3)) == (True, 0.3)
    assert (
        ended(tree(modified("retry", do(fails=True, line=4), count=2))).message == "goal rejected; do at visit.osc:4:9"
    )


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
def test_modifiers_read_a_status_as_another(outcome, modifier, success, failure, running):
    assert outcome(modified(modifier, do())) == success
    assert outcome(modified(modifier, do(fails=True))) == failure
    assert outcome(modified(modifier, do(0.3))) == running


def test_first_written_modifier_is_outermost(outcome):
    assert outcome(modified("inverter", timeout(0.5, do(9.0)))) == (True, 0.7)
    assert outcome(timeout(0.5, modified("inverter", do(9.0)))) == (False, 0.7)


def test_modifier_that_makes_a_failure_of_a_success_says_so(tree):
    failed = ended(tree(modified("inverter", log())))
    assert (failed.cause, failed.message) == ("behavior", "inverter at visit.osc:8:5 failed: log: success is failure")


def test_until_ends_a_branch_with_success_and_cancels_it(outcome, journal):
    assert outcome(until(Elapsed(value(0.5), PLACE), do(9.0, label="a"))) == (True, 0.6)
    assert journal[-1] == (0.6, "a", "is cancelled")
    signal = serial(elapsed(0.3), emit("stop"))
    stopped = until(Happened("stop", None, PLACE), repeat(-1, elapsed(1.0)))
    assert outcome(parallel(signal, stopped)) == (True, 0.4)


def test_child_of_until_that_ends_first_keeps_its_result(outcome):
    assert outcome(until(Elapsed(value(0.5), PLACE), do(0.2))) == (True, 0.3)
    assert outcome(until(Elapsed(value(0.5), PLACE), do(0.2, fails=True))) == (False, 0.3)


def test_failed_action_is_named_with_its_place_its_reason_and_its_code(tree):
    failed = ended(tree(serial(log(), parallel(elapsed(9.0), do(0.3, fails=True, line=30)))))
    assert (failed.cause, failed.error_code) == ("action", 203)
    assert failed.message == "goal rejected; do at visit.osc:30:9"


def test_label_names_a_node(tree):
    failed = ended(tree(serial(do(fails=True, label="first_leg", line=3))))
    assert failed.message == "goal rejected; first_leg at visit.osc:3:9"


def test_scenario_that_divides_by_zero_can_not_work_and_says_where(tree):
    for root in (
        call("log", msg=operation("/", 1.0, 0.0)),
        elapsed(operation("/", 1.0, 0.0)),
        holds(operation("/", 1.0, 0.0)),
        timeout(operation("/", 1.0, 0.0), do()),
        until(Holds(operation("/", 1.0, 0.0), PLACE), do(9.0)),
    ):
        broken = tree(root)
        with pytest.raises(ScenarioError, match=r"visit\.osc:8:5: .*zero"):
            ended(broken)
        assert broken.now_s == 0.1


def test_scenario_with_a_declaration_that_has_no_value_can_not_work(tree):
    initial = operation("/", 1.0, 0.0)
    with pytest.raises(ScenarioError, match=r"visit\.osc:8:5: .*zero"):
        tree(log(), variables=(Field("share", Type("float", "basic"), initial, PLACE),))


def test_action_of_an_actor_sees_the_actors_members_and_its_name(tree):
    seen = []

    class Look(Deed):
        journal: ClassVar = []

        def enter(self, arguments):
            super().enter(arguments)
            seen.append(self.situation.actor)

    bot = Actor("bot", ("robot",), {"namespace": value(name("space"))}, (), PLACE)
    ended(
        tree(call("robot.look", "bot"), actors=(bot,), values={"space": "north"}, actions={"robot.look": Look}.items())
    )
    assert seen == [{"namespace": "north", "name": "bot"}]


def test_exception_of_an_action_is_passed_on_and_every_action_is_shut_down_once(tree, journal):
    class Broken(Deed):
        def update(self):
            raise OSError("no such simulator")

    Broken.journal = journal
    under_way = tree(parallel(do(9.0, label="a"), call("break", label="b")), actions={"break": Broken}.items())
    with pytest.raises(OSError, match="no such simulator"):
        under_way.tick()
    under_way.shutdown()
    under_way.shutdown()
    assert [(who, what) for _, who, what in journal[2:]] == [("a", "is shut down"), ("b", "is shut down")]


def test_exception_in_one_shutdown_keeps_no_other_from_its_own(tree, journal):
    class Stuck(Deed):
        def shutdown(self):
            super().shutdown()
            raise OSError("does not stop")

    Stuck.journal = journal
    under_way = tree(serial(call("stick", label="a"), do(label="b")), actions={"stick": Stuck}.items())
    with pytest.raises(OSError, match="does not stop"):
        under_way.shutdown()
    assert [who for _, who, _ in journal] == ["a", "b"]


def test_status_of_every_node_is_told_at_the_start_and_then_each_change(tree):
    under_way = ended(tree(serial(elapsed(0.2), log("over"), label="body")))
    rows = [(row.t_s, row.node, row.parent, row.child_index, row.name, row.status) for row in under_way.changes]
    assert rows == [
        (0.0, 0, None, 0, "visit", "INVALID"),
        (0.0, 1, 0, 0, "body", "INVALID"),
        (0.0, 2, 1, 0, "wait elapsed", "INVALID"),
        (0.0, 3, 1, 1, "log", "INVALID"),
        (0.1, 0, None, 0, "visit", "RUNNING"),
        (0.1, 1, 0, 0, "body", "RUNNING"),
        (0.1, 2, 1, 0, "wait elapsed", "RUNNING"),
        (0.3, 0, None, 0, "visit", "SUCCESS"),
        (0.3, 1, 0, 0, "body", "SUCCESS"),
        (0.3, 2, 1, 0, "wait elapsed", "SUCCESS"),
        (0.3, 3, 1, 1, "log", "SUCCESS"),
    ]
    assert under_way.changes[-1].message == "over"
    assert [row.class_name for row in under_way.changes[:4]] == ["Sequence", "Sequence", "Waiting", "Log"]


def test_trees_side_by_side_know_nothing_of_each_other(tree):
    one, other = (tree(serial(event("go"), emit("end"))) for _ in range(2))
    first = tree(serial(emit("go"), elapsed(0.1)))
    for under_way in (first, one, other):
        under_way.tick()
    assert not one.ended and not other.ended


def test_no_tick_is_made_twice_or_after_the_end(tree):
    under_way = tree(elapsed(0.3))
    under_way.tick(2)
    with pytest.raises(ValueError, match=r"tick 2 can't be made: the scenario is at tick 2"):
        under_way.tick(2)
    ended(under_way)
    with pytest.raises(ValueError, match=r"tick 9 can't be made: the scenario ended at tick 5"):
        under_way.tick(9)


def test_period_is_a_whole_number_of_microseconds(tree):
    for period_s in (0.0, -0.1, 1 / 3, math.nan, math.inf):
        with pytest.raises(ValueError, match="whole number of microseconds"):
            tree(log(), period_s=period_s)
    assert ended(tree(elapsed(1.0), period_s=0.05)).now_s == 1.05


def test_action_that_nothing_implements_is_refused_with_its_place(tree):
    with pytest.raises(ValueError, match=r"visit\.osc:8:9: nothing implements the action fly"):
        tree(call("fly"))
