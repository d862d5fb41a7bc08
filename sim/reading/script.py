"""The script of a run: an abstract scenario with the values and goals of a concrete one."""

import math
import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

from vastflow.sim.model.digest import FileContent, Value
from vastflow.sim.model.faults import Place, ScenarioError
from vastflow.sim.model.obstacle import Obstacle, obstacles_of
from vastflow.sim.model.pose import Pose, pose_of
from vastflow.sim.model.scenario import Scenario
from vastflow.sim.reading.abstract import definition_of
from vastflow.sim.scenario.definition import (
    Behavior,
    Call,
    Composition,
    Field,
    Modified,
    Name,
    ScenarioDefinition,
    Until,
    behaviors_of,
)
from vastflow.sim.scenario.evaluation import evaluate
from vastflow.sim.scenario.language.parameters import bound
from vastflow.sim.scenario.programs.folders import handed_name

GOAL_KEY: Final = "goal_pose"
GOALS_KEY: Final = "goal_poses"
LENGTH_KEY: Final = "reference_length"

_NUMBERED: Final = re.compile(rf"{GOAL_KEY}_?(\d+)")
_SEND: Final = "nav_to_pose"


def goal_keys(definition: ScenarioDefinition, keys: Collection[str]) -> tuple[str, ...]:
    """Return the keys of a configuration that replace the scenario's single `goal_pose`, in order.

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
    """Return the scenario with one navigation call for each goal under `keys`, and its parameters' values.

    Every `nav_to_pose(goal_pose)` becomes a `serial` of as many. Elsewhere `goal_pose` is the last goal.

    Raises:
        ValueError: what is under the key is no list of goals.
    """
    found: Any = given[GOALS_KEY] if GOALS_KEY in keys else [given[key] for key in keys]
    goals = [found] if isinstance(found, Mapping) else found
    if not isinstance(goals, Sequence) or isinstance(goals, str) or not goals:
        raise ValueError(f"{GOALS_KEY}: expected a list of poses, at least one, got {found!r}")
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


START_KEY: Final = "start_pose"

ROBOT_ACTIONS: Final = "differential_drive_robot."
"""Prefixes of the names of a robot's actions."""

NAVIGATIONS: Final[Mapping[str, str]] = {
    "nav_to_pose": "goal_pose",
    "nav_through_poses": "goal_poses",
    "follow_waypoints": "goal_poses",
}
"""Actions that send the robot somewhere, and the argument that says where to."""


@dataclass(frozen=True)
class Script:
    """The course of a scenario's runs.

    Attributes:
        values: Every parameter of the definition.
        start: Pose of the robot at the start: the scenario's `start_pose`, else where `init_nav2` puts it; None without a robot.
        goals: Goals of the navigation actions in the order they are written, repeated by their loops, as far as they are known
            before a run.
        passed: The goals among them that a mission through poses passes by, and that every run visits that succeeds.
        rounds: Number of times that the goals are visited in turn.
        obstacles: Obstacles that stand or appear whatever the scenario does; entities it spawns itself are not among them.
        topics: Topics that its `bag_record`s name; None where there are none, where one names none and so all, or where only a
            run knows.
        reference_length_m: Length of the path that a benchmark compares with; None where the campaign gives none.
    """

    definition: ScenarioDefinition
    values: Mapping[str, Any]
    start: Pose | None
    goals: tuple[Pose, ...]
    passed: tuple[Pose, ...]
    rounds: int
    obstacles: tuple[Obstacle, ...]
    topics: tuple[str, ...] | None
    reference_length_m: float | None = None


def script_of(scenario: Scenario) -> Script:
    """Return the script of a scenario's runs.

    Raises:
        ValueError: an abstract scenario that can't be read (`FileError`), a value that is none of a parameter
            (`ParameterMismatch`), a pose or an obstacle that is none, a second robot.
    """
    definition = definition_of(scenario.abstract)
    given: Mapping[str, Value] = {**scenario.environment, **scenario.system, **scenario.task}
    if isinstance(scenario.abstract, FileContent) and (keys := goal_keys(definition, given)):
        definition, given = sent_to_each(definition, given, keys)
    overrides = overrides_of(definition, given)
    values = bound(definition, overrides)
    start, goals, passed, rounds = None, [], [], 1
    bags, always = [], frozenset(map(id, _always_called(definition.root)))
    calls = tuple(calls_of(definition.root))
    _one_robot(calls)
    for call in calls:
        kind = call.action.rpartition(".")[2]
        if kind == "init_nav2" and start is None:
            start = _pose(_argument(call, "initial_pose", values))
        elif kind in NAVIGATIONS:
            found = _argument(call, NAVIGATIONS[kind], values)
            stops = [_pose(stop) for stop in (found if isinstance(found, list) else [found])]
            again = int(_argument(call, "loop_count", values) or 0)
            goals += [stop for stop in stops if stop] * (1 + again)
            if kind == "nav_through_poses" and id(call) in always:
                accepted = _argument(call, "success_on_acceptance", values)
                passed += [] if accepted else [stop for stop in stops[:-1] if stop]
            rounds = max(rounds, 1 + again)
        elif kind == "bag_record":
            bags.append(_argument(call, "topics", values))
    if START_KEY in given:
        start = pose_of(given[START_KEY], START_KEY)
    standing = {key: value for key, value in scenario.environment.items() if key not in overrides}
    topics = tuple(str(topic) for bag in bags for topic in bag) if bags and all(bags) else None
    length_m: Any = given.get(LENGTH_KEY)
    if LENGTH_KEY in given and not (isinstance(length_m, int | float) and 0 < length_m < math.inf):
        raise ScenarioError(f"{LENGTH_KEY}: expected a length above 0 m, got {length_m!r}")
    return Script(
        definition, values, start, tuple(goals), tuple(passed), rounds, obstacles_of(standing), topics, length_m
    )


def overrides_of(definition: ScenarioDefinition, given: Mapping[str, Value]) -> dict[str, Any]:
    """Return the values for a definition's parameters, with full poses and the programs' file names.

    The shipped missions through several poses take a single `goal_pose` for a list of one. Where no objects are given there
    are none to spawn.
    """
    found: dict[str, Any] = {}
    for parameter in definition.parameters:
        if parameter.name in given:
            value = given[parameter.name]
        elif parameter.name == GOALS_KEY and GOAL_KEY in given:
            value = [given[GOAL_KEY]]
        elif is_optional_list(parameter):
            value = []
        else:
            continue
        if parameter.type.name in _SHAPED:
            shaped = _SHAPED[parameter.type.name]
            value = [shaped(item) for item in value] if isinstance(value, list | tuple) else shaped(value)
        found[parameter.name] = handed_name(parameter.name, value) if isinstance(value, FileContent) else value
    return found


def is_optional_list(parameter: Field) -> bool:
    """True for a list of objects to spawn without a default, which may be empty."""
    return parameter.type.is_list and parameter.type.name == "spawn_entity" and parameter.default is None


def calls_of(root: Behavior) -> Iterator[Call]:
    """Yield every call of an action, in the order of the file."""
    return (behavior for behavior in behaviors_of(root) if isinstance(behavior, Call))


def _always_called(behavior: Behavior) -> Iterator[Call]:
    """Yield the calls that succeeded in every scenario that did."""
    match behavior:
        case Call():
            yield behavior
        case Composition(kind="serial" | "parallel", children=children):
            for child in children:
                yield from _always_called(child)
        case Modified(modifier="timeout" | "repeat" | "retry", child=child):
            yield from _always_called(child)


def _one_robot(calls: Sequence[Call]) -> None:
    acting: dict[str, Place] = {}
    for call in calls:
        if call.action.startswith(ROBOT_ACTIONS):
            acting.setdefault(call.actor, call.place)
    if len(acting) > 1:
        first, second, *_ = acting
        raise ValueError(f"{acting[second]}: expected one robot, {first!r}, got {second!r} too")


def _in_full(value: Value) -> Value:
    """Return a pose as `pose_3d`; `bound` refuses other values."""
    if isinstance(value, Mapping) and "position" not in value and "orientation" not in value:
        try:
            return pose_of(value).value()
        except ValueError:
            return value
    return value


def _entity(value: Value) -> Value:
    """Return an obstacle as `spawn_entity`; the scenario decides when it appears."""
    if not isinstance(value, Mapping):
        return value
    kept = {key: item for key, item in value.items() if key != "spawn_trigger"}
    return {**kept, "spawn_pose": _in_full(kept["spawn_pose"])} if "spawn_pose" in kept else kept


_SHAPED: Final[Mapping[str, Callable[[Value], Value]]] = {"pose_3d": _in_full, "spawn_entity": _entity}
"""Struct to what brings a configuration's value into its shape."""


def _argument(call: Call, name: str, values: Mapping[str, Any]) -> Any:
    """Return an argument of a call, or None if only a run knows it."""
    try:
        return evaluate(call.arguments[name], values, {}) if name in call.arguments else None
    except ScenarioError:
        return None


def _pose(value: Any) -> Pose | None:
    try:
        return pose_of(value)
    except ValueError:
        return None
