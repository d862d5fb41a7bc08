"""The rules of the scenario grammar as the classes of `syntax`, made while Lark parses."""

import re
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, Final

from lark import Token, Transformer, Tree

from vastflow.sim.model.faults import Place
from vastflow.sim.scenario.definition import Constant
from vastflow.sim.scenario.language import syntax

ESCAPED: Final = re.compile(r"\\([\\'\"])")
"""Anything else behind a backslash is for the program or the pattern that the string is for."""

REFUSED: Final[Mapping[str, str]] = {
    "cover": "an oracle, which sees every run",
    "record": "an oracle, as runs are recorded in any case",
    "remove_default": "'keep(it.member == value)'",
}
"""Actions and modifiers that vastflow does not have, and what to write in their place."""

REFUSED_FUNCTIONS: Final[Mapping[str, str]] = {
    "every": "'repeat()' round a serial that begins with 'wait elapsed(…)'",
    "rise": "a serial of 'wait not (…)' and 'wait …'",
    "fall": "a serial of 'wait …' and 'wait not (…)'",
    "range": "a value, as ranges are for the campaign file to draw from",
    "sample": "a 'var', which holds what was measured last",
}


def _call(path: syntax.Path, arguments: Any, refused: Mapping[str, str] = REFUSED) -> syntax.Call | syntax.Refused:
    if (name := str(path)) in refused:
        return syntax.Refused(repr(name), refused[name], path.place)
    return syntax.Call(path, arguments or (), path.place)


def _act(
    label: syntax.Word | None, path: syntax.Path, arguments: Any, with_: syntax.With = ()
) -> syntax.Act | syntax.Refused:
    call = _call(path, arguments)
    return call if isinstance(call, syntax.Refused) else syntax.Act(label, call, with_)


def _composition(
    label: syntax.Word | None, kind: syntax.Word, arguments: Any, *members: Any
) -> syntax.Composition | syntax.Refused:
    if arguments is not None:
        return syntax.Refused(f"{kind.text!r} with arguments", f"'{kind.text}:' alone", kind.place)
    *parts, with_ = members
    return syntax.Composition(label, kind.text, tuple(parts), with_ or (), kind.place)  # type: ignore[arg-type]


def _emit(
    label: syntax.Word | None, keyword: syntax.Word, event: syntax.Word, arguments: Any, with_: syntax.With = ()
) -> syntax.Emit | syntax.Refused:
    if arguments is not None:
        return syntax.Refused("'emit' with arguments", "the event alone", event.place)
    return syntax.Emit(label, event, with_, keyword.place)


def _unary(operator: syntax.Word, operand: syntax.Expression) -> syntax.Expression:
    if operator.text == "-" and isinstance(operand, syntax.Physical):
        return operand._replace(number=-operand.number, place=operator.place)
    if operator.text == "-" and isinstance(operand, Constant) and type(operand.value) in (int, float):
        return Constant(-operand.value, operator.place)  # type: ignore[operator]
    return syntax.Operation(operator.text, (operand,), operator.place)


def _refused(construct: str, right: str) -> Callable[..., syntax.Refused]:
    """A construct that vastflow does not have, at the place of the first word in it."""

    def made(*children: Any) -> syntax.Refused:
        return syntax.Refused(construct, right, next(c for c in children if isinstance(c, syntax.Word)).place)

    return made


def _file(*parts: Any) -> syntax.File:
    imports = tuple(part for part in parts if isinstance(part, syntax.Import))
    return syntax.File(imports, tuple(part for part in parts if not isinstance(part, syntax.Import)))


def _all(*children: Any) -> tuple[Any, ...]:
    return children


RULES: Final[Mapping[str, Callable[..., Any]]] = {
    "file_": _file,
    "library_import": lambda _, path: syntax.Import(str(path), False, path.place),
    "file_import": lambda _, file: syntax.Import(str(file.value), True, file.place),
    "physical_type": syntax.PhysicalType,
    "unit": syntax.Unit,
    "si": _all,
    "si_item": lambda name, minus, number: (name, -number.value if minus else number.value),
    "enum": lambda name, *members: syntax.EnumType(name, members),
    "enum_member": lambda name, number: (name, number and number.value),
    "extend": _refused("'extend'", "the members where the type is declared, or 'inherits'"),
    "compound": lambda kind, name, base, *members: syntax.Compound(kind.text, name, base, members),
    "field": lambda names, type_, default, with_=(): syntax.Field(names, type_, default, with_, False),
    "variable": lambda names, type_, default, with_=(): syntax.Field(names, type_, default, with_, True),
    "names": _all,
    "type_": lambda is_list, name: syntax.Type(name, is_list is not None),
    "event": lambda _, name: syntax.Event(name),
    "event_is": _refused("'event … is'", "the event alone, and 'emit' where it happens"),
    "method": lambda name, parameters, returns, _: syntax.Method(name, parameters or (), returns),
    "parameters": _all,
    "keep": lambda keyword, condition: syntax.Keep(condition, keyword.place),
    "do": lambda keyword, behavior: syntax.Do(behavior, keyword.place),
    "composition": _composition,
    "composition_arguments": lambda arguments: arguments or (),
    "application": lambda *parts: _act(None, *parts),
    "act": _act,
    "wait": lambda label, keyword, awaited, with_=(): syntax.Wait(label, awaited, with_, keyword.place),
    "emit": _emit,
    "label": lambda name: name,
    "on": _refused("'on'", "a serial of 'wait @event' and what is to be done, beside the others in a parallel"),
    "call": _refused("'call'", "an action, or the function in an argument"),
    "condition": lambda condition: syntax.Awaited(None, condition, condition.place),
    "happened": lambda path, condition: syntax.Awaited(path, condition, path.place),
    "stand_in": lambda line: syntax.Refused(repr(line.text), "nothing in its place", line.place),
    "with_": _all,
    "modification": _call,
    "until": lambda keyword, awaited: syntax.Until(awaited, keyword.place),
    "arguments": _all,
    "argument": lambda *parts: syntax.Argument(parts[0] if len(parts) == 2 else None, parts[-1]),
    "ternary": _refused("'? :'", "one value, or two scenarios"),
    "binary": lambda left, operator, right: syntax.Operation(operator.text, (left, right), operator.place),
    "unary": _unary,
    "number": lambda constant: constant,
    "physical": lambda number, unit: syntax.Physical(number.value, unit, number.place),
    "string": lambda constant: constant,
    "truth": lambda word: Constant(word.text == "true", word.place),
    "enumerator": lambda type_, member: syntax.Enumerator(type_, member, type_.place),
    "path": lambda *words: syntax.Path(words, words[0].place),
    "construction": partial(_call, refused=REFUSED_FUNCTIONS),
    "list_": lambda bracket, *items: syntax.ListOf(tuple(item for item in items if item is not None), bracket.place),
    "range_": _refused("a range", "a value, as ranges are for the campaign file to draw from"),
    "index": _refused("an index", "a parameter for each value that is used alone"),
}
"""Rule of the grammar to what it makes of its children."""


class Builder(Transformer[Token, syntax.File]):
    """Makes the syntax of a file.

    Attributes:
        file: Its name, for places.
    """

    file = ""

    def __default__(self, data: str, children: list[Any], meta: object) -> Any:
        if data not in RULES:  # a part of a rule, whose children become the rule's own
            return Tree(data, children)
        return RULES[data](*(self._leaf(child) if isinstance(child, Token) else child for child in children))

    def _leaf(self, token: Token) -> syntax.Word | Constant:
        place = Place(self.file, token.line or 1, token.column or 1)
        match token.type:
            case "NUMBER" if token.startswith("0x"):
                return Constant(int(token, 16), place)
            case "NUMBER":
                # Python refuses to read thousands of digits; as a float they are infinite, which is refused where values are.
                return Constant(float(token) if "." in token or len(token) > 300 else int(token), place)
            case "STRING":
                marks = 3 if token[:3] in ('"""', "'''") else 1
                return Constant(ESCAPED.sub(r"\1", token[marks:-marks]), place)
            case _:
                return syntax.Word(token.strip("|"), place)
