"""A scenario's definition into the nodes of one run's tree."""

from collections.abc import Callable, Mapping
from typing import TypeVar

from vastflow.sim.behaviour.action import Action, ActionFactory, Situation
from vastflow.sim.behaviour.composition import OneOf, Parallel, Sequence
from vastflow.sim.behaviour.leaf import ActionCall, Emission, Undefined, Waiting
from vastflow.sim.behaviour.modifier import MODIFIERS, UntilHolds
from vastflow.sim.behaviour.node import Node
from vastflow.sim.behaviour.state import RunState
from vastflow.sim.osc.definition import (
    Behaviour,
    Call,
    Composition,
    Emit,
    Modified,
    Place,
    ScenarioDefinition,
    Until,
    Wait,
)
from vastflow.sim.osc.evaluation import EvaluationError

Made = TypeVar("Made")

_COMPOSITIONS: Mapping[str, Callable[..., Node]] = {"serial": Sequence, "parallel": Parallel, "one_of": OneOf}


def build(
    definition: ScenarioDefinition, state: RunState, actions: Mapping[str, ActionFactory]
) -> tuple[Node, tuple[Action, ...]]:
    """The root, a sequence named after the scenario, and the actions below it.

    Evaluates actors and variables into the state's names. Where one has no value (a division by zero), the tree is
    one leaf that fails and says so.

    Raises:
        ValueError: An action or a modifier that nothing implements; `support.unsupported` finds those beforehand.
    """
    made: list[Action] = []
    try:
        _declare(definition, state)
    except EvaluationError as error:
        top: Node = Undefined(str(error), definition.place, state)
    else:
        top = _node(definition.root, state, actions, made)
    return Sequence(definition.name, [top], definition.place, state), tuple(made)


def _declare(definition: ScenarioDefinition, state: RunState) -> None:
    for actor in definition.actors:
        members = {name: state.value(expression) for name, expression in actor.members.items()}
        state.names[actor.name] = {**members, "name": actor.name}
    variables = state.variables
    for variable in definition.variables:
        variables.declare(variable.name)
        if variable.initial is not None:
            variables[variable.name] = state.value(variable.initial)


def _node(behaviour: Behaviour, state: RunState, actions: Mapping[str, ActionFactory], made: list[Action]) -> Node:
    match behaviour:
        case Composition(kind, children, label, place):
            below = [_node(child, state, actions, made) for child in children]
            return _COMPOSITIONS[kind](label or kind, below, place, state)
        case Call():
            action = _implementation(actions, behaviour.action, "action", behaviour.place)(
                Situation(
                    state.names[behaviour.actor] if behaviour.actor else {},
                    behaviour.label,
                    state.clock,
                    state.variables,
                    state.log,
                )
            )
            made.append(action)
            return ActionCall(behaviour, action, state)
        case Wait():
            return Waiting(behaviour, state)
        case Emit():
            return Emission(behaviour, state)
        case Modified():
            modifier = _implementation(MODIFIERS, behaviour.modifier, "modifier", behaviour.place)
            return modifier(behaviour, _node(behaviour.child, state, actions, made), state)
        case Until():
            return UntilHolds(behaviour, _node(behaviour.child, state, actions, made), state)


def _implementation(known: Mapping[str, Made], name: str, kind: str, place: Place) -> Made:
    if name not in known:
        raise ValueError(f"{place}: nothing implements the {kind} {name}")
    return known[name]
