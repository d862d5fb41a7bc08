"""The store: results by the key of what they follow from. A cache: deleting it costs time, nothing else."""

import contextlib
import hashlib
import json
import logging
import os
import re
import shutil
import time
import uuid
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final, Protocol

from vastflow.sim.digest import digest

LOGGER: Final = logging.getLogger("vastflow.store")
MANIFEST: Final = "manifest"
VARIABLE: Final = "VASTFLOW_STORE"

_ABANDONED_S: Final = 24 * 3600.0
_TRIES: Final = 5
"""Another writer can get in between as often as this before something else must be wrong."""


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


class Store(Protocol):
    """Content-addressed artifacts. Every method may be called from any process at any time.

    A key is a path of names joined by `/`. `Lost` says that something has to be computed again.
    """

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


@dataclass(frozen=True, slots=True)
class LocalStore:
    """A store in a folder: an artifact is a directory that is moved into place whole."""

    root: Path

    def find(self, key: str) -> Artifact | None:
        """See `Store.find`."""
        place = f"{self.root}/{key}"  # pathlib would take as long as the file system, three times a configuration
        try:
            with open(f"{place}/{MANIFEST}", "rb") as file:
                artifact = _artifact(key, file.read())
            for name, entry in artifact.files.items():
                if (found := os.stat(f"{place}/{name}").st_size) != entry.size:
                    raise ValueError(f"{name} has {found} of {entry.size} bytes")
        except FileNotFoundError as error:
            if os.path.exists(place):
                self.discard(key, f"no file {error.filename}")
            return None
        except (ValueError, KeyError, TypeError) as error:
            self.discard(key, str(error))
            return None
        return artifact

    def under(self, key: str) -> tuple[str, ...]:
        """See `Store.under`."""
        try:
            return tuple(sorted(os.listdir(self.root / key)))
        except (FileNotFoundError, NotADirectoryError):
            return ()

    def load(self, artifact: Artifact, name: str) -> bytes:
        """See `Store.load`."""
        try:
            content = (self.root / artifact.key / name).read_bytes()
        except FileNotFoundError:
            raise Lost(f"{artifact.key}: {name} went away") from None
        if hashlib.sha256(content).hexdigest() != artifact.files[name].sha256:
            self.discard(artifact.key, f"{name} is not what was written")
            raise Lost(f"{artifact.key}: {name} is damaged")
        return content

    def read(self, key: str, name: str) -> bytes:
        """See `Store.read`."""
        artifact = self.find(key)
        if artifact is None or name not in artifact.files:
            raise Lost(f"{key}: {name} is not in the store")
        return self.load(artifact, name)

    def beside(self, key: str, name: str) -> bytes | None:
        """See `Store.beside`."""
        try:
            return (self.root / key / name).read_bytes()
        except OSError:
            return None

    def put(
        self,
        key: str,
        files: Mapping[str, bytes],
        info: Mapping[str, Any] | None = None,
        sidecar: Mapping[str, bytes] | None = None,
    ) -> Artifact:
        """See `Store.put`."""
        entries = {
            name: FileEntry(hashlib.sha256(content).hexdigest(), len(content)) for name, content in files.items()
        }
        artifact = Artifact(key, entries, dict(info or {}))
        prepared = self._temporary()
        prepared.mkdir(parents=True)
        for name, content in {**(sidecar or {}), **files, MANIFEST: _manifest(artifact)}.items():
            (prepared / name).write_bytes(content)
        place = self.root / key
        place.parent.mkdir(parents=True, exist_ok=True)
        for _ in range(_TRIES):
            with contextlib.suppress(OSError):  # a directory that isn't empty can't be replaced
                prepared.rename(place)
                return artifact
            if (kept := self._sound(key)) is not None:
                shutil.rmtree(prepared, ignore_errors=True)
                return kept
        raise StoreError(f"store: can't put {key} into {str(self.root)!r}")

    def sweep(self) -> None:
        """Remove what killed writers left a day ago or longer."""
        for entry in (self.root / "temporary").iterdir():
            with contextlib.suppress(OSError):
                if time.time() - entry.stat().st_mtime > _ABANDONED_S:
                    shutil.rmtree(entry, ignore_errors=True)

    def _sound(self, key: str) -> Artifact | None:
        artifact = self.find(key)
        if artifact is None:
            return None
        try:
            for name in artifact.files:
                self.load(artifact, name)
        except Lost:
            return None
        return artifact

    def discard(self, key: str, why: str) -> None:
        """Forget an artifact, so that it is computed again."""
        LOGGER.warning("%s is damaged and will be computed again: %s", key, why)
        aside = self._temporary()
        with contextlib.suppress(OSError):  # another process was first
            aside.parent.mkdir(exist_ok=True)
            (self.root / key).rename(aside)
        shutil.rmtree(aside, ignore_errors=True)

    def _temporary(self) -> Path:
        return self.root / "temporary" / uuid.uuid4().hex


def store_root(place: str | os.PathLike[str] | None = None) -> Path:
    """The store's folder: `place`, else the variable `VASTFLOW_STORE`, else the user's cache folder.

    Raises:
        StoreError: the place is an address and no local folder.
    """
    chosen = place or os.environ.get(VARIABLE)
    if chosen:
        if re.match(r"[A-Za-z][A-Za-z0-9+.-]+://", os.fspath(chosen)):
            raise StoreError(f"store: found {os.fspath(chosen)!r}; a local folder, this version reads no other place")
        return Path(chosen).expanduser().absolute()
    import platformdirs

    return Path(platformdirs.user_cache_dir("vastflow")) / "store"


def open_store(place: str | os.PathLike[str] | None = None) -> LocalStore:
    """The local store at `store_root(place)`, made where there is none.

    Raises:
        StoreError: the folder can't be written, or the place is an address.
    """
    root = store_root(place)
    try:
        (root / "temporary").mkdir(parents=True, exist_ok=True)
        probe = root / "temporary" / uuid.uuid4().hex
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise StoreError(
            f"store: can't write to {str(root)!r} ({error.strerror}); give a folder of your own with --store"
        ) from None
    store = LocalStore(root)
    store.sweep()
    return store


def _manifest(artifact: Artifact) -> bytes:
    """Two lines: SHA-256 of the second, and what is promised as JSON."""
    files = {name: asdict(entry) for name, entry in artifact.files.items()}
    promise = json.dumps({"files": files, "info": artifact.info}, sort_keys=True).encode()
    return hashlib.sha256(promise).hexdigest().encode() + b"\n" + promise


def _artifact(key: str, manifest: bytes) -> Artifact:
    hashed, _, promise = manifest.partition(b"\n")
    if hashlib.sha256(promise).hexdigest().encode() != hashed:
        raise ValueError(f"{MANIFEST} is not what was written")
    body = json.loads(promise)
    return Artifact(key, {name: FileEntry(**entry) for name, entry in body["files"].items()}, body["info"])
