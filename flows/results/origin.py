"""Origin: the code and the kind of machine that a campaign's results follow from, and what is other here."""

import importlib.metadata
import platform
from collections.abc import Iterator, Mapping
from typing import Any, Final

from vastflow.flows.results.differences import changes_text
from vastflow.tasks.keys import Keys

_CLASS_PARTS: Final = ("architecture", "C library", "processor features", "variables", "Python")
"""Of `vastflow.tasks.keys.numeric_class`, in its order."""
_LISTS: Final = ("processor features", "variables")


def origin_row(keys: Keys) -> dict[str, Any]:
    """What `metadata.json` says of it: the numeric class, `execution.seed`, and a source digest for each stage."""
    source = {"execute": keys.execute_source, "observe": keys.observe_source, "judge": keys.judge_source}
    return {"numeric_class": keys.numeric, "seed": keys.seed, "source": source}


def origin_differences(metadata: Mapping[str, Any], numeric: str, execute_source: str) -> list[str]:
    """Why a run may come out as another here than it was recorded, a sentence each; none where the bytes must be equal.

    A directory written before `metadata.json` named its origin says nothing.

    Args:
        metadata: Of the campaign directory.
        numeric: The numeric class of this process.
        execute_source: Source digest of the simulator as it is installed here.
    """
    found = []
    recorded_source = metadata.get("source", {}).get("execute", execute_source)
    if recorded_source != execute_source:
        others = "".join(f"; {words}" for words in _other_versions(metadata))
        found.append(
            f"recorded with other source of the simulator ({recorded_source[:12]}, here {execute_source[:12]}){others}"
        )
    recorded_class = metadata.get("numeric_class", numeric)
    if recorded_class != numeric:
        then, now = numeric_parts(recorded_class), numeric_parts(numeric)
        words = changes_text(then, now) if then.keys() == now.keys() else f"{recorded_class!r}, here {numeric!r}"
        found.append(f"recorded on another numeric class: {words}")
    return found


def versions(metadata: Mapping[str, Any], same_origin: bool) -> str:
    """Who recorded and who executed, and which libraries differ.

    Args:
        same_origin: Whether `origin_differences` found none.
    """
    here = importlib.metadata.version("vastflow")
    words = [f"recorded by vastflow {metadata['vastflow']}, executed by vastflow {here}", *_other_versions(metadata)]
    host = {key: metadata["host"][key] for key in ("machine", "system")}
    words += [f"{name} {then}, here {now}" for name, then in host.items() if (now := _version(name)) != then]
    if "source" not in metadata or "numeric_class" not in metadata:
        if len(words) == 1 and metadata["vastflow"] == here:
            words.append(
                "libraries and machine are of the same versions: the simulator's code or the processor is another"
            )
    elif same_origin:
        words.append(
            "source and numeric class are those of the recording, so the file was changed or this is an internal error"
        )
    return "; ".join(words)


def _other_versions(metadata: Mapping[str, Any]) -> Iterator[str]:
    for name, then in metadata["versions"].items():
        if (now := _version(name)) != then:
            yield f"{name} {then}, here {now}"


def numeric_parts(numeric: str) -> dict[str, Any]:
    """A numeric class by its parts, of which some are lists; as a whole where another version wrote it in another form."""
    parts = numeric.split("; ")
    if len(parts) == len(_CLASS_PARTS) - 1:  # before it had Python's minor version
        parts.append("not recorded")
    if len(parts) != len(_CLASS_PARTS):
        return {"all of it": numeric}
    return {name: part.split() if name in _LISTS else part for name, part in zip(_CLASS_PARTS, parts, strict=True)}


def _version(name: str) -> str:
    own = {"python": platform.python_version, "machine": platform.machine, "system": platform.platform}
    if name in own:
        return own[name]()
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return "none"
