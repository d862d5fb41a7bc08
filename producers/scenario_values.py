"""Values of a scenario that are known when the campaign file is read, checked against what the simulator takes."""

from collections.abc import Iterable, Mapping, Sequence
from typing import TypeAlias

from vastflow.producers.faults import shown
from vastflow.producers.stops import GOAL_KEY, GOALS_KEY, START_KEY
from vastflow.sim.digest import Value
from vastflow.sim.nav.parameters import ParameterError, parameters_of, unread
from vastflow.sim.obstacle import obstacle_of
from vastflow.sim.pose import pose_of
from vastflow.sim.scenario import DIMENSION_OF_KEY, Dimension

LOOPS_KEY = "number_of_loops"

Complaint: TypeAlias = tuple[str, str]
"""What was found, and what would be right."""


def complaint_of(key: str, value: Value, dimension: Dimension) -> Complaint | None:
    """What is wrong with a value the simulator would read; None for a good one and for one it does not read."""
    if key in (START_KEY, GOAL_KEY):
        return _pose_complaint(value)
    if key == GOALS_KEY:
        if not isinstance(value, Sequence) or isinstance(value, str) or not value:
            return f"found {shown(value)}", "a list of one pose {x, y, yaw} or more"
        return next(filter(None, map(_pose_complaint, value)), None)
    if key == LOOPS_KEY:
        good = isinstance(value, int) and not isinstance(value, bool) and value >= 0
        return None if good else (f"found {shown(value)}", "a whole number, 0 or more")
    if dimension == "environment" and isinstance(value, Sequence) and not isinstance(value, str):
        return next(filter(None, map(_obstacle_complaint, value)), None)
    return _parameter_complaint(key, value) if dimension == "system" else None


def dimension_of(key: str, value: Value, given: Dimension | None) -> Dimension:
    """The dimension of a fixed parameter: as given, by its key, or the environment's for a list of obstacles."""
    if given or key in DIMENSION_OF_KEY:
        return given or DIMENSION_OF_KEY[key]
    if isinstance(value, Sequence) and any(isinstance(item, Mapping) and "spawn_pose" in item for item in value):
        return "environment"
    return "system"


def unread_keys(keys: Iterable[str]) -> tuple[str, ...]:
    """Those keys of the system dimension that nothing in the simulator reads."""
    return unread(dict.fromkeys(keys))


def combined_complaint(system: Mapping[str, Value]) -> Complaint | None:
    """What is wrong with values that are each right on their own."""
    try:
        parameters_of(system)
    except ParameterError as error:
        return f"found parameters that contradict each other: {error}", "values that agree"
    return None


def _pose_complaint(value: Value) -> Complaint | None:
    try:
        pose_of(value)
    except ValueError:
        return f"found {shown(value)}", "a pose, {x, y, yaw} or {position: {x, y}, orientation: {yaw}}"
    return None


def _obstacle_complaint(value: Value) -> Complaint | None:
    if not isinstance(value, Mapping) or "spawn_pose" not in value:
        return f"found {shown(value)}", "an obstacle, {entity_name, model, spawn_pose, xacro_arguments}"
    try:
        obstacle_of(value)
    except ValueError as error:
        what, _, right = str(error).partition("; ")
        return what, right
    return None


def _parameter_complaint(key: str, value: Value) -> Complaint | None:
    try:
        parameters_of({key: value})
    except ParameterError as error:
        message = str(error)
        # A bound on a pair of parameters is for the pair: the other may be given too.
        if message.partition(" must ")[0] in key:
            return f"found {shown(value)}", message.partition(", got ")[0]
    return None
