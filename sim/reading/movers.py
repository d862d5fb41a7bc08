"""The movers of a scenario's environment, under the key `movers`."""

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final

from pydantic import ValidationError

from vastflow.sim.model.digest import Value
from vastflow.sim.model.faults import ScenarioError
from vastflow.sim.model.names import did_you_mean
from vastflow.sim.model.parameter import complaints
from vastflow.sim.model.shape import Box, Disc
from vastflow.sim.nav2.parameter_files.reader import shown
from vastflow.sim.plug_ins.neighbors import PlugInError
from vastflow.sim.plug_ins.registry import plug_in_value
from vastflow.sim.world.mover import MOVER_PLUG_INS, Mover, MoverRule, MovingBody, ReactiveMover
from vastflow.sim.world.pedestrian import Pedestrian

MOVERS_KEY: Final = "movers"
WAYPOINTS: Final = "waypoints"
"""The rule of a mover that names none."""
_OWN: Final = ("name", "shape", "rule")
_SIZES: Final = (("radius_m",), ("length_m", "width_m"))
LARGEST_M: Final = 1000.0
_TAKEN: Final = r"wall|cylinder [\d.e+-]+ m|box [\d.e+-]+ x [\d.e+-]+ m"
"""What contacts with walls and columns of obstacles' sizes are called."""


def movers_of(environment: Mapping[str, Value]) -> tuple[MovingBody, ...]:
    """Return the movers of an environment, in order.

    Raises:
        ScenarioError: one can't be read; with its place, the problem, and what was expected.
    """
    return tuple(
        MovingBody(name, shape, _rule(entry, place))
        for place, entry, name, shape in _bodies(environment.get(MOVERS_KEY, ()))
    )


def mover_shapes(environment: Mapping[str, Value]) -> Mapping[str, Disc | Box]:
    """Return the shapes of movers by their names, as `movers_of` does, and load no rule."""
    return {name: shape for _, _, name, shape in _bodies(environment.get(MOVERS_KEY, ()))}


def movers_value(value: Value, base: Path) -> Value:
    """Return movers as a configuration's value: rules of `file.py:Class` below `base` as the file and the class."""
    if not isinstance(value, Sequence) or isinstance(value, str):
        return value
    return [
        {**entry, "rule": plug_in_value(entry["rule"], base)}
        if isinstance(entry, Mapping) and "rule" in entry
        else entry
        for entry in value
    ]


def _bodies(value: Value) -> Iterator[tuple[str, Mapping[str, Value], str, Disc | Box]]:
    """Yield the place, entry, name, and shape of each mover."""
    if not isinstance(value, Sequence) or isinstance(value, str):
        raise ScenarioError(f"{MOVERS_KEY}: expected a list of movers, got {shown(value)}")
    names: set[str] = set()
    for k, entry in enumerate(value):
        place = f"{MOVERS_KEY}[{k}]"
        if not isinstance(entry, Mapping):
            raise ScenarioError(f"{place}: expected a mapping with name, shape, and waypoints, got {shown(entry)}")
        name = entry.get("name")
        if not isinstance(name, str) or not re.fullmatch(r"[\w .-]+", name):
            raise ScenarioError(f"{place}.name: expected letters, digits, blanks, '.', '_', or '-', got {shown(name)}")
        if name in names:
            raise ScenarioError(f"{place}.name: expected a name of its own, got {name!r} again")
        if re.fullmatch(_TAKEN, name):
            raise ScenarioError(f"{place}.name: expected a name that no wall or obstacle has in a report, got {name!r}")
        names.add(name)
        yield place, entry, name, _shape(entry.get("shape"), f"{place}.shape")


def _shape(value: Value, place: str) -> Disc | Box:
    sizes = tuple(value.values()) if isinstance(value, Mapping) and tuple(sorted(value)) in _SIZES else ()
    good = all(isinstance(size, int | float) and not isinstance(size, bool) and 0 < size <= LARGEST_M for size in sizes)
    if not isinstance(value, Mapping) or not sizes or not good:
        right = f"{{radius_m: …}} or {{length_m: …, width_m: …}} above 0 and up to {LARGEST_M:g}"
        raise ScenarioError(f"{place}: expected {right}, got {shown(value)}")
    numbers = {key: float(size) for key, size in value.items() if isinstance(size, int | float)}
    return Disc(**numbers) if "radius_m" in numbers else Box(**numbers)


def _rule(entry: Mapping[str, Value], place: str) -> MoverRule:
    try:
        kind = MOVER_PLUG_INS.of(entry.get("rule", WAYPOINTS))
    except PlugInError as error:
        raise ScenarioError(f"{place}.rule: {error.problem}; {error.expected}") from None
    given = {key: value for key, value in entry.items() if key not in _OWN}
    for key in given:
        if key not in kind.model_fields:
            raise ScenarioError(f"{place}.{key}: unknown key; {did_you_mean(key, [*_OWN, *kind.model_fields])}")
    for key, field in kind.model_fields.items():
        if field.is_required() and key not in given:
            raise ScenarioError(f"{place}.{key}: expected a value, got none")
    try:
        rule = kind(**given)
    except ValidationError as error:
        key, right = next(complaints(kind, error))
        raise ScenarioError(f"{place}.{key}: expected {right}, got {shown(given.get(key))}") from None
    if not isinstance(rule, Mover | ReactiveMover | Pedestrian):
        raise ScenarioError(f"{place}.rule: expected a subclass of Mover or ReactiveMover, got {kind.__name__}")
    return rule
