"""Values as numpy records: kernels get one pointer to them, which keeps their signatures small and quick to compile."""

from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray


def record_dtype(value: Any) -> np.dtype[np.void]:
    """The record type of a dataclass: numbers float64, whole numbers and flags int64, tuples arrays, groups records."""
    return np.dtype([(field.name, _type_of(getattr(value, field.name))) for field in fields(value)], align=True)


def record_of(value: Any) -> NDArray[np.void]:
    """A (1,) record array with the values of a dataclass, groups of it as records inside the record."""
    return np.array([record_row(value)], dtype=record_dtype(value))


def _type_of(value: Any) -> Any:
    if is_dataclass(value):
        return record_dtype(value)
    if isinstance(value, tuple):
        return np.float64, (len(value),)
    return np.int64 if isinstance(value, int) else np.float64


def record_row(value: Any) -> Any:
    """The values of a dataclass as nested tuples, as numpy takes them for a record."""
    return tuple(
        record_row(item) if is_dataclass(item) else item
        for item in (getattr(value, field.name) for field in fields(value))
    )
