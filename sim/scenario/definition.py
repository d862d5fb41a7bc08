"""Definitions of scenarios: the checked content of a file, with names, types, and modifiers resolved.

A definition is a value. It is made once for a file, and any number of runs build their trees from it.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, TypeAlias

from vastflow.sim.model.faults import Place

Kind: TypeAlias = Literal["basic", "physical", "struct", "enum", "actor"]


@dataclass(frozen=True, slots=True)
class Type:
    """A basic type, a physical type, a struct, an enum, an actor, or a list of one of them.

    Attributes:
        kind: Kind of the type that has this name.
    """

    name: str
    kind: Kind
    is_list: bool = False

    def __str__(self) -> str:
        return f"list of {self.name}" if self.is_list else self.name


@dataclass(frozen=True, slots=True)
class EnumValue:
    type: str
    member: str
    number: int

    def __str__(self) -> str:
        return f"{self.type}!{self.member}"


@dataclass(frozen=True, slots=True)
class Constant:
    """A known value: int, float (SI units if physical), bool, str, or `EnumValue`."""

    value: int | float | bool | str | EnumValue
    place: Place


@dataclass(frozen=True, slots=True)
class Name:
    """A parameter, variable, global or actor instance by name, and below it members of structs (`start.position.x`)."""

    path: tuple[str, ...]
    place: Place


@dataclass(frozen=True, slots=True)
class ListOf:
    items: "tuple[Expression, ...]"
    place: Place


@dataclass(frozen=True, slots=True)
class Struct:
    """A struct with every member, given or by default."""

    type: str
    members: "Mapping[str, Expression]"
    place: Place


@dataclass(frozen=True, slots=True)
class Operation:
    """An operator and one operand or two."""

    operator: str
    operands: "tuple[Expression, ...]"
    place: Place


@dataclass(frozen=True, slots=True)
class External:
    """A call of an external function, such as `random.get_int`, by library struct and function name."""

    function: str
    arguments: "tuple[Expression, ...]"
    place: Place


Expression: TypeAlias = Constant | Name | ListOf | Struct | Operation | External


def substituted(expression: Expression, values: Mapping[str, Expression]) -> Expression:
    """Return `expression` with values in place of names; other names stay."""
    match expression:
        case Name(path=(first, *below)) if first in values:
            return below_of(values[first], below)
        case ListOf(items=items):
            return replace(expression, items=tuple(substituted(item, values) for item in items))
        case Operation(operands=operands):
            return replace(expression, operands=tuple(substituted(operand, values) for operand in operands))
        case External(arguments=arguments):
            return replace(expression, arguments=tuple(substituted(argument, values) for argument in arguments))
        case Struct(members=members):
            return replace(expression, members={name: substituted(part, values) for name, part in members.items()})
        case _:
            return expression


def below_of(expression: Expression, path: Sequence[str]) -> Expression:
    """Return the member at a path below a struct."""
    for word in path:
        if isinstance(expression, Struct):
            expression = expression.members[word]
        elif isinstance(expression, Name):
            expression = replace(expression, path=(*expression.path, word))
    return expression


@dataclass(frozen=True, slots=True)
class Elapsed:
    """`elapsed(d)`: holds once so much simulated time went by since it was first looked at."""

    duration: Expression
    place: Place


@dataclass(frozen=True, slots=True)
class Happened:
    """`@event`, perhaps `if condition`: events are flags that stay set for the rest of the run."""

    event: str
    condition: Expression | None
    place: Place


@dataclass(frozen=True, slots=True)
class Holds:
    """A condition over parameters and variables, evaluated at each tick."""

    condition: Expression
    place: Place


Awaited: TypeAlias = Elapsed | Happened | Holds


@dataclass(frozen=True, slots=True)
class Composition:
    kind: Literal["serial", "parallel", "one_of"]
    children: "tuple[Behavior, ...]"
    label: str
    place: Place


@dataclass(frozen=True, slots=True)
class Call:
    """A call of an action.

    Attributes:
        action: Qualified by the actor that declares it, where one does: `differential_drive_robot.nav_to_pose`, `log`.
        actor: The instance that acts, by name; empty for an action of no actor.
        arguments: Every declared parameter that was given or has a default. One that names a variable, such as the target
            of `increment`, is the variable's name as a `Constant`.
        label: Label as written before the call, or empty.
    """

    action: str
    actor: str
    arguments: Mapping[str, Expression]
    label: str
    place: Place


@dataclass(frozen=True, slots=True)
class Wait:
    until: Awaited
    label: str
    place: Place


@dataclass(frozen=True, slots=True)
class Emit:
    """`emit`: sets an event's flag; `end` and `fail` end the scenario after the tick."""

    event: str
    label: str
    place: Place


@dataclass(frozen=True, slots=True)
class Modified:
    """A modifier round a behavior, such as `timeout` or `repeat`, with all its parameters."""

    modifier: str
    arguments: Mapping[str, Expression]
    child: "Behavior"
    place: Place


@dataclass(frozen=True, slots=True)
class Until:
    """`until`: ends the behavior below with success when something holds."""

    until: Awaited
    child: "Behavior"
    place: Place


Behavior: TypeAlias = Composition | Call | Wait | Emit | Modified | Until


def behaviors_of(root: Behavior) -> Iterator[Behavior]:
    """Yield a behavior and all below it, in the order of the file."""
    waiting = [root]
    while waiting:
        behavior = waiting.pop()
        yield behavior
        match behavior:
            case Composition():
                waiting += reversed(behavior.children)
            case Modified() | Until():
                waiting.append(behavior.child)


@dataclass(frozen=True, slots=True)
class Field:
    """A parameter or a `var` of any declaration, or a global.

    Attributes:
        default: None where a value has to be given; a `var` begins with it.
        unit: Unit of a physical default as it is written (`36.0kmph`: `kmph`), else empty.
        is_variable: Whether it is a `var`, a value that may change during a run.
    """

    name: str
    type: Type
    default: Expression | None
    place: Place
    unit: str = ""
    is_variable: bool = False


@dataclass(frozen=True, slots=True)
class Actor:
    """An instance of an actor, with every member its type and the `keep` of the instance give.

    Attributes:
        types: Its type and those that one inherits from, the nearest first.
        members: A `var` of the actor is among them where it has an initial value.
        variables: Its `var`s by name.
    """

    name: str
    types: tuple[str, ...]
    members: Mapping[str, Expression]
    variables: tuple[str, ...]
    place: Place


@dataclass(frozen=True)
class ScenarioDefinition:
    """A scenario, checked.

    Attributes:
        parameters: In the order in which they are declared, as all fields.
        variables: Globals are among them.
        events: Declared names.
        root: The `do` behavior with the modifiers of the scenario's body wrapped round it.
        structs: Struct name to its members by name, for values that come from outside.
        units: Unit name to (physical type, factor, offset): value × factor + offset is SI.
        enums: Enum name to member name to number.
        bases: Scenarios that it inherits from, by name.
    """

    name: str
    parameters: tuple[Field, ...]
    variables: tuple[Field, ...]
    actors: tuple[Actor, ...]
    events: tuple[str, ...]
    root: Behavior
    place: Place
    structs: Mapping[str, Mapping[str, Field]] = field(repr=False)
    units: Mapping[str, tuple[str, float, float]] = field(repr=False)
    enums: Mapping[str, Mapping[str, int]] = field(repr=False)
    bases: tuple[str, ...] = ()
