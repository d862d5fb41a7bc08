"""Operators and functions of constraints: Python's, without its silent conversions.

True is no number, text never equals a number, and an infinite or undefined result is an error.
"""

import ast
import math
import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import PurePath
from typing import Any, Final, Literal, TypeAlias

from vastflow.sim.model.digest import FileContent

ValueKind: TypeAlias = Literal["number", "text", "truth", "list", "file", "map", "nothing"]

MOST_BITS: Final = 1_000
"""Limit of integers, below the greatest float, so that no power or product grows without end."""
MOST_DIGITS: Final = 30
"""Limit of the digits that `round` takes."""


class NotEvaluable(Exception):
    """An expression is neither true nor false for a configuration."""


@dataclass(frozen=True, slots=True)
class LanguageFunction:
    """A function of the language.

    Attributes:
        arguments: Least and greatest number of arguments.
        takes: Kinds of the arguments.
    """

    call: Callable[..., Any]
    arguments: tuple[int, int]
    takes: tuple[ValueKind, ...]


FUNCTIONS: Final[Mapping[str, LanguageFunction]] = {
    "abs": LanguageFunction(abs, (1, 1), ("number",)),
    "sqrt": LanguageFunction(math.sqrt, (1, 1), ("number",)),
    "round": LanguageFunction(round, (1, 2), ("number",)),
    "min": LanguageFunction(lambda *values: min(values), (1, 99), ("number", "list")),
    "max": LanguageFunction(lambda *values: max(values), (1, 99), ("number", "list")),
    "len": LanguageFunction(len, (1, 1), ("list", "text")),
}
SYMBOLS: Final[Mapping[type[ast.AST], str]] = {
    ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.Mod: "%", ast.Pow: "**", ast.UAdd: "+", ast.USub: "-",
    ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!=", ast.In: "in", ast.NotIn: "not in",
}  # fmt: skip
"""Operators of the language."""
_BINARY: Final[Mapping[str, Callable[[Any, Any], Any]]] = {
    "+": operator.add, "-": operator.sub, "*": operator.mul, "/": operator.truediv, "%": operator.mod, "**": operator.pow,
    "<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge, "==": operator.eq, "!=": operator.ne,
}  # fmt: skip
_SPELLED: Final[Mapping[ValueKind | None, str]] = {
    "number": "a number",
    "text": "text",
    "truth": "true or false",
    "list": "a list",
    "file": "a file",
    "map": "a mapping",
    "nothing": "nothing",
    None: "a value",
}


def kind_of(value: Any) -> ValueKind:
    """Return the kind of a value."""
    if isinstance(value, bool):
        return "truth"
    if isinstance(value, int | float):
        return "number"
    if isinstance(value, str):
        return "text"
    if isinstance(value, FileContent):
        return "file"
    if isinstance(value, Mapping):
        return "map"
    return "list" if isinstance(value, Sequence) else "nothing"


def spelled(kind: ValueKind | None) -> str:
    """Return a kind in words; None is an unknown one."""
    return _SPELLED[kind]


def arithmetic(symbol: str, left: Any, right: Any) -> int | float:
    """Compute `left symbol right` for + - * / % and **."""
    if type(left) not in (int, float) or type(right) not in (int, float):
        raise NotEvaluable(f"{spelled(kind_of(left))} {symbol} {spelled(kind_of(right))}")
    # Before it is computed: the power of two short numbers can fill the memory.
    if symbol == "**" and type(left) is type(right) is int and (abs(left).bit_length() - 1) * right > MOST_BITS:
        raise NotEvaluable("the result of '**' is too large")
    return _number(symbol, _BINARY[symbol], left, right)


def called(name: str, arguments: Sequence[Any]) -> int | float:
    """Call a function; `min` and `max` also take the items of lists."""
    values, takes = list(arguments), FUNCTIONS[name].takes
    if name in ("min", "max"):
        values = [item for each in arguments for item in (each if kind_of(each) == "list" else [each])]
        takes = ("number",)
    for value in values:
        if kind_of(value) not in takes:
            raise NotEvaluable(f"{name} of {spelled(kind_of(value))}")
    if name == "round" and len(values) == 2 and (type(values[1]) is not int or abs(values[1]) > MOST_DIGITS):
        raise NotEvaluable(f"round to {values[1]} digits")
    if not values:
        raise NotEvaluable(f"{name} of an empty list")
    return _number(name, FUNCTIONS[name].call, *values)


def compared(relation: str, left: Any, right: Any) -> bool:
    """Compute `left relation right`; text equals a file whose path ends with it."""
    one, other = kind_of(left), kind_of(right)
    if relation in ("in", "not in"):
        if other != "list":
            raise NotEvaluable(f"{relation!r} {spelled(other)}")
        return (True in [compared("==", left, item) for item in right]) == (relation == "in")
    equality = relation in ("==", "!=")
    if equality and {one, other} == {"file", "text"}:
        return _is_file(left, right) == (relation == "==")
    if one != other or one not in (("number", "text", "truth", "file") if equality else ("number", "text")):
        raise NotEvaluable(f"{spelled(one)} {relation} {spelled(other)}")
    return bool(_BINARY[relation](left, right))


def _is_file(one: Any, other: Any) -> bool:
    """Whether a text is the end of a file's path, such as `maps/rooms.yaml`."""
    file, text = (one, other) if isinstance(one, FileContent) else (other, one)
    parts = PurePath(text).parts
    return bool(parts) and PurePath(file.path).parts[-len(parts) :] == parts


def _number(name: str, compute: Callable[..., Any], *values: Any) -> int | float:
    problem = "the result of {} is too large or not a number"
    try:
        found = compute(*values)
        if isinstance(found, complex):
            problem = "{} gives no real number"
        elif math.isfinite(found) and not (isinstance(found, int) and found.bit_length() > MOST_BITS):
            number: int | float = found
            return number
    except ZeroDivisionError:
        problem = "{} by zero"
    except ValueError:
        problem = f"{{}} of {values[0]}"
    except OverflowError:
        pass
    raise NotEvaluable(problem.format(name if name in FUNCTIONS else repr(name)))
