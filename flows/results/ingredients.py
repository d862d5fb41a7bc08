"""Ingredients: what the keys of a campaign follow from beside its scenarios, as `metadata.json` keeps it; and what of it changed."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal, TypeAlias

from vastflow.flows.results.differences import changes_text, few, flat_changes
from vastflow.flows.results.origin import numeric_parts
from vastflow.flows.results.tables import plain
from vastflow.oracles.oracle import Oracle
from vastflow.producers.instantiation.family import Family
from vastflow.producers.model.producer import Producer
from vastflow.tasks.evaluation import content_of, producers_in
from vastflow.tasks.keys import EVALUATE_SOURCE, EXECUTE_SOURCE, JUDGE_SOURCE, OBSERVE_SOURCE
from vastflow.tasks.source import PLUG_IN, Code, SourceTree

Stage: TypeAlias = Literal["instantiate", "execute", "observe", "judge"]
ReasonKind: TypeAlias = Literal[
    "never computed",
    "new configuration",
    "scenario changed",
    "more runs",
    "producer changed",
    "input changed",
    "oracle changed",
    "seed changed",
    "source changed",
    "numeric class changed",
    "lost",
    "broke",
    "follows",
]

_ENTRIES: Final[Mapping[Stage, tuple[str, ...]]] = {
    "instantiate": EVALUATE_SOURCE,
    "execute": EXECUTE_SOURCE,
    "observe": OBSERVE_SOURCE,
    "judge": JUDGE_SOURCE,
}
_ORDER: Final = "order of oracles"
_DIGITS: Final = 12
_MOST_FILES: Final = 5


@dataclass(frozen=True, slots=True)
class DueReason:
    """Why something is computed.

    Attributes:
        what: In a few words that are the same for much of a campaign.
        detail: What is special about this one; may be empty.
    """

    kind: ReasonKind
    what: str
    detail: str = ""

    def __str__(self) -> str:
        return f"{self.what}: {self.detail}" if self.detail else self.what


Ingredients: TypeAlias = Mapping[str, tuple[ReasonKind, Any]]
"""Name to the kind of reason that another value is, and the value. Names are those that a user reads."""


def ingredients_row(tree: SourceTree, families: Sequence[Family], oracles: Sequence[Oracle[Any]]) -> dict[str, Any]:
    """What `metadata.json` says of the ingredients: each source by the short digests of its files, and its libraries."""
    sources: dict[str, Any] = {stage: _source(tree.code(*entries)) for stage, entries in _ENTRIES.items()}
    return {
        "oracles": [_plug_in_row(tree, each, each.name, sources) for each in oracles],
        "producers": {
            family.name: [_plug_in_row(tree, each, type(each).__name__, sources) for each in family.producers]
            for family in families
        },
        "code": sources,
    }


def _plug_in_row(
    tree: SourceTree, plug_in: Oracle[Any] | Producer[Any], name: str, sources: dict[str, Any]
) -> dict[str, Any]:
    """A plug-in's row; its source, shared by all of the same code, goes into `sources`."""
    kinds = dict.fromkeys(type(each) for each in (plug_in, *producers_in(plug_in.parameters)))
    source = "+".join(tree.plug_in_digest(kind)[:_DIGITS] for kind in kinds)
    if source not in sources:
        parts = [_source(tree.plug_in_code(kind)) for kind in kinds]
        sources[source] = {
            key: {k: v for part in parts for k, v in part[key].items()} for key in ("files", "libraries")
        }
    return {"name": name, "parameters": plain(content_of(plug_in.parameters)), "source": source}


def _source(code: Code) -> dict[str, dict[str, str]]:
    data = {f"data of {name}": value for name, value in code.data.items()}
    files = {_file_name(name): value[:_DIGITS] for name, value in {**code.modules, **data}.items()}
    return {"files": files, "libraries": dict(code.libraries)}


def _file_name(name: str) -> str:
    """`sim.world.lidar` of a module, `its file` or `its helper.py` of what lies beside a campaign."""
    place = name.removeprefix("data of ")
    if place == PLUG_IN or place.startswith(f"{PLUG_IN}/"):
        return f"its {place.removeprefix(PLUG_IN).removeprefix('/') or 'file'}"
    return name.removeprefix("vastflow.")


def has_ingredients(metadata: Mapping[str, Any]) -> bool:
    """Whether a directory's `metadata.json` has them; earlier versions wrote none."""
    return "execute" in metadata.get("code", {})


def stage_ingredients(metadata: Mapping[str, Any], stage: Stage) -> dict[str, tuple[ReasonKind, Any]]:
    """What every key of a stage follows from, in the order in which it is told."""
    found: dict[str, tuple[ReasonKind, Any]] = {
        "numeric class": ("numeric class changed", numeric_parts(metadata["numeric_class"])),
        f"source of {stage}": ("source changed", metadata["code"][stage]),
    }
    if stage == "execute":
        found["execution.seed"] = ("seed changed", metadata["seed"])
    if stage == "judge":
        for each in metadata["oracles"]:
            found |= _of_plug_in(metadata, each, f"oracle {each['name']}", "oracle changed")
        found[_ORDER] = ("oracle changed", [each["name"] for each in metadata["oracles"]])
    return found


def evaluation_ingredients(metadata: Mapping[str, Any], row: Mapping[str, Any]) -> dict[str, tuple[ReasonKind, Any]]:
    """What every evaluation of a producer follows from; `row` is the producer's in `metadata`."""
    return stage_ingredients(metadata, "instantiate") | _of_plug_in(metadata, row, row["name"], "producer changed")


def _of_plug_in(
    metadata: Mapping[str, Any], row: Mapping[str, Any], name: str, kind: ReasonKind
) -> dict[str, tuple[ReasonKind, Any]]:
    return {
        name: (kind, None),
        f"parameters of {name}": (kind, row["parameters"]),
        f"source of {name}": ("source changed", {"digest": row["source"], **metadata["code"][row["source"]]}),
    }


def changes(then: Ingredients, now: Ingredients) -> Iterator[DueReason]:
    """Each ingredient that is another than it was, with what of it changed.

    Of a plug-in that is new or gone only that is told, and of code that several share the first tells it.
    """
    for name, (kind, value) in {**then, **now}.items():
        if value is None and (name in then) != (name in now):
            yield DueReason(kind, f"{name} is {'new' if name in now else 'gone'}")
    known: set[str] = set()
    for name in filter(then.__contains__, now):
        (kind, value), (_, before) = now[name], then[name]
        if value == before or (name == _ORDER and sorted(value) != sorted(before)):
            continue
        if kind != "source changed":
            yield DueReason(kind, f"{name} changed", changes_text(before, value))
            continue
        words = [each for each in _source_changes(before, value) if each not in known]
        if words or not known:
            yield DueReason(kind, f"{name} changed", few(words, _MOST_FILES))
        known.update(words)


def _source_changes(then: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """Names of files, and libraries with both versions."""
    files = [name for name, _, _ in flat_changes(then["files"], now["files"])]
    libraries = flat_changes(then["libraries"], now["libraries"])
    return [*files, *(f"{name} {a or 'none'} is now {b or 'none'}" for name, a, b in libraries)]
