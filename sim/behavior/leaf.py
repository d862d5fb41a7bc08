"""Leaves of the tree: calls of actions, waits, events."""

import math
from collections.abc import Callable, Sequence
from typing import ParamSpec, TypeVar

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from vastflow.sim.behavior.action import Action
from vastflow.sim.behavior.clock import microseconds
from vastflow.sim.behavior.condition import condition_of
from vastflow.sim.behavior.node import Node, Reason
from vastflow.sim.behavior.state import RunState
from vastflow.sim.osc.definition import Call, Emit, Place, Wait
from vastflow.sim.scenario_error import ScenarioError

P = ParamSpec("P")
T = TypeVar("T")


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
        """What it comes to at this tick."""
        raise NotImplementedError

    def reason(self) -> Reason:
        return Reason("behavior", f"{self.name} at {self.place} failed: {self.feedback_message}")


class ActionCall(Leaf):
    """Calls an action: enters it with evaluated arguments, asks it at each tick, cancels it when given up.

    A `ScenarioError` of the action is raised with the place of the call.
    """

    def __init__(self, call: Call, action: Action, state: RunState) -> None:
        super().__init__(call.label or call.action.rpartition(".")[2], call.place, state)
        self._call = call
        self._action = action

    @property
    def class_name(self) -> str:
        return type(self._action).__name__

    @property
    def goes_along(self) -> bool:
        """Whether nobody waits for it."""
        return self._action.goes_along

    def enter(self) -> None:
        value = self.state.value
        arguments = {name: value(expression) for name, expression in self._call.arguments.items()}
        self._asked(self._action.enter, arguments)

    def answer(self) -> Status:
        status = self._asked(self._action.update)
        self.feedback_message = self._action.message
        if status is Status.INVALID:
            raise ValueError(f"{self.class_name}.update() answers RUNNING, SUCCESS or FAILURE, not {status}")
        return status

    def terminate(self, new_status: Status) -> None:
        if new_status is Status.INVALID and self.status is Status.RUNNING:
            self.feedback_message = "cancelled"
            self._action.cancel()

    def wakes(self) -> float:
        at_s = self._action.wakes_s()
        return self.state.clock.first_at(microseconds(at_s)) if math.isfinite(at_s) else at_s

    def reason(self) -> Reason:
        which = f"{self.name} at {self.place}"
        told = f"{self._action.message}; {which}" if self._action.message else f"{which} failed"
        return Reason("action", told, self._action.error_code)

    def _asked(self, question: Callable[P, T], *arguments: P.args, **named: P.kwargs) -> T:
        try:
            return question(*arguments, **named)
        except ScenarioError as error:
            raise ScenarioError(f"{error}; {self.name} at {self.place}") from error


class Waiting(Leaf):
    """`wait`: runs until something holds, which may be at once."""

    def __init__(self, wait: Wait, state: RunState) -> None:
        self._condition = condition_of(wait.until, state)
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
    """Names of running leaves that the scenario waits for: actions but those that only go along, if there are any."""
    actions = [leaf for leaf in leaves if isinstance(leaf, ActionCall)]
    return [leaf.name for leaf in actions if not leaf.goes_along] or [leaf.name for leaf in actions or leaves]
