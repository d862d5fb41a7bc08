"""The kinds of number of campaign files: producers' parameters with their ranges, and quantities of memory."""

import math
import re
from collections.abc import Mapping
from fractions import Fraction
from typing import Annotated, Any, Final, TypeAlias

from pydantic import BeforeValidator, Field, Strict

from vastflow.sim.model.faults import Invalid

DEFAULT_ROBOT_DIAMETER_M: Final = 0.35
"""Outer diameter of the TurtleBot 4 to the nearest 0.05 m; the paper's paths were drawn with it."""


def _no_flag(value: Any) -> Any:
    """Refuse true and false, which pydantic would read as 1.0 and 0.0."""
    if type(value) is bool:
        raise ValueError(f"expected a number, got {str(value).lower()}")
    return value


def _unquoted(value: Any) -> Any:
    """A whole number that is written in quotes as the number it is."""
    return int(value) if isinstance(value, str) and re.fullmatch(r"[+-]?[0-9]{1,19}", value) else value


def _listed(value: Any) -> Any:
    values = value if isinstance(value, list | tuple) else [value]
    if not values:
        raise ValueError("expected at least one value, got an empty list")
    return values


Number: TypeAlias = Annotated[float, BeforeValidator(_no_flag), Field(allow_inf_nan=False)]
"""A finite number; text such as `5e-2`, which YAML 1.1 does not take for a number, is read as one."""
Positive: TypeAlias = Annotated[Number, Field(gt=0)]
NotNegative: TypeAlias = Annotated[Number, Field(ge=0)]
Whole: TypeAlias = Annotated[int, Strict(), BeforeValidator(_unquoted, json_schema_input_type=int)]
"""A whole number, also one in quotes."""
Count: TypeAlias = Annotated[Whole, Field(ge=1)]
Amount: TypeAlias = Annotated[Whole, Field(ge=0)]
MOST_GOALS: Final = 1_000
"""Maximum number of goals of one path."""
Goals: TypeAlias = Annotated[Count, Field(le=MOST_GOALS)]
Seed: TypeAlias = Annotated[Whole, Field(ge=0)]
"""η: any whole number from 0."""

Numbers: TypeAlias = Annotated[
    tuple[Number, ...], BeforeValidator(_listed, json_schema_input_type=Number | list[Number])
]
"""A finite number or a list of at least one; a tuple once read."""
Amounts: TypeAlias = Annotated[
    tuple[Amount, ...], BeforeValidator(_listed, json_schema_input_type=Amount | list[Amount])
]
Flags: TypeAlias = Annotated[tuple[bool, ...], BeforeValidator(_listed, json_schema_input_type=bool | list[bool])]
Positives: TypeAlias = Annotated[
    tuple[Positive, ...], BeforeValidator(_listed, json_schema_input_type=Positive | list[Positive])
]
"""A number > 0 or a list of at least one; a tuple once read."""
NotNegatives: TypeAlias = Annotated[
    tuple[NotNegative, ...], BeforeValidator(_listed, json_schema_input_type=NotNegative | list[NotNegative])
]
"""A number >= 0 or a list of at least one; a tuple once read."""

SUFFIXES: Final[Mapping[str, int]] = {
    "": 1,
    "k": 10**3,
    "M": 10**6,
    "G": 10**9,
    "T": 10**12,
    "P": 10**15,
    "Ki": 2**10,
    "Mi": 2**20,
    "Gi": 2**30,
    "Ti": 2**40,
    "Pi": 2**50,
}
"""Units of Kubernetes' quantities, without those below a byte (`8m` is 0.008 bytes) and exponents."""
QUANTITY: Final = re.compile(r"(\d+(?:\.\d*)?|\.\d+)\s*([A-Za-z]*)", re.ASCII)


def memory_bytes(text: str) -> int:
    """Return the bytes of a quantity such as `8Gi` or `1.5G`, rounded up.

    Raises:
        ValueError: no such quantity.
    """
    match = QUANTITY.fullmatch(text.strip())
    if match and match[2] in SUFFIXES and text == match[1] + match[2]:
        size = math.ceil(Fraction(match[1]) * SUFFIXES[match[2]])
        if size > 0:
            return size
    near = f"{match[2][:1].upper()}i" if match else ""
    meant = f"{match[1]}{near}" if match and near in SUFFIXES else text
    right = "expected more than 0, such as 8Gi" if meant == text else f"did you mean {meant!r}?"
    raise Invalid(f"unknown quantity {text!r}", right)
