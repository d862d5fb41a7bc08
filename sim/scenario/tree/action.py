"""Actions: the leaves of a scenario's tree that do something to the simulated world, or to a process."""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, MutableMapping, MutableSequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TypeAlias

from py_trees.common import Status

from vastflow.sim.scenario.tree.state import TickClock

if TYPE_CHECKING:  # names of actions are known without the simulator
    from vastflow.sim.loop.simulation import Simulation


@dataclass(frozen=True, slots=True)
class ActionSituation:
    """The context of an action in a run.

    Attributes:
        actor: Members of the actor instance it is called on, evaluated, with its `name`; empty without one.
        label: Label as written before the call, or empty.
        clock: The scenario's.
        variables: Values of the run's `var`s by name, which actions may change.
        log: Takes a line for the run's log.
        monitors: Called before each tick; an action may add one that keeps a variable up to date.
    """

    actor: Mapping[str, Any]
    label: str
    clock: TickClock
    variables: MutableMapping[str, Any]
    log: Callable[[str], None]
    monitors: MutableSequence[Callable[[], None]] = field(default_factory=list)


class Action(ABC):
    """One call of an action; modifiers may enter it again.

    Attributes:
        goes_along: It runs until the scenario ends, whatever happens; nobody waits for it, and no timeout runs out for it.
        message: One line on what it is doing, or why it ended as it did.
        error_code: Nav2's code of the failure it ended with, else 0.
    """

    goes_along: bool = False
    message: str = ""
    error_code: int = 0

    @abstractmethod
    def enter(self, arguments: Mapping[str, Any]) -> None:
        """Begin, with the arguments as they are at this moment: SI numbers, structs as dicts, lists, `EnumValue`s."""

    @abstractmethod
    def update(self) -> Status:
        """Return RUNNING, SUCCESS, or FAILURE; called once per tick, from the tick of `enter` on."""

    def cancel(self) -> None:  # noqa: B027 - most have nothing to stop
        """Stop the action; called when its branch is abandoned while it runs."""

    def shutdown(self) -> None:  # noqa: B027 - most leave nothing
        """Leave nothing running; called once at the end of a run, whatever became of the action."""

    def wakes_s(self) -> float:
        """Return the time (s) at which `update` may change its answer unless the robot's mission ends.

        Ticks in between change nothing and are left out. By default any moment: at the next tick.
        """
        return -math.inf


class Immediate(Action):
    """An action that is over in the tick in which it begins."""

    _succeeded = True

    def enter(self, arguments: Mapping[str, Any]) -> None:
        self.message = ""
        self._succeeded = self.act(arguments)

    def update(self) -> Status:
        return Status.SUCCESS if self._succeeded else Status.FAILURE

    @abstractmethod
    def act(self, arguments: Mapping[str, Any]) -> bool:
        """Act and return True on success; `message` says why it failed."""


class WorldAction(Action):
    """An action on the simulated world of a run."""

    def __init__(self, simulation: "Simulation", situation: ActionSituation) -> None:
        self.simulation = simulation
        self.situation = situation


ActionFactory: TypeAlias = Callable[[ActionSituation], Action]

WorldFactory: TypeAlias = "Callable[[Simulation, ActionSituation], Action]"
"""Makes an action of one run on the simulated world."""
