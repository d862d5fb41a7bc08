"""Drawings: figures as files, drawn when these are asked for, or taken from an earlier report that drew the same."""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from functools import cached_property
from typing import Any, Final, TypeAlias

import numpy as np
from matplotlib.figure import Figure

from vastflow.oracles.figures.style import png, svg

Files: TypeAlias = Mapping[str, bytes]
"""Suffix to content."""
Before: TypeAlias = Callable[[str], Files | None]
"""Gives the files of an earlier drawing by its key."""


class Drawing:
    """A function and its arguments, drawn on demand.

    Args:
        draw: Makes a figure, or files.
        content: Its arguments.
    """

    def __init__(self, draw: Callable[..., Figure | Files], *content: Any) -> None:
        self._draw, self._content = draw, content

    @cached_property
    def key(self) -> str:
        """Digest of the function's name and the content; of code it has nothing. Empty for content of unknown types."""
        hashed = hashlib.sha256(f"{self._draw.__module__}.{self._draw.__qualname__}".encode())
        try:
            _feed(hashed, self._content)
        except TypeError:
            return ""
        return hashed.hexdigest()

    @cached_property
    def files(self) -> Files:
        made = self._draw(*self._content)
        return {"png": png(made), "svg": svg(made)} if isinstance(made, Figure) else made

    def take(self, before: Before) -> None:
        """Take the files of an earlier drawing, if there is one."""
        if self.key and (found := before(self.key)) is not None:
            self.__dict__["files"] = found


_SCALARS: Final = (str, bytes, int, float, complex, np.generic, type(None))


def _feed(hashed: Any, value: Any) -> None:
    kind = type(value).__name__
    if isinstance(value, _SCALARS):
        hashed.update(f"{kind} {value!r};".encode())
    elif isinstance(value, np.ndarray) and not value.dtype.hasobject:
        hashed.update(f"{value.dtype} {value.shape};".encode() + value.tobytes())
    elif is_dataclass(value) and not isinstance(value, type):
        hashed.update(f"{kind} {len(fields(value))};".encode())
        for field in fields(value):
            _feed(hashed, getattr(value, field.name))
    elif isinstance(value, Mapping):
        hashed.update(f"mapping {len(value)};".encode())
        for item in value.items():
            _feed(hashed, item)
    elif isinstance(value, Sequence):
        hashed.update(f"sequence {len(value)};".encode())
        for item in value:
            _feed(hashed, item)
    else:
        raise TypeError(kind)
