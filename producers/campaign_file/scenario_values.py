"""Checks of a scenario's values that are known when the campaign file is read."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import suppress

from vastflow.producers.model.faults import shown
from vastflow.producers.places.stops import GOAL_KEY, GOALS_KEY, START_KEY
from vastflow.sim.model.digest import Value
from vastflow.sim.model.faults import Complaint, FileError, Got
from vastflow.sim.model.obstacle import lists_obstacles, obstacle_of
from vastflow.sim.model.pose import written_pose_of
from vastflow.sim.model.scenario import DIMENSION_OF_KEY, Dimension
from vastflow.sim.reading.movers import MOVERS_KEY, movers_of
from vastflow.sim.system.keys import CONTROLLER_KEY, FILE_KEY
from vastflow.sim.system.system import system_kind, system_of

LOOPS_KEY = "number_of_loops"


def complaint_of(
    key: str, value: Value, dimension: Dimension, system: Mapping[str, Value] | None = None
) -> Complaint | None:
    """Return the fault of a value in the context of `system`, or None."""
    if key in (START_KEY, GOAL_KEY):
        return _pose_complaint(value)
    if key == GOALS_KEY:
        if not isinstance(value, Sequence) or isinstance(value, str) or not value:
            return Got(shown(value)), "a list of one pose {x, y, yaw} or more"
        return next(filter(None, map(_pose_complaint, value)), None)
    if key == LOOPS_KEY:
        good = isinstance(value, int) and not isinstance(value, bool) and value >= 0
        return None if good else (Got(shown(value)), "a whole number, 0 or more")
    if key == MOVERS_KEY:
        return _said_by(lambda: movers_of({key: value}))
    if dimension == "environment" and isinstance(value, Sequence) and not isinstance(value, str):
        return next(filter(None, map(_obstacle_complaint, value)), None)
    return _parameter_complaint(key, value, system or {}) if dimension == "system" else None


def dimension_of(key: str, value: Value, given: Dimension | None) -> Dimension:
    """The dimension of a fixed parameter: as given, by its key, or the environment's for a list of obstacles."""
    if given or key in DIMENSION_OF_KEY:
        return given or DIMENSION_OF_KEY[key]
    return "environment" if lists_obstacles(value) else "system"


def unread_keys(system: Mapping[str, Value], varied: Collection[str]) -> tuple[str, ...]:
    """Return the keys of the system dimension that nothing reads, whatever the values of `varied` keys, sorted."""
    found: list[set[str]] = []
    for each in _variants(system, varied):
        with suppress(FileError):  # another controller than those varied need not suit the rest
            found.append(set(system_of(each).unread(varied)))
    return tuple(sorted(set.intersection(*found))) if found else ()


def intended(key: str, system: Mapping[str, Value], varied: Collection[str], others: Collection[str]) -> str | None:
    """The known key that an unknown one resembles, or None."""
    meant: list[str | None] = []
    with suppress(FileError):
        meant = [system_of(each).intended_key(key, {*others, *DIMENSION_OF_KEY}) for each in _variants(system, varied)]
    return next(filter(None, meant), None)


def replaced_by(key: str, system: Mapping[str, Value], varied: Collection[str]) -> str:
    """The reason why other parameters make one ineffective; empty if it is effective."""
    with suppress(FileError):
        return next(filter(None, (system_of(each).unused_because(key) for each in _variants(system, varied))), "")
    return ""


def combined_complaint(system: Mapping[str, Value]) -> tuple[str, Complaint] | None:
    """Return the first fault of values that are each right on their own, and its key."""
    try:
        system_of(system).check_all()
    except FileError as error:
        first = error.faults[0]
        return first.place.where, (first.problem, first.expected)
    return None


def mask_complaints(system: Mapping[str, Value], written: Collection[str]) -> Iterator[tuple[str, Complaint]]:
    """Masks that filters of the system need, and neither a parameter nor a producer gives."""
    with suppress(FileError):  # said already
        yield from (found for found in system_of(system).missing_masks() if found[0] not in written)


def _pose_complaint(value: Value) -> Complaint | None:
    if not isinstance(value, Mapping):
        return Got(shown(value)), "a pose, {x, y, yaw} or {position: {x, y}, orientation: {yaw}}"
    return _said_by(lambda: written_pose_of(value, ""))


def _obstacle_complaint(value: Value) -> Complaint | None:
    if not isinstance(value, Mapping) or "spawn_pose" not in value:
        return Got(shown(value)), "an obstacle, {entity_name, model, spawn_pose, xacro_arguments}"
    return _said_by(lambda: (obstacle_of(value), written_pose_of(value["spawn_pose"], "obstacle.spawn_pose")))


def _said_by(read: Callable[[], object]) -> Complaint | None:
    try:
        read()
    except ValueError as error:
        return str(error).removeprefix(": "), ""
    return None


def _parameter_complaint(key: str, value: Value, system: Mapping[str, Value]) -> Complaint | None:
    if key == FILE_KEY:
        return Got(shown(value)), f"execution.{FILE_KEY}, the file of all families"
    others = {other: given for other, given in system.items() if other != key}
    undecided = () if CONTROLLER_KEY in (key, *system) else _variants(others, (CONTROLLER_KEY,))
    for each in (others, *undecided):
        try:
            if system_of(each).check(key, value):
                break
        except FileError as error:
            # A bound on a pair of parameters is for the pair: the other may be given too.
            own = [each for each in error.faults if each.place.where == key and each.kind != "contradiction"]
            if not own and key == CONTROLLER_KEY:  # critics of another, for example
                return Got(shown(value)), f"one that goes with the rest ({error.faults[0]})"
            if not own and (wrong := {each.place.where for each in error.faults} & others.keys()):
                return _parameter_complaint(key, value, {other: others[other] for other in others.keys() - wrong})
            if own and isinstance(own[0].problem, str):
                return own[0].problem, own[0].expected
            return (Got(shown(value)), own[0].expected) if own else None
    return None


def _variants(system: Mapping[str, Value], varied: Collection[str]) -> list[Mapping[str, Value]]:
    """The system with each software that it may have, where it is not known which."""
    return system_kind().variants(system, varied)
