"""Rewrites of a document by varied parameters, after the rules of nav2_common's RewrittenYaml."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

from vastflow.sim.digest import Value
from vastflow.sim.nav.parameters.document import EXPONENT, PARAMETERS, ParameterDocument, ParameterLocation

WHOLE: Final = re.compile(r"[-+]?\d+")
POINTED: Final = re.compile(r"[-+]?(\d+\.\d*|\.\d+)")


@dataclass(frozen=True)
class Rewritten:
    """A document after rewrites.

    Attributes:
        touched: Key to the paths it stands for.
    """

    document: ParameterDocument
    touched: Mapping[str, tuple[ParameterLocation, ...]]


def rewritten(document: ParameterDocument, rewrites: Mapping[str, Value]) -> Rewritten:
    """Replace parameters of a document, or add them: each key at its `targets`.

    Of two keys for one path the longer one counts, in whatever order they come. Text that is a number or a flag is
    that.
    """
    values = dict(document.values)
    touched: dict[str, tuple[ParameterLocation, ...]] = {}
    for key in sorted(rewrites, key=lambda key: (key.count("."), key)):
        touched[key] = targets(values, key)
        for path in touched[key]:
            items = _items(values.get(path[:-1]))
            if path not in values and items and path[-1].isdecimal():
                k = int(path[-1])
                values[path[:-1]] = [*items[:k], converted(rewrites[key]), *items[k + 1 :]]
            else:
                values[path] = converted(rewrites[key])
    return Rewritten(replace(document, values=values), touched)


def targets(values: Mapping[ParameterLocation, Value], key: str) -> tuple[ParameterLocation, ...]:
    """The paths that a key stands for.

    A key is the name of a parameter and stands for every occurrence of it, or a whole path with its nodes and
    `ros__parameters`, dotted, which stands for this one, present or not; a number at the end is an item of a list. Besides
    these, RewrittenYaml's own, the last names of a path stand for every path that ends with them
    (`FollowPath.vx_max`, `global_costmap.robot_radius`).
    """
    names = tuple(key.split("."))
    if found := _occurrences(values, names):
        return found
    if names[-1].isdecimal() and (lists := _occurrences(values, names[:-1])):
        k = int(names[-1])
        return tuple((*path, str(k)) for path in lists if k < len(_items(values[path])))
    return (names,) if PARAMETERS in names[:-1] else ()


def _occurrences(values: Mapping[ParameterLocation, Value], names: ParameterLocation) -> tuple[ParameterLocation, ...]:
    if names in values:
        return (names,)
    return tuple(path for path in values if path[-1:] == names[-1:] and _without_marker(path)[-len(names) :] == names)


def _without_marker(path: ParameterLocation) -> ParameterLocation:
    return tuple(name for name in path if name != PARAMETERS)


def _items(value: Value) -> Sequence[Value]:
    return value if isinstance(value, Sequence) and not isinstance(value, str) else ()


def converted(value: Value) -> Value:
    """Text that is a number or a flag, as that; the files of launch arguments have nothing but text."""
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [converted(item) for item in value]
    if not isinstance(value, str):
        return value
    text = value.strip()
    if text.lower() in ("true", "false"):
        return text.lower() == "true"
    if WHOLE.fullmatch(text):
        return int(text)
    return float(text) if POINTED.fullmatch(text) or EXPONENT.fullmatch(text) else value
