"""The template of a search: the parameters and producers of its one family, with `$name` for what is searched."""

import re
from collections.abc import Container, Iterator, Mapping
from dataclasses import replace
from typing import Any, Final

from vastflow.producers.faults import Fault, Location, shown
from vastflow.producers.vast.document import Document
from vastflow.producers.vast.search import SearchSpec
from vastflow.sim.model.names import did_you_mean

SEARCH: Final[Location] = ("search",)

_MARKER: Final = re.compile(r"\$(?:\{(?P<braced>.*)\}|(?P<bare>[A-Za-z_][\w.-]*))", re.DOTALL)
_ESCAPE: Final = "$$"


def marker_of(value: object) -> str | None:
    """The dimension that a value stands for, where it is all of a text, `$name` or `${name}`."""
    found = _MARKER.fullmatch(value) if isinstance(value, str) else None
    return None if found is None else found["bare"] or found["braced"] or ""


def marker_faults(document: Document, spec: SearchSpec) -> Iterator[Fault]:
    """Markers of the template that name no dimension."""
    for part in ("parameters", "variations"):
        for where, name in _markers(document.data["search"].get(part), (*SEARCH, part)):
            if name not in spec.search_space:
                what = f"found {shown(document.value(where))}, a dimension that search_space does not have"
                yield document.fault(where, what, did_you_mean(name, spec.search_space))


def with_point(
    document: Document, spec: SearchSpec, point: Mapping[str, Any], left_out: Container[int] = ()
) -> Document:
    """The file with the template as a family would have it, each dimension at its value of a point.

    Places stay. A dimension that no marker names is a parameter of the scenario.

    Args:
        left_out: Places of producers that can't be had here, of which the template then has none.
    """
    search = document.data["search"]
    template = {part: search.get(part) or [] for part in ("parameters", "variations")}
    named = {name for _, name in _markers(template, SEARCH)}
    filled = {part: [_filled(entry, point) for entry in entries] for part, entries in template.items()}
    filled["parameters"] += [{name: value} for name, value in point.items() if name not in named]
    filled["variations"] = [{} if k in left_out else entry for k, entry in enumerate(filled["variations"])]
    values = dict(document.values)
    for k, entry in enumerate(filled["parameters"][len(template["parameters"]) :], len(template["parameters"])):
        (name,) = entry
        values[(*SEARCH, "parameters", k, name)] = document.place((*SEARCH, "search_space", name))
        values[(*SEARCH, "parameters", k)] = values[(*SEARCH, "parameters", k, name)]
    values.setdefault((*SEARCH, "parameters"), document.place(SEARCH))
    return replace(document, data={**document.data, "search": filled}, values=values)


def _markers(value: Any, where: Location) -> Iterator[tuple[Location, str]]:
    name = marker_of(value)
    if name is not None:
        yield where, name
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in items:
        yield from _markers(item, (*where, key))


def _filled(value: Any, point: Mapping[str, Any]) -> Any:
    if isinstance(value, dict):
        return {key: _filled(item, point) for key, item in value.items()}
    if isinstance(value, list):
        return [_filled(item, point) for item in value]
    if isinstance(value, str) and value.startswith(_ESCAPE):
        return value[1:]
    name = marker_of(value)
    return value if name is None else point.get(name, value)
