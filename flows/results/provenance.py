"""Provenance: the code, the machine, and all else that a campaign's results follow from, and what of it changed."""

import importlib.metadata
import platform
import re
from collections.abc import Container, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal, TypeAlias, get_args

from vastflow.oracles.judgment.oracle import Oracle
from vastflow.oracles.results.schema import plain
from vastflow.producers.instantiation.instantiate import Family
from vastflow.producers.model.faults import shown
from vastflow.producers.model.producer import Producer
from vastflow.sim.model.files import Unreadable, read_text
from vastflow.sim.system.keys import FILE_KEY
from vastflow.sim.system.system import system_of
from vastflow.tasks.engine.evaluation import content_of, evaluation_source, producers_in
from vastflow.tasks.keys.keys import EVALUATE_SOURCE, EXECUTE_SOURCE, JUDGE_SOURCE, OBSERVE_SOURCE, Keys
from vastflow.tasks.keys.source import PLUG_IN, Code, SourceTree

_MOST_SHOWN: Final = 3


def value_changes(then: Any, now: Any, path: str = "") -> Iterator[tuple[str, Any, Any]]:
    """Yield path, old, and new value of each difference of two plain values; None where one is absent.

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


def _of_mappings(value: Any) -> bool:
    return isinstance(value, list) and all(isinstance(item, Mapping) for item in value)


def changes_text(then: Any, now: Any) -> str:
    """Describe the first few differences between two plain values."""
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
    """The first few, and the number of others."""
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


def origin_row(keys: Keys) -> dict[str, Any]:
    """Return numeric class, seed, and source digests for `metadata.json`."""
    source = {"execute": keys.execute_source, "observe": keys.observe_source, "judge": keys.judge_source}
    return {"numeric_class": keys.numeric, "seed": keys.seed, "source": {**source, "oracles": dict(keys.by_oracle)}}


DEFAULTS_KEY: Final = "nav2_defaults"
"""Key of `metadata.json` with the defaults of Nav2's code that count for a Nav2 parameter file, absent without one."""


def default_changes(then: Mapping[str, Any], now: Mapping[str, Any], had_file: bool = True) -> list[str]:
    """Name the defaults that count otherwise now for what a Nav2 file leaves out; directories before 0.2 keep none.

    Args:
        had_file: Whether the earlier campaign had a Nav2 file, without which nothing was left out.
    """
    here = now.get(DEFAULTS_KEY, {})
    if DEFAULTS_KEY not in then and not had_file:
        words = []
    elif DEFAULTS_KEY not in then:
        words = [f"{name} is now {short_text(each['value'])}" for name, each in here.items() if each["since"]]
    else:
        before = then[DEFAULTS_KEY]
        both = [name for name in here if name in before and before[name]["value"] != here[name]["value"]]
        words = [change_text(name, before[name]["value"], here[name]["value"]) for name in both]
    return [f"the Nav2 file leaves out, and Nav2's code counts: {few(words, _MOST_FILES)}"] if words else []


def origin_differences(
    metadata: Mapping[str, Any], numeric: str, execute_source: str, system: Mapping[str, Any]
) -> list[str]:
    """Return reasons why a replay may differ from the recording; empty if its bytes must be equal.

    Args:
        numeric, execute_source: Numeric class of this process, and source digest of the simulator as it is installed here.
        system: System of the recorded scenario.
    """
    defaults = system_of(system).defaults
    found = default_changes(metadata, {} if defaults is None else {DEFAULTS_KEY: defaults})
    recorded_source = metadata["source"]["execute"]
    if recorded_source != execute_source:
        others = "".join(f"; {words}" for words in _other_versions(metadata))
        found.append(
            f"recorded with other source of the simulator ({recorded_source[:12]}, here {execute_source[:12]}){others}"
        )
    if metadata["numeric_class"] != numeric:
        found.append(f"recorded on another numeric class: {metadata['numeric_class']!r}, here {numeric!r}")
    return found


def versions(metadata: Mapping[str, Any], same_origin: bool) -> str:
    """Describe the recording and the executing version; `same_origin` where `origin_differences` found none."""
    here = importlib.metadata.version("vastflow")
    words = [f"recorded by vastflow {metadata['vastflow']}, executed by vastflow {here}", *_other_versions(metadata)]
    host = {key: metadata["host"][key] for key in ("machine", "system")}
    words += [f"{name} {then}, here {now}" for name, then in host.items() if (now := _version(name)) != then]
    if same_origin:
        words.append(
            "source and numeric class are those of the recording, so the file was changed or this is an internal error"
        )
    return "; ".join(words)


def _other_versions(metadata: Mapping[str, Any]) -> Iterator[str]:
    for name, then in metadata["versions"].items():
        if (now := _version(name)) != then:
            yield f"{name} {then}, here {now}"


def _version(name: str) -> str:
    own = {"python": platform.python_version, "machine": platform.machine, "system": platform.platform}
    if name in own:
        return own[name]()
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return "none"


Stage: TypeAlias = Literal["instantiate", "execute", "observe", "judge"]
STAGES: Final[tuple[Stage, ...]] = get_args(Stage)
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
    "forced",
    "lost",
    "broke",
    "open",
    "follows",
]

_ENTRIES: Final[Mapping[Stage, tuple[str, ...]]] = {
    "instantiate": EVALUATE_SOURCE,
    "execute": EXECUTE_SOURCE,
    "observe": OBSERVE_SOURCE,
    "judge": JUDGE_SOURCE,
}
_DIGITS: Final = 12
_MOST_FILES: Final = 5


@dataclass(frozen=True, slots=True)
class DueReason:
    """Why something is computed.

    Attributes:
        what: The reason in a few words that are the same for much of a campaign.
        detail: Details of this single case; may be empty.
    """

    kind: ReasonKind
    what: str
    detail: str = ""

    def __str__(self) -> str:
        return f"{self.what}: {self.detail}" if self.detail else self.what


Ingredients: TypeAlias = Mapping[str, tuple[ReasonKind, Any]]
"""Name to the kind of reason that another value is, and the value. Names are those that a user reads."""


def ingredients_row(tree: SourceTree, families: Sequence[Family], oracles: Sequence[Oracle[Any]]) -> dict[str, Any]:
    """Return the ingredients for `metadata.json`: short digests of source files, and libraries."""
    sources: dict[str, Any] = {stage: _source(tree.code(*entries)) for stage, entries in _ENTRIES.items()}
    return {
        "oracles": [_plug_in_row(tree, each, each.name, sources) for each in oracles],
        "producers": {
            family.name: [
                _plug_in_row(tree, each, type(each).__name__, sources)
                | {"evaluation_source": evaluation_source(tree, each)}
                for each in family.producers
            ]
            for family in families
        },
        "code": sources,
    }


def _plug_in_row(
    tree: SourceTree, plug_in: Oracle[Any] | Producer[Any], name: str, sources: dict[str, Any]
) -> dict[str, Any]:
    kinds = dict.fromkeys(type(each) for each in (plug_in, *producers_in(plug_in.parameters)))
    source = "+".join(tree.plug_in_digest(kind)[:_DIGITS] for kind in kinds)
    if source not in sources:
        parts = [_source(tree.plug_in_code(kind)) for kind in kinds]
        sources[source] = {
            key: {k: v for part in parts for k, v in part[key].items()} for key in ("files", "libraries")
        }
    return {"name": name, "parameters": plain(content_of(plug_in.parameters)), "source": source}


def _source(code: Code) -> dict[str, dict[str, str]]:
    files = {}
    for name, value in {**code.modules, **{f"data of {name}": value for name, value in code.data.items()}}.items():
        place = name.removeprefix("data of ")
        own = place == PLUG_IN or place.startswith(f"{PLUG_IN}/")  # what lies beside a campaign
        beside = f"its {place.removeprefix(PLUG_IN).removeprefix('/') or 'file'}"
        files[beside if own else name.removeprefix("vastflow.")] = value[:_DIGITS]
    return {"files": files, "libraries": dict(code.libraries)}


def stage_ingredients(
    metadata: Mapping[str, Any], stage: Stage, oracles: Container[str] | None = None
) -> dict[str, tuple[ReasonKind, Any]]:
    """Return the ingredients of a stage's keys, in the order of messages, of `judge` those of some or all oracles."""
    found: dict[str, tuple[ReasonKind, Any]] = {
        "numeric class": ("numeric class changed", metadata["numeric_class"]),
        f"source of {stage}": ("source changed", metadata["code"][stage]),
    }
    if stage == "execute":
        found["execution.seed"] = ("seed changed", metadata["seed"])
    if stage == "judge":
        for each in metadata["oracles"]:
            if oracles is None or each["name"] in oracles:
                found |= _of_plug_in(metadata, each, f"oracle {each['name']}", "oracle changed")
    return found


def evaluation_ingredients(metadata: Mapping[str, Any], row: Mapping[str, Any]) -> dict[str, tuple[ReasonKind, Any]]:
    """Return the ingredients of a producer's evaluations; `row` is its row in `metadata`."""
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
        if value == before:
            continue
        if kind != "source changed":
            yield DueReason(kind, f"{name} changed", changes_text(before, value))
            continue
        words = [each for each in _source_changes(before, value) if each not in known]
        if words or not known:
            yield DueReason(kind, f"{name} changed", few(words, _MOST_FILES))
        known.update(words)


def campaign_changes(then: Mapping[str, Any], now: Mapping[str, Any], folder: Path) -> list[str]:
    """Describe the differences between two `metadata.json`, the first one in a folder, configurations excepted."""
    versions = then.get("vastflow"), now.get("vastflow")
    found = [] if versions[0] == versions[1] else [change_text("vastflow", *versions)]
    with suppress(Unreadable):
        had_file = (
            re.search(rf"^[^#\n]*\b{FILE_KEY}\s*:", read_text(folder / "campaign.vast"), re.MULTILINE) is not None
        )
        found += default_changes(then, now, had_file)
    reasons = (changes(stage_ingredients(then, stage), stage_ingredients(now, stage)) for stage in STAGES)
    return [*found, *dict.fromkeys(str(reason) for some in reasons for reason in some)]


def _source_changes(then: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:

    def changed(part: str) -> list[str]:
        return [name for name in {**now[part], **then[part]} if then[part].get(name) != now[part].get(name)]

    old, new = then["libraries"], now["libraries"]
    libraries = (f"{name} {old.get(name) or 'none'} is now {new.get(name) or 'none'}" for name in changed("libraries"))
    return [*changed("files"), *libraries]
