"""Modifiers: nodes with one child that limit its time, repeat it, or change its result."""

import math
from collections.abc import Mapping
from typing import Final

from py_trees import decorators
from py_trees.behaviour import Behaviour
from py_trees.common import Status

from vastflow.sim.scenario.definition import Modified, Until
from vastflow.sim.scenario.tree.node import Condition, Node, Reason, awaited_names, running_leaves
from vastflow.sim.scenario.tree.state import RunState, microseconds


class Modifier(decorators.Decorator, Node):
    """A node round one child, which passes the child's status on."""

    def __init__(self, modified: Modified, child: Behaviour, state: RunState) -> None:
        super().__init__(modified.modifier, child)
        self.belongs(modified.place, state)
        self._arguments = modified.arguments

    def initialise(self) -> None:
        self.state.moved = True
        self.feedback_message = ""
        self.enter()

    def update(self) -> Status:
        return self.answer(self.decorated.status)

    def enter(self) -> None:
        """Begin, before the child is ticked."""

    def answer(self, child: Status) -> Status:
        """Return the status that follows from the child's status at this tick."""
        return child


class Timeout(Modifier):
    """Fails at the first tick later than `duration` after its first, even if the child then succeeds.

    A child that fails in that tick has failed for its own reason.
    """

    def enter(self) -> None:
        duration_s = self.state.value(self._arguments["duration"])
        self._end_us = self.state.clock.now_us + microseconds(duration_s)
        self._ran_out = ""
        self._words = f"{self.name}({duration_s:g} s) at {self.place} ran out"

    def answer(self, child: Status) -> Status:
        if self.state.clock.now_us <= self._end_us or child is Status.FAILURE:
            return child
        if child is Status.RUNNING:
            *names, last = awaited_names(list(running_leaves(self.decorated)))
            awaited = f"{', '.join(names)} and {last} were" if names else f"{last} was"
            self._ran_out = f"while {awaited} running"
        else:
            self._ran_out = f"in the tick in which {self.decorated.name} succeeded"
        self.feedback_message = f"ran out {self._ran_out}"
        self.state.moved = True
        return Status.FAILURE

    def wakes(self) -> float:
        return self.state.clock.first_after(self._end_us)

    def reason(self) -> Reason:
        if self._ran_out:
            return Reason("timeout", f"{self._words} {self._ran_out}")
        return super().reason()


class Repeat(Modifier):
    """Begins the child again, at the tick after its success, until it succeeded `count` times; -1 is for ever."""

    def enter(self) -> None:
        self._left = self.state.value(self._arguments["count"])

    def answer(self, child: Status) -> Status:
        if child is not Status.SUCCESS:
            return child
        self.state.moved = True
        self._left -= 1
        return Status.SUCCESS if self._left == 0 else Status.RUNNING


class Retry(Modifier):
    """Begins the child again, at the tick after its failure, until it failed `count` times; -1 is for ever."""

    def enter(self) -> None:
        count = self.state.value(self._arguments["count"])
        self._left = math.inf if count < 0 else count

    def answer(self, child: Status) -> Status:
        if child is not Status.FAILURE:
            return child
        self.state.moved = True
        self._left -= 1
        return Status.FAILURE if self._left <= 0 else Status.RUNNING


class Translation(Modifier):
    """Reads a status of the child as another one; a child that runs on under a result is cancelled."""

    def __init__(self, modified: Modified, child: Behaviour, state: RunState) -> None:
        super().__init__(modified, child, state)
        self._meanings = TRANSLATIONS[modified.modifier]

    @property
    def class_name(self) -> str:
        return self.name.title().replace("_", "")

    def answer(self, child: Status) -> Status:
        status = self._meanings.get(child, child)
        if status is not child:
            self.state.moved = True
            self.feedback_message = f"{self.decorated.name}: {child.value.lower()} is {status.value.lower()}"
        return status


TRANSLATIONS: Final[Mapping[str, Mapping[Status, Status]]] = {
    "inverter": {Status.SUCCESS: Status.FAILURE, Status.FAILURE: Status.SUCCESS},
    "failure_is_running": {Status.FAILURE: Status.RUNNING},
    "failure_is_success": {Status.FAILURE: Status.SUCCESS},
    "running_is_failure": {Status.RUNNING: Status.FAILURE},
    "running_is_success": {Status.RUNNING: Status.SUCCESS},
    "success_is_failure": {Status.SUCCESS: Status.FAILURE},
    "success_is_running": {Status.SUCCESS: Status.RUNNING},
}
"""Modifier to the statuses that it reads as others; a child that is running then begins again at the next tick."""


class UntilHolds(Modifier):
    """Ends the child with success when something holds; a child that ends in the same tick keeps its own result."""

    def __init__(self, until: Until, child: Behaviour, state: RunState) -> None:
        super().__init__(Modified("until", {}, until.child, until.place), child, state)
        self._condition = Condition(until.until, state)

    def enter(self) -> None:
        self._condition.begin()

    def answer(self, child: Status) -> Status:
        if child is Status.RUNNING and self._condition.holds():
            self.state.moved = True
            return Status.SUCCESS
        return child

    def wakes(self) -> float:
        return self._condition.wakes()


MODIFIERS: Final[Mapping[str, type[Modifier]]] = {
    "timeout": Timeout,
    "repeat": Repeat,
    "retry": Retry,
    **dict.fromkeys(TRANSLATIONS, Translation),
}
"""Modifiers by their names in a file."""
