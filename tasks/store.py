"""The store: results by the key of what they follow from. A cache: deleting it costs time, nothing else."""

import hashlib
import json
import os
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final, Protocol

from vastflow.sim.digest import digest

MANIFEST: Final = "manifest"
VARIABLE: Final = "VASTFLOW_STORE"
STAGES: Final = ("evaluate", "execute", "observe", "judge", "report", "parcel")
"""The first name of an artifact's key; a store's place may hold other things beside them."""

EARLIER: Final = "an earlier version of vastflow wrote it, without its key; it is never used"
"""What `Store.fault` says of an artifact whose manifest has no key: nothing tells whether it is in its place."""

WRITING_S: Final = 24 * 3600.0
"""What is younger may be half of what a campaign is just writing."""


class StoreError(OSError):
    """The store's place can't be used."""


class Lost(Exception):
    """An artifact is missing or damaged: it has to be computed again."""


@dataclass(frozen=True, slots=True)
class FileEntry:
    """A file of an artifact as its manifest has it."""

    sha256: str
    size: int


@dataclass(frozen=True, slots=True)
class Artifact:
    """What a manifest promises.

    Attributes:
        content: Digest of the names and contents of the files.
        info: Small facts of the content, there without reading it.
    """

    key: str
    files: Mapping[str, FileEntry]
    info: Mapping[str, Any]

    @property
    def content(self) -> str:
        """Digest of the files' names and contents."""
        return digest({name: entry.sha256 for name, entry in self.files.items()})


@dataclass(frozen=True, slots=True)
class Holding:
    """What lies under a key, by a look from outside.

    Attributes:
        size_bytes: Of all its files, manifest and sidecars too.
        written_s: When the youngest of them was written (s since 1970).
        whole: Whether it has a manifest; else it is what a writer has not finished.
    """

    key: str
    size_bytes: int
    written_s: float
    whole: bool

    @property
    def stage(self) -> str:
        """The stage that made it."""
        return self.key.partition("/")[0]


class Store(Protocol):
    """Content-addressed artifacts. Every method may be called from any process at any time.

    A key is a path of names joined by `/`. `Lost` says that something has to be computed again; every method raises
    `StoreError` if the place can't be used.
    """

    @property
    def place(self) -> str:
        """The folder or address, as a user would write it."""

    @property
    def local(self) -> Path:
        """Folder on this machine for what belongs to the store and is no artifact: environments, logs, Prefect's results."""

    def survey(self) -> None:
        """Where looking is slow, look once: `find` and `under` may answer from what is there now, until the next survey."""

    def changed(self, key: str) -> None:
        """Another process may have put or discarded `key`, or what is directly below: look there anew."""

    def find(self, key: str) -> Artifact | None:
        """The artifact of this key, if its manifest and all files are there in their sizes."""

    def under(self, key: str) -> tuple[str, ...]:
        """Names of the artifacts directly below `key`, sorted."""

    def load(self, artifact: Artifact, name: str) -> bytes:
        """A file of an artifact that was found, checked against its manifest.

        Raises:
            Lost: it is missing or damaged; a damaged artifact is gone afterwards.
        """

    def read(self, key: str, name: str) -> bytes:
        """Find and load a file of an artifact.

        Raises:
            Lost: as `load`, or there is none of this key.
        """

    def beside(self, key: str, name: str) -> bytes | None:
        """A sidecar of an artifact, if it is there; nothing vouches for it."""

    def put(
        self,
        key: str,
        files: Mapping[str, bytes],
        info: Mapping[str, Any] | None = None,
        sidecar: Mapping[str, bytes] | None = None,
    ) -> Artifact:
        """Keep an artifact and give what is kept: an undamaged one that is already there stays.

        Args:
            info: See `Artifact`; JSON values.
            sidecar: Files beside it that are outside every digest, such as a run log.
        """

    def discard(self, key: str, why: str) -> None:
        """Forget a damaged artifact, with a line in the log, so that it is computed again."""

    def holdings(self) -> list[Holding]:
        """All artifacts, and what looks like one that is not finished, by key."""

    def fault(self, key: str) -> str | None:
        """What is wrong with an artifact, every file read; None if nothing. It stays as it is."""

    def remove(self, keys: Iterable[str]) -> None:
        """Delete what lies under each of the keys."""


def entry_of(content: bytes) -> FileEntry:
    """What a manifest says of a file."""
    return FileEntry(hashlib.sha256(content).hexdigest(), len(content))


def manifest_of(artifact: Artifact) -> bytes:
    """Two lines: SHA-256 of the second, and what is promised as JSON, under which key."""
    files = {name: asdict(entry) for name, entry in artifact.files.items()}
    promise = json.dumps({"files": files, "info": artifact.info, "key": artifact.key}, sort_keys=True).encode()
    return hashlib.sha256(promise).hexdigest().encode() + b"\n" + promise


def artifact_of(key: str, manifest: bytes) -> Artifact:
    """The artifact that a manifest promises.

    Raises:
        ValueError: it is not what was written, or not under this key.
    """
    hashed, _, promise = manifest.partition(b"\n")
    if hashlib.sha256(promise).hexdigest().encode() != hashed:
        raise ValueError(f"{MANIFEST} is not what was written")
    body = json.loads(promise)
    if "key" not in body:
        raise ValueError(EARLIER)
    if body["key"] != key:
        raise ValueError(f"it is a copy of {body['key']}")
    return Artifact(key, {name: FileEntry(**entry) for name, entry in body["files"].items()}, body["info"])


def artifact_fault(artifact: Artifact, content: Callable[[str], bytes]) -> str | None:
    """What is wrong with the files of an artifact, `content` giving each by name; None if nothing."""
    for name, entry in artifact.files.items():
        try:
            found = entry_of(content(name))
        except FileNotFoundError:
            return f"{name} is missing"
        if found != entry:
            return f"{name} is not what was written"
    return None


def store_address(place: str | os.PathLike[str] | None = None) -> str | None:
    """The address of a store that is no local folder: `place`, else the variable `VASTFLOW_STORE`; None for a folder."""
    chosen = os.fspath(place or os.environ.get(VARIABLE) or "")
    return chosen if is_address(chosen) else None


def is_address(place: str) -> bool:
    """Whether a place is an address such as `s3://bucket/prefix`, and no local folder."""
    return re.match(r"(?!file:)[A-Za-z][A-Za-z0-9+.-]+://", place) is not None


def store_root(place: str | os.PathLike[str] | None = None) -> Path:
    """A local store's folder: `place`, else the variable `VASTFLOW_STORE`, else the user's cache folder.

    Raises:
        StoreError: the place is an address and no local folder.
    """
    if (address := store_address(place)) is not None:
        raise StoreError(f"store: found {address!r}; a local folder")
    if chosen := place or os.environ.get(VARIABLE):
        return Path(os.fspath(chosen).removeprefix("file://")).expanduser().absolute()
    import platformdirs

    return Path(platformdirs.user_cache_dir("vastflow")) / "store"


def open_store(place: str | os.PathLike[str] | None = None) -> Store:
    """The store at `place`, else at the variable `VASTFLOW_STORE`, else in the user's cache folder.

    A folder is made where there is none. An address such as `s3://bucket/prefix` is any that fsspec knows.

    Raises:
        StoreError: it can't be written.
    """
    if (address := store_address(place)) is not None:
        from vastflow.tasks.object_store import open_object_store  # a third of a second, for those who need it

        return open_object_store(address)
    from vastflow.tasks.local_store import open_local_store

    return open_local_store(store_root(place))
