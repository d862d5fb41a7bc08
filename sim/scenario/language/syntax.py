"""A scenario file as it is written: its declarations as values, each with its place, nothing resolved."""

from dataclasses import dataclass
from typing import Literal, TypeAlias

from vastflow.sim.model.faults import Place
from vastflow.sim.scenario.definition import Constant


@dataclass(frozen=True, slots=True)
class Word:
    """A name where it stands."""

    text: str
    place: Place


@dataclass(frozen=True, slots=True)
class PhysicalText:
    """A number with a unit."""

    number: int | float
    unit: Word
    place: Place


@dataclass(frozen=True, slots=True)
class EnumText:
    """`type!member`."""

    type: Word
    member: Word
    place: Place


@dataclass(frozen=True, slots=True)
class PathText:
    """A name, perhaps with members below: `start.position.x`."""

    words: tuple[Word, ...]
    place: Place

    def __str__(self) -> str:
        return ".".join(word.text for word in self.words)


@dataclass(frozen=True, slots=True)
class ArgumentText:
    """An argument of a call; `name` is None where it stands by position."""

    name: Word | None
    value: "ExpressionText"


@dataclass(frozen=True, slots=True)
class CallText:
    """`path(arguments)`: a struct's constructor, an external function, an action or a modifier."""

    path: PathText
    arguments: tuple[ArgumentText, ...]
    place: Place


@dataclass(frozen=True, slots=True)
class ListText:
    """`[a, b]`."""

    items: "tuple[ExpressionText, ...]"
    place: Place


@dataclass(frozen=True, slots=True)
class OperationText:
    """An operator on one operand or two; the place is the operator's."""

    operator: str
    operands: "tuple[ExpressionText, ...]"
    place: Place


@dataclass(frozen=True, slots=True)
class RefusedText:
    """Something of the language that vastflow does not have.

    Attributes:
        construct: How it is written.
        right: What to write in its place.
    """

    construct: str
    right: str
    place: Place


ExpressionText: TypeAlias = (
    Constant | PhysicalText | EnumText | PathText | CallText | ListText | OperationText | RefusedText
)


@dataclass(frozen=True, slots=True)
class TypeText:
    """A type by name, or a list of one."""

    name: Word
    is_list: bool


@dataclass(frozen=True, slots=True)
class KeepText:
    """`keep(it.member == value)`."""

    condition: ExpressionText
    place: Place


@dataclass(frozen=True, slots=True)
class AwaitedText:
    """The event, the condition, or both that `wait` and `until` wait for."""

    event: PathText | None
    condition: ExpressionText | None
    place: Place


@dataclass(frozen=True, slots=True)
class UntilText:
    """`until` in a `with:` block."""

    awaited: AwaitedText
    place: Place


WithItem: TypeAlias = CallText | KeepText | UntilText | RefusedText
WithText: TypeAlias = tuple[WithItem, ...]
"""What stands in a `with:` block."""


@dataclass(frozen=True, slots=True)
class FieldText:
    """A parameter, or a `var`, or several of one type."""

    names: tuple[Word, ...]
    type: TypeText
    default: ExpressionText | None
    keeps: WithText
    is_variable: bool


@dataclass(frozen=True, slots=True)
class EventText:
    """`event name`."""

    name: Word


@dataclass(frozen=True, slots=True)
class MethodText:
    """`def name(parameters) -> type is external …()`."""

    name: Word
    parameters: tuple[FieldText, ...]
    returns: TypeText | None


@dataclass(frozen=True, slots=True)
class ActText:
    """A call of an action or a modifier, with its label and its `with:` block."""

    label: Word | None
    call: CallText
    modifiers: WithText


@dataclass(frozen=True, slots=True)
class WaitText:
    """`wait …`."""

    label: Word | None
    awaited: AwaitedText
    modifiers: WithText
    place: Place


@dataclass(frozen=True, slots=True)
class EmitText:
    """`emit event`."""

    label: Word | None
    event: Word
    modifiers: WithText
    place: Place


@dataclass(frozen=True, slots=True)
class CompositionText:
    """`serial:`, `parallel:` or `one_of:` and its members."""

    label: Word | None
    kind: Literal["serial", "parallel", "one_of"]
    members: "tuple[BehaviorText, ...]"
    modifiers: WithText
    place: Place


BehaviorText: TypeAlias = CompositionText | ActText | WaitText | EmitText | RefusedText


@dataclass(frozen=True, slots=True)
class DoText:
    """`do` and what is done."""

    behavior: BehaviorText
    place: Place


MemberText: TypeAlias = FieldText | EventText | MethodText | KeepText | ActText | DoText | RefusedText


@dataclass(frozen=True, slots=True)
class ImportText:
    """`import osc.name` or `import "file.osc"`."""

    target: str
    is_file: bool
    place: Place


@dataclass(frozen=True, slots=True)
class PhysicalTypeText:
    """`type name is SI(…)`: a physical type by the exponents of its base units."""

    name: Word
    exponents: tuple[tuple[Word, int | float], ...]


@dataclass(frozen=True, slots=True)
class UnitText:
    """`unit name of type is SI(…)`, with a factor and an offset."""

    name: Word
    type: Word
    exponents: tuple[tuple[Word, int | float], ...]


@dataclass(frozen=True, slots=True)
class EnumTypeText:
    """`enum name: [member, …]`."""

    name: Word
    members: tuple[tuple[Word, int | None], ...]


@dataclass(frozen=True, slots=True)
class CompoundText:
    """A struct, actor, action, modifier or scenario with its members.

    Attributes:
        name: One word, or an actor's and its action's.
        base: What it inherits from.
    """

    kind: Literal["struct", "actor", "action", "modifier", "scenario"]
    name: PathText
    base: PathText | None
    members: tuple[MemberText, ...]


@dataclass(frozen=True, slots=True)
class GlobalText:
    """`global name: type = value`."""

    field: FieldText


DeclarationText: TypeAlias = PhysicalTypeText | UnitText | EnumTypeText | CompoundText | GlobalText | RefusedText


@dataclass(frozen=True, slots=True)
class FileText:
    """A file: what it imports and what it declares, each in its order."""

    imports: tuple[ImportText, ...]
    declarations: tuple[DeclarationText, ...]
