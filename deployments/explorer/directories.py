"""Campaign directories below the folders that the explorer was given."""

import hashlib
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any, Final, Literal, TypeAlias

from vastflow.flows.results.address import METADATA
from vastflow.oracles.results.events import EVENTS, LAST, Event, event_of
from vastflow.oracles.results.unfinished import final_of, is_running
from vastflow.oracles.results.unusable import DAMAGE
from vastflow.sim.model.files import is_inside, open_file, read_json

State: TypeAlias = Literal["running", "finished", "stopped", "damaged"]

DEEPEST: Final = 5
"""Folders below a given one that are looked into."""

_NAMED: Final = re.compile(r"(.+)-(\d{4}-\d\d-\d\d)-(\d\d)(\d\d)(\d\d)(-\d+)?")
"""Name of a campaign directory: that of the campaign, and when it was begun."""
_PROGRESS: Final = ("runs_done", "runs_total", "passed", "failed", "not_judged")
_END_BYTES: Final = 8192
"""Part of the events that is read for the first and for the last."""
_KEPT: Final = 2000
"""Campaigns whose `metadata.json` stays in memory, as each request reads those of all."""
_MOST_METADATA_BYTES: Final = 32 * 2**20
_MOST_NAME: Final = 1000


class NoSuchCampaign(LookupError):
    """No campaign directory has the id of an address."""


@dataclass(frozen=True, slots=True)
class CampaignDirectory:
    """A campaign directory, finished or not.

    Attributes:
        id: Text for addresses. It stays the same when a running campaign ends.
        path: Current place. A running campaign's folder is hidden, and renamed when the campaign ends.
        name: Name of the campaign, which several directories share.
        created: Local time in ISO 8601; empty where nothing tells it.
        metadata: Content of `metadata.json`; empty while there is none.
        problem: Damage of the directory, or the reason that a campaign stopped; may be empty.
        progress: Numbers of an unfinished campaign's last event of progress; empty without one.
    """

    id: str
    path: Path
    name: str
    created: str
    state: State
    metadata: Mapping[str, Any] = field(default_factory=dict, repr=False, compare=False)
    problem: str = ""
    progress: Mapping[str, int] = field(default_factory=dict, compare=False)

    @property
    def faults(self) -> list[Mapping[str, Any]]:
        """Faults as `metadata.json` has them; none where it has something else."""
        found = self.metadata.get("faults")
        return [each for each in found if isinstance(each, dict)] if isinstance(found, list) else []


class Directories:
    """The campaign directories below some folders, looked up anew for each request.

    Args:
        roots: Folders of campaign directories, or such directories themselves.
    """

    def __init__(self, roots: Sequence[Path]) -> None:
        self.roots = tuple(root.resolve() for root in roots)
        self._hidden: tuple[Path, ...] = ()
        self._read = lru_cache(_KEPT)(_metadata)

    def hide(self, root: Path) -> None:
        """Find, but don't list, campaign directories below a folder from now on."""
        self._hidden = (*self._hidden, root.resolve())

    def all(self) -> list[CampaignDirectory]:
        """Return every campaign directory, newest first."""
        found = {path: self._at(path) for root in self.roots for path in _below(root, DEEPEST)}
        return sorted(found.values(), key=lambda each: (each.created, each.path.name), reverse=True)

    def find(self, id: str) -> CampaignDirectory:
        """Return the campaign directory with an id.

        Raises:
            NoSuchCampaign: there is none, or it was removed.
        """
        for root in (*self.roots, *self._hidden):
            for path in _below(root, DEEPEST):
                if _id(final_of(path)) == id:
                    return self._at(path)
        raise NoSuchCampaign("No campaign directory has this id. It may have been moved or removed.")

    def _at(self, path: Path) -> CampaignDirectory:
        return directory_at(path, self._read)


def directory_at(path: Path, read: "MetadataReader | None" = None) -> CampaignDirectory:
    """Return the campaign directory of a path, damaged where anything in it is not what a campaign writes."""
    try:
        return _finished(path, read or _metadata) if final_of(path) == path else _unfinished(path)
    except DAMAGE as error:
        problem = " ".join(str(error).split()) or type(error).__name__
        return CampaignDirectory(_id(final_of(path)), path, path.name, "", "damaged", problem=problem)


def _below(folder: Path, depth: int) -> Iterator[Path]:
    """Yield campaign directories at or below a folder; links are not followed, as they may lead out of it."""
    if final_of(folder) != folder or os.path.lexists(folder / METADATA):
        yield folder
        return
    if depth < 0:
        return
    try:
        inside = sorted(entry.path for entry in os.scandir(folder) if entry.is_dir(follow_symlinks=False))
    except OSError:  # removed meanwhile, or not ours to read
        return
    for path in map(Path, inside):
        if not path.name.startswith(".") or final_of(path) != path:
            yield from _below(path, depth - 1)


def _id(final: Path) -> str:
    readable = re.sub(r"[^A-Za-z0-9._-]+", "-", final.name)[:80]
    return f"{readable}-{hashlib.sha256(os.fsencode(final)).hexdigest()[:8]}"


def _unfinished(path: Path) -> CampaignDirectory:
    """Return the directory of a campaign that runs, was stopped, or whose process is gone."""
    final = final_of(path)
    named = _NAMED.fullmatch(final.name)
    assert named is not None  # or it would not be unfinished
    name, created = named[1], f"{named[2]}T{named[3]}:{named[4]}:{named[5]}"
    first, last, progress = _ends(path / EVENTS) if is_inside(path / EVENTS, path) else (None, None, None)
    if first is not None and isinstance(first.values.get("name"), str):
        name = first.values["name"]  # the folder's name lacks characters
    if is_running(path):
        found = progress.values if progress else {}
        numbers = {key: found[key] for key in _PROGRESS if isinstance(found.get(key), int)}
        known = numbers if len(numbers) == len(_PROGRESS) else {}
        return CampaignDirectory(_id(final), path, name, created, "running", progress=known)
    told = last.values.get("reason") if last is not None and last.event in LAST else None
    return CampaignDirectory(_id(final), path, name, created, "stopped", problem=str(told or "its process is gone"))


def _ends(file: Path) -> tuple[Event | None, Event | None, Event | None]:
    try:
        with open_file(file) as events:
            head = events.read(_END_BYTES).split(b"\n")[0]
            size = events.seek(0, os.SEEK_END)
            events.seek(max(0, size - _END_BYTES))
            lines = [b"", *events.read(_END_BYTES).split(b"\n")[:-1]]
    except (OSError, ValueError):
        return None, None, None
    told = next((line for line in reversed(lines) if b'"event":"progress"' in line), b"")
    return event_of(head), event_of(lines[-1]), event_of(told)


def headline_of(campaign: CampaignDirectory) -> Mapping[str, Any]:
    """Return the headline that was written with a finished campaign; empty without one."""
    counts = campaign.metadata.get("counts")
    found = counts.get("headline") if isinstance(counts, dict) else None
    return found if isinstance(found, dict) else {}


MetadataReader: TypeAlias = Callable[[Path, tuple[int, ...]], Mapping[str, Any]]
"""Reads `metadata.json` of a directory; the second argument tells a cache that it is another file."""


def _metadata(path: Path, written: tuple[int, ...]) -> Mapping[str, Any]:
    if written[0] > _MOST_METADATA_BYTES:
        raise ValueError(f"{METADATA}: got {written[0]:,} bytes, expected at most {_MOST_METADATA_BYTES:,}")
    content = read_json(path / METADATA)
    return content if isinstance(content, dict) else {}


def _finished(path: Path, read: MetadataReader) -> CampaignDirectory:
    problem, metadata = "", dict[str, Any]()
    try:
        if led := next(
            (each.name for each in os.scandir(path) if each.is_symlink() and not is_inside(each, path)), None
        ):
            raise ValueError(f"{led} is a link out of the directory")
        status = os.stat(path / METADATA)
        metadata = {**read(path, (status.st_size, status.st_mtime_ns, status.st_ino))}
        lacking = {"name", "created", "counts"} - metadata.keys()
        if lacking or not isinstance(metadata["counts"], dict):
            raise ValueError(f"{METADATA} has no {min(lacking, default='counts')}")
    except DAMAGE as error:
        problem = " ".join(str(error).split()) or type(error).__name__
    name, created = (str(metadata.get(key, ""))[:_MOST_NAME] for key in ("name", "created"))
    state: State = "damaged" if problem else "finished"
    return CampaignDirectory(_id(path), path, name or path.name, created, state, metadata, problem)
