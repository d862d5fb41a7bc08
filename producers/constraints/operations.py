"""Operators and functions of constraints: Python's, without its silent conversions.

True is no number, text never equals a number, and an infinite or undefined result is an error.
"""

import ast
import math
import operator
from collections.abc import Callable, Mapping, Sequence
from pathlib import PurePath
from typing import Any, Final, Literal, TypeAlias

from vastflow.sim.model.digest import FileContent

ValueKind: TypeAlias = Literal[
    "a number", "text", "true or false", "a list", "a file", "a mapping", "nothing", "a value"
]
"""Kinds of values, in the words of messages; `a value` is one that is not known yet."""

MOST_BITS: Final = 1_000
"""Limit of integers, below the greatest float, so that no power or product grows without end."""
MOST_DIGITS: Final = 30
"""Limit of the digits that `round` takes."""


class NotEvaluable(Exception):
    """An expression is neither true nor false for a configuration."""


FUNCTIONS: Final[Mapping[str, tuple[Callable[..., Any], int, int, tuple[ValueKind, ...]]]] = {
    "abs": (abs, 1, 1, ("a number",)),
    "sqrt": (math.sqrt, 1, 1, ("a number",)),
    "round": (round, 1, 2, ("a number",)),
    "min": (lambda *values: min(values), 1, 99, ("a number", "a list")),
    "max": (lambda *values: max(values), 1, 99, ("a number", "a list")),
    "len": (len, 1, 1, ("a list", "text")),
}
"""Functions of the language, with the least and greatest number of their arguments, and the kinds that these can have."""
SYMBOLS: Final[Mapping[type[ast.AST], str]] = {
    ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.Mod: "%", ast.Pow: "**", ast.UAdd: "+", ast.USub: "-",
    ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!=", ast.In: "in", ast.NotIn: "not in",
}  # fmt: skip
"""Operators of the language."""
_BINARY: Final[Mapping[str, Callable[[Any, Any], Any]]] = {
    "+": operator.add, "-": operator.sub, "*": operator.mul, "/": operator.truediv, "%": operator.mod, "**": operator.pow,
    "<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge, "==": operator.eq, "!=": operator.ne,
}  # fmt: skip
_KINDS: Final[Mapping[ValueKind, Any]] = {
    "true or false": bool, "a number": (int, float), "text": str, "a file": FileContent, "a mapping": Mapping, "a list": Sequence,
}  # fmt: skip


def kind_of(value: Any) -> ValueKind:
    for kind, types in _KINDS.items():
        if isinstance(value, types):
            return kind
    return "nothing"


def arithmetic(symbol: str, left: Any, right: Any) -> int | float:
    """Compute `left symbol right` for + - * / % and **."""
    if type(left) not in (int, float) or type(right) not in (int, float):
        raise NotEvaluable(f"{kind_of(left)} {symbol} {kind_of(right)}")
    # Before it is computed: the power of two short numbers can fill the memory.
    if symbol == "**" and type(left) is type(right) is int and (abs(left).bit_length() - 1) * right > MOST_BITS:
        raise NotEvaluable("the result of '**' is too large")
    return _number(symbol, _BINARY[symbol], left, right)


def called(name: str, arguments: Sequence[Any]) -> int | float:
    """Call a function; `min` and `max` also take the items of lists."""
    values = list(arguments)
    call, _, _, takes = FUNCTIONS[name]
    if name in ("min", "max"):
        values = [item for each in arguments for item in (each if kind_of(each) == "a list" else [each])]
        takes = ("a number",)
    for value in values:
        if kind_of(value) not in takes:
            raise NotEvaluable(f"{name} of {kind_of(value)}")
    if name == "round" and len(values) == 2 and (type(values[1]) is not int or abs(values[1]) > MOST_DIGITS):
        raise NotEvaluable(f"round to {values[1]} digits")
    if not values:
        raise NotEvaluable(f"{name} of an empty list")
    return _number(name, call, *values)


def compared(relation: str, left: Any, right: Any) -> bool:
    """Compute `left relation right`; text equals a file if its path ends with it."""
    one, other = kind_of(left), kind_of(right)
    if relation in ("in", "not in"):
        if other != "a list":
            raise NotEvaluable(f"{relation!r} {other}")
        return (True in [compared("==", left, item) for item in right]) == (relation == "in")
    equality = relation in ("==", "!=")
    if equality and {one, other} == {"a file", "text"}:
        file, text = (left, right) if one == "a file" else (right, left)
        parts = PurePath(text).parts
        return (bool(parts) and PurePath(file.path).parts[-len(parts) :] == parts) == (relation == "==")
    if one != other or one not in ("a number", "text", *(("true or false", "a file") if equality else ())):
        raise NotEvaluable(f"{one} {relation} {other}")
    return bool(_BINARY[relation](left, right))


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
