"""The tree of one run of a scenario, ticked in simulated time."""

import math
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from typing import Any, NamedTuple, TypeVar

from py_trees import composites
from py_trees.behaviour import Behaviour
from py_trees.common import ParallelPolicy, Status

from vastflow.sim.model.faults import Place
from vastflow.sim.scenario.definition import (
    Behavior,
    Call,
    Composition,
    Emit,
    Expression,
    Modified,
    ScenarioDefinition,
    Struct,
    Until,
    Wait,
)
from vastflow.sim.scenario.evaluation import names_in
from vastflow.sim.scenario.tree.action import Action, ActionFactory, ActionSituation
from vastflow.sim.scenario.tree.modifier import MODIFIERS, UntilHolds
from vastflow.sim.scenario.tree.node import ActionCall, Emission, Leaf, Node, Reason, Waiting, awaited_names
from vastflow.sim.scenario.tree.state import RunState, TickClock

_NO_FUNCTIONS: Mapping[str, Callable[..., Any]] = {}
Made = TypeVar("Made")


class StatusChange(NamedTuple):
    """One node has another status after a tick than before it.

    Attributes:
        t_s: Simulated time of the tick; 0 for the status before the first.
        behavior: Number of the node, from 0 for the root, parents before children, from left to right.
        parent: The parent's; -1 for the root.
        child_index: Which child of its parent it is, from 0.
        class_name: Name of the class of the node; of a call, that of the action.
        status: INVALID (not entered, or given up), RUNNING, SUCCESS or FAILURE.
        message: Message of the node on its status; may be empty.
        line, column: Its place in the file.
    """

    t_s: float
    behavior: int
    parent: int
    child_index: int
    name: str
    class_name: str
    status: str
    message: str
    line: int
    column: int


class Sequence(composites.Sequence, Node):
    """Children one after another, with memory: the next begins in the tick in which one succeeds."""


class Parallel(composites.Parallel, Node):
    """Ticks all children until they succeed; fails with the first failure, succeeds with the last success."""


class OneOf(composites.Parallel, Node):
    """All children in each tick; the first success ends it with success and cancels the rest, one failure fails it."""


def _composed(kind: str, name: str, children: list[Behaviour], place: Place, state: RunState) -> Node:
    node: Node
    match kind:
        case "serial":
            node = Sequence(name, True, children)
        case "parallel":
            node = Parallel(name, ParallelPolicy.SuccessOnAll(synchronise=True), children)
        case _:
            node = OneOf(name, ParallelPolicy.SuccessOnOne(), children)
    node.belongs(place, state)
    return node


class ScenarioTree:
    """A scenario under way: ticked from outside, it drives its actions and ends with a verdict.

    The clock is the number of the tick times the period; the first tick is number 1. After each tick, `emit fail` or
    a failed root end it as failed, else `emit end` or a succeeded root as passed. Actions that still run then are not
    cancelled but shut down.

    Nothing is shared between trees, so any number of them can be under way side by side.

    Attributes:
        ended: There is a verdict; no tick may follow.
        passed: The scenario passed.
        reason: Innermost cause of the failure; empty unless it failed.
        changes: Every node's status at t = 0, then all changes by tick and node.
    """

    def __init__(
        self,
        definition: ScenarioDefinition,
        values: Mapping[str, Any],
        actions: Mapping[str, ActionFactory],
        functions: Mapping[str, Callable[..., Any]] = _NO_FUNCTIONS,
        *,
        period_s: float = 0.1,
        log: Callable[[str], None] = lambda line: None,
    ) -> None:
        """Build the tree; no action is entered yet.

        Args:
            values: Values of the scenario's parameters, as `language.parameters.bound` gives them.
            actions: By qualified name.
            functions: External functions by library struct and name (`random.get_int`).
            period_s: Between two ticks; whole microseconds.

        Raises:
            ScenarioError: An actor or a variable has no value, such as a division by zero.
            ValueError: A period that is none, or an action or a modifier that nothing implements; `support.unsupported`
                finds those beforehand.
        """
        self._clock = TickClock(period_s)
        self._state = RunState(self._clock, values, functions, log)
        _declare(definition, self._state)
        self._actions: list[Action] = []
        top = _node(definition.root, self._state, actions, self._actions)
        self._root = _composed("serial", definition.name, [top], definition.place, self._state)
        self._nodes = _preorder(self._root)
        numbers = {node.id: i for i, node in enumerate(self._nodes)}
        self._homes = {child.id: (numbers[node.id], k) for node in self._nodes for k, child in enumerate(node.children)}
        self._statuses = [node.status for node in self._nodes]
        self.changes: list[StatusChange] = []
        for i in range(len(self._nodes)):
            self._record(i)
        self.reason = Reason()
        self.ended = self.passed = self._is_shut_down = False

    @property
    def number(self) -> int:
        """Number of the last tick; 0 before the first."""
        return self._clock.number

    @property
    def now_s(self) -> float:
        """Time of the last tick made."""
        return self._clock.now_s

    @property
    def awaited(self) -> tuple[str, ...]:
        """Names of the awaited actions, or else of other running leaves."""
        running = [node for node in self._nodes if isinstance(node, Leaf) and node.status is Status.RUNNING]
        return tuple(awaited_names(running))

    def tick(self, number: int | None = None) -> None:
        """Advance one tick, or several if those between change nothing (`next_tick`).

        What an action raises is passed on.

        Raises:
            ScenarioError: The scenario can't work: an expression has no value, an action is called with what it can't take.
            ValueError: A tick that was made already, or any after the end.
        """
        number = self.number + 1 if number is None else number
        if self.ended or number <= self.number:
            made = f"ended at tick {self.number}" if self.ended else f"is at tick {self.number}"
            raise ValueError(f"tick {number} can't be made: the scenario {made}")
        self._clock.number = number
        self._state.moved = False
        for look in self._state.monitors:
            look()
        self._root.tick_once()
        for i, node in enumerate(self._nodes):
            if node.status is not self._statuses[i]:
                self._statuses[i] = node.status
                self._record(i)
        self._judge()

    def next_tick(self) -> float:
        """Return the earliest tick that may change anything unless the robot's mission ends.

        Infinite where only the mission's end can, and after the scenario's. The ticks up to that one may be left out.
        """
        if self.ended:
            return math.inf
        soonest = self.number + 1
        if self._state.moved or self._state.monitors or self.number == 0:
            return soonest
        running = (node.wakes() for node in self._nodes if node.status is Status.RUNNING)
        return max(soonest, min(running, default=math.inf))

    def shutdown(self) -> None:
        """Shut down all actions once; an error is raised after all of them."""
        if self._is_shut_down:
            return
        self._is_shut_down = True
        for node in self._nodes:
            # Circles, which would keep all that actions hold until the collector comes by.
            node.parent, node.iterator = None, iter(())
        with ExitStack() as stack:
            for action in self._actions[::-1]:
                stack.callback(action.shutdown)

    def _judge(self) -> None:
        events, root = self._state.events, self._root.status
        if "fail" in events:
            emissions = (node for node in self._nodes if isinstance(node, Emission) and node.emitted)
            by = next(node for node in emissions if node.event == "fail")
            self.reason = Reason("emit", f"emit fail at {by.place}")
        elif root is Status.FAILURE:
            self.reason = self._root.reason()
        elif "end" in events or root is Status.SUCCESS:
            self.passed = True
        else:
            return
        self.ended = True

    def _record(self, i: int) -> None:
        node = self._nodes[i]
        what = node.name, node.class_name, node.status.value, node.feedback_message
        home = self._homes.get(node.id, (-1, 0))
        self.changes.append(StatusChange(self.now_s, i, *home, *what, node.place.line, node.place.column))


def _declare(definition: ScenarioDefinition, state: RunState) -> None:
    """Evaluate actors and variables in the order of their dependences."""
    waiting: dict[str, Expression | None] = {variable.name: variable.default for variable in definition.variables}
    waiting |= {actor.name: Struct(actor.types[0], actor.members, actor.place) for actor in definition.actors}

    def settle(name: str) -> None:
        expression = waiting.pop(name)
        if expression is not None:
            for needed in names_in(expression):
                if needed in waiting:
                    settle(needed)
            state.names[name] = state.value(expression)

    while waiting:
        settle(next(iter(waiting)))
    for actor in definition.actors:
        state.names[actor.name]["name"] = actor.name
        for variable in actor.variables:
            state.variables.declare(f"{actor.name}.{variable}")
    for each in definition.variables:
        state.variables.declare(each.name)


def _node(behavior: Behavior, state: RunState, actions: Mapping[str, ActionFactory], made: list[Action]) -> Node:
    match behavior:
        case Composition(kind, children, label, place):
            below: list[Behaviour] = [_node(child, state, actions, made) for child in children]
            return _composed(kind, label or kind, below, place, state)
        case Call():
            action = _implementation(actions, behavior.action, "action", behavior.place)(
                ActionSituation(
                    state.names[behavior.actor] if behavior.actor else {},
                    behavior.label,
                    state.clock,
                    state.variables,
                    state.log,
                    state.monitors,
                )
            )
            made.append(action)
            return ActionCall(behavior, action, state)
        case Wait():
            return Waiting(behavior, state)
        case Emit():
            return Emission(behavior, state)
        case Modified():
            modifier = _implementation(MODIFIERS, behavior.modifier, "modifier", behavior.place)
            return modifier(behavior, _node(behavior.child, state, actions, made), state)
        case Until():
            return UntilHolds(behavior, _node(behavior.child, state, actions, made), state)


def _implementation(known: Mapping[str, Made], name: str, kind: str, place: Place) -> Made:
    if name not in known:
        raise ValueError(f"{place}: nothing implements the {kind} {name}")
    return known[name]


def _preorder(root: Node) -> list[Node]:
    nodes = [root]
    for child in root.children:
        assert isinstance(child, Node)  # `_node` makes no others
        nodes += _preorder(child)
    return nodes
