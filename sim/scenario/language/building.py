"""The rules of the scenario grammar as the classes of `syntax`, made while Lark parses."""

import re
from collections.abc import Callable, Mapping
from typing import Any, Final

from lark import Token, Transformer, Tree

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
    ExpressionText,
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

REFUSED: Final[Mapping[str, str]] = {
    "cover": "an oracle, which sees every run",
    "record": "an oracle, which sees every run; runs are recorded in any case",
    "remove_default": "'keep(it.member == value)'",
}
"""Actions and modifiers that vastflow does not have, and what to write in their place."""

REFUSED_FUNCTIONS: Final[Mapping[str, str]] = {
    "every": "'repeat()' round a serial that begins with 'wait elapsed(…)'",
    "rise": "a serial of 'wait not (…)' and 'wait …'",
    "fall": "a serial of 'wait …' and 'wait not (…)'",
    "range": "a value; ranges are for the campaign file to draw from",
    "sample": "a 'var', which holds what was measured last",
}


def _file(*parts: Any) -> FileText:
    imports = tuple(part for part in parts if isinstance(part, ImportText))
    return FileText(imports, tuple(part for part in parts if not isinstance(part, ImportText)))


def _import(_: Word, target: PathText | Constant) -> ImportText:
    if isinstance(target, PathText):
        return ImportText(str(target), False, target.place)
    return ImportText(str(target.value), True, target.place)


def _field(is_variable: bool) -> Callable[..., FieldText]:
    return lambda names, type_, default, with_=(): FieldText(names, type_, default, with_, is_variable)


def _event(keyword: Word, name: Word, condition: AwaitedText | None) -> EventText | RefusedText:
    if condition is not None:
        return RefusedText("event … is", "the event alone, and 'emit' where it happens", keyword.place)
    return EventText(name)


def _composition(label: Word | None, kind: Word, arguments: Any, *members: Any) -> CompositionText | RefusedText:
    if arguments is not None:
        return RefusedText(f"{kind.text} with arguments", f"'{kind.text}:' alone", kind.place)
    *parts, with_ = members
    return CompositionText(label, kind.text, tuple(parts), with_ or (), kind.place)  # type: ignore[arg-type]


def _act(label: Word | None, path: PathText, arguments: Any, with_: WithText = ()) -> ActText | RefusedText:
    call = _call(REFUSED)(path, arguments)
    return call if isinstance(call, RefusedText) else ActText(label, call, with_)


def _call(refused: Mapping[str, str]) -> Callable[[PathText, Any], CallText | RefusedText]:
    def made(path: PathText, arguments: Any) -> CallText | RefusedText:
        name = str(path)
        if name in refused:
            return RefusedText(name, refused[name], path.place)
        return CallText(path, arguments or (), path.place)

    return made


def _emit(
    label: Word | None, keyword: Word, event: Word, arguments: Any, with_: WithText = ()
) -> EmitText | RefusedText:
    if arguments is not None:
        return RefusedText("emit with arguments", "the event alone", event.place)
    return EmitText(label, event, with_, keyword.place)


def _awaited(child: AwaitedText | ExpressionText) -> AwaitedText:
    return child if isinstance(child, AwaitedText) else AwaitedText(None, child, child.place)


def _unary(operator: Word, operand: ExpressionText) -> ExpressionText:
    if operator.text == "-" and isinstance(operand, PhysicalText):
        return PhysicalText(-operand.number, operand.unit, operator.place)
    if operator.text == "-" and isinstance(operand, Constant) and type(operand.value) in (int, float):
        return Constant(-operand.value, operator.place)  # type: ignore[operator]
    return OperationText(operator.text, (operand,), operator.place)


def _refused(construct: str, right: str) -> Callable[..., RefusedText]:
    """A construct that vastflow does not have, at the place of the first word in it."""
    return lambda *children: RefusedText(construct, right, next(c for c in children if isinstance(c, Word)).place)


def _all(*children: Any) -> tuple[Any, ...]:
    return children


RULES: Final[Mapping[str, Callable[..., Any]]] = {
    "file_": _file,
    "import_": _import,
    "physical_type": PhysicalTypeText,
    "unit": UnitText,
    "si": _all,
    "si_item": lambda name, minus, number: (name, -number.value if minus else number.value),
    "enum": lambda name, *members: EnumTypeText(name, members),
    "enum_member": lambda name, number: (name, number and number.value),
    "global_": GlobalText,
    "extend": _refused("extend", "the members where the type is declared, or 'inherits'"),
    "compound": lambda kind, name, base, *members: CompoundText(kind.text, name, base, members),
    "field": _field(False),
    "variable": _field(True),
    "names": _all,
    "type_": lambda is_list, name: TypeText(name, is_list is not None),
    "event": _event,
    "event_is": lambda awaited: awaited,
    "method": lambda name, parameters, returns, _: MethodText(name, parameters or (), returns),
    "parameters": _all,
    "parameter": _field(False),
    "keep": lambda keyword, condition: KeepText(condition, keyword.place),
    "do": lambda keyword, behavior: DoText(behavior, keyword.place),
    "composition": _composition,
    "composition_arguments": lambda arguments: arguments or (),
    "application": lambda *parts: _act(None, *parts),
    "act": _act,
    "wait": lambda label, keyword, awaited, with_=(): WaitText(label, awaited, with_, keyword.place),
    "emit": _emit,
    "label": lambda name: name,
    "on": _refused("on", "a serial of 'wait @event' and what is to be done, beside the others in a parallel"),
    "call": _refused("call", "an action, or the function in an argument"),
    "awaited": _awaited,
    "happened": lambda path, condition: AwaitedText(path, condition, path.place),
    "stand_in": lambda line: RefusedText(repr(line.text), "nothing in its place", line.place),
    "with_": _all,
    "modification": _call(REFUSED),
    "until": lambda keyword, awaited: UntilText(awaited, keyword.place),
    "arguments": _all,
    "argument": lambda *parts: ArgumentText(parts[0] if len(parts) == 2 else None, parts[-1]),
    "ternary": _refused("? :", "one value; two scenarios where it has to be either"),
    "binary": lambda left, operator, right: OperationText(operator.text, (left, right), operator.place),
    "unary": _unary,
    "number": lambda constant: constant,
    "physical": lambda number, unit: PhysicalText(number.value, unit, number.place),
    "string": lambda constant: constant,
    "truth": lambda word: Constant(word.text == "true", word.place),
    "enumerator": lambda type_, member: EnumText(type_, member, type_.place),
    "path": lambda *words: PathText(words, words[0].place),
    "construction": _call(REFUSED_FUNCTIONS),
    "list_": lambda bracket, *items: ListText(tuple(item for item in items if item is not None), bracket.place),
    "range_": _refused("a range", "a value; ranges are for the campaign file to draw from"),
    "index": _refused("an index", "a parameter for each value that is used alone"),
}
"""Rule of the grammar to what it makes of its children."""


class Builder(Transformer[Token, FileText]):
    """Makes the syntax of a file.

    Attributes:
        file: Its name, for places.
    """

    file = ""

    def __default__(self, data: str, children: list[Any], meta: object) -> Any:
        if data not in RULES:  # a part of a rule, whose children become the rule's own
            return Tree(data, children)
        return RULES[data](*(self._leaf(child) if isinstance(child, Token) else child for child in children))

    def _leaf(self, token: Token) -> Word | Constant:
        place = Place(self.file, token.line or 1, token.column or 1)
        match token.type:
            case "NUMBER":
                return Constant(_number(token), place)
            case "STRING":
                marks = 3 if token[:3] in ('"""', "'''") else 1
                return Constant(ESCAPED.sub(r"\1", token[marks:-marks]), place)
            case _:
                return Word(token.strip("|"), place)


def _number(token: Token) -> int | float:
    if token.startswith("0x"):
        return int(token, 16)
    # Python refuses to read thousands of digits; as a float they are infinite, which is refused where values are.
    return float(token) if "." in token or len(token) > 300 else int(token)
