"""Checked values as plain ones, which have a digest."""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

from pydantic import BaseModel

from vastflow.sim.digest import FileContent, Value


def plain_value(part: Any) -> Value:
    """All that a value is made of: dataclasses and pydantic models by the name of their class and by field, deep down.

    A property is left out: what computes it must be code that a run depends on, not code that reads.
    """
    if isinstance(part, FileContent):
        return part
    if isinstance(part, BaseModel):
        names: list[str] = list(type(part).model_fields)
    elif is_dataclass(part) and not isinstance(part, type):
        names = [field.name for field in fields(part)]
    elif isinstance(part, Mapping):
        return {key: plain_value(value) for key, value in part.items()}
    elif isinstance(part, tuple | list):
        return [plain_value(item) for item in part]
    elif isinstance(part, set | frozenset):
        return sorted(part)
    else:
        value: Value = part
        return value
    return {"": type(part).__name__, **{name: plain_value(getattr(part, name)) for name in names}}
