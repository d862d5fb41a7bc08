"""The store in a folder."""

import contextlib
import hashlib
import logging
import os
import shutil
import time
import uuid
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from vastflow.tasks.store import (
    MANIFEST,
    STAGES,
    WRITING_S,
    Artifact,
    Holding,
    Lost,
    StoreError,
    artifact_fault,
    artifact_of,
    entry_of,
    manifest_of,
)

LOGGER: Final = logging.getLogger("vastflow.store")

_TEMPORARY: Final = "temporary"
_TRIES: Final = 100
"""Others who write and remove can get in between as often as this before something else must be wrong."""


@dataclass(frozen=True, slots=True)
class LocalStore:
    """A store in a folder: an artifact is a directory that is moved into place whole."""

    root: Path

    @property
    def place(self) -> str:
        """See `Store.place`."""
        return str(self.root)

    @property
    def local(self) -> Path:
        """The store's folder itself, so that all is deleted together."""
        return self.root

    def survey(self) -> None:
        """Nothing: looking costs microseconds."""

    def changed(self, key: str) -> None:
        """Nothing: every look is a new one."""

    def find(self, key: str) -> Artifact | None:
        """See `Store.find`."""
        for last in (False, True):
            try:
                return self._found(key)
            except FileNotFoundError as error:
                if not os.path.exists(f"{self.root}/{key}"):
                    return None
                if last:  # at the first look another process may have been removing it, and another writing it anew
                    self.discard(key, f"no file {error.filename}")
            except OSError as error:
                raise self._unreadable(error) from None
            except (ValueError, KeyError, TypeError) as error:
                self.discard(key, str(error))
                return None
        return None

    def under(self, key: str) -> tuple[str, ...]:
        """See `Store.under`."""
        try:
            return tuple(sorted(os.listdir(f"{self.root}/{key}")))
        except (FileNotFoundError, NotADirectoryError):
            return ()
        except OSError as error:
            raise self._unreadable(error) from None

    def load(self, artifact: Artifact, name: str) -> bytes:
        """See `Store.load`."""
        try:
            content = _content(f"{self.root}/{artifact.key}/{name}")
        except FileNotFoundError:
            raise Lost(f"{artifact.key}: {name} went away") from None
        except OSError as error:
            raise self._unreadable(error) from None
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
            return _content(f"{self.root}/{key}/{name}")
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
        artifact = Artifact(key, {name: entry_of(content) for name, content in files.items()}, dict(info or {}))
        prepared = self._temporary()
        place = self.root / key
        try:
            prepared.mkdir(parents=True)
            for name, content in {**(sidecar or {}), **files, MANIFEST: manifest_of(artifact)}.items():
                (prepared / name).write_bytes(content)
        except OSError as error:
            shutil.rmtree(prepared, ignore_errors=True)
            raise self._unwritable(error) from None
        refused: OSError | None = None
        for _ in range(_TRIES):
            try:
                place.parent.mkdir(parents=True, exist_ok=True)
                prepared.rename(place)
                return artifact
            except OSError as error:  # somebody put this key, or removed a folder above it while it was empty
                refused = error
            if (kept := self._sound(key)) is not None:
                shutil.rmtree(prepared, ignore_errors=True)
                return kept
        shutil.rmtree(prepared, ignore_errors=True)
        raise self._unwritable(refused or OSError(0, f"{key} can't be moved into place"))

    def _found(self, key: str) -> Artifact:
        place = f"{self.root}/{key}"
        artifact = artifact_of(key, _content(f"{place}/{MANIFEST}"))
        for name, entry in artifact.files.items():
            if (found := os.stat(f"{place}/{name}").st_size) != entry.size:
                raise ValueError(f"{name} has {found} of {entry.size} bytes")
        return artifact

    def sweep(self) -> None:
        """Remove what killed writers left a day ago or longer."""
        for entry in (self.root / _TEMPORARY).iterdir():
            with contextlib.suppress(OSError):
                if time.time() - entry.stat().st_mtime > WRITING_S:
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
        """See `Store.discard`."""
        LOGGER.warning("%s is damaged and will be computed again: %s", key, why)
        self._take_away(key)

    def holdings(self) -> list[Holding]:
        """See `Store.holdings`."""
        return sorted(self._holdings(), key=lambda each: each.key)

    def _holdings(self) -> Iterator[Holding]:
        for stage in STAGES:
            for folder, _, names in os.walk(self.root / stage):
                files = [stat for name in names if (stat := _stat(f"{folder}/{name}")) is not None]
                if files:
                    key = Path(folder).relative_to(self.root).as_posix()
                    youngest_s = max(stat.st_mtime for stat in files)
                    yield Holding(key, sum(stat.st_size for stat in files), youngest_s, MANIFEST in names)

    def fault(self, key: str) -> str | None:
        """See `Store.fault`."""
        try:
            artifact = artifact_of(key, (self.root / key / MANIFEST).read_bytes())
            return artifact_fault(artifact, lambda name: (self.root / key / name).read_bytes())
        except FileNotFoundError:
            return f"{MANIFEST} is missing"
        except OSError as error:
            return f"{Path(error.filename or key).name} can't be read ({error.strerror})"
        except (ValueError, KeyError, TypeError) as error:
            return str(error)

    def remove(self, keys: Iterable[str]) -> None:
        """See `Store.remove`."""
        for key in keys:
            self._take_away(key)
            with contextlib.suppress(OSError):  # where something else lies they stay
                for folder in Path(key).parents[:-1]:
                    (self.root / folder).rmdir()

    def _take_away(self, key: str) -> None:
        aside = self._temporary()
        with contextlib.suppress(OSError):  # another process was first
            aside.parent.mkdir(exist_ok=True)
            (self.root / key).rename(aside)
        shutil.rmtree(aside, ignore_errors=True)

    def _temporary(self) -> Path:
        return self.root / _TEMPORARY / uuid.uuid4().hex

    def _unwritable(self, error: OSError) -> StoreError:
        return StoreError(
            f"store: can't write to {str(self.root)!r} ({error.strerror}); make room there or give another folder "
            f"with --store; what was finished is kept"
        )

    def _unreadable(self, error: OSError) -> StoreError:
        return StoreError(
            f"store: can't read {error.filename!r} ({error.strerror}); check the disk, or give another folder with --store"
        )


def open_local_store(root: Path) -> LocalStore:
    """The store in the folder `root`, made where there is none.

    Raises:
        StoreError: the folder can't be written.
    """
    try:
        (root / _TEMPORARY).mkdir(parents=True, exist_ok=True)
        probe = root / _TEMPORARY / uuid.uuid4().hex
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise StoreError(
            f"store: can't write to {str(root)!r} ({error.strerror}); give a folder of your own with --store"
        ) from None
    store = LocalStore(root)
    store.sweep()
    return store


def _content(path: str) -> bytes:
    """A file's content; pathlib and a buffer would take as long as the file system, several times a configuration."""
    with open(path, "rb", buffering=0) as file:
        return file.read()


def _stat(path: str) -> os.stat_result | None:
    try:
        return os.stat(path)
    except OSError:  # deleted meanwhile
        return None
