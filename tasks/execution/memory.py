"""Amounts of memory as Kubernetes writes them, and as Docker Compose does."""

import math
import re
from collections.abc import Mapping
from fractions import Fraction
from typing import Final

SUFFIXES: Final[Mapping[str, int]] = {
    "": 1,
    "k": 10**3,
    "M": 10**6,
    "G": 10**9,
    "T": 10**12,
    "P": 10**15,
    "Ki": 2**10,
    "Mi": 2**20,
    "Gi": 2**30,
    "Ti": 2**40,
    "Pi": 2**50,
}
"""Of Kubernetes' quantities, without those of less than a byte (`8m` is 0.008 bytes) and exponents."""
QUANTITY: Final = re.compile(r"(\d+(?:\.\d*)?|\.\d+)\s*([A-Za-z]*)", re.ASCII)


def memory_bytes(text: str) -> int:
    """Bytes of a quantity such as `8Gi` or `1.5G`, rounded up.

    Raises:
        ValueError: not such a quantity, or nothing. The message says what was found and what would be right.
    """
    match = QUANTITY.fullmatch(text.strip())
    if match and match[2] in SUFFIXES and text == match[1] + match[2]:
        size = math.ceil(Fraction(match[1]) * SUFFIXES[match[2]])
        if size > 0:
            return size
    near = f"{match[2][:1].upper()}i" if match else ""
    right = f"did you mean '{match[1]}{near}'?" if match and near in SUFFIXES else "a quantity such as 8Gi or 512Mi"
    raise ValueError(f"found {text!r}; {right}")


def kubernetes_memory(size: int) -> str:
    """`size` bytes as a quantity of Kubernetes, in the largest unit in which they are a whole number."""
    return _in_units(size, {"Gi": 2**30, "Mi": 2**20, "Ki": 2**10}, "")


def compose_memory(size: int) -> str:
    """`size` bytes as Docker Compose reads them, whose k, m and g are powers of 1024."""
    return _in_units(size, {"g": 2**30, "m": 2**20, "k": 2**10}, "b")


def _in_units(size: int, units: Mapping[str, int], byte: str) -> str:
    return next((f"{size // unit}{name}" for name, unit in units.items() if size % unit == 0), f"{size}{byte}")
