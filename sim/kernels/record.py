"""Values as numpy records: kernels get one pointer to them, which keeps their signatures small and quick to compile."""

from dataclasses import fields, is_dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

_LISTS: Final = ("zones",)


def record_of(value: Any) -> NDArray[np.void]:
    """Return a (1,) record array with the values of a dataclass, model, or mapping; groups are nested records."""
    dtype, row = record(value)
    return np.array([row], dtype=dtype)


def record(value: Any) -> tuple[np.dtype[np.void], tuple[Any, ...]]:
    """Return the record type of a dataclass, a pydantic model, or a mapping, and its values as nested tuples.

    Numbers are float64, whole numbers and flags int64, tuples arrays, and groups records.

    Texts and lists of groups are left out: no kernel reads one.
    """
    items = [(f.name, getattr(value, f.name)) for f in fields(value)] if is_dataclass(value) else dict(value).items()
    types: list[Any] = []
    row: list[Any] = []
    for name, item in items:
        if isinstance(item, str) or name in _LISTS:
            continue
        if isinstance(item, tuple):
            types.append((name, np.float64, (len(item),)))
        elif isinstance(item, int | float):
            types.append((name, np.int64 if isinstance(item, int) else np.float64))
        else:
            kind, item = record(item)
            types.append((name, kind))
        row.append(item)
    return np.dtype(types, align=True), tuple(row)
