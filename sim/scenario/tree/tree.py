"""The tree of one run of a scenario, ticked in simulated time."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from vastflow.sim.model.faults import Place
from vastflow.sim.scenario.definition import ScenarioDefinition
from vastflow.sim.scenario.tree.action import ActionFactory
from vastflow.sim.scenario.tree.building import build
from vastflow.sim.scenario.tree.node import Cause, Emission, Leaf, Node, Reason, awaited_names
from vastflow.sim.scenario.tree.state import RunState, TickClock

_NO_FUNCTIONS: Mapping[str, Callable[..., Any]] = {}


def ignored(line: str) -> None:
    """Discard a log line."""


@dataclass(frozen=True, slots=True)
class StatusChange:
    """One node has another status after a tick than before it.

    Attributes:
        t_s: Simulated time of the tick; 0 for the status before the first.
        node: Number of the node, from 0 for the root, parents before children, from left to right.
        parent: The parent's; None for the root.
        child_index: Which child of its parent it is, from 0.
        class_name: What it does; of a call, the class of the action.
        status: INVALID (not entered, or given up), RUNNING, SUCCESS or FAILURE.
        message: What the node says of it; may be empty.
    """

    t_s: float
    node: int
    parent: int | None
    child_index: int
    name: str
    class_name: str
    status: str
    message: str
    place: Place


class ScenarioTree:
    """A scenario under way: ticked from outside, it drives its actions and ends with a verdict.

    The clock is the number of the tick times the period; the first tick is number 1. After each tick, `emit fail` or
    a failed root end it as failed, else `emit end` or a succeeded root as passed. Actions that still run then are not
    cancelled but shut down.

    Nothing is shared between trees, so any number of them can be under way side by side.
    """

    def __init__(
        self,
        definition: ScenarioDefinition,
        values: Mapping[str, Any],
        actions: Mapping[str, ActionFactory],
        functions: Mapping[str, Callable[..., Any]] = _NO_FUNCTIONS,
        *,
        period_s: float = 0.1,
        log: Callable[[str], None] = ignored,
    ) -> None:
        """Build the tree; no action is entered yet.

        Args:
            values: Of the scenario's parameters, as `osc.parameters.bound` gives them.
            actions: By qualified name.
            functions: External functions by library struct and name (`random.get_int`).
            period_s: Between two ticks; whole microseconds.

        Raises:
            ValueError: A period that is none, or an action that nothing implements.
        """
        self._clock = TickClock(period_s)
        self._state = RunState(self._clock, values, functions, log)
        self._root, self._actions = build(definition, self._state, actions)
        self._nodes = tuple(_preorder(self._root))
        self._identities = _identities(self._nodes)
        self._statuses = [node.status for node in self._nodes]
        self._changes: list[StatusChange] = []
        for i in range(len(self._nodes)):
            self._record(i)
        self._reason = Reason()
        self._ended = self._passed = self._is_shut_down = False

    @property
    def number(self) -> int:
        """Number of the last tick; 0 before the first."""
        return self._clock.number

    @property
    def now_s(self) -> float:
        """Time of the last tick made."""
        return self._clock.now_s

    @property
    def ended(self) -> bool:
        """True once there is a verdict; no tick may follow."""
        return self._ended

    @property
    def passed(self) -> bool:
        """True if the scenario passed."""
        return self._passed

    @property
    def message(self) -> str:
        """Innermost cause of the failure with its place; empty unless it failed."""
        return self._reason.message

    @property
    def cause(self) -> Cause:
        """Kind of the cause; empty unless it failed."""
        return self._reason.cause

    @property
    def error_code(self) -> int:
        """Nav2's code of the action that was the cause, else 0."""
        return self._reason.error_code

    @property
    def awaited(self) -> tuple[str, ...]:
        """Names of the awaited actions, or else of other running leaves."""
        running = [node for node in self._nodes if isinstance(node, Leaf) and node.status is Status.RUNNING]
        return tuple(awaited_names(running))

    @property
    def changes(self) -> Sequence[StatusChange]:
        """Every node's status at t = 0, then all changes by tick and node."""
        return self._changes

    def tick(self, number: int | None = None) -> None:
        """Make the next tick, or a later one if those between change nothing (`next_tick`).

        What an action raises is passed on.

        Raises:
            ScenarioError: The scenario can't work: an expression has no value, an action is called with what it can't take.
            ValueError: A tick that was made already, or any after the end.
        """
        number = self.number + 1 if number is None else number
        if self._ended or number <= self.number:
            made = f"ended at tick {self.number}" if self._ended else f"is at tick {self.number}"
            raise ValueError(f"tick {number} can't be made: the scenario {made}")
        self._clock.number = number
        self._state.moved = False
        for monitor in self._state.monitors:
            monitor.look()
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
        if self._ended:
            return math.inf
        soonest = self.number + 1
        if self._state.moved or self._state.monitors or self.number == 0:
            return soonest
        earliest = min(
            (node.wakes() for node in self._nodes if node.status is Status.RUNNING),
            default=math.inf,
        )
        return max(soonest, earliest)

    def shutdown(self) -> None:
        """Shut down all actions once; an error is raised after all of them."""
        if self._is_shut_down:
            return
        self._is_shut_down = True
        for node in self._nodes:
            # Circles, which would keep all that actions hold until the collector comes by.
            node.parent, node.iterator = None, _nothing()
        with ExitStack() as stack:
            for action in reversed(self._actions):
                stack.callback(action.shutdown)

    def _judge(self) -> None:
        events, root = self._state.events, self._root.status
        if "fail" in events:
            by = next(
                node for node in self._nodes if isinstance(node, Emission) and node.event == "fail" and node.emitted
            )
            self._reason = Reason("emit", f"emit fail at {by.place}")
        elif root is Status.FAILURE:
            self._reason = self._root.reason()
        elif "end" in events or root is Status.SUCCESS:
            self._passed = True
        else:
            return
        self._ended = True

    def _record(self, i: int) -> None:
        node = self._nodes[i]
        parent, child_index = self._identities[i]
        self._changes.append(
            StatusChange(
                self.now_s,
                i,
                parent,
                child_index,
                node.name,
                node.class_name,
                node.status.value,
                node.feedback_message,
                node.place,
            )
        )


def _nothing() -> Iterator[Behaviour]:
    yield from ()


def _preorder(root: Node) -> list[Node]:
    nodes = [root]
    for child in root.children:
        assert isinstance(child, Node)  # `build` makes no others
        nodes += _preorder(child)
    return nodes


def _identities(nodes: Sequence[Node]) -> list[tuple[int | None, int]]:
    """Return each node's parent number and its index among the parent's children."""
    identities: list[tuple[int | None, int]] = [(None, 0)] * len(nodes)
    numbers = {id(node): i for i, node in enumerate(nodes)}
    for i, node in enumerate(nodes):
        for child_index, child in enumerate(node.children):
            identities[numbers[id(child)]] = (i, child_index)
    return identities
