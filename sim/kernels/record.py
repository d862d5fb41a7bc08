"""Values as numpy records: kernels get one pointer to them, which keeps their signatures small and quick to compile."""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel

_LISTS: Final = ("zones",)


def record_dtype(value: Any) -> np.dtype[np.void]:
    """Return the record type of a dataclass, a pydantic model, or a mapping.

    Numbers are float64, whole numbers and flags int64, tuples arrays, and groups records.

    Texts and lists of groups are left out: no kernel reads one.
    """
    return np.dtype([(name, _type_of(item)) for name, item in _items(value).items()], align=True)


def record_of(value: Any) -> NDArray[np.void]:
    """Return a (1,) record array with the values of a dataclass, model, or mapping; groups are nested records."""
    return np.array([record_row(value)], dtype=record_dtype(value))


def record_row(value: Any) -> Any:
    """The values as nested tuples, as numpy takes them for a record."""
    return tuple(record_row(item) if _is_group(item) else item for item in _items(value).values())


def _type_of(value: Any) -> Any:
    if _is_group(value):
        return record_dtype(value)
    if isinstance(value, tuple):
        return np.float64, (len(value),)
    return np.int64 if isinstance(value, int) else np.float64


def _is_group(value: Any) -> bool:
    return isinstance(value, BaseModel) or is_dataclass(value)


def _items(value: Any) -> Mapping[str, Any]:
    every = {f.name: getattr(value, f.name) for f in fields(value)} if is_dataclass(value) else dict(value)
    return {name: item for name, item in every.items() if not isinstance(item, str) and name not in _LISTS}
