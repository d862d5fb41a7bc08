"""What every node of a scenario's tree has beyond py_trees' behaviors: a place, a time to wake, a reason."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal, TypeAlias

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from vastflow.sim.behavior.state import RunState
from vastflow.sim.osc.definition import Place

Cause: TypeAlias = Literal["", "action", "timeout", "emit", "behavior"]


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
        place: Where it stands in the file.
        state: What the run's nodes share.
    """

    place: Place
    state: RunState

    @property
    def class_name(self) -> str:
        """Name of what it does; an action's own where it calls one."""
        return type(self).__name__

    def belongs(self, place: Place, state: RunState) -> None:
        """Tell a new node where it stands; py_trees' constructors each take other arguments."""
        self.place = place
        self.state = state

    def wakes(self) -> float:
        """While it runs: number of the first tick at which time alone may change its answer; infinite if none."""
        return math.inf

    def reason(self) -> Reason:
        """Why it failed: what the first child that failed says, or that this node itself made a failure of it."""
        for child in self.children:
            if child.status is Status.FAILURE and isinstance(child, Node):
                return child.reason()
        return Reason("behavior", f"{self.name} at {self.place} failed: {self.feedback_message}")


def running_leaves(node: Behaviour) -> Iterator[Behaviour]:
    """What runs below a node and has nothing running below itself, from left to right."""
    if node.status is Status.RUNNING:
        below = [leaf for child in node.children for leaf in running_leaves(child)]
        yield from below or [node]
