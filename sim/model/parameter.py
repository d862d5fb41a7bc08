"""Groups of Nav2's parameters as pydantic models, and complaints about their values."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Final, Self, TypeAlias, get_args

from pydantic import BaseModel, ConfigDict, Field, ValidationError, ValidationInfo, field_validator
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

ParameterLocation: TypeAlias = tuple[str, ...]
"""Names from the top: nodes, `ros__parameters`, groups, the parameter."""


class ParameterGroup(BaseModel):
    """Parameters of one node, plug-in or critic under Nav2's leaf names, with Nav2 Jazzy's defaults.

    Whole numbers may have a point (`30.0`) and lengths none (`1`), as YAML authors write both; text is not a number.
    """

    model_config = ConfigDict(
        frozen=True,
        extra="forbid",
        strict=True,
        allow_inf_nan=False,
        protected_namespaces=(),  # MPPI has a `model_dt`
    )

    @field_validator("*", mode="before")
    @classmethod
    def _from_yaml(cls, value: Any, info: ValidationInfo) -> Any:
        known = cls.model_fields[str(info.field_name)]
        if isinstance(value, int | float) and not isinstance(value, bool):
            value = _meant(known, value)
        if isinstance(value, float) and value.is_integer() and known.annotation in _WHOLE:
            return int(value)
        return tuple(value) if isinstance(value, list) else value

    def with_values(self, **values: Any) -> Self:
        """Return the group with some values replaced; raises `pydantic.ValidationError` if one is wrong."""
        return type(self)(**{**dict(self), **values})


Needs: TypeAlias = tuple[str, Any, str] | None


@dataclass(frozen=True, slots=True)
class Source:
    """Source of a field in a parameter file; the field's own name and type by default.

    Attributes:
        needs: Another field, the value without which this one has no effect, and why.
        stands_for: Values outside of the range, such as -1 for no limit, to those that mean the same.
        below, above: Value that all numbers below or above the range mean, as where Nav2 has a default for them.
        mirrored: Whether Nav2 takes a number and its negative alike.
        least, most: Range of the numbers with which Nav2 starts, and works.
        name: Parameter with the `texts` that stand for the field's values.
        is_derived: True if the field follows from lists and classes, not from a parameter.
    """

    needs: Needs = None
    stands_for: Mapping[float, float] = field(default_factory=dict)
    below: float | None = None
    above: float | None = None
    mirrored: bool = False
    least: float = -math.inf
    most: float = math.inf
    name: str = ""
    texts: Mapping[str, Any] | None = None
    is_derived: bool = False


_SOURCE: Final = "source"
"""Key in `json_schema_extra`."""


def parameter(default: Any, low: float | None = None, high: float | None = None, **source: Any) -> Any:
    """Return a field of a `ParameterGroup` with an inclusive range, and its `Source` by that one's attributes."""
    return _field_from(Source(**source), default, low, high)


def choice(default: Any, name: str, texts: Mapping[str, Any]) -> Any:
    """Return a field that a parameter gives as one of several texts, see `Source`."""
    return _field_from(Source(name=name, texts=texts), default)


def derived(default: Any) -> Any:
    """Return a field that no parameter gives."""
    return _field_from(Source(is_derived=True), default)


def _field_from(source: Source, default: Any, low: float | None = None, high: float | None = None) -> Any:
    extra: dict[str, Any] = {_SOURCE: source}
    return Field(default, ge=low, le=high, json_schema_extra=extra)


def source_of(field: FieldInfo) -> Source:
    """Return a field's source in a parameter file."""
    extra: Any = field.json_schema_extra
    return extra[_SOURCE] if isinstance(extra, Mapping) and _SOURCE in extra else Source()


def _meant(field: FieldInfo, value: float) -> float:
    """Return the number that another one stands for."""
    source, (low, high) = source_of(field), range_of(field)
    if source.mirrored:
        value = abs(value) if high > 0.0 else -abs(value)
    value = source.stands_for.get(value, value)
    if source.below is not None and value < low:
        return source.below
    return source.above if source.above is not None and value > high else value


def held(field: FieldInfo, value: Any) -> float | None:
    """Return the bound that a number lies beyond; None for other values and where Nav2 fails."""
    source, (low, high) = source_of(field), range_of(field)
    if isinstance(value, bool) or not isinstance(value, int | float) or not source.least <= value <= source.most:
        return None
    meant = _meant(field, value)
    bound = min(max(meant, low), high)
    return None if bound == meant else bound


def complaint(model: type[BaseModel], name: str, value: Any) -> str | None:
    """Return a complaint about one parameter of a group; None if `value` is valid."""
    try:
        model.model_validate({name: value})
    except ValidationError as error:
        return next((right for at, right in complaints(model, error) if at == name), None)
    return None


def complaints(model: type[BaseModel], error: ValidationError) -> Iterator[tuple[str, str]]:
    """Yield each faulty parameter with the expected value, such as `a whole number`.

    The parameter is empty where values contradict each other.
    """
    for each in error.errors(include_url=False):
        name, *items = map(str, each["loc"] or ("",))
        yield name, _expected(items, model.model_fields.get(name), each)


def _expected(items: list[str], field: FieldInfo | None, error: ErrorDetails) -> str:
    kind, message = error["type"], error["msg"].removeprefix("Value error, ").removeprefix("Input should be ")
    if kind == "too_short" and not items:
        return f"{error['ctx']['min_length']} items or more"
    if kind in ("too_long", "tuple_type") or (kind == "missing" and items):
        return f"a list of {len(get_args(field.annotation)) if field else 0} numbers"
    if kind in ("greater_than_equal", "less_than_equal") and field:
        low, high = range_of(field)
        message = f"a number in [{low:g}, {high:g}]"
    return _KINDS.get(kind, message) + "".join(f" at index {item}" for item in items)


_WHOLE: Final = (int, int | None)
_KINDS: Final = {
    "bool_type": "true or false",
    "string_type": "text",
    "int_type": "a whole number",
    "float_type": "a number",
    "finite_number": "a number",
}
"""Type of a pydantic error to the expected value."""


def range_of(field: FieldInfo) -> tuple[float, float]:
    """Return the lowest and highest number of a field, or of each item of a list."""
    items = [item for item in get_args(field.annotation) if hasattr(item, "__metadata__")]
    bounds = [bound for mark in items[0].__metadata__ for bound in mark.metadata] if items else field.metadata
    low = next((bound.ge for bound in bounds if hasattr(bound, "ge")), -float("inf"))
    return low, next((bound.le for bound in bounds if hasattr(bound, "le")), float("inf"))
