"""Nodes of a scenario's tree: their base, the leaves, and awaited conditions."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias, TypeVar

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from vastflow.sim.model.faults import Place, ScenarioError
from vastflow.sim.scenario.definition import Awaited, Call, Elapsed, Emit, External, Happened, Wait
from vastflow.sim.scenario.evaluation import parts_of
from vastflow.sim.scenario.tree.action import Action
from vastflow.sim.scenario.tree.state import RunState, microseconds

Cause: TypeAlias = Literal["", "action", "timeout", "emit", "behavior"]
T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Reason:
    """Why a scenario failed.

    Attributes:
        cause: `action` an action ended with failure, `timeout` time ran out, `emit` the file said `emit fail`,
            `behavior` a modifier turned a result round; empty where nothing failed.
        message: In words, with the place in the file.
        error_code: Nav2's code of the action that failed, else 0.
    """

    cause: Cause = ""
    message: str = ""
    error_code: int = 0


class Node(Behaviour):
    """A node of the tree of one run.

    Attributes:
        place: Place of its text in the scenario file.
        state: State that the run's nodes share.
    """

    place: Place
    state: RunState

    @property
    def class_name(self) -> str:
        """Name of its behavior; the action's name if it calls one."""
        return type(self).__name__

    def belongs(self, place: Place, state: RunState) -> None:
        """Set place and state; py_trees' constructors take other arguments."""
        self.place = place
        self.state = state

    def wakes(self) -> float:
        """Return the first tick at which time alone may change the answer, or infinity."""
        return math.inf

    def reason(self) -> Reason:
        """Return the reason of the first failed child, or this node's own."""
        for child in self.children:
            if child.status is Status.FAILURE and isinstance(child, Node):
                return child.reason()
        return Reason("behavior", f"{self.name} at {self.place} failed: {self.feedback_message}")


def running_leaves(node: Behaviour) -> Iterator[Behaviour]:
    """Yield the running nodes below a node that have no running children, from left to right."""
    if node.status is Status.RUNNING:
        below = [leaf for child in node.children for leaf in running_leaves(child)]
        yield from below or [node]


class Condition:
    """Condition of a `wait` or `until` in one run; its evaluation may raise `ScenarioError`.

    Attributes:
        words: Short text of the condition.
    """

    def __init__(self, awaited: Awaited, state: RunState) -> None:
        self._state = state
        self._duration = awaited.duration if isinstance(awaited, Elapsed) else None
        self._event = awaited.event if isinstance(awaited, Happened) else None
        self._condition = None if isinstance(awaited, Elapsed) else awaited.condition
        self._due_us = math.inf
        parts = parts_of(self._condition) if self._condition else ()
        self._asks_outside = any(isinstance(part, External) for part in parts)
        self.words = "elapsed" if self._duration else f"@{self._event}" if self._event else "condition"

    def begin(self) -> None:
        """Start waiting at this tick."""
        if self._duration is not None:
            self._due_us = self._state.clock.in_us(self._state.value(self._duration))

    def holds(self) -> bool:
        """True once the duration is over, or if the event's flag is set and, at this tick, the condition holds."""
        if self._duration is not None:
            return self._state.clock.now_us >= self._due_us
        if self._event is not None and self._event not in self._state.events:
            return False
        return self._condition is None or bool(self._state.value(self._condition))

    def wakes(self) -> float:
        """Return the first tick at which time alone can make it hold, or infinity."""
        if self._duration is not None:
            return self._state.clock.first_at(self._due_us)
        happened = self._event is None or self._event in self._state.events
        # A function may answer otherwise each time (random.get_int), so every tick has to ask it.
        return self._state.clock.number + 1 if happened and self._asks_outside else math.inf


class Leaf(Node):
    """A node without children."""

    def __init__(self, name: str, place: Place, state: RunState) -> None:
        super().__init__(name)
        self.belongs(place, state)

    def initialise(self) -> None:
        self.state.moved = True
        self.feedback_message = ""
        self.enter()

    def update(self) -> Status:
        status = self.answer()
        if status is not Status.RUNNING:
            self.state.moved = True
        return status

    def enter(self) -> None:
        """Begin."""

    def answer(self) -> Status:
        """Return the status at this tick."""
        raise NotImplementedError


class ActionCall(Leaf):
    """Calls an action: enters it with evaluated arguments, asks it at each tick, cancels it when given up.

    A `ScenarioError` of the action is raised with the place of the call.
    """

    def __init__(self, call: Call, action: Action, state: RunState) -> None:
        super().__init__(call.label or call.action.rpartition(".")[2], call.place, state)
        self._call = call
        self.action = action

    @property
    def class_name(self) -> str:
        return type(self.action).__name__

    def enter(self) -> None:
        value = self.state.value
        self._asked(self.action.enter, {name: value(each) for name, each in self._call.arguments.items()})

    def answer(self) -> Status:
        status = self._asked(self.action.update)
        self.feedback_message = self.action.message
        if status is Status.INVALID:
            raise ValueError(f"{self.class_name}.update() answers RUNNING, SUCCESS or FAILURE, not {status}")
        return status

    def terminate(self, new_status: Status) -> None:
        if new_status is Status.INVALID and self.status is Status.RUNNING:
            self.feedback_message = "cancelled"
            self.action.cancel()

    def wakes(self) -> float:
        at_s = self.action.wakes_s()
        return self.state.clock.first_at(microseconds(at_s)) if math.isfinite(at_s) else at_s

    def reason(self) -> Reason:
        which = f"{self.name} at {self.place}"
        told = f"{self.action.message}; {which}" if self.action.message else f"{which} failed"
        return Reason("action", told, self.action.error_code)

    def _asked(self, question: Callable[..., T], *arguments: Any) -> T:
        try:
            return question(*arguments)
        except ScenarioError as error:
            raise ScenarioError(f"{error}; {self.name} at {self.place}") from error


class Waiting(Leaf):
    """`wait`: runs until something holds, which may be at once."""

    def __init__(self, wait: Wait, state: RunState) -> None:
        self._condition = Condition(wait.until, state)
        super().__init__(wait.label or f"wait {self._condition.words}", wait.place, state)

    def enter(self) -> None:
        self._condition.begin()

    def answer(self) -> Status:
        return Status.SUCCESS if self._condition.holds() else Status.RUNNING

    def wakes(self) -> float:
        return self._condition.wakes()


class Emission(Leaf):
    """`emit`: sets an event's flag and succeeds.

    Attributes:
        emitted: `emit fail` was reached, for one.
    """

    def __init__(self, emit: Emit, state: RunState) -> None:
        super().__init__(emit.label or f"emit {emit.event}", emit.place, state)
        self.event = emit.event
        self.emitted = False

    def answer(self) -> Status:
        self.emitted = True
        self.state.events.add(self.event)
        return Status.SUCCESS


def awaited_names(leaves: Sequence[Behaviour]) -> list[str]:
    """Return the names of the awaited leaves: actions, unless all of them are background ones."""
    actions = [leaf for leaf in leaves if isinstance(leaf, ActionCall)]
    return [leaf.name for leaf in actions if not leaf.action.goes_along] or [leaf.name for leaf in actions or leaves]
