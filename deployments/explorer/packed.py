"""Packed replies: a line of JSON, then arrays of numbers that a browser reads in place."""

import json
from collections.abc import Mapping
from typing import Any, Final

from numpy.typing import NDArray

from vastflow.oracles.results.schema import plain

KINDS: Final = ("uint8", "uint16", "uint32", "int16", "int32", "float32")
"""Types of arrays that JavaScript has as typed arrays, without 64 bit numbers."""
_ALIGNED: Final = 8


def packed(header: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> bytes:
    """Write a header line and arrays, each at a multiple of 8 bytes.

    The header gets `arrays`: name to type, shape, and offset in bytes from the end of the line, itself a multiple of 8.

    Raises:
        ValueError: an array of a type that is not in `KINDS`.
    """
    places: dict[str, Any] = {}
    parts, offset = [], 0
    for name, array in arrays.items():
        if array.dtype.name not in KINDS:
            raise ValueError(f"{name}: expected an array of {', '.join(KINDS)}, got {array.dtype.name}")
        content = array.astype(array.dtype.newbyteorder("<"), copy=False).tobytes()
        places[name] = {"type": array.dtype.name, "shape": [*array.shape], "offset": offset}
        content += bytes(-len(content) % _ALIGNED)
        parts.append(content)
        offset += len(content)
    line = json.dumps(plain({**header, "arrays": places}), ensure_ascii=False, separators=(",", ":")).encode()
    return b"".join([line, b" " * (-(len(line) + 1) % _ALIGNED), b"\n", *parts])
