"""Checking expressions: names resolved, types agreed, units turned into SI."""

import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import Final, TypeAlias, cast

from vastflow.sim.model.faults import Fault, Place
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
from vastflow.sim.scenario.language.syntax import (
    ArgumentText,
    CallText,
    EnumText,
    ExpressionText,
    ListText,
    OperationText,
    PathText,
    PhysicalText,
    RefusedText,
    Word,
)

Typed: TypeAlias = tuple[Expression, Type]


@dataclass(frozen=True, slots=True)
class Visible:
    """The names an expression may use.

    Attributes:
        variables: Those of them that are `var`s.
        faulty: Names whose declaration is at fault, so that nothing is said of their use.
    """

    types: Mapping[str, Type]
    variables: frozenset[str] = frozenset()
    faulty: frozenset[str] = frozenset()


NO_NAMES: Final = Visible({})

LITERALS: Final[Mapping[type, Type]] = {bool: BOOL, int: INT, float: FLOAT, str: STRING}
_NO_NUMBERS: Final = (bool, str, EnumValue)


class ExpressionChecker:
    """Checks expressions against declarations; what is wrong goes to `faults`, and the value is None then.

    Attributes:
        of_library: Whether what only libraries may use is known.
    """

    def __init__(
        self,
        declarations: Declarations,
        faults: list[Fault],
        *,
        of_library: bool = False,
    ) -> None:
        self._declared = declarations
        self._faults = faults
        self.of_library: Final = of_library

    def right_type(self, name: str, known: Collection[str]) -> str:
        """Return what to write in place of an unknown type."""
        from vastflow.sim.scenario.language.declaring import right_type  # reads libraries by this checker

        return right_type(name, known)

    def fault(self, place: Place, what: str, right: str) -> None:
        """Take down a fault."""
        self._faults.append(Fault(place, what, right))

    def refuse(self, text: RefusedText) -> None:
        """Take down that a construct is not part of what vastflow executes."""
        self.fault(text.place, f"got {text.construct}, which vastflow does not have", text.right)

    def assigned(self, text: ExpressionText, wanted: Type, names: Visible, whose: str) -> Expression | None:
        """The value for something of type `wanted`; `whose` is the words for it in a fault.

        A name of a number or a truth value can stand for a text, and is its text then.
        """
        if wanted == VARIABLE:
            return self._variable(text, names, whose)
        if isinstance(text, ListText) and wanted.is_list:
            self._refuse_empty(text)
            item = Type(wanted.name, wanted.kind)
            items = [self.assigned(part, item, names, f"an item of {whose}") for part in text.items]
            return None if None in items else ListOf(tuple(cast(list[Expression], items)), text.place)
        typed = self.value(text, names)
        return None if typed is None else self._fitted(text, typed, wanted, whose)

    def given(self, text: ExpressionText, wanted: Type, names: Visible, whose: str) -> Expression | None:
        """Return the value as `assigned` does; plain numbers also stand for SI values and texts."""
        if wanted == VARIABLE or isinstance(text, ListText):
            return self.assigned(text, wanted, names, whose)
        typed = self.value(text, names)
        if typed is None:
            return None
        takes_numbers = wanted == FLOAT or (wanted.kind == "physical" and not wanted.is_list)
        if takes_numbers and is_number(typed[1]):
            return typed[0]
        if wanted == STRING and isinstance(text, Constant):
            return Constant(text_of(text.value), text.place)
        return self._fitted(text, typed, wanted, whose)

    def value(self, text: ExpressionText, names: Visible) -> Typed | None:
        """Return an expression with its type."""
        match text:
            case Constant():
                return self._literal(text)
            case PhysicalText():
                return self._physical(text)
            case EnumText():
                return self._enum(text)
            case PathText():
                return self._name(text, names)
            case CallText():
                return self._call(text, names)
            case ListText():
                return self._list(text, names)
            case OperationText():
                return self._operation(text, names)
            case RefusedText():
                self.refuse(text)
                return None

    def arguments(
        self, texts: Iterable[ArgumentText], parameters: Mapping[str, Field], names: Visible, whose: str
    ) -> dict[str, Expression] | None:
        """The given arguments of a call by the names of its parameters, in their order; `whose` names what is called."""
        order = list(parameters)
        given: dict[str, Expression | None] = {}
        named = False
        for position, argument in enumerate(texts):
            if argument.name is not None:
                named, name, place = True, argument.name.text, argument.name.place
                if name not in parameters:
                    self.fault(place, f"{whose} has no parameter {name!r}", did_you_mean(name, order, "no arguments"))
                    given[name] = None
                    continue
            elif named:
                self.fault(argument.value.place, "got a value after a named one", "values by position first")
                return None
            elif position >= len(order):
                count = f"{len(order)} at most" if order else "no arguments"
                self.fault(argument.value.place, f"got one argument more than {whose} takes", count)
                return None
            else:
                name, place = order[position], argument.value.place
            if name in given:
                self.fault(place, f"{name!r} of {whose} is given twice", "one value")
            given[name] = self.given(argument.value, parameters[name].type, names, f"{name!r} of {whose}")
        if None in given.values():
            return None
        return {name: cast(Expression, given[name]) for name in order if name in given}

    def complete(
        self, given: Mapping[str, Expression], parameters: Mapping[str, Field], place: Place, whose: str
    ) -> dict[str, Expression] | None:
        """`given` and the defaults of all other parameters, those that the members of structs have among them."""
        values, missing = self._declared.filled(given, parameters, place)
        if missing:
            words = _listed([f"{member.name}: {member.type}" for member in missing])
            self.fault(place, f"{whose} is called without {words}", "a value for each parameter without a default")
            return None
        return values

    def _fitted(self, text: ExpressionText, typed: Typed, wanted: Type, whose: str) -> Expression | None:
        value, found = typed
        if self._fits(value, found, wanted):
            return value
        if wanted == STRING and isinstance(value, Name) and _has_text(found):
            return Operation("+", (Constant("", text.place), value), text.place)
        self.fault(text.place, f"got {_shown(text, found)} for {whose}, {_a(wanted)}", self._such_as(wanted, text))
        return None

    def _refuse_empty(self, text: ListText) -> None:
        if not text.items and not self.of_library:
            self.fault(text.place, "got an empty list, which the language does not have", "one item or more")

    def _fits(self, value: Expression, found: Type, wanted: Type) -> bool:
        if self._declared.is_a(found, wanted):
            return True
        if found.is_list or wanted.is_list:
            return False
        if wanted.name == "uint" and found.name == "int":
            return isinstance(value, Constant) and cast(int, value.value) >= 0
        return wanted.name == "int" and found.name == "uint"

    def _variable(self, text: ExpressionText, names: Visible, whose: str) -> Expression | None:
        if isinstance(text, PathText) and str(text) in names.variables:
            return Constant(str(text), text.place)
        if isinstance(text, PathText) and str(text) in names.faulty:
            return None
        what = f"got {text}" if isinstance(text, PathText) else "got a value"
        right = did_you_mean(str(text), names.variables, "'var' with its name and type, declared in the scenario")
        self.fault(text.place, f"{what} for {whose}, the name of a variable", right)
        return None

    def _literal(self, text: Constant) -> Typed | None:
        if isinstance(text.value, int | float) and not math.isfinite(text.value):
            self.fault(text.place, "got a number that is too large", "at most 1.7e308")
            return None
        return text, LITERALS[type(text.value)]

    def _physical(self, text: PhysicalText) -> Typed | None:
        unit = self._declared.units.get(text.unit.text)
        if unit is None:
            near = did_you_mean(text.unit.text, self._declared.units, "'import osc.types', which declares the units")
            self.fault(text.unit.place, f"unknown unit {text.unit.text!r}", near)
            return None
        of, factor, offset = unit
        number = float(text.number) * factor + offset
        if not math.isfinite(number):
            self.fault(text.place, "got a number that is too large", "at most 1.7e308")
            return None
        return Constant(number, text.place), Type(of, "physical")

    def _enum(self, text: EnumText) -> Typed | None:
        members = self._declared.enums.get(text.type.text)
        if members is None:
            self.fault(
                text.type.place, f"unknown enum {text.type.text!r}", did_you_mean(text.type.text, self._declared.enums)
            )
            return None
        if text.member.text not in members:
            what = f"enum {text.type.text} has no member {text.member.text!r}"
            self.fault(text.member.place, what, did_you_mean(text.member.text, members))
            return None
        value = EnumValue(text.type.text, text.member.text, members[text.member.text])
        return Constant(value, text.place), Type(text.type.text, "enum")

    def _name(self, text: PathText, names: Visible) -> Typed | None:
        first, *rest = text.words
        if first.text in names.faulty:
            return None
        type_ = names.types.get(first.text)
        value: Expression | None = Name((first.text,), first.place)
        if type_ is None and rest:
            type_ = self._declared.type_named(first.text)
            value = None if type_ is None else self._defaults(type_, first.place)
        if type_ is None or value is None:
            right = did_you_mean(first.text, names.types, "a value; no name can be used here")
            self.fault(first.place, f"unknown name {first.text!r}", right)
            return None
        for word in rest:
            members = self._declared.members_of(type_)
            if word.text not in members:
                what = f"{_a(type_)} has no member {word.text!r}"
                self.fault(word.place, what, did_you_mean(word.text, members, "the name alone"))
                return None
            type_ = members[word.text].type
        return below_of(value, [word.text for word in rest]), type_

    def _defaults(self, type_: Type, place: Place) -> Expression | None:
        """Return the default members of a struct or an actor as its value."""
        members, missing = self._declared.filled({}, self._declared.members_of(type_), place)
        return Struct(type_.name, members, place) if members and not missing else None

    def _call(self, text: CallText, names: Visible) -> Typed | None:
        if len(text.path.words) == 1:
            return self._construction(text, text.path.words[0], names)
        function = self._function(text.path)
        if function is None:
            return None
        whose = f"{function.name}()"
        given = self.arguments(text.arguments, function.parameters, names, whose)
        values = None if given is None else self.complete(given, function.parameters, text.place, whose)
        if values is None:
            return None
        return External(function.name, tuple(values.values()), text.place), function.returns or ANY

    def _construction(self, text: CallText, name: Word, names: Visible) -> Typed | None:
        struct = self._declared.structs.get(name.text)
        if struct is None:
            if name.text in self._declared.actions:
                self.fault(name.place, f"{name.text!r} is an action, which has no value", "a value here")
            elif name.text == "elapsed":
                self.fault(name.place, "got elapsed inside of an expression", "'wait elapsed(…)' alone")
            else:
                near = self.right_type(name.text, self._declared.structs)
                self.fault(name.place, f"unknown struct {name.text!r}", near)
            return None
        whose = f"{name.text}(…)"
        given = self.arguments(text.arguments, struct.members, names, whose)
        values = None if given is None else self.complete(given, struct.members, text.place, whose)
        return None if values is None else (Struct(name.text, values, text.place), Type(name.text, "struct"))

    def _function(self, path: PathText) -> Function | None:
        struct, name = path.words[0], path.words[-1]
        owner = self._declared.structs.get(struct.text)
        libraries = [key for key, value in self._declared.structs.items() if value.functions]
        if owner is None or not owner.functions or len(path.words) != 2:
            self.fault(path.place, f"unknown function {str(path)!r}", did_you_mean(struct.text, libraries))
            return None
        function = owner.functions.get(name.text)
        if function is None:
            right = did_you_mean(name.text, owner.functions)
            self.fault(name.place, f"{struct.text} has no function {name.text!r}", right)
            return None
        if not function.of_library:
            self.fault(path.place, f"{path} is external code of your own", "a function of a library, or a parameter")
            return None
        return function

    def _list(self, text: ListText, names: Visible) -> Typed | None:
        self._refuse_empty(text)
        typed = [self.value(item, names) for item in text.items]
        if None in typed:
            return None
        items = cast(list[Typed], typed)
        types = {type_ for _, type_ in items}
        if len(types) > 1:
            self.fault(text.place, f"got a list of {_listed(sorted(map(str, types)))}", "items of one type")
            return None
        item = next(iter(types), ANY)
        return ListOf(tuple(value for value, _ in items), text.place), Type(item.name, item.kind, True)

    def _operation(self, text: OperationText, names: Visible) -> Typed | None:
        typed = [self.value(operand, names) for operand in text.operands]
        if None in typed:
            return None
        operands = cast(list[Typed], typed)
        types = tuple(type_ for _, type_ in operands)
        result = result_of(text.operator, types, self._declared.physical)
        if result is None:
            what = f"{text.operator!r} does not go with {_listed([_a(type_) for type_ in types])}"
            self.fault(text.place, what, OPERANDS[text.operator])
            return None
        return Operation(text.operator, tuple(value for value, _ in operands), text.place), result

    def _such_as(self, wanted: Type, text: ExpressionText) -> str:
        """Return an example of the type in place of `text`."""
        number = text.value if isinstance(text, Constant) and not isinstance(text.value, _NO_NUMBERS) else None
        if wanted.is_list:
            return f"[…], a {wanted}"
        if wanted.kind == "physical":
            shown = number if number is not None else text.number if isinstance(text, PhysicalText) else 1
            return f"a number with a unit of {wanted.name}, such as {shown}{self._declared.unit_of(wanted.name)}"
        if wanted.kind == "enum":
            return f"one of {', '.join(f'{wanted.name}!{member}' for member in self._declared.enums[wanted.name])}"
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


def _has_text(type_: Type) -> bool:
    return not type_.is_list and (type_.kind == "physical" or type_ == BOOL or is_number(type_))


def _shown(text: ExpressionText, type_: Type) -> str:
    match text:
        case Constant(value=bool(value)):
            return f"{str(value).lower()}, a bool,"
        case Constant(value=value):
            return f"{value!r:.40}, {_a(type_)},"
        case PhysicalText():
            return f"{text.number}{text.unit.text}, {_a(type_)},"
        case PathText():
            return f"{text}, {_a(type_)},"
        case _:
            return _a(type_)


def _a(type_: Type) -> str:
    article = "an" if str(type_)[0] in "aeio" else "a"
    return f"{article} {type_}"


def _listed(parts: list[str]) -> str:
    return " and ".join(filter(None, [", ".join(parts[:-1]), parts[-1]]))
