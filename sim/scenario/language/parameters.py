"""Values of a scenario's parameters: the file's defaults and a configuration's values."""

import math
import re
from collections import ChainMap
from collections.abc import Callable, Iterable, Mapping, Sequence
from numbers import Integral, Real
from typing import Any, Final

from vastflow.sim.model.faults import Got, ScenarioError, message_of
from vastflow.sim.model.names import nearest
from vastflow.sim.scenario.definition import EnumValue, Field, ScenarioDefinition, Struct, Type
from vastflow.sim.scenario.evaluation import evaluate, text_of

NO_FUNCTIONS: Final[Mapping[str, Callable[..., Any]]] = {}


class ParameterMismatch(ValueError):
    """A parameter has an invalid value, or lacks one.

    Attributes:
        scenario: Name of the scenario.
        parameter: Name of the parameter, with the members below it: `start.position.x`.
        expected: Description of a valid value or name.
        given: Description of what was given.
    """

    def __init__(self, scenario: str, parameter: str, expected: str, given: str) -> None:
        self.scenario, self.parameter, self.expected, self.given = scenario, parameter, expected, given
        super().__init__(scenario, parameter, expected, given)

    def __str__(self) -> str:
        problem = message_of(Got(self.given), self.expected)
        return f"parameter {self.parameter} of scenario {self.scenario}: {problem}"


def bound(
    scenario: ScenarioDefinition,
    overrides: Mapping[str, Any],
    functions: Mapping[str, Callable[..., Any]] = NO_FUNCTIONS,
) -> dict[str, Any]:
    """Return the values of all parameters, in their order.

    A mapping changes the members it names and leaves the default's others; a list replaces the whole list. Text takes
    anything, a float whole numbers too. A number with a unit is given without: in the unit in which the default is
    written where it has one, else in SI units, and so are members of structs.

    Args:
        overrides: By the parameter's name.
        functions: External functions that defaults may call.

    Raises:
        ParameterMismatch: a value does not fit, there is no such parameter, or one has no value.
    """
    known = {parameter.name: parameter for parameter in scenario.parameters}
    for name in overrides:
        if name not in known:
            raise ParameterMismatch(scenario.name, name, _name_of(name, known) or "no parameters", repr(name))
    values = _Values(scenario, overrides, functions)
    return {name: values[name] for name in known}


def _name_of(given: str, known: Iterable[str]) -> str:
    """Return the name that was meant, or all that are known."""
    near = nearest(given, known)
    return repr(near) if near else ", ".join(sorted(known))


def default_of(scenario: ScenarioDefinition, name: str) -> Any:
    """Return the default of a parameter, or None if it has none before a run."""
    try:
        return _Values(scenario, {}, NO_FUNCTIONS)[name]
    except (ParameterMismatch, ScenarioError):
        return None


class _Values(dict[str, Any]):
    """Lazily evaluated values by name, as a default may use earlier declarations."""

    def __init__(
        self, scenario: ScenarioDefinition, overrides: Mapping[str, Any], functions: Mapping[str, Callable[..., Any]]
    ) -> None:
        super().__init__()
        self._scenario = scenario
        self._overrides = overrides
        self._functions = functions
        self._parameters = {parameter.name: parameter for parameter in scenario.parameters}
        self._others = {variable.name: variable.default for variable in scenario.variables if variable.default}
        self._others |= {actor.name: Struct(actor.types[0], actor.members, actor.place) for actor in scenario.actors}

    def __contains__(self, name: object) -> bool:
        return name in self._parameters or name in self._others

    def __missing__(self, name: str) -> Any:
        if name in self._parameters:
            self[name] = self._value(self._parameters[name])
        else:
            self[name] = evaluate(self._others[name], self, self._functions)
        return self[name]

    def _value(self, parameter: Field) -> Any:
        name, type_, unit = parameter.name, parameter.type, parameter.unit
        default = None
        if parameter.default is not None and (name not in self._overrides or type_.kind == "struct"):
            try:
                default = evaluate(parameter.default, self, self._functions)
            except ScenarioError as error:
                raise self._mismatch(name, "a default that has a value", str(error)) from None
        if name in self._overrides:
            return self._fitted(name, type_, self._overrides[name], default, unit)
        if default is None:
            raise self._mismatch(name, _right(type_, unit), "nothing")
        return default

    def _mismatch(self, where: str, expected: str, given: str) -> ParameterMismatch:
        return ParameterMismatch(self._scenario.name, where, expected, given)

    def _fitted(self, where: str, type_: Type, given: Any, default: Any, unit: str) -> Any:
        """Return `given` as a value of `type_`, with missing members of structs from `default`."""
        if type_.is_list:
            item = Type(type_.name, type_.kind)
            if not isinstance(given, Sequence) or isinstance(given, str | bytes):
                raise self._mismatch(where, _right(type_), _shown(given))
            return [self._fitted(f"{where}[{i}]", item, value, None, "") for i, value in enumerate(given)]
        if type_.kind == "struct":
            return self._struct(where, type_, given, default)
        if type_.kind == "enum":
            members = self._scenario.enums[type_.name]
            name = given.member if isinstance(given, EnumValue) else str(given).removeprefix(f"{type_.name}!")
            if name not in members:
                raise self._mismatch(where, _name_of(name, members), _shown(given))
            return EnumValue(type_.name, name, members[name])
        value = _basic(type_.name, given) if type_.kind == "basic" else _number(given)
        if value is None:
            raise self._mismatch(where, _right(type_, unit), _shown(given))
        if type_.kind == "physical" and unit:
            _, factor, offset = self._scenario.units[unit]
            return value * factor + offset
        return value

    def _struct(self, where: str, type_: Type, given: Any, default: Any) -> dict[str, Any]:
        members = self._scenario.structs[type_.name]
        if not isinstance(given, Mapping):
            raise self._mismatch(where, f"{_right(type_)} with {', '.join(members)}", _shown(given))
        for name in given:
            if name not in members:
                raise self._mismatch(where, _name_of(str(name), members), f"member {name!r}")
        whole: dict[str, Any] = {}
        for name, member in members.items():
            below = f"{where}.{name}"
            value = default[name] if isinstance(default, Mapping) and name in default else None
            if value is None and member.default is not None:
                value = evaluate(member.default, ChainMap(whole, self), self._functions)
            if name in given:
                whole[name] = self._fitted(below, member.type, given[name], value, "")
            elif value is None and member.type.kind == "struct" and not member.type.is_list:
                whole[name] = self._struct(below, member.type, {}, None)
            elif value is None:
                raise self._mismatch(below, _right(member.type), "nothing")
            else:
                whole[name] = value
        return whole


def _number(given: Any) -> float | None:
    """Return a number, also from a text, or None for anything else."""
    if isinstance(given, bool) or not isinstance(given, Real | str):
        return None
    try:
        value = float(given)
    except (OverflowError, ValueError):
        return None
    return value if math.isfinite(value) else None


def _basic(name: str, given: Any) -> Any:
    """Return `given` as a value of a basic type, or None."""
    if name == "string":
        return None if given is None else text_of(given)
    if name == "bool":
        return given if isinstance(given, bool) else None
    if name == "float":
        return _number(given)
    if isinstance(given, str) and re.fullmatch(r"[+-]?[0-9]+", given):
        given = int(given)
    if isinstance(given, bool) or not isinstance(given, Integral) or (name == "uint" and given < 0):
        return None
    return int(given)


def _right(type_: Type, unit: str = "") -> str:
    if type_.is_list:
        return f"a {type_}"
    if type_.kind == "physical":
        return f"a {type_.name}, a number in {unit or 'SI units'}"
    if type_.kind == "struct":
        return f"a mapping, {type_.name}"
    return {
        "string": "text",
        "bool": "true or false",
        "float": "a number",
        "int": "a whole number",
        "uint": "a whole number >= 0",
    }.get(type_.name, f"a member of {type_.name}")


def _shown(given: Any) -> str:
    if given is None:
        return "nothing"
    if isinstance(given, bool):
        return str(given).lower()
    text = repr(given)
    return text if len(text) <= 60 else f"{text[:59]}…"
