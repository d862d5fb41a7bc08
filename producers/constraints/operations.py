"""What the operators and functions of constraints do with values: as Python, but without its silent conversions.

True is no number, text is never equal to a number, and a result that is infinite or not a number is none.
"""

import math
import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import PurePath
from typing import Any, Final, Literal, TypeAlias

from vastflow.sim.model.digest import FileContent

ValueKind: TypeAlias = Literal["number", "text", "truth", "list", "file", "map", "nothing"]

MOST_BITS: Final = 1_000
"""Of a whole number: below the greatest float, so that no power or product grows without end."""


class NotEvaluable(Exception):
    """An expression is neither true nor false of a configuration; says why."""


MOST_DIGITS: Final = 30
"""That a number is rounded to."""


@dataclass(frozen=True, slots=True)
class LanguageFunction:
    """A function of the language.

    Attributes:
        arguments: The least and the greatest number of them.
        takes: What they may be.
    """

    call: Callable[..., Any]
    arguments: tuple[int, int]
    takes: tuple[ValueKind, ...]


FUNCTIONS: Final[Mapping[str, LanguageFunction]] = {
    "abs": LanguageFunction(abs, (1, 1), ("number",)),
    "sqrt": LanguageFunction(math.sqrt, (1, 1), ("number",)),
    "round": LanguageFunction(round, (1, 2), ("number",)),
    "min": LanguageFunction(min, (1, 99), ("number", "list")),
    "max": LanguageFunction(max, (1, 99), ("number", "list")),
    "len": LanguageFunction(len, (1, 1), ("list", "text")),
}

_ARITHMETIC: Final[Mapping[str, Callable[[Any, Any], Any]]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": operator.truediv,
    "%": operator.mod,
    "**": operator.pow,
}
_RELATIONS: Final[Mapping[str, Callable[[Any, Any], bool]]] = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
    "==": operator.eq,
    "!=": operator.ne,
}
_SPELLED: Final[Mapping[ValueKind, str]] = {
    "number": "a number",
    "text": "text",
    "truth": "true or false",
    "list": "a list",
    "file": "a file",
    "map": "a mapping",
    "nothing": "nothing",
}


def kind_of(value: Any) -> ValueKind:
    """What a value is in the language."""
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


def spelled(kind: object) -> str:
    """A kind, or the kind of a value, in words."""
    if kind is None:
        return "a value"
    return _SPELLED[kind] if isinstance(kind, str) and kind in _SPELLED else _SPELLED[kind_of(kind)]  # type: ignore[index]


def result_kind(symbol: str, left: ValueKind | None, right: ValueKind | None) -> ValueKind | None:
    """What an operator of arithmetic gives; None where it can't be used on these."""
    return "number" if {left, right} <= {None, "number"} else None


def arithmetic(symbol: str, left: Any, right: Any) -> int | float:
    """`left symbol right` for + - * / % and **."""
    if type(left) not in (int, float) or type(right) not in (int, float):
        raise NotEvaluable(f"{spelled(kind_of(left))} {symbol} {spelled(kind_of(right))}")
    # Before it is computed: the power of two short numbers can fill the memory.
    if symbol == "**" and type(left) is type(right) is int and (abs(left).bit_length() - 1) * right > MOST_BITS:
        raise NotEvaluable("the result of '**' is too large")
    try:
        return _finite(_ARITHMETIC[symbol](left, right), symbol)
    except ZeroDivisionError:
        raise NotEvaluable(f"{symbol!r} by zero") from None
    except OverflowError:
        raise NotEvaluable(f"the result of {symbol!r} is too large") from None


def negative(value: Any, minus: bool) -> int | float:
    """`-value`, or `+value`."""
    if type(value) not in (int, float):
        raise NotEvaluable(f"the sign of {spelled(kind_of(value))}")
    number: int | float = -value if minus else value
    return number


def called(name: str, arguments: list[Any]) -> int | float:
    """The function of that name."""
    function = FUNCTIONS[name]
    values = list(arguments[0]) if name in ("min", "max") and kind_of(arguments[0]) == "list" else arguments
    takes = ("number",) if name in ("min", "max") else function.takes
    for value in values:
        if kind_of(value) not in takes:
            raise NotEvaluable(f"{name} of {spelled(kind_of(value))}")
    if name == "round" and len(values) == 2 and (type(values[1]) is not int or abs(values[1]) > MOST_DIGITS):
        raise NotEvaluable(f"round to {values[1]} digits")
    if not values:
        raise NotEvaluable(f"{name} of an empty list")
    try:
        if name in ("min", "max"):
            return _finite(function.call(values), name)
        return _finite(function.call(*values), name)
    except ValueError:
        raise NotEvaluable(f"{name} of {values[0]}") from None
    except OverflowError:
        raise NotEvaluable(f"the result of {name} is too large") from None


def compared(relation: str, left: Any, right: Any) -> bool:
    """`left relation right` for < <= > >= == and !=."""
    one, other = kind_of(left), kind_of(right)
    equality = relation in ("==", "!=")
    if equality and {one, other} == {"file", "text"}:
        return _is_file(left, right) == (relation == "==")
    if one != other or one not in (("number", "text", "truth", "file") if equality else ("number", "text")):
        raise NotEvaluable(f"{spelled(one)} {relation} {spelled(other)}")
    return bool(_RELATIONS[relation](left, right))


def contained(relation: str, left: Any, right: Any) -> bool:
    """`left in right`, or `left not in right`."""
    if kind_of(right) != "list":
        raise NotEvaluable(f"{relation!r} {spelled(kind_of(right))}")
    return (True in [compared("==", left, item) for item in right]) == (relation == "in")


def _is_file(one: Any, other: Any) -> bool:
    """Whether a text is the end of a file's path, as `maps/rooms.yaml` is."""
    file, text = (one, other) if isinstance(one, FileContent) else (other, one)
    parts = PurePath(text).parts
    return bool(parts) and PurePath(file.path).parts[-len(parts) :] == parts


def _finite(value: Any, what: str) -> int | float:
    if isinstance(value, complex):
        raise NotEvaluable(f"{what!r} gives no real number")
    if isinstance(value, int) and value.bit_length() > MOST_BITS:
        raise NotEvaluable(f"the result of {what!r} is too large")
    if not math.isfinite(value):
        raise NotEvaluable(f"the result of {what!r} is too large or not a number")
    number: int | float = value
    return number
