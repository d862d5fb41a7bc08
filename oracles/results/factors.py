"""Factors: varying keys of the configurations of a campaign, as categories."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

MOST_LEVELS: Final = 12
BINS: Final = 4
_text: Final = json.JSONEncoder(sort_keys=True, ensure_ascii=False).encode

Codes = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Factor:
    """A varying key with its values as levels.

    Attributes:
        levels: In natural order, each of at least one configuration.
        codes: (m,) index of each configuration's level; -1 without the key.
        values: (m,) the number behind the level, NaN without; None for levels that are not numbers.
    """

    name: str
    levels: tuple[str, ...]
    codes: Codes = field(repr=False)
    values: NDArray[np.float64] | None = field(default=None, repr=False)


@dataclass(frozen=True, slots=True)
class Dropped:
    """A key that is not analyzed, and the reason."""

    name: str
    reason: str


def factors_of(rows: Sequence[Mapping[str, Any]]) -> tuple[list[Factor], list[Dropped]]:
    """The factors among the values of configurations, and the varying keys that are dropped.

    Each distinct value is a level. Numbers with more than `MOST_LEVELS` values are grouped by their gaps (as lengths drawn within a tolerance
    have), or else binned at quantiles into `BINS` levels. Lists of objects count by their length. Places and keys with more values
    are dropped, and so are all but the first of keys that divide the configurations alike.

    Args:
        rows: (m,) each configuration's values by key, as in the column `factors`.
    """
    factors: list[Factor] = []
    dropped: list[Dropped] = []
    seen: dict[bytes, str] = {}
    for key in dict.fromkeys(key for row in rows for key in row):
        name, values = key, [row.get(key) for row in rows]
        given = [value for value in values if value is not None]
        if given and all(isinstance(v, list) and all(isinstance(item, Mapping) for item in v) for v in given):
            name, values = f"number of {key}", [None if value is None else len(value) for value in values]
        known = {_text(value): value for value in values if value is not None}
        if len(known) < 2 and None not in values:
            continue
        factor = _factor(name, values, known)
        if any((isinstance(value, Mapping) and set(value) != {"file"}) or isinstance(value, list) for value in values):
            dropped.append(Dropped(name, "is a place or a list, and not one of a few values"))
        elif factor is None:
            dropped.append(Dropped(name, f"has {len(known)} different values, at most {MOST_LEVELS} can be compared"))
        elif len(factor.levels) < 2:
            dropped.append(Dropped(name, "has one value where it is given at all"))
        elif (same := seen.setdefault(_partition(factor.codes), name)) != name:
            dropped.append(Dropped(name, f"divides the configurations as {same} does"))
        else:
            factors.append(factor)
    return factors, dropped


def _factor(name: str, values: Sequence[Any], known: Mapping[str, Any]) -> Factor | None:
    numeric = all(isinstance(value, int | float) and not isinstance(value, bool) for value in known.values())
    numbers = np.array([np.nan if value is None else float(value) for value in values]) if numeric else None
    if len(known) > MOST_LEVELS:
        return None if numbers is None else _binned(name, numbers)
    levels = sorted(known, key=lambda kind: float(known[kind])) if numeric else list(known)
    codes = {level: k for k, level in enumerate(levels)}
    at = np.array([-1 if value is None else codes[_text(value)] for value in values], dtype=np.int64)
    if numeric and not all(math.isfinite(known[level]) for level in levels):
        numbers = None
    return Factor(name, tuple(_level_text(known[level]) for level in levels), at, numbers)


def _heaps(known: NDArray[np.float64]) -> NDArray[np.float64]:
    """Middles of gaps at least twice as wide as the widest of at most `MOST_LEVELS` clusters."""
    at = np.unique(known)
    gaps = np.diff(at)
    widest_first = np.argsort(-gaps, kind="stable")
    for cuts in range(min(MOST_LEVELS, len(at)) - 1, 0, -1):
        after = np.sort(widest_first[:cuts])
        starts, ends = np.r_[0, after + 1], np.r_[after, len(at) - 1]
        if gaps[after].min() >= 2 * (at[ends] - at[starts]).max():
            return np.asarray((at[after] + at[after + 1]) / 2)
    return np.empty(0)


def _binned(name: str, numbers: NDArray[np.float64]) -> Factor:
    known = numbers[np.isfinite(numbers)]
    inner = _heaps(known)
    if not inner.size:
        inner = np.unique(np.quantile(known, np.linspace(0, 1, BINS + 1)))[1:-1]
    codes = np.where(np.isfinite(numbers), np.searchsorted(inner, numbers, side="right"), -1).astype(np.int64)
    used = np.unique(codes[codes >= 0])
    levels = tuple(f"{numbers[codes == k].min():.4g} to {numbers[codes == k].max():.4g}" for k in used)
    return Factor(name, levels, np.where(codes >= 0, np.searchsorted(used, codes), -1).astype(np.int64), numbers)


def _partition(codes: Codes) -> bytes:
    _, first, inverse = np.unique(codes, return_index=True, return_inverse=True)
    renamed: Codes = np.argsort(np.argsort(first))[inverse].astype(np.int64)
    return renamed.tobytes()


def _level_text(value: Any) -> str:
    if isinstance(value, Mapping):  # a file, by its content
        return str(value["file"])[:12] if set(value) == {"file"} else _text(value)
    return value if isinstance(value, str) else _text(value)
