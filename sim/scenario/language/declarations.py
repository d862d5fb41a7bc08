"""Declarations of a scenario file, and the types of operators."""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, fields
from typing import Final, Literal, TypeAlias

from vastflow.sim.model.faults import Place
from vastflow.sim.model.names import did_you_mean
from vastflow.sim.scenario.definition import Expression, Field, Kind, Struct, Type, substituted
from vastflow.sim.scenario.language import syntax

BASIC: Final = ("int", "uint", "float", "bool", "string")

ANY: Final = Type("any", "basic")
"""Type of a library's parameter that takes values of every type."""

VARIABLE: Final = Type("variable", "basic")
"""Type of a library's parameter that is the name of a `var`."""


@dataclass(frozen=True, slots=True)
class Function:
    """An external function.

    Attributes:
        name: With its struct: `random.get_int`.
        of_library: Whether vastflow brings it; a user's own can't be run.
    """

    name: str
    parameters: Mapping[str, Field]
    returns: Type | None
    of_library: bool


@dataclass(frozen=True, slots=True)
class Compound:
    """A struct, actor, action or modifier with all members, the inherited ones first.

    Attributes:
        name: An actor's action has its actor before it: `robot.drive`.
        bases: Names of the declarations that it inherits from, the nearest first.
        origin: The library or file that declares it.
    """

    kind: Literal["struct", "actor", "action", "modifier"]
    name: str
    bases: tuple[str, ...]
    members: Mapping[str, Field]
    functions: Mapping[str, Function]
    origin: str
    place: Place


@dataclass(frozen=True, slots=True)
class Declarations:
    """Declarations by name.

    Attributes:
        physical: Physical type to the exponents of its base units.
        units: Unit to (physical type, factor, offset).
        actions: More than one where libraries declare the same name.
        scenarios: Scenarios as written; they are checked one by one.
        right_type: Suggests what to write in place of an unknown type, of those known.
    """

    physical: dict[str, Mapping[str, int | float]] = field(default_factory=dict)
    units: dict[str, tuple[str, float, float]] = field(default_factory=dict)
    enums: dict[str, Mapping[str, int]] = field(default_factory=dict)
    structs: dict[str, Compound] = field(default_factory=dict)
    actors: dict[str, Compound] = field(default_factory=dict)
    modifiers: dict[str, Compound] = field(default_factory=dict)
    globals: dict[str, Field] = field(default_factory=dict)
    scenarios: dict[str, syntax.Compound] = field(default_factory=dict)
    actions: dict[str, tuple[Compound, ...]] = field(default_factory=dict)
    right_type: Callable[[str, Collection[str]], str] = did_you_mean

    def include(self, other: "Declarations") -> tuple[str, ...]:
        """Add the declarations of an import, and return the names that clash.

        Actions may: one that is declared twice can't be used.
        """
        clashing: list[str] = []
        for kind in (each.name for each in fields(self) if each.name not in ("actions", "right_type")):
            mine, theirs = getattr(self, kind), getattr(other, kind)
            clashing += [name for name, meant in theirs.items() if mine.get(name, meant) is not meant]
            mine.update(theirs)
        for name, actions in other.actions.items():
            known = self.actions.get(name, ())
            self.actions[name] = known + tuple(action for action in actions if all(action is not one for one in known))
        return tuple(clashing)

    @property
    def type_names(self) -> tuple[str, ...]:
        """Every name that can be used as a type."""
        return (*BASIC, *self.physical, *self.enums, *self.structs, *self.actors)

    def type_named(self, name: str, is_list: bool = False) -> Type | None:
        kinds: tuple[tuple[Kind, Collection[str]], ...] = (
            ("basic", BASIC),
            ("physical", self.physical),
            ("struct", self.structs),
            ("enum", self.enums),
            ("actor", self.actors),
        )
        return next((Type(name, kind, is_list) for kind, names in kinds if name in names), None)

    def is_a(self, found: Type, wanted: Type) -> bool:
        if wanted == ANY or found == wanted:
            return True
        if found.is_list != wanted.is_list or found.kind != wanted.kind or found.kind not in ("struct", "actor"):
            return False
        return wanted.name in (self.structs | self.actors)[found.name].bases

    def members_of(self, type_: Type) -> Mapping[str, Field]:
        """Members of a struct or an actor; none of anything else."""
        if type_.is_list or type_.kind not in ("struct", "actor"):
            return {}
        return (self.structs if type_.kind == "struct" else self.actors)[type_.name].members

    def variables_of(self, type_: Type) -> tuple[str, ...]:
        """The names of the `var`s of an actor; none of anything else."""
        members = self.members_of(type_) if type_.kind == "actor" else {}
        return tuple(name for name, member in members.items() if member.is_variable)

    def default_of(self, type_: Type, place: Place) -> Expression | None:
        """Return a struct of its members' defaults; None if one is missing, and for other types."""
        if type_.is_list or type_.kind != "struct":
            return None
        members, missing = self.filled({}, self.structs[type_.name].members, place)
        return None if missing else Struct(type_.name, members, place)

    def filled(
        self, given: Mapping[str, Expression], declared: Mapping[str, Field], place: Place
    ) -> tuple[dict[str, Expression], list[Field]]:
        """Return `given` with all other members' defaults, and the members without a value."""
        values: dict[str, Expression] = {}
        missing: list[Field] = []
        for name, member in declared.items():
            value = given.get(name)
            if value is None and member.default is not None:
                value = substituted(member.default, values)
            if value is None:
                value = self.default_of(member.type, place)
            if value is None:
                missing.append(member)
            else:
                values[name] = value
        return values, missing

    def unit_of(self, physical: str) -> str:
        """The SI unit of a physical type, for messages."""
        return next((name for name, unit in self.units.items() if unit == (physical, 1.0, 0.0)), "")


Physical: TypeAlias = Mapping[str, Mapping[str, int | float]]

INT: Final = Type("int", "basic")
FLOAT: Final = Type("float", "basic")
BOOL: Final = Type("bool", "basic")
STRING: Final = Type("string", "basic")
NUMERIC: Final = frozenset({"int", "uint", "float"})

OPERANDS: Final[Mapping[str, str]] = {
    **dict.fromkeys(("and", "or", "not"), "conditions"),
    **dict.fromkeys(("==", "!="), "values of one type"),
    **dict.fromkeys(("<", "<=", ">", ">="), "numbers, or values of one physical type"),
    "in": "a value, and a list of its type",
    "+": "numbers, values of one physical type, two strings or two lists",
    "-": "numbers, or values of one physical type",
    "%": "numbers, or values of one physical type",
    "*": "numbers, or a value with a unit and a number",
    "/": "numbers, a value with a unit and a number, or values of one physical type",
}


def result_of(operator: str, types: tuple[Type, ...], physical: Physical) -> Type | None:
    """Return the type of an operation, or None if the operator does not take operands of `types`.

    Args:
        physical: Physical types to the exponents of their base units, for products and quotients.
    """
    if operator in ("and", "or", "not"):
        return BOOL if all(type_ in (BOOL, ANY) for type_ in types) else None
    if len(types) == 1:
        (one,) = types
        return one if is_number(one) or (one.kind == "physical" and not one.is_list) else None
    left, right = types
    if operator == "in":
        return BOOL if right.is_list and _comparable(left, Type(right.name, right.kind)) else None
    if operator in ("==", "!="):
        return BOOL if _comparable(left, right) else None
    if left.is_list or right.is_list:
        return left if operator == "+" and left == right else None
    ordering = operator in ("<", "<=", ">", ">=")
    if ANY in types:
        return BOOL if ordering else ANY
    if operator in ("*", "/"):
        return _product(operator, left, right, physical)
    ordered = (is_number(left) and is_number(right)) or (left == right and left.kind == "physical")
    if ordering:
        return BOOL if ordered or left == right == STRING else None
    if operator == "+" and left == right == STRING:
        return STRING
    return _wider(left, right) if ordered else None


def _product(operator: str, left: Type, right: Type, physical: Physical) -> Type | None:
    if is_number(left) and is_number(right):
        return FLOAT if operator == "/" else _wider(left, right)
    if left.kind == "physical" and is_number(right):
        return left
    if operator == "*" and is_number(left) and right.kind == "physical":
        return right
    if left.kind != "physical" or right.kind != "physical":
        return None
    if left == right and operator == "/":
        return FLOAT
    mine, theirs, sign = physical[left.name], physical[right.name], 1 if operator == "*" else -1
    exponents = {unit: mine.get(unit, 0) + sign * theirs.get(unit, 0) for unit in {*mine, *theirs}}
    wanted = {unit: exponent for unit, exponent in exponents.items() if exponent}
    same = [name for name, of in physical.items() if of == wanted]
    return Type(same[0], "physical") if len(same) == 1 else None


def is_number(type_: Type) -> bool:
    """True if values of a type are plain numbers."""
    return type_.name in NUMERIC and not type_.is_list


def _wider(left: Type, right: Type) -> Type:
    return left if left == right else FLOAT if FLOAT in (left, right) else INT


def _comparable(left: Type, right: Type) -> bool:
    return left == right or ANY in (left, right) or (is_number(left) and is_number(right))
