"""A pack: what a store in a folder had of a campaign's complete members, so that a look at one costs a stat for each of its files.

Looking at members one by one reads three manifests of each and makes three keys, most of what a campaign takes in which nothing
is missing. A pack is believed only where every file is as it was when it was looked at: size, times and inode, of which the time of
the last change is out of an editor's reach. It is a cache: without it, and where it is damaged, members are looked at.
"""

import contextlib
import hashlib
import json
import os
import time
import uuid
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, TypeAlias

from vastflow.sim.model.digest import digest
from vastflow.tasks.keys.keys import Keys
from vastflow.tasks.store.artifact import MANIFEST, Artifact, Block, FileEntry, Stored
from vastflow.tasks.store.store import Store

FOLDER: Final = "packs"
"""In the store, with which they are deleted."""
KEPT: Final = 20

SETTLED_S: Final = 2.0
"""A file that was changed so shortly before may be changed again without another time: file systems count up to two seconds."""

MOST_SEGMENTS: Final = 32
_FEW: Final = 100
_FORM: Final = 1

_Entry: TypeAlias = list[Any]
"""Of a member: its home's key and stamp, and of each block start, stop, content and its artifacts with the stamps of their files."""


class MemberPack:
    """A pack in a file. Each line of it has its own digest: what several processes append, or what is damaged, spoils nothing else.

    Args:
        root: The store's folder.
        file: Whose name says which keys it is of.
    """

    def __init__(self, root: Path, file: Path) -> None:
        self._root = root
        self._file = file
        self._known: dict[str, _Entry] = {}
        self._used: set[str] = set()
        self._new: dict[str, _Entry] = {}
        self._segments = 0
        for segment in self._read():
            self._segments += 1
            self._known.update(segment)

    def find(self, checked: str, runs: int) -> list[Stored] | None:
        """All that the store has of a member, if it was complete and is as it was.

        Args:
            checked, runs: The member's.
        """
        name = f"{checked} {runs}"
        entry = self._known.get(name)
        if entry is None:
            return None
        home, stamp, blocks = entry
        try:
            if _folder_stamp(f"{self._root}/{home}") != stamp or not all(
                self._is_as_it_was(artifact) for _, _, _, artifacts in blocks for artifact in artifacts
            ):
                return None
        except OSError:
            return None
        self._used.add(name)
        return [_stored(*block) for block in blocks]

    def add(self, checked: str, runs: int, home: str, stored: Sequence[Stored]) -> None:
        """Take a complete member that was looked at just now.

        Args:
            home: Key below which its recordings lie.
        """
        try:
            stamp = _folder_stamp(f"{self._root}/{home}")
            blocks = [self._block(each) for each in stored]
        except OSError:
            return
        stamps = [stamp, *(each for block in blocks for artifact in block[3] for each in artifact[3])]
        if max(max(each[:2]) for each in stamps) / 1e9 < time.time() - SETTLED_S:
            self._new[f"{checked} {runs}"] = [home, stamp, blocks]

    def keep(self) -> None:
        """Write what was added. A folder that does not take it costs the next call time, no more."""
        if not self._new:
            return
        self._known |= self._new
        self._used |= self._new.keys()
        is_worn = self._segments >= MOST_SEGMENTS or len(self._known) > 2 * len(self._used) + _FEW
        with contextlib.suppress(OSError, ValueError):
            self._file.parent.mkdir(exist_ok=True)
            if is_worn:
                self._known = {name: entry for name, entry in self._known.items() if name in self._used}
                self._rewrite()
            else:
                with open(self._file, "ab", buffering=0) as file:
                    file.write(b"\n" + self._segment(self._new))
                self._segments += 1
        self._new = {}

    def _rewrite(self) -> None:
        prepared = self._file.with_name(f".{uuid.uuid4().hex}")
        try:
            prepared.write_bytes(self._segment(self._known))
            os.replace(prepared, self._file)
        finally:
            prepared.unlink(missing_ok=True)
        self._segments = 1

    def _segment(self, entries: Mapping[str, _Entry]) -> bytes:
        body = json.dumps(entries, separators=(",", ":")).encode()
        return self._hash(body) + b" " + body

    def _read(self) -> Iterator[dict[str, _Entry]]:
        try:
            lines = self._file.read_bytes().split(b"\n")
        except OSError:
            return
        for line in lines:
            hashed, _, body = line.partition(b" ")
            if body and self._hash(body) == hashed:
                yield json.loads(body)

    def _hash(self, body: bytes) -> bytes:
        return hashlib.sha256(self._file.name.encode() + b"\n" + body).hexdigest().encode()

    def _block(self, stored: Stored) -> list[Any]:
        block = stored.block
        artifacts = [self._artifact(each) for each in (stored.recordings, stored.trace, stored.verdicts) if each]
        return [block.start, block.stop, block.content, artifacts]

    def _artifact(self, artifact: Artifact) -> list[Any]:
        files = {name: [entry.sha256, entry.size] for name, entry in artifact.files.items()}
        return [artifact.key, files, artifact.info, list(self._stamps(artifact.key, files))]

    def _is_as_it_was(self, artifact: Sequence[Any]) -> bool:
        key, files, _, stamps = artifact
        return [*self._stamps(key, files)] == list(stamps)

    def _stamps(self, key: str, files: Iterable[str]) -> Iterator[list[int]]:
        for name in (MANIFEST, *files):
            found = os.stat(f"{self._root}/{key}/{name}")
            yield [found.st_mtime_ns, found.st_ctime_ns, found.st_size, found.st_ino]


def member_pack(store: Store, keys: Keys, campaign: str) -> MemberPack:
    """The pack of a campaign of this name under these keys; also removes those that nobody has used for long.

    Args:
        store: One in a folder.
    """
    folder = store.local / FOLDER
    file = folder / f"{digest(_FORM, keys.identity, campaign)}.pack"
    with contextlib.suppress(OSError):
        if file.exists():
            os.utime(file)
        for old in sorted(folder.glob("*.pack"), key=lambda each: each.stat().st_mtime)[:-KEPT]:
            old.unlink(missing_ok=True)
    return MemberPack(store.local, file)


def _folder_stamp(place: str) -> list[int]:
    found = os.stat(place)
    return [found.st_mtime_ns, found.st_ctime_ns, found.st_ino]


def _stored(start: int, stop: int, content: str, artifacts: Sequence[Sequence[Any]]) -> Stored:
    recordings, trace, verdicts = (
        Artifact(key, {name: FileEntry(*entry) for name, entry in files.items()}, info)
        for key, files, info, _ in artifacts
    )
    return Stored(Block(recordings.key, start, stop, content), recordings, trace, verdicts)
