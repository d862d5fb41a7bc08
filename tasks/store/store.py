"""The store: results by the key of what they follow from. A cache: deleting it costs time, nothing else."""

import copy
import functools
import logging
import os
import re
import threading
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, Final, Self

from vastflow.tasks.store.artifact import (
    MANIFEST,
    Artifact,
    Holding,
    Lost,
    StoreError,
    artifact_of,
    entry_of,
    info_text,
    manifest_of,
)
from vastflow.tasks.store.files import WRITING_S, Listed, StoreFiles
from vastflow.tasks.store.folder_files import FolderFiles
from vastflow.tasks.store.source_files import SourceFiles

__all__ = ["MANIFEST", "STAGES", "WRITING_S", "Artifact", "Holding", "Lost", "Store", "StoreError", "open_store"]
__all__ += ["is_address", "store_address", "store_root"]

LOGGER: Final = logging.getLogger("vastflow.store")

VARIABLE: Final = "VASTFLOW_STORE"
STAGES: Final = ("evaluate", "search", "execute", "observe", "judge", "bundle", "rows", "report")
"""The first name of an artifact's key; a store's place may hold other things beside them."""

_TRIES: Final = 100
"""Retries before concurrent changes count as an error."""


class Listing:
    """Artifacts that one listing of the whole store found, kept up to date by what this process does and hears."""

    def __init__(self, artifacts: Iterable[Artifact]) -> None:
        self._lock = threading.Lock()
        self._folders: dict[str, dict[str, Artifact]] = {}
        self._changed: set[str] = set()
        for artifact in artifacts:
            self.add(artifact)

    def find(self, key: str, look: Callable[[str], Artifact | None]) -> Artifact | None:
        """Return the artifact of a key; `look` is asked where another process may have changed it."""
        folder, _, name = key.rpartition("/")
        with self._lock:
            artifact = self._folders.get(folder, {}).get(name)
            if artifact is not None or self._changed.isdisjoint((key, folder)):
                return artifact
        if (artifact := look(key)) is not None:
            self.add(artifact)
        return artifact

    def under(self, key: str, look: Callable[[str], Iterable[str]]) -> Iterable[str]:
        """Return the names of the artifacts directly below a key; `look` is asked as in `find`."""
        with self._lock:
            if key not in self._changed:
                return tuple(self._folders.get(key, ()))
        return look(key)

    def add(self, artifact: Artifact) -> None:
        folder, _, name = artifact.key.rpartition("/")
        with self._lock:
            self._folders.setdefault(folder, {})[name] = artifact

    def drop(self, key: str) -> None:
        """Remove an artifact."""
        folder, _, name = key.rpartition("/")
        with self._lock:
            self._folders.get(folder, {}).pop(name, None)

    def changed(self, key: str) -> None:
        """Forget a key and the entries directly below it."""
        self.drop(key)
        with self._lock:
            self._folders.pop(key, None)
            self._changed.add(key)


class Store:
    """Content-addressed artifacts in a folder or at an address that fsspec knows, such as `s3://bucket/prefix`.

    A key is a path of names joined by `/`. Every method is safe in any thread or process, and raises `StoreError` if the
    place can't be used. A store can be pickled; its listing stays behind.

    Args:
        place: See `open_store`, which also checks that it can be written.
        read_only: Write and delete nothing: what is put stays in this object, what is damaged seems gone.
        sources: Source files of the keys; a process that imported others finds and keeps nothing.

    Attributes:
        unwritable: Why it is only read although it was to be written; None otherwise.
    """

    def __init__(
        self,
        place: str | os.PathLike[str] | None = None,
        *,
        read_only: bool = False,
        sources: SourceFiles | None = None,
    ) -> None:
        self.unwritable: StoreError | None = None
        self._files = _files(place)
        self._read_only = read_only
        self._sources = sources
        self._listing: Listing | None = None
        self._held: dict[str, tuple[Artifact, Mapping[str, bytes]]] = {}
        self._gone: set[str] = set()

    def __reduce__(self) -> tuple[Any, ...]:
        return functools.partial(Store, read_only=self._read_only, sources=self._sources), (self.place,)

    def for_sources(self, sources: SourceFiles | None) -> Self:
        """Return this store for computations by these sources only."""
        store = copy.copy(self)
        store._sources = sources
        return store

    @property
    def place(self) -> str:
        """The folder or address, as a user would write it."""
        return self._files.place

    @property
    def local(self) -> Path:
        """Folder on this machine for environments and logs: the store's own folder where it has one."""
        return self._files.local

    def refresh(self) -> None:
        """List a remote store once, so that `find` and `under` need no requests until the next one."""
        if (found := self._files.everything()) is not None:
            # A long listing may have the manifest of what another process writes meanwhile, and not its files.
            looked = (artifact or self._look(key) for key, artifact in found)
            self._listing = Listing(artifact for artifact in looked if artifact is not None)

    def changed(self, key: str) -> None:
        """Refresh `key` and the entries directly below it, as other processes may have changed them."""
        if self._listing is not None:
            self._listing.changed(key)

    def learn(self, artifacts: Iterable[Artifact]) -> None:
        """Add artifacts to the listing that another process reports as stored."""
        if self._listing is not None:
            for artifact in artifacts:
                self._listing.add(artifact)

    def find(self, key: str) -> Artifact | None:
        """Return the artifact of this key, if its manifest and all files are there in their sizes."""
        if self._sources is not None:
            self._sources.check()  # nothing is begun that could not be put
        if key in self._held:
            return self._held[key][0]
        if key in self._gone:
            return None
        return self._look(key) if self._listing is None else self._listing.find(key, self._look)

    def under(self, key: str) -> tuple[str, ...]:
        """Return the names of the artifacts directly below `key`, sorted."""
        names = self._files.names
        try:
            return tuple(sorted(names(key) if self._listing is None else self._listing.under(key, names)))
        except OSError as error:
            raise _unreadable(error) from None

    def load(self, artifact: Artifact, name: str) -> bytes:
        """Return a file of an artifact, checked against its manifest.

        Raises:
            Lost: it is missing or damaged; a damaged artifact is gone afterwards.
        """
        key, entry = artifact.key, artifact.files.get(name)
        if key in self._held and entry is not None:
            return self._held[key][1][name]
        try:
            content = b"" if entry is None else self._files.read(key, name, entry)
        except FileNotFoundError:
            self.changed(key)
            raise Lost(f"{key}: {name} went away") from None
        except ValueError as error:
            self.discard(key, str(error))
            raise Lost(f"{key}: {error}") from None
        except OSError as error:
            raise _unreadable(error) from None
        if entry_of(content) != entry:
            self.discard(key, f"{name} is not what was written")
            raise Lost(f"{key}: {name} is damaged")
        return content

    def read(self, key: str, name: str) -> bytes:
        """Find and load a file of an artifact.

        Raises:
            Lost: as `load`, or there is none of this key.
        """
        artifact = self.find(key)
        if artifact is None:
            raise Lost(f"{key}: {name} is not in the store")
        return self.load(artifact, name)

    def beside(self, key: str, name: str) -> bytes | None:
        """Return a sidecar of an artifact, unchecked, if it is there."""
        try:
            return self._files.read(key, name)
        except StoreError:
            raise
        except (OSError, ValueError):
            return None

    def put(
        self,
        key: str,
        files: Mapping[str, bytes],
        info: Mapping[str, Any] | None = None,
        sidecar: Mapping[str, bytes] | None = None,
    ) -> Artifact:
        """Store an artifact and return the stored one; an undamaged earlier one stays.

        Args:
            info: See `Artifact`; JSON values.
            sidecar: Files beside it that are outside every digest, such as a run log.

        Raises:
            StoreError: this process imported other source than the store is for.
        """
        if self._sources is not None:
            self._sources.check()
        artifact = Artifact(key, {name: entry_of(content) for name, content in files.items()}, info_text(info or {}))
        if self._read_only:
            self._held[key] = artifact, dict(files)
            return artifact
        manifest = manifest_of(artifact)
        for left in reversed(range(_TRIES)):
            kept = self._sound(key)
            refused = None if kept is not None else self._files.write(artifact, files, sidecar or {}, manifest)
            if refused is None:
                break
            if not left:
                raise refused
        kept = kept or artifact
        if self._listing is not None:
            self._listing.add(kept)
        return kept

    def discard(self, key: str, why: str) -> None:
        """Remove a damaged artifact, with a line in the log, so that it is computed again."""
        if not self._read_only:
            LOGGER.warning("%s is damaged and will be computed again: %s", key, why)
        self.remove([key])

    def holdings(self) -> list[Holding]:
        """Return all artifacts and unfinished ones, by key."""
        folders: dict[str, list[Listed]] = {}
        for file in self._files.listed(STAGES):
            folders.setdefault(file.key, []).append(file)
        return [
            Holding(
                key,
                sum(file.size_bytes for file in files),
                max(file.written_s for file in files),
                any(file.name == MANIFEST for file in files),
            )
            for key, files in sorted(folders.items())
        ]

    def fault(self, key: str) -> str | None:
        """Read every file of an artifact, and return its damage or None; nothing is changed."""
        name = MANIFEST
        try:
            artifact = artifact_of(key, self._files.read(key, MANIFEST))
            for name, entry in artifact.files.items():
                if self._files.measured(key, name, entry) != entry:
                    return f"{name} is not what was written"
        except FileNotFoundError:
            return f"{name} is missing"
        except StoreError:
            raise
        except OSError as error:
            return f"{name} can't be read ({error.strerror})"
        except ValueError as error:
            return str(error)
        return None

    def remove(self, keys: Iterable[str]) -> None:
        """Delete all entries below each key."""
        chosen = list(keys)
        if self._read_only:
            self._gone.update(chosen)
            return
        self._files.delete(chosen)
        if self._listing is not None:
            for key in chosen:
                self._listing.drop(key)

    def _look(self, key: str) -> Artifact | None:
        """Return the current artifact; discard a damaged one."""
        for last in (False, True):
            try:
                return self._files.look(key)
            except FileNotFoundError as error:
                if last:  # at the first look another process may have been removing it, and another writing it anew
                    self.discard(key, f"no file {error.filename}")
            except OSError as error:
                raise _unreadable(error) from None
            except ValueError as error:
                self.discard(key, str(error))
                return None
        return None

    def _sound(self, key: str) -> Artifact | None:
        """Return the artifact of this key if every byte of it is there."""
        if (artifact := self._look(key)) is None:
            return None
        try:
            for name in artifact.files:
                self.load(artifact, name)
        except Lost:
            return None
        return artifact


def store_address(place: str | os.PathLike[str] | None = None) -> str | None:
    """Return the address of a remote store: `place`, else the variable `VASTFLOW_STORE`; None for a folder."""
    chosen = os.fspath(place or os.environ.get(VARIABLE) or "")
    return chosen if is_address(chosen) else None


def is_address(place: str) -> bool:
    """Whether a place is an address such as `s3://bucket/prefix`, and no local folder."""
    return re.match(r"(?!file:)[A-Za-z][A-Za-z0-9+.-]+://", place) is not None


def store_root(place: str | os.PathLike[str] | None = None) -> Path:
    """Return a local store's folder: `place`, else the variable `VASTFLOW_STORE`, else the user's cache folder.

    Raises:
        StoreError: the place is an address and no local folder.
    """
    if (address := store_address(place)) is not None:
        raise StoreError(f"store: expected a local folder, got {address!r}")
    if chosen := place or os.environ.get(VARIABLE):
        return Path(os.fspath(chosen).removeprefix("file://")).expanduser().absolute()
    import platformdirs

    return Path(platformdirs.user_cache_dir("vastflow")) / "store"


def open_store(
    place: str | os.PathLike[str] | None = None, *, read_only: bool = False, may_be_full: bool = False
) -> Store:
    """Open the store at `place`, else at the variable `VASTFLOW_STORE`, else in the user's cache folder.

    A missing folder is made, unless it is only read. An address is any that fsspec knows, such as `s3://bucket/prefix`.

    Args:
        may_be_full: Only read a store that can't be written: nothing may be missing in it.

    Raises:
        StoreError: it can't be written.
    """
    address = store_address(place)
    if address is not None and address.startswith("memory:"):
        raise StoreError(
            f"store: expected a folder, or s3://bucket/prefix, got {address!r}, which no other process sees"
        )
    store = Store(place, read_only=read_only)
    if not read_only:
        try:
            store._files.prepare()
        except StoreError as error:
            # What is no folder, or a network that is away, can't be read either.
            readable = store.local.is_dir() if address is None else isinstance(error.__context__, PermissionError)
            if not (may_be_full and readable):
                raise
            store = Store(place, read_only=True)
            store.unwritable = error
    return store


def _files(place: str | os.PathLike[str] | None) -> StoreFiles:
    if (address := store_address(place)) is None:
        return FolderFiles(store_root(place))
    from vastflow.tasks.store.remote_files import RemoteFiles  # a third of a second, for those who need it

    return RemoteFiles(address)


def _unreadable(error: OSError) -> StoreError:
    if isinstance(error, StoreError):
        return error
    return StoreError(
        f"store: can't read {error.filename!r} ({error.strerror}). Check the disk, or give another folder with --store."
    )
