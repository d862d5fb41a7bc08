"""The script of a run: an abstract scenario with the values of a concrete one."""

import functools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from vastflow.sim.behavior.evaluation import EvaluationError, evaluate
from vastflow.sim.digest import FileContent, Value
from vastflow.sim.osc.definition import (
    Behavior,
    Call,
    Composition,
    Field,
    Modified,
    Place,
    ScenarioDefinition,
    Until,
)
from vastflow.sim.osc.parameters import bound
from vastflow.sim.pose import Pose, pose_of
from vastflow.sim.process.handed import handed_name
from vastflow.sim.reading.abstract import definition_of
from vastflow.sim.reading.goals import GOAL_KEY, GOALS_KEY, goal_keys, sent_to_each
from vastflow.sim.scenario import Scenario
from vastflow.sim.world.obstacle import Obstacle
from vastflow.sim.world.obstacle_values import obstacles_of

START_KEY: Final = "start_pose"

ROBOT_ACTIONS: Final = "differential_drive_robot."
"""How the names of a robot's actions begin."""

NAVIGATIONS: Final[Mapping[str, str]] = {
    "nav_to_pose": "goal_pose",
    "nav_through_poses": "goal_poses",
    "follow_waypoints": "goal_poses",
}
"""Actions that send the robot somewhere, and the argument that says where to."""


@dataclass(frozen=True)
class Script:
    """What is to happen in a scenario's runs.

    Attributes:
        values: Every parameter of the definition.
        start: Where the robot stands at first: the scenario's `start_pose`, else where `init_nav2` puts it; None without a robot.
        goals: Of the navigation actions in the order they are written, repeated by their loops, as far as they are known
            before a run.
        rounds: How often the goals are visited in turn.
        obstacles: What stands there, or appears, whatever the scenario does; entities it spawns itself are not among them.
        topics: What its `bag_record`s name; None where there are none, where one names none and so all, or where only a
            run knows.
    """

    definition: ScenarioDefinition
    values: Mapping[str, Any]
    start: Pose | None
    goals: tuple[Pose, ...]
    rounds: int
    obstacles: tuple[Obstacle, ...]
    topics: tuple[str, ...] | None


def script_of(scenario: Scenario) -> Script:
    """Read what a scenario's runs are to do.

    Raises:
        ValueError: an abstract scenario that can't be read (`OscError`), a value that is none of a parameter
            (`ParameterMismatch`), a pose or an obstacle that is none, a second robot.
    """
    definition = definition_of(scenario.abstract)
    given: Mapping[str, Value] = {**scenario.environment, **scenario.system, **scenario.task}
    if isinstance(scenario.abstract, FileContent) and (keys := goal_keys(definition, given)):
        definition, given = sent_to_each(definition, given, keys)
    overrides = overrides_of(definition, given)
    values = bound(definition, overrides)
    start, goals, rounds = None, [], 1
    bags = []
    calls = tuple(calls_of(definition.root))
    _one_robot(calls)
    for call in calls:
        arguments = functools.partial(_argument, definition, values, call)
        kind = call.action.rpartition(".")[2]
        if kind == "init_nav2" and start is None:
            start = _pose(arguments("initial_pose"))
        elif kind in NAVIGATIONS:
            found = arguments(NAVIGATIONS[kind])
            stops = [_pose(stop) for stop in (found if isinstance(found, list) else [found])]
            again = int(arguments("loop_count") or 0)
            goals += [stop for stop in stops if stop] * (1 + again)
            rounds = max(rounds, 1 + again)
        elif kind == "bag_record":
            bags.append(arguments("topics"))
    if START_KEY in given:
        start = pose_of(given[START_KEY], START_KEY)
    standing = {key: value for key, value in scenario.environment.items() if key not in overrides}
    topics = tuple(str(topic) for bag in bags for topic in bag) if bags and all(bags) else None
    return Script(definition, values, start, tuple(goals), rounds, obstacles_of(standing), topics)


def overrides_of(definition: ScenarioDefinition, given: Mapping[str, Value]) -> dict[str, Any]:
    """The values of a scenario that are for parameters of its definition, poses in full, files by the names programs have for them.

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
    """Whether a parameter without a value stands for nothing: a list of objects to spawn that has no default."""
    return parameter.type.is_list and parameter.type.name == "spawn_entity" and parameter.default is None


def calls_of(behavior: Behavior) -> Iterator[Call]:
    """Every call of an action, in the order they are written."""
    if isinstance(behavior, Call):
        yield behavior
    elif isinstance(behavior, Composition):
        for child in behavior.children:
            yield from calls_of(child)
    elif isinstance(behavior, Modified | Until):
        yield from calls_of(behavior.child)


def navigates(actions: Iterable[str]) -> bool:
    """Whether one of these actions, by their names in a file, sends the robot somewhere."""
    return any(action.rpartition(".")[2] in NAVIGATIONS for action in actions)


def _one_robot(calls: Sequence[Call]) -> None:
    """Raise ValueError where robots of several names act."""
    acting: dict[str, Place] = {}
    for call in calls:
        if call.action.startswith(ROBOT_ACTIONS):
            acting.setdefault(call.actor, call.place)
    if len(acting) > 1:
        first, second, *_ = acting
        raise ValueError(f"{acting[second]}: found a second robot {second!r}; {first!r} alone, for a world has one")


def _in_full(value: Value) -> Value:
    """A pose in the shape of `pose_3d`; what is none is left for `bound` to complain of."""
    if isinstance(value, Mapping) and "position" not in value and "orientation" not in value:
        try:
            return pose_of(value).value()
        except ValueError:
            return value
    return value


def _entity(value: Value) -> Value:
    """An obstacle as `spawn_entity` has it: when it appears is for the scenario to say."""
    if not isinstance(value, Mapping):
        return value
    kept = {key: item for key, item in value.items() if key != "spawn_trigger"}
    return {**kept, "spawn_pose": _in_full(kept["spawn_pose"])} if "spawn_pose" in kept else kept


_SHAPED: Final[Mapping[str, Callable[[Value], Value]]] = {"pose_3d": _in_full, "spawn_entity": _entity}
"""Struct to what brings a configuration's value into its shape."""


def _argument(definition: ScenarioDefinition, values: Mapping[str, Any], call: Call, name: str) -> Any:
    """An argument of a call as far as it is known before a run, else None."""
    if name not in call.arguments:
        return None
    try:
        return evaluate(call.arguments[name], values, {})
    except EvaluationError:
        return None


def _pose(value: Any) -> Pose | None:
    try:
        return pose_of(value)
    except ValueError:
        return None
