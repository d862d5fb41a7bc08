"""What is waited for: time that goes by, an event, a condition that comes to hold."""

import math
from abc import ABC, abstractmethod
from typing import TypeAlias

from vastflow.sim.behavior.state import RunState
from vastflow.sim.osc.definition import (
    Awaited,
    Elapsed,
    Expression,
    External,
    Happened,
    Holds,
    ListOf,
    Operation,
    Struct,
)


class Condition(ABC):
    """Something awaited, in one run. Evaluation of what a user wrote may raise `EvaluationError`."""

    words: str = ""
    """How it is written, in short."""

    def begin(self) -> None:  # noqa: B027 - most have no beginning
        """Start to wait, at the present tick."""

    @abstractmethod
    def holds(self) -> bool:
        """Whether it has come."""

    def wakes(self) -> float:
        """Number of the first tick at which time alone can make it hold; infinite where time can't."""
        return math.inf


class TimeElapsed(Condition):
    """Holds at the first tick that is a duration or more after `begin`."""

    def __init__(self, awaited: Elapsed, state: RunState) -> None:
        self.words = "elapsed"
        self._awaited = awaited
        self._state = state
        self._due_us = math.inf

    def begin(self) -> None:
        self._due_us = self._state.clock.in_us(self._state.value(self._awaited.duration))

    def holds(self) -> bool:
        return self._state.clock.now_us >= self._due_us

    def wakes(self) -> float:
        return self._state.clock.first_at(self._due_us)


class EventHappened(Condition):
    """Holds when an event's flag is set and, at the same tick, a condition holds."""

    def __init__(self, awaited: Happened, state: RunState) -> None:
        self.words = f"@{awaited.event}"
        self._event = awaited.event
        self._state = state
        self._condition = None if awaited.condition is None else ExpressionHolds(awaited.condition, state)

    def holds(self) -> bool:
        if self._event not in self._state.events:
            return False
        return self._condition is None or self._condition.holds()

    def wakes(self) -> float:
        if self._condition is None or self._event not in self._state.events:
            return math.inf
        return self._condition.wakes()


class ExpressionHolds(Condition):
    """Holds when an expression over parameters and variables is true."""

    def __init__(self, expression: Expression, state: RunState) -> None:
        self.words = "condition"
        self._expression = expression
        self._state = state
        self._asks_outside = _calls_function(expression)

    def holds(self) -> bool:
        return bool(self._state.value(self._expression))

    def wakes(self) -> float:
        # A function may answer otherwise each time (random.get_int), so every tick has to ask it.
        return self._state.clock.number + 1 if self._asks_outside else math.inf


AnyCondition: TypeAlias = TimeElapsed | EventHappened | ExpressionHolds


def condition_of(awaited: Awaited, state: RunState) -> AnyCondition:
    """The condition that a file's words describe."""
    match awaited:
        case Elapsed():
            return TimeElapsed(awaited, state)
        case Happened():
            return EventHappened(awaited, state)
        case Holds():
            return ExpressionHolds(awaited.condition, state)


def _calls_function(expression: Expression) -> bool:
    match expression:
        case External():
            return True
        case ListOf(items=parts) | Operation(operands=parts):
            return any(map(_calls_function, parts))
        case Struct(members=members):
            return any(map(_calls_function, members.values()))
        case _:
            return False
