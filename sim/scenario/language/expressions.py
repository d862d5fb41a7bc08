"""Checking expressions: names resolved, types agreed, units turned into SI."""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Final, NoReturn, ParamSpec, TypeAlias, TypeVar, cast

from vastflow.sim.model.faults import Fault, Got, Place, Problem
from vastflow.sim.model.names import did_you_mean
from vastflow.sim.scenario.definition import (
    Constant,
    EnumValue,
    Expression,
    External,
    Field,
    ListOf,
    Name,
    Operation,
    Struct,
    Type,
    below_of,
)
from vastflow.sim.scenario.evaluation import text_of
from vastflow.sim.scenario.language import syntax
from vastflow.sim.scenario.language.declarations import (
    ANY,
    BOOL,
    FLOAT,
    INT,
    OPERANDS,
    STRING,
    VARIABLE,
    Declarations,
    Function,
    is_number,
    result_of,
)

Typed: TypeAlias = tuple[Expression, Type]
P = ParamSpec("P")
S = TypeVar("S")
T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Visible:
    """The names an expression may use.

    Attributes:
        variables: Names in `types` that are `var`s.
        faulty: Names whose declaration is at fault, so that nothing is said of their use.
    """

    types: Mapping[str, Type]
    variables: frozenset[str] = frozenset()
    faulty: frozenset[str] = frozenset()


NO_NAMES: Final = Visible({})

LITERALS: Final[Mapping[type, Type]] = {bool: BOOL, int: INT, float: FLOAT, str: STRING}
_NO_NUMBERS: Final = (bool, str, EnumValue)


class Faulty(Exception):
    """Raised after a fault was reported, to leave out what depends on it."""


class ExpressionChecker:
    """Checks expressions against declarations, and appends faults to `faults`.

    Methods that return a value raise `Faulty` where it has a fault.

    Attributes:
        of_library: Whether what only libraries may use is known.
        names: Names that an expression may use where it stands.
    """

    def __init__(self, declared: Declarations, faults: list[Fault], *, of_library: bool = False) -> None:
        self.declared: Final = declared
        self.faults: Final = faults
        self.of_library: Final = of_library
        self.names = NO_NAMES

    def fault(self, place: Place, problem: Problem, expected: str) -> None:
        self.faults.append(Fault(place, problem, expected))

    def fail(self, place: Place, problem: Problem, expected: str) -> NoReturn:
        """Report a fault and give up the value that has it."""
        self.fault(place, problem, expected)
        raise Faulty

    def refuse(self, text: syntax.Refused) -> NoReturn:
        """Fail because vastflow does not have a construct."""
        self.fail(text.place, f"{text.construct} is not supported", f"use {text.right}")

    def each(self, check: Callable[[T], S], parts: Iterable[T]) -> list[S]:
        """Check all parts, report their faults, and fail if any has one."""
        checked = [self.attempt(check, part) for part in parts]
        if None in checked:
            raise Faulty
        return cast(list[S], checked)

    def attempt(self, check: Callable[P, S], *arguments: P.args, **named: P.kwargs) -> S | None:
        """Return a checked value, or None if it has a fault."""
        try:
            return check(*arguments, **named)
        except Faulty:
            return None

    def assigned(self, text: syntax.Expression, wanted: Type, whose: str) -> Expression:
        """Return the value converted to the type `wanted`; `whose` names it in faults.

        A name of a number or a truth value can stand for a text, and is its text then.
        """
        if wanted == VARIABLE:
            return self._variable(text, whose)
        if isinstance(text, syntax.ListOf) and wanted.is_list:
            self._refuse_empty(text)
            item = Type(wanted.name, wanted.kind)
            items = self.each(lambda part: self.assigned(part, item, f"an item of {whose}"), text.items)
            return ListOf(tuple(items), text.place)
        return self._fitted(text, self.value(text), wanted, whose)

    def given(self, text: syntax.Expression, wanted: Type, whose: str) -> Expression:
        """Return the value as `assigned` does; plain numbers also stand for SI values and texts."""
        if wanted == VARIABLE or isinstance(text, syntax.ListOf):
            return self.assigned(text, wanted, whose)
        typed = self.value(text)
        takes_numbers = wanted == FLOAT or (wanted.kind == "physical" and not wanted.is_list)
        if takes_numbers and is_number(typed[1]):
            return typed[0]
        if wanted == STRING and isinstance(text, Constant):
            return Constant(text_of(text.value), text.place)
        return self._fitted(text, typed, wanted, whose)

    def value(self, text: syntax.Expression) -> Typed:
        """Return an expression with its type."""
        match text:
            case Constant(value, place):
                return self._finite(value, place), LITERALS[type(value)]
            case syntax.Physical():
                return self._physical(text)
            case syntax.Enumerator():
                return self._enum(text)
            case syntax.Path():
                return self._name(text)
            case syntax.Call():
                return self._call(text)
            case syntax.ListOf():
                return self._list(text)
            case syntax.Operation():
                return self._operation(text)
            case syntax.Refused():
                self.refuse(text)

    def arguments(self, call: syntax.Call, parameters: Mapping[str, Field], whose: str) -> dict[str, Expression]:
        """Return the given arguments of a call by the names of its parameters, in their order.

        Args:
            whose: Names what is called.
        """
        order = list(parameters)
        given: dict[str, Expression | None] = {}
        named = False
        for position, argument in enumerate(call.arguments):
            if argument.name is not None:
                named, name, place = True, argument.name.text, argument.name.place
                if name not in parameters:
                    right = did_you_mean(name, order, "it takes no arguments")
                    self.fault(place, f"{name!r} is not a parameter of {whose}", right)
                    given[name] = None
                    continue
            elif named:
                self.fail(argument.value.place, Got("a value after a named one"), "values by position first")
            elif position >= len(order):
                count = f"{len(order)} at most" if order else "no arguments"
                self.fail(argument.value.place, Got(f"one argument more than {whose} takes"), count)
            else:
                name, place = order[position], argument.value.place
            if name in given:
                self.fault(place, f"duplicate {name!r} of {whose}", "keep one value")
            given[name] = self.attempt(self.given, argument.value, parameters[name].type, f"{name!r} of {whose}")
        if None in given.values():
            raise Faulty
        return {name: cast(Expression, given[name]) for name in order if name in given}

    def complete(
        self, given: Mapping[str, Expression], parameters: Mapping[str, Field], place: Place, whose: str
    ) -> dict[str, Expression]:
        """Return `given` and the defaults of all other parameters, struct members included."""
        values, missing = self.declared.filled(given, parameters, place)
        if missing:
            words = _listed([f"{member.name}: {member.type}" for member in missing])
            self.fail(place, f"the call of {whose} lacks {words}", "parameters without a default need a value")
        return values

    def _fitted(self, text: syntax.Expression, typed: Typed, wanted: Type, whose: str) -> Expression:
        value, found = typed
        if self._fits(value, found, wanted):
            return value
        has_text = not found.is_list and (found.kind == "physical" or found == BOOL or is_number(found))
        if wanted == STRING and isinstance(value, Name) and has_text:
            return Operation("+", (Constant("", text.place), value), text.place)
        self.fail(text.place, Got(f"{_shown(text, found)} for {whose}, {_a(wanted)}"), self._such_as(wanted, text))

    def _refuse_empty(self, text: syntax.ListOf) -> None:
        if not text.items and not self.of_library:
            self.fault(text.place, Got("an empty list, which the language does not have"), "one item or more")

    def _fits(self, value: Expression, found: Type, wanted: Type) -> bool:
        if found.is_list or wanted.is_list or {found.name, wanted.name} != {"int", "uint"}:
            return self.declared.is_a(found, wanted)
        return found.name == "uint" or (isinstance(value, Constant) and cast(int, value.value) >= 0)

    def _variable(self, text: syntax.Expression, whose: str) -> Expression:
        name = str(text) if isinstance(text, syntax.Path) else ""
        if name in self.names.variables:
            return Constant(name, text.place)
        if name in self.names.faulty:
            raise Faulty
        right = did_you_mean(str(text), self.names.variables, "declare 'var' with its name and type in the scenario")
        self.fail(text.place, f"{whose} must name a variable", right)

    def _finite(self, value: float | str | EnumValue, place: Place) -> Constant:
        if isinstance(value, int | float) and not math.isfinite(value):
            self.fail(place, Got("a number that is too large"), "at most 1.7e308")
        return Constant(value, place)

    def _physical(self, text: syntax.Physical) -> Typed:
        unit = self.declared.units.get(text.unit.text)
        if unit is None:
            near = did_you_mean(text.unit.text, self.declared.units, "write 'import osc.types', which has units")
            self.fail(text.unit.place, f"unknown unit '{text.unit}'", near)
        of, factor, offset = unit
        return self._finite(float(text.number) * factor + offset, text.place), Type(of, "physical")

    def _enum(self, text: syntax.Enumerator) -> Typed:
        name, member = text.type.text, text.member.text
        members = self.declared.enums.get(name)
        if members is None:
            self.fail(text.type.place, f"unknown enum {name!r}", did_you_mean(name, self.declared.enums))
        if member not in members:
            self.fail(text.member.place, f"enum {name} has no member {member!r}", did_you_mean(member, members))
        return Constant(EnumValue(name, member, members[member]), text.place), Type(name, "enum")

    def _name(self, text: syntax.Path) -> Typed:
        first, *rest = text.words
        if first.text in self.names.faulty:
            raise Faulty
        type_ = self.names.types.get(first.text)
        value: Expression | None = Name((first.text,), first.place)
        if type_ is None and rest and (type_ := self.declared.type_named(first.text)):
            # The defaults of a struct or an actor are the value of its name.
            members, missing = self.declared.filled({}, self.declared.members_of(type_), first.place)
            value = Struct(type_.name, members, first.place) if members and not missing else None
        if type_ is None or value is None:
            right = did_you_mean(first.text, self.names.types, "write a value, as no name can be used here")
            self.fail(first.place, f"unknown name '{first}'", right)
        for word in rest:
            known = self.declared.members_of(type_)
            if word.text not in known:
                right = did_you_mean(word.text, known, "write the name alone")
                self.fail(word.place, f"{_a(type_)} has no member '{word}'", right)
            type_ = known[word.text].type
        return below_of(value, [word.text for word in rest]), type_

    def _call(self, text: syntax.Call) -> Typed:
        if len(text.path.words) > 1:
            function = self._function(text.path)
            whose = f"{function.name}()"
            given = self.arguments(text, function.parameters, whose)
            values = self.complete(given, function.parameters, text.place, whose)
            return External(function.name, tuple(values.values()), text.place), function.returns or ANY
        name, place = str(text.path), text.path.place
        struct = self.declared.structs.get(name)
        if struct is None:
            if name in self.declared.actions:
                self.fail(place, f"{name!r} is an action, which has no value", "write a value")
            if name == "elapsed":
                self.fail(place, Got("elapsed inside of an expression"), "'wait elapsed(…)' alone")
            self.fail(place, f"unknown struct {name!r}", self.declared.right_type(name, self.declared.structs))
        whose = f"{name}(…)"
        values = self.complete(self.arguments(text, struct.members, whose), struct.members, text.place, whose)
        return Struct(name, values, text.place), Type(name, "struct")

    def _function(self, path: syntax.Path) -> Function:
        struct, name = path.words[0], path.words[-1]
        owner = self.declared.structs.get(struct.text)
        if owner is None or not owner.functions or len(path.words) != 2:
            libraries = [key for key, value in self.declared.structs.items() if value.functions]
            self.fail(path.place, f"unknown function '{path}'", did_you_mean(struct.text, libraries))
        function = owner.functions.get(name.text)
        if function is None:
            right = did_you_mean(name.text, owner.functions)
            self.fail(name.place, f"'{name}' is not a function of {struct}", right)
        if not function.of_library:
            self.fail(path.place, f"{path} is external code of your own", "use a function of a library, or a parameter")
        return function

    def _list(self, text: syntax.ListOf) -> Typed:
        self._refuse_empty(text)
        items = self.each(self.value, text.items)
        types = {type_ for _, type_ in items}
        if len(types) > 1:
            self.fail(text.place, Got(f"a list of {_listed(sorted(map(str, types)))}"), "items of one type")
        item = next(iter(types), ANY)
        return ListOf(tuple(value for value, _ in items), text.place), Type(item.name, item.kind, True)

    def _operation(self, text: syntax.Operation) -> Typed:
        operands = self.each(self.value, text.operands)
        types = tuple(type_ for _, type_ in operands)
        result = result_of(text.operator, types, self.declared.physical)
        if result is None:
            what = f"{text.operator!r} does not go with {_listed([_a(type_) for type_ in types])}"
            self.fail(text.place, what, f"expected {OPERANDS[text.operator]}")
        return Operation(text.operator, tuple(value for value, _ in operands), text.place), result

    def _such_as(self, wanted: Type, text: syntax.Expression) -> str:
        """Return an example of the type in place of `text`."""
        number = text.value if isinstance(text, Constant) and not isinstance(text.value, _NO_NUMBERS) else None
        if wanted.is_list:
            return f"[…], a {wanted}"
        if wanted.kind == "physical":
            shown = number if number is not None else text.number if isinstance(text, syntax.Physical) else 1
            return f"a number with a unit of {wanted.name}, such as {shown}{self.declared.unit_of(wanted.name)}"
        if wanted.kind == "enum":
            return f"one of {', '.join(f'{wanted.name}!{member}' for member in self.declared.enums[wanted.name])}"
        if wanted.kind == "struct":
            return f"{wanted.name}(…)"
        if wanted.kind == "actor":
            return f"an instance of {wanted.name}"
        if wanted.name == "float" and number is not None:
            return f"{float(number)}"
        return {
            "float": "a number with a point, such as 1.0",
            "int": "a whole number",
            "uint": "a whole number that is not negative",
            "bool": "true or false",
            "string": "a text in quotes",
        }[wanted.name]


def _shown(text: syntax.Expression, type_: Type) -> str:
    match text:
        case Constant(value=bool(value)):
            return f"{str(value).lower()}, a bool,"
        case Constant(value=value):
            return f"{value!r:.40}, {_a(type_)},"
        case syntax.Physical():
            return f"{text.number}{text.unit.text}, {_a(type_)},"
        case syntax.Path():
            return f"{text}, {_a(type_)},"
        case _:
            return _a(type_)


def _a(type_: Type) -> str:
    article = "an" if str(type_)[0] in "aeio" else "a"
    return f"{article} {type_}"


def _listed(parts: list[str]) -> str:
    return " and ".join(filter(None, [", ".join(parts[:-1]), parts[-1]]))
