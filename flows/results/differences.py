"""Differences: what is other in two plain values, in words."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

from vastflow.producers.model.faults import shown

_MOST_SHOWN: Final = 3


def value_changes(then: Any, now: Any, path: str = "") -> Iterator[tuple[str, Any, Any]]:
    """Path, old and new value of all that differs in two plain values; None for what is not there.

    Mappings are compared key by key, lists of as many mappings one by one, everything else as a whole.
    """
    if isinstance(then, Mapping) and isinstance(now, Mapping) and "file" not in then and "file" not in now:
        for key in dict.fromkeys([*then, *now]):
            yield from value_changes(then.get(key), now.get(key), f"{path}.{key}" if path else str(key))
    elif _of_mappings(then) and _of_mappings(now) and len(then) == len(now):
        for k, (old, new) in enumerate(zip(then, now, strict=True)):
            yield from value_changes(old, new, f"{path}[{k}]")
    elif then != now or type(then) is not type(now):
        yield path, then, now


def flat_changes(then: Mapping[str, Any], now: Mapping[str, Any]) -> list[tuple[str, Any, Any]]:
    """Name, old and new value of all that differs in two mappings, of which names may have dots; None for what is not there."""
    names = dict.fromkeys([*now, *then])
    return [(name, then.get(name), now.get(name)) for name in names if then.get(name) != now.get(name)]


def _of_mappings(value: Any) -> bool:
    return isinstance(value, list) and all(isinstance(item, Mapping) for item in value)


def changes_text(then: Any, now: Any) -> str:
    """What differs in two plain values: the first few of it."""
    return few([change_text(*change) for change in value_changes(then, now)])


def change_text(path: str, then: Any, now: Any) -> str:
    """One of `value_changes`: `x from 1 to 2`, `values gained 3, lost 4`."""
    if isinstance(then, list) and isinstance(now, list):
        gained = [short_text(item) for item in now if item not in then]
        lost = [short_text(item) for item in then if item not in now]
        words = [f"gained {few(gained)}"] * bool(gained) + [f"lost {few(lost)}"] * bool(lost)
        return " ".join(filter(None, [path, ", ".join(words) or "in another order or number"]))
    return " ".join(filter(None, [path, f"from {short_text(then)} to {short_text(now)}"]))


def few(words: Sequence[str], most: int = _MOST_SHOWN) -> str:
    """The first few, and how many more there are."""
    more = len(words) - most
    return ", ".join(words) if more <= 0 else f"{', '.join(words[:most])} and {more} more"


def short_text(value: Any) -> str:
    """A plain value in a few characters."""
    if isinstance(value, Mapping) and value.keys() == {"file"}:
        return f"file {str(value['file'])[:12]}"
    if isinstance(value, float):
        text = f"{value:.10g}"
        return f"{text}.0" if text.removeprefix("-").isdigit() else text
    return shown(value)
