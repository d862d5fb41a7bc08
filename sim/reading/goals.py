"""Several goals of a configuration, for a scenario that sends the robot to one: it is sent to each in turn."""

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

from vastflow.sim.digest import Value
from vastflow.sim.osc.definition import Behavior, Call, Composition, Modified, Name, ScenarioDefinition, Until

GOAL_KEY: Final = "goal_pose"
GOALS_KEY: Final = "goal_poses"

_NUMBERED: Final = re.compile(rf"{GOAL_KEY}_?(\d+)")
_SEND: Final = "nav_to_pose"


def goal_keys(definition: ScenarioDefinition, keys: Collection[str]) -> tuple[str, ...]:
    """Of a configuration's keys, those whose goals stand for the scenario's one `goal_pose`, in order.

    They are `goal_poses`, or `goal_pose1`, `goal_pose2` and so on. None where the configuration has a `goal_pose`, or where
    the scenario has no such parameter, or has theirs.
    """
    own = {parameter.name: parameter.type for parameter in definition.parameters}
    if GOAL_KEY in keys or GOAL_KEY not in own or own[GOAL_KEY].is_list:
        return ()
    if GOALS_KEY in keys:
        return () if GOALS_KEY in own else (GOALS_KEY,)
    numbers = {int(found[1]): key for key in keys if (found := _NUMBERED.fullmatch(key)) and key not in own}
    return tuple(numbers[number] for number in sorted(numbers))


def sent_to_each(
    definition: ScenarioDefinition, given: Mapping[str, Value], keys: Sequence[str]
) -> tuple[ScenarioDefinition, dict[str, Value]]:
    """The scenario with its goal sent for once for each of the goals under `keys`, and the values for its parameters.

    Every `nav_to_pose(goal_pose)` becomes a `serial` of as many. Elsewhere `goal_pose` is the last goal.

    Raises:
        ValueError: what is under the key is no list of goals.
    """
    found: Any = given[GOALS_KEY] if GOALS_KEY in keys else [given[key] for key in keys]
    goals = [found] if isinstance(found, Mapping) else found
    if not isinstance(goals, Sequence) or isinstance(goals, str) or not goals:
        raise ValueError(f"{GOALS_KEY}: found {found!r}; a list of poses, at least one")
    values = {**given, GOAL_KEY: goals[-1]}
    if len(goals) == 1:
        return definition, values
    names = [f"{GOAL_KEY}[{number}]" for number in range(1, len(goals) + 1)]
    (parameter,) = (each for each in definition.parameters if each.name == GOAL_KEY)
    each_goal = tuple(replace(parameter, name=name, default=None) for name in names)
    root = _in_turn(definition.root, names)
    together = replace(definition, parameters=(*definition.parameters, *each_goal), root=root)
    return together, {**values, **dict(zip(names, goals, strict=True))}


def _in_turn(behavior: Behavior, names: Sequence[str]) -> Behavior:
    match behavior:
        case Call(action=action, arguments={"goal_pose": Name(path=("goal_pose",), place=place)}):
            if action.rpartition(".")[2] != _SEND:
                return behavior
            calls = [
                replace(behavior, arguments={**behavior.arguments, "goal_pose": Name((name,), place)}) for name in names
            ]
            return Composition("serial", tuple(calls), "", behavior.place)
        case Composition(children=children):
            return replace(behavior, children=tuple(_in_turn(child, names) for child in children))
        case Modified(child=child) | Until(child=child):
            return replace(behavior, child=_in_turn(child, names))
        case _:
            return behavior
