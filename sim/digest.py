"""Content digests: SHA-256 over one canonical, tagged JSON text.

Equal content has an equal digest on every machine and Python version; a file enters by what it holds,
never by its path or time.
"""

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeAlias


@dataclass(frozen=True, slots=True)
class FileContent:
    """A file as a value: equal to another where the content is equal, wherever the two lie.

    Attributes:
        path: Where this process can read it.
        digest: SHA-256 (hex) of what it holds. For a map that is the decoded grid and its metadata, see
            `vastflow.sim.maps.map_content`.
    """

    path: str = field(compare=False)
    digest: str


Value: TypeAlias = "bool | int | float | str | FileContent | Sequence[Value] | Mapping[str, Value] | None"


def canonical(value: Value) -> str:
    """The one text of `value`: sorted keys, floats as hexadecimal, `1`, `1.0` and `True` kept apart.

    Raises:
        TypeError: a type that has no canonical form.
        ValueError: NaN, which is not equal to itself.
    """
    return json.dumps(_tagged(value), sort_keys=True, separators=(",", ":"), ensure_ascii=True)


def digest(*values: Value) -> str:
    """SHA-256 (64 hexadecimal digits) of the canonical form of `values`, in order."""
    return hashlib.sha256(canonical(values).encode()).hexdigest()


def file_digest(path: str | Path) -> str:
    """SHA-256 (hex) of a file's bytes."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _tagged(value: Value) -> object:
    if value is None or isinstance(value, bool | str):
        return value
    if isinstance(value, int):
        return int(value)
    if isinstance(value, float):
        if math.isnan(value):
            raise ValueError("NaN has no digest: it is not equal to itself")
        return {"float": float(value + 0.0).hex()}  # + 0.0 turns -0.0 into 0.0
    if isinstance(value, FileContent):
        return {"file": value.digest}
    if isinstance(value, Mapping):
        return {"map": {_text_key(key): _tagged(item) for key, item in value.items()}}
    if isinstance(value, Sequence) and not isinstance(value, bytes | bytearray):
        return [_tagged(item) for item in value]
    raise TypeError(f"{type(value).__name__} has no canonical form; use None, bool, int, float, str, list or dict")


def _text_key(key: object) -> str:
    if not isinstance(key, str):
        raise TypeError(f"a mapping's key must be text, got {key!r}")
    return key
