"""From a scenario's definition to the nodes of one run's tree."""

from collections.abc import Callable, Mapping
from collections.abc import Sequence as Ordered
from typing import TypeVar

from py_trees import composites
from py_trees.behaviour import Behaviour
from py_trees.common import ParallelPolicy

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
from vastflow.sim.scenario.tree.node import ActionCall, Emission, Node, Waiting
from vastflow.sim.scenario.tree.state import RunState


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


Made = TypeVar("Made")

_COMPOSITIONS: Mapping[str, Callable[..., Node]] = {"serial": Sequence, "parallel": Parallel, "one_of": OneOf}


def build(
    definition: ScenarioDefinition, state: RunState, actions: Mapping[str, ActionFactory]
) -> tuple[Node, tuple[Action, ...]]:
    """Return the root, a sequence named after the scenario, and the actions below it.

    Evaluates actors and variables into the state's names.

    Raises:
        ScenarioError: One of these has no value, such as a division by zero.
        ValueError: An action or a modifier that nothing implements; `support.unsupported` finds those beforehand.
    """
    made: list[Action] = []
    _declare(definition, state)
    top = _node(definition.root, state, actions, made)
    return Sequence(definition.name, [top], definition.place, state), tuple(made)


def _declare(definition: ScenarioDefinition, state: RunState) -> None:
    """Evaluate actors and variables, each after those that it needs."""
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
            below = [_node(child, state, actions, made) for child in children]
            return _COMPOSITIONS[kind](label or kind, below, place, state)
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
