"""One parameter of the stack: its default, what Nav2's code takes where a file leaves it out, and its range."""

import dataclasses
import math
from collections.abc import Callable
from typing import Any, Final

CODE_DEFAULT: Final = "code_default"
RANGE: Final = "range"


class ParameterError(ValueError):
    """A parameter whose value the stack can't use."""


def parameter(default: Any, low: float = -math.inf, high: float = math.inf, *, code: Any = None) -> Any:
    """A dataclass field under Nav2's leaf name.

    Args:
        default: Value in Nav2 Jazzy's default parameter file, which is used where the user gives no file.
        low, high: Inclusive range of numbers the stack can work with.
        code: Default in Nav2's code, where it differs: a file of the user's that leaves the parameter out means this.
    """
    metadata = {RANGE: (low, high), CODE_DEFAULT: default if code is None else code}
    return dataclasses.field(default=default, metadata=metadata)


def group(make: Callable[[], Any]) -> Any:
    """A dataclass field that holds a group of parameters, by default what `make` gives."""
    return dataclasses.field(default_factory=make)


def check(parameters: Any, where: str = "") -> None:
    """Check the type and range of every parameter of a dataclass and the groups in it.

    Args:
        where: What to put before the names in an error, `amcl.` for example.

    Raises:
        ParameterError: a value of the wrong type or out of range; says which.
    """
    for field in dataclasses.fields(parameters):
        value = getattr(parameters, field.name)
        if dataclasses.is_dataclass(value):
            check(value, f"{where}{field.name}.")
            continue
        if RANGE not in field.metadata:
            continue
        check_value(f"{where}{field.name}", value, field.default, *field.metadata[RANGE])


def check_value(name: str, value: Any, default: Any, low: float, high: float) -> None:
    """Check one value by the type of its default and its range.

    Raises:
        ParameterError: says what `name` must be.
    """
    if isinstance(default, tuple):
        if not isinstance(value, tuple) or len(value) != len(default):
            raise ParameterError(f"{name} must be a list of {len(default)} numbers, got {value!r}")
        for index, (item, item_default) in enumerate(zip(value, default, strict=True)):
            check_value(f"{name}[{index}]", item, item_default, low, high)
        return
    if isinstance(value, bool) != isinstance(default, bool) or not isinstance(value, bool | int | float):
        kind = "true or false" if isinstance(default, bool) else "a number"
        raise ParameterError(f"{name} must be {kind}, got {value!r}")
    if isinstance(default, int) and not isinstance(value, int):
        raise ParameterError(f"{name} must be a whole number, got {value!r}")
    if not low <= value <= high:
        raise ParameterError(f"{name} must lie in [{low:g}, {high:g}], got {value!r}")
