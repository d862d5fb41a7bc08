"""Content digests: SHA-256 over one canonical, tagged JSON text.

Equal content has an equal digest on every machine and Python version; a file enters by its content, never by its path or time.
"""

import hashlib
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from json.encoder import encode_basestring_ascii
from pathlib import Path
from typing import Final, TypeAlias

from vastflow.sim.model.faults import Got
from vastflow.sim.model.files import Unreadable, open_file

MOST_FILE_BYTES: Final = 4 * 2**30


@dataclass(frozen=True, slots=True)
class FileContent:
    """A file as a value: two are equal if their contents are, wherever they are stored.

    Attributes:
        path: Path for this process.
        digest: SHA-256 (hex) of its content; for a map of the decoded grid, see `vastflow.sim.world.world.map_content`.
    """

    path: str = field(compare=False)
    digest: str


Value: TypeAlias = "bool | int | float | str | FileContent | Sequence[Value] | Mapping[str, Value] | None"


def canonical(value: Value) -> str:
    """Return the canonical text of `value`: sorted keys, floats as hexadecimal, `1`, `1.0` and `True` distinct.

    The text is JSON as `json.dumps` writes it with sorted keys and no spaces, in one pass: half of instantiation is digests.

    Raises:
        TypeError: a type that has no canonical form.
        ValueError: NaN, which is not equal to itself.
    """
    kind = type(value)
    if kind is str:
        return encode_basestring_ascii(value)  # type: ignore[arg-type]
    if kind is float:
        return _float_text(value)  # type: ignore[arg-type]
    if kind is dict:
        return _map_text(value)  # type: ignore[arg-type]
    if value is None or isinstance(value, bool):
        return "null" if value is None else "true" if value else "false"
    if isinstance(value, str):
        return encode_basestring_ascii(value)
    if isinstance(value, int):
        return int.__repr__(value)
    if isinstance(value, float):
        return _float_text(value)
    if isinstance(value, FileContent):
        return f'{{"file":{encode_basestring_ascii(value.digest)}}}'
    if isinstance(value, Mapping):
        return _map_text(value)
    if isinstance(value, Sequence) and not isinstance(value, bytes | bytearray):
        return f"[{','.join([canonical(item) for item in value])}]"
    raise TypeError(f"{type(value).__name__} has no canonical form. Use None, bool, int, float, str, list or dict")


def digest(*values: Value) -> str:
    """Return the SHA-256 (64 hexadecimal digits) of the canonical form of `values`, in order."""
    return text_digest(canonical(values))


class Texts:
    """Canonical texts of values that share objects, each object's made once."""

    def __init__(self) -> None:
        self._known: dict[int, tuple[Value, str]] = {}  # with the value, so that no other gets its id

    def __call__(self, value: Value) -> str:
        """Return `canonical(value)`; `value` must not change later."""
        found = self._known.get(id(value))
        if found is None:
            found = self._known[id(value)] = value, canonical(value)
        return found[1]

    def of_map(self, value: Mapping[str, Value]) -> str:
        """Return `canonical(value)` from the texts of the mapping's values."""
        return _map_of([f"{encode_basestring_ascii(key)}:{self(value[key])}" for key in sorted(value)])


def text_digest(canonical_text: str) -> str:
    """Return the digest of the value with this canonical text."""
    return hashlib.sha256(canonical_text.encode()).hexdigest()


def file_digest(path: str | Path) -> str:
    """SHA-256 (hex) of a file's bytes.

    Raises:
        Missing, Unreadable: see `open_file`; or larger than any file of a campaign.
    """
    with open_file(path) as file:
        if (found := os.fstat(file.fileno()).st_size) > MOST_FILE_BYTES:
            raise Unreadable(Got(f"{found:,} bytes"), f"at most {MOST_FILE_BYTES:,}")
        if not found:  # or a file of the kernel, which may have nothing yet and never ends
            return hashlib.sha256(b"").hexdigest()
        return hashlib.file_digest(file, "sha256").hexdigest()


def _float_text(value: float) -> str:
    if math.isnan(value):
        raise ValueError("NaN has no digest: it is not equal to itself")
    return f'{{"float":"{(float(value) + 0.0).hex()}"}}'  # + 0.0 turns -0.0 into 0.0


def _map_text(value: Mapping[str, Value]) -> str:
    for key in value:
        if not isinstance(key, str):
            raise TypeError(f"a mapping's key must be text, got {key!r}")
    return _map_of([f"{encode_basestring_ascii(key)}:{canonical(value[key])}" for key in sorted(value)])


def _map_of(items: list[str]) -> str:
    return f'{{"map":{{{",".join(items)}}}}}'
