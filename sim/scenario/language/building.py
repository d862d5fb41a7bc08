"""Lark's tree of a scenario file to our syntax."""

import re
from collections.abc import Mapping
from typing import Any, Final

from lark import Token, Transformer

from vastflow.sim.model.faults import Place
from vastflow.sim.scenario.definition import Constant
from vastflow.sim.scenario.language.syntax import (
    ActText,
    ArgumentText,
    AwaitedText,
    CallText,
    CompositionText,
    CompoundText,
    DoText,
    EmitText,
    EnumText,
    EnumTypeText,
    EventText,
    FieldText,
    FileText,
    GlobalText,
    ImportText,
    KeepText,
    ListText,
    MethodText,
    OperationText,
    PathText,
    PhysicalText,
    PhysicalTypeText,
    RefusedText,
    TypeText,
    UnitText,
    UntilText,
    WaitText,
    WithText,
    Word,
)

ESCAPED: Final = re.compile(r"\\([\\'\"])")
"""Anything else behind a backslash is for the program or the pattern that the string is for."""


class Builder(Transformer[Token, FileText]):
    """Builds the syntax of one file; a method for each rule of the grammar."""

    def __init__(self, file: str) -> None:
        super().__init__()
        self._file = file

    def _place(self, token: Token) -> Place:
        return Place(self._file, token.line or 1, token.column or 1)

    def _word(self, token: Token) -> Word:
        return Word(token.strip("|"), self._place(token))

    def file_(self, children: list[Any]) -> FileText:
        imports = tuple(child for child in children if isinstance(child, ImportText))
        return FileText(imports, tuple(child for child in children if not isinstance(child, ImportText)))

    def import_(self, children: list[Any]) -> ImportText:
        _, target = children
        if isinstance(target, PathText):
            return ImportText(str(target), False, target.place)
        return ImportText(_text(target), True, self._place(target))

    def physical_type(self, children: list[Any]) -> PhysicalTypeText:
        return PhysicalTypeText(self._word(children[0]), children[1])

    def unit(self, children: list[Any]) -> UnitText:
        return UnitText(self._word(children[0]), self._word(children[1]), children[2])

    def si(self, children: list[Any]) -> tuple[Any, ...]:
        return tuple(children)

    def si_item(self, children: list[Any]) -> tuple[Word, int | float]:
        name, minus, number = children
        return self._word(name), -_number(number) if minus else _number(number)

    def enum(self, children: list[Any]) -> EnumTypeText:
        return EnumTypeText(self._word(children[0]), tuple(children[1:]))

    def enum_member(self, children: list[Any]) -> tuple[Word, int | float | None]:
        name, number = children
        return self._word(name), None if number is None else _number(number)

    def global_(self, children: list[Any]) -> GlobalText:
        return GlobalText(children[0])

    def extend(self, children: list[Any]) -> RefusedText:
        return RefusedText("extend", "the members where the type is declared, or 'inherits'", self._place(children[0]))

    def compound(self, children: list[Any]) -> CompoundText:
        kind, name, base, *members = children
        return CompoundText(str(kind), name, base, tuple(members))  # type: ignore[arg-type]

    def field(self, children: list[Any]) -> FieldText:
        names, type_, default, *with_ = children
        return FieldText(names, type_, default, _block(with_), False)

    def variable(self, children: list[Any]) -> FieldText:
        names, type_, default, *with_ = children
        return FieldText(names, type_, default, _block(with_), True)

    def names(self, children: list[Any]) -> tuple[Word, ...]:
        return tuple(map(self._word, children))

    def type_(self, children: list[Any]) -> TypeText:
        return TypeText(self._word(children[1]), children[0] is not None)

    def event(self, children: list[Any]) -> EventText | RefusedText:
        keyword, name, condition = children
        if condition is not None:
            return RefusedText("event … is", "the event alone, and 'emit' where it happens", self._place(keyword))
        return EventText(self._word(name))

    def event_is(self, children: list[Any]) -> AwaitedText:
        (awaited,) = children
        return awaited  # type: ignore[no-any-return]

    def method(self, children: list[Any]) -> MethodText:
        name, parameters, returns, _ = children
        return MethodText(self._word(name), parameters or (), returns)

    def parameters(self, children: list[Any]) -> tuple[FieldText, ...]:
        return tuple(children)

    parameter = field

    def keep(self, children: list[Any]) -> KeepText:
        return KeepText(children[1], self._place(children[0]))

    def application(self, children: list[Any]) -> ActText | RefusedText:
        return self.act([None, *children])

    def do(self, children: list[Any]) -> DoText:
        return DoText(children[1], self._place(children[0]))

    def composition(self, children: list[Any]) -> CompositionText | RefusedText:
        label, kind, arguments, *members = children
        place = self._place(kind)
        if arguments is not None:
            return RefusedText(f"{kind} with arguments", f"'{kind}:' alone", place)
        with_ = members.pop()
        return CompositionText(label, str(kind), tuple(members), with_ or (), place)  # type: ignore[arg-type]

    def composition_arguments(self, children: list[Any]) -> tuple[ArgumentText, ...]:
        return children[0] or ()

    def act(self, children: list[Any]) -> ActText | RefusedText:
        label, path, arguments, *with_ = children
        if str(path) in REFUSED_CALLS:
            return RefusedText(str(path), REFUSED_CALLS[str(path)], path.place)
        return ActText(label, CallText(path, arguments or (), path.place), _block(with_))

    def wait(self, children: list[Any]) -> WaitText:
        label, keyword, awaited, *with_ = children
        return WaitText(label, awaited, _block(with_), self._place(keyword))

    def emit(self, children: list[Any]) -> EmitText | RefusedText:
        label, keyword, event, arguments, *with_ = children
        if arguments is not None:
            return RefusedText("emit with arguments", "the event alone", self._place(event))
        return EmitText(label, self._word(event), _block(with_), self._place(keyword))

    def label(self, children: list[Any]) -> Word:
        return self._word(children[0])

    def on(self, children: list[Any]) -> RefusedText:
        right = "a serial of 'wait @event' and what is to be done, beside the others in a parallel"
        return RefusedText("on", right, self._place(children[0]))

    def call(self, children: list[Any]) -> RefusedText:
        return RefusedText("call", "an action, or the function in an argument", self._place(children[0]))

    def awaited(self, children: list[Any]) -> AwaitedText:
        (child,) = children
        return child if isinstance(child, AwaitedText) else AwaitedText(None, child, child.place)

    def happened(self, children: list[Any]) -> AwaitedText:
        path, condition = children
        return AwaitedText(path, condition, path.place)

    def stand_in(self, children: list[Any]) -> RefusedText:
        return RefusedText(repr(str(children[0])), "nothing in its place", self._place(children[0]))

    def with_(self, children: list[Any]) -> WithText:
        return tuple(children)

    def modification(self, children: list[Any]) -> CallText | RefusedText:
        path, arguments = children
        if str(path) in REFUSED_CALLS:
            return RefusedText(str(path), REFUSED_CALLS[str(path)], path.place)
        return CallText(path, arguments or (), path.place)

    def until(self, children: list[Any]) -> UntilText:
        return UntilText(children[1], self._place(children[0]))

    def arguments(self, children: list[Any]) -> tuple[ArgumentText, ...]:
        return tuple(children)

    def argument(self, children: list[Any]) -> ArgumentText:
        if len(children) == 2:
            return ArgumentText(self._word(children[0]), children[1])
        return ArgumentText(None, children[0])

    def ternary(self, children: list[Any]) -> RefusedText:
        return RefusedText("? :", "one value; two scenarios where it has to be either", self._place(children[1]))

    def binary(self, children: list[Any]) -> OperationText:
        left, operator, right = children
        return OperationText(str(operator), (left, right), self._place(operator))

    def unary(self, children: list[Any]) -> Any:
        operator, operand = children
        place = self._place(operator)
        if operator == "-" and isinstance(operand, PhysicalText):
            return PhysicalText(-operand.number, operand.unit, place)
        if operator == "-" and isinstance(operand, Constant) and type(operand.value) in (int, float):
            return Constant(-operand.value, place)  # type: ignore[operator]
        return OperationText(str(operator), (operand,), place)

    def number(self, children: list[Any]) -> Constant:
        return Constant(_number(children[0]), self._place(children[0]))

    def physical(self, children: list[Any]) -> PhysicalText:
        number, unit = children
        return PhysicalText(_number(number), self._word(unit), self._place(number))

    def string(self, children: list[Any]) -> Constant:
        return Constant(_text(children[0]), self._place(children[0]))

    def truth(self, children: list[Any]) -> Constant:
        return Constant(children[0] == "true", self._place(children[0]))

    def enumerator(self, children: list[Any]) -> EnumText:
        return EnumText(self._word(children[0]), self._word(children[1]), self._place(children[0]))

    def path(self, children: list[Any]) -> PathText:
        return PathText(tuple(map(self._word, children)), self._place(children[0]))

    def construction(self, children: list[Any]) -> CallText | RefusedText:
        path, arguments = children
        if str(path) in REFUSED_FUNCTIONS:
            return RefusedText(str(path), REFUSED_FUNCTIONS[str(path)], path.place)
        return CallText(path, arguments or (), path.place)

    def list_(self, children: list[Any]) -> ListText:
        return ListText(tuple(child for child in children[1:] if child is not None), self._place(children[0]))

    def range_(self, children: list[Any]) -> RefusedText:
        return RefusedText(
            "a range", "a value; ranges are for the campaign file to draw from", self._place(children[0])
        )

    def index(self, children: list[Any]) -> RefusedText:
        return RefusedText("an index", "a parameter for each value that is used alone", self._place(children[1]))


REFUSED_CALLS: Final[Mapping[str, str]] = {
    "cover": "an oracle, which sees every run",
    "record": "an oracle, which sees every run; runs are recorded in any case",
    "remove_default": "'keep(it.member == value)'",
}

REFUSED_FUNCTIONS: Final[Mapping[str, str]] = {
    "every": "'repeat()' round a serial that begins with 'wait elapsed(…)'",
    "rise": "a serial of 'wait not (…)' and 'wait …'",
    "fall": "a serial of 'wait …' and 'wait not (…)'",
    "range": "a value; ranges are for the campaign file to draw from",
    "sample": "a 'var', which holds what was measured last",
}


def _number(token: Token) -> int | float:
    if token.startswith("0x"):
        return int(token, 16)
    # Python refuses to read thousands of digits; as a float they are infinite, which is refused where values are.
    return float(token) if "." in token or len(token) > 300 else int(token)


def _text(token: Token) -> str:
    marks = 3 if token[:3] in ('"""', "'''") else 1
    return ESCAPED.sub(r"\1", str(token)[marks:-marks])


def _block(with_: list[WithText]) -> WithText:
    """The `with:` block, where there is one."""
    return with_[0] if with_ else ()
