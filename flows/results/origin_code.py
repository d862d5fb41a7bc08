"""The code that a campaign's results follow from, module by module: as `metadata.json` keeps it, and what changed since."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

from vastflow.flows.results.tables import plain
from vastflow.oracles.oracle import Oracle
from vastflow.producers.family import Family
from vastflow.sim.digest import digest
from vastflow.tasks.evaluation import content_of
from vastflow.tasks.keys import EVALUATE_SOURCE, EXECUTE_SOURCE, JUDGE_SOURCE, OBSERVE_SOURCE
from vastflow.tasks.source import PLUG_IN, Code, SourceTree

ENTRIES: Final[Mapping[str, tuple[str, ...]]] = {
    "instantiate": EVALUATE_SOURCE,
    "execute": EXECUTE_SOURCE,
    "observe": OBSERVE_SOURCE,
    "judge": JUDGE_SOURCE,
}
"""Entry modules of each stage."""

MOST_NAMED: Final = 5
_DIGITS: Final = 12
_PACKAGE: Final = "vastflow."


def code_row(tree: SourceTree, families: Sequence[Family], oracles: Sequence[Oracle[Any]]) -> dict[str, Any]:
    """What `metadata.json` says of it: oracles and producers with their parameters, and modules by short digests."""
    producers = [producer for family in families for producer in family.producers]
    codes = [tree.code(*entries) for entries in ENTRIES.values()]
    codes += [tree.plug_in_code(kind) for kind in dict.fromkeys(map(type, [*producers, *oracles]))]
    modules = {name: digest for code in codes for name, digest in _short(code.modules).items()}
    data = {name: digest for code in codes for name, digest in _short(code.data).items()}
    return {
        "oracles": [_plug_in_row(tree, oracle, oracle.name) for oracle in oracles],
        "producers": {
            family.name: [_plug_in_row(tree, producer, type(producer).__name__) for producer in family.producers]
            for family in families
        },
        "code": {
            "libraries": dict(sorted((name, version) for code in codes for name, version in code.libraries.items())),
            "data": dict(sorted(_not_plug_ins(data).items())),
            "modules": dict(sorted(_not_plug_ins(modules).items())),
        },
    }


def _plug_in_row(tree: SourceTree, plug_in: Any, name: str) -> dict[str, Any]:
    code = tree.plug_in_code(type(plug_in))
    everything = {**code.modules, **code.data}
    own = [[part, everything[part]] for part in everything if part not in _not_plug_ins(everything)]
    return {
        "name": name,
        "parameters": plain(content_of(plug_in.parameters)),
        "source": tree.plug_in_digest(type(plug_in)),
        "file": digest(own)[:_DIGITS] if own else None,
    }


def _not_plug_ins(found: Mapping[str, str]) -> dict[str, str]:
    """Without what lies beside a campaign: each plug-in's row has a digest of that."""
    return {name: digest for name, digest in found.items() if name.partition("/")[0] != PLUG_IN}


def _short(digests: Mapping[str, str]) -> dict[str, str]:
    return {name.removeprefix(_PACKAGE): digest[:_DIGITS] for name, digest in digests.items()}


def code_changes(then: Mapping[str, Any], now: Code) -> list[str]:
    """What of `now` is other than it was, a few words each: modules together, data, libraries.

    Args:
        then: `code` of `metadata.json`; empty where an earlier version wrote it, and then nothing is known.
    """
    recorded = {"modules": _short(now.modules), "data": _short(now.data), "libraries": now.libraries}
    return recorded_changes(then, recorded)


def recorded_changes(then: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """As `code_changes`, of two that are recorded."""
    return [*_changes(then, now)] if then and now else []


def _changes(then: Mapping[str, Any], now: Mapping[str, Any]) -> Iterator[str]:
    if modules := _differing(then["modules"], now["modules"]):
        yield some(modules)
    for package in _differing(then["data"], now["data"]):
        yield f"data of {package}"
    for library in _differing(then["libraries"], now["libraries"]):
        yield f"{library} {then['libraries'].get(library) or 'none'} is now {now['libraries'][library] or 'none'}"


def _differing(then: Mapping[str, str], now: Mapping[str, str]) -> list[str]:
    return [name for name, value in _not_plug_ins(now).items() if then.get(name) != value]


def some(names: Sequence[str]) -> str:
    """The first few of `names`, and how many more there are."""
    more = len(names) - MOST_NAMED
    return ", ".join(names) if more <= 0 else f"{', '.join(names[:MOST_NAMED])} and {more} more"
