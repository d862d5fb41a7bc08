"""`serial`, `parallel` and `one_of`: py_trees' composites, which use neither timers nor shared state."""

from collections.abc import Sequence as Ordered

from py_trees import composites
from py_trees.behaviour import Behaviour
from py_trees.common import ParallelPolicy

from vastflow.sim.behavior.node import Node
from vastflow.sim.behavior.state import RunState
from vastflow.sim.osc.definition import Place


class Sequence(composites.Sequence, Node):
    """Children one after another, with memory: the next begins in the tick in which one succeeds."""

    def __init__(self, name: str, children: Ordered[Behaviour], place: Place, state: RunState) -> None:
        super().__init__(name, True, children)
        self.belongs(place, state)


class Parallel(composites.Parallel, Node):
    """All children in each tick, those that succeeded not again; fails with the first failure, succeeds with the last."""

    def __init__(self, name: str, children: Ordered[Behaviour], place: Place, state: RunState) -> None:
        super().__init__(name, ParallelPolicy.SuccessOnAll(synchronise=True), children)
        self.belongs(place, state)


class OneOf(composites.Parallel, Node):
    """All children in each tick; the first success ends it with success and cancels the rest, one failure fails it."""

    def __init__(self, name: str, children: Ordered[Behaviour], place: Place, state: RunState) -> None:
        super().__init__(name, ParallelPolicy.SuccessOnOne(), children)
        self.belongs(place, state)
