"""A scenario file as it is written: its declarations as values, each with its place, nothing resolved."""

from typing import Literal, NamedTuple, TypeAlias

from vastflow.sim.model.faults import Place
from vastflow.sim.scenario.definition import Constant


class Word(NamedTuple):
    """A name where it stands."""

    text: str
    place: Place

    def __str__(self) -> str:
        return self.text


class Physical(NamedTuple):
    """A number with a unit."""

    number: int | float
    unit: Word
    place: Place


class Enumerator(NamedTuple):
    type: Word
    member: Word
    place: Place


class Path(NamedTuple):
    """A name, perhaps with members below: `start.position.x`."""

    words: tuple[Word, ...]
    place: Place

    def __str__(self) -> str:
        return ".".join(map(str, self.words))


class Argument(NamedTuple):
    """An argument of a call; `name` is None where it stands by position."""

    name: Word | None
    value: "Expression"


class Call(NamedTuple):
    """`path(arguments)`: a struct's constructor, an external function, an action or a modifier."""

    path: Path
    arguments: tuple[Argument, ...]
    place: Place


class ListOf(NamedTuple):
    items: "tuple[Expression, ...]"
    place: Place


class Operation(NamedTuple):
    """An operator on one operand or two; the place is the operator's."""

    operator: str
    operands: "tuple[Expression, ...]"
    place: Place


class Refused(NamedTuple):
    """A construct, as it is written, that vastflow does not have, and what to write in its place (`right`)."""

    construct: str
    right: str
    place: Place


Expression: TypeAlias = Constant | Physical | Enumerator | Path | Call | ListOf | Operation | Refused


class Type(NamedTuple):
    """A type by name, or a list of one."""

    name: Word
    is_list: bool


class Keep(NamedTuple):
    """`keep(it.member == value)`."""

    condition: Expression
    place: Place


class Awaited(NamedTuple):
    """The event, the condition, or both that `wait` and `until` wait for."""

    event: Path | None
    condition: Expression | None
    place: Place


class Until(NamedTuple):
    awaited: Awaited
    place: Place


WithItem: TypeAlias = Call | Keep | Until | Refused
With: TypeAlias = tuple[WithItem, ...]
"""Members of a `with:` block."""


class Field(NamedTuple):
    """A parameter, or a `var`, or several of one type; a global where it stands outside of everything."""

    names: tuple[Word, ...]
    type: Type
    default: Expression | None
    keeps: With
    is_variable: bool


class Event(NamedTuple):
    name: Word


class Method(NamedTuple):
    """`def name(parameters) -> type is external …()`."""

    name: Word
    parameters: tuple[Field, ...]
    returns: Type | None


class Act(NamedTuple):
    """A call of an action or a modifier, with its label and its `with:` block."""

    label: Word | None
    call: Call
    modifiers: With


class Wait(NamedTuple):
    label: Word | None
    awaited: Awaited
    modifiers: With
    place: Place


class Emit(NamedTuple):
    label: Word | None
    event: Word
    modifiers: With
    place: Place


class Composition(NamedTuple):
    """`serial:`, `parallel:` or `one_of:` and its members."""

    label: Word | None
    kind: Literal["serial", "parallel", "one_of"]
    members: "tuple[Behavior, ...]"
    modifiers: With
    place: Place


Behavior: TypeAlias = Composition | Act | Wait | Emit | Refused


class Do(NamedTuple):
    behavior: Behavior
    place: Place


Member: TypeAlias = Field | Event | Method | Keep | Act | Do | Refused


class Import(NamedTuple):
    """`import osc.name` or `import "file.osc"`."""

    target: str
    is_file: bool
    place: Place


class PhysicalType(NamedTuple):
    """`type name is SI(…)`: a physical type by the exponents of its base units."""

    name: Word
    exponents: tuple[tuple[Word, int | float], ...]


class Unit(NamedTuple):
    """`unit name of type is SI(…)`, with a factor and an offset."""

    name: Word
    type: Word
    exponents: tuple[tuple[Word, int | float], ...]


class EnumType(NamedTuple):
    """`enum name: [member, …]`."""

    name: Word
    members: tuple[tuple[Word, int | float | None], ...]


class Compound(NamedTuple):
    """A struct, actor, action, modifier, or scenario with its members and bases.

    The name is one word, or an actor's and its action's.
    """

    kind: Literal["struct", "actor", "action", "modifier", "scenario"]
    name: Path
    base: Path | None
    members: tuple[Member, ...]


Declaration: TypeAlias = PhysicalType | Unit | EnumType | Compound | Field | Refused


class File(NamedTuple):
    """A file: its imports and its declarations, in order."""

    imports: tuple[Import, ...]
    declarations: tuple[Declaration, ...]
