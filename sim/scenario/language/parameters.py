"""Values of a scenario's parameters: the file's defaults and a configuration's values."""

import math
import re
from collections import ChainMap
from collections.abc import Callable, Iterator, Mapping, MutableMapping, Sequence
from numbers import Integral, Real
from typing import Any, Final, cast

from vastflow.sim.model.faults import ScenarioError, complaint
from vastflow.sim.model.names import did_you_mean
from vastflow.sim.scenario.definition import EnumValue, Expression, Field, ScenarioDefinition, Struct, Type
from vastflow.sim.scenario.evaluation import evaluate, text_of

NO_FUNCTIONS: Final[Mapping[str, Callable[..., Any]]] = {}


class ParameterMismatch(ValueError):
    """A value that a parameter can't have, or one that it needs.

    Attributes:
        scenario: Name of the scenario.
        parameter: Name of the parameter, with the members below it: `start.position.x`.
        expected: What would be right.
        given: What was given.
    """

    def __init__(self, scenario: str, parameter: str, expected: str, given: str) -> None:
        self.scenario, self.parameter, self.expected, self.given = scenario, parameter, expected, given
        super().__init__(scenario, parameter, expected, given)

    def __str__(self) -> str:
        problem = complaint(f"got {self.given}", self.expected)
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
    for name, given in overrides.items():
        if name not in known:
            raise ParameterMismatch(scenario.name, name, did_you_mean(name, known, "no parameters"), _shown(given))
    values = _Values(scenario, overrides, functions)
    return {name: values[name] for name in known}


def default_of(scenario: ScenarioDefinition, name: str) -> Any:
    """Return the default of a parameter, or None if it has none before a run."""
    values = _Values(scenario, {}, NO_FUNCTIONS)
    try:
        return values[name]
    except (ParameterMismatch, ScenarioError):
        return None


class _Values(Mapping[str, Any]):
    """Names to values, each made when it is first asked for: a default may use what is declared before it."""

    def __init__(
        self, scenario: ScenarioDefinition, overrides: Mapping[str, Any], functions: Mapping[str, Callable[..., Any]]
    ) -> None:
        self._scenario = scenario
        self._overrides = overrides
        self._functions = functions
        self._parameters = {parameter.name: parameter for parameter in scenario.parameters}
        self._others: dict[str, Expression] = {
            variable.name: variable.default for variable in scenario.variables if variable.default is not None
        }
        self._others |= {actor.name: Struct(actor.types[0], actor.members, actor.place) for actor in scenario.actors}
        self._made: dict[str, Any] = {}

    def __iter__(self) -> Iterator[str]:
        return iter({**self._parameters, **self._others})

    def __len__(self) -> int:
        return len(self._parameters) + len(self._others)

    def __getitem__(self, name: str) -> Any:
        if name not in self._made:
            if name in self._parameters:
                self._made[name] = self._value(self._parameters[name])
            else:
                self._made[name] = evaluate(self._others[name], self, self._functions)
        return self._made[name]

    def _value(self, parameter: Field) -> Any:
        default = None
        if parameter.name not in self._overrides or parameter.type.kind == "struct":
            default = self._default(parameter)
        if parameter.name not in self._overrides:
            if default is None:
                raise self._mismatch(parameter.name, _right(parameter.type, parameter.unit), "nothing")
            return default
        given = self._overrides[parameter.name]
        return self._fitted(parameter.name, parameter.type, given, default, parameter.unit)

    def _default(self, parameter: Field) -> Any:
        if parameter.default is None:
            return None
        try:
            return evaluate(parameter.default, self, self._functions)
        except ScenarioError as error:
            raise self._mismatch(parameter.name, "a default that has a value", str(error)) from None

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
            return self._enum(where, type_, given)
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
                raise self._mismatch(where, did_you_mean(str(name), members), f"member {name!r}")
        whole: dict[str, Any] = {}
        for name, member in members.items():
            below = f"{where}.{name}"
            value = default[name] if isinstance(default, Mapping) and name in default else None
            if value is None and member.default is not None:
                value = evaluate(member.default, ChainMap(whole, cast(MutableMapping[str, Any], self)), self._functions)
            if name in given:
                whole[name] = self._fitted(below, member.type, given[name], value, "")
            elif value is None and member.type.kind == "struct" and not member.type.is_list:
                whole[name] = self._struct(below, member.type, {}, None)
            elif value is None:
                raise self._mismatch(below, _right(member.type), "nothing")
            else:
                whole[name] = value
        return whole

    def _enum(self, where: str, type_: Type, given: Any) -> EnumValue:
        members = self._scenario.enums[type_.name]
        name = given.member if isinstance(given, EnumValue) else str(given).removeprefix(f"{type_.name}!")
        if name not in members:
            raise self._mismatch(where, did_you_mean(name, members), _shown(given))
        return EnumValue(type_.name, name, members[name])


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
    """Describe a value of a type as configurations write it."""
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
