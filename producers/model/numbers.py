"""The kinds of number a producer's parameters are made of, with their ranges."""

import re
from typing import Annotated, Any, Final, TypeAlias

from pydantic import BeforeValidator, Field, Strict

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

Positives: TypeAlias = Annotated[
    tuple[Positive, ...], BeforeValidator(_listed, json_schema_input_type=Positive | list[Positive])
]
"""A number > 0 or a list of at least one; a tuple once read."""
NotNegatives: TypeAlias = Annotated[
    tuple[NotNegative, ...], BeforeValidator(_listed, json_schema_input_type=NotNegative | list[NotNegative])
]
"""A number >= 0 or a list of at least one; a tuple once read."""
