"""The files of a store in a folder: an artifact is a directory that is moved into place whole.

This is the fast path round fsspec: a look takes microseconds, and each configuration needs several.
"""

import contextlib
import hashlib
import os
import shutil
import stat
import time
import uuid
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from io import FileIO
from pathlib import Path
from typing import Final

from vastflow.tasks.store.artifact import MANIFEST, Artifact, FileEntry, StoreError, present
from vastflow.tasks.store.files import WRITING_S, Listed

_TEMPORARY: Final = "temporary"


@dataclass(frozen=True, slots=True)
class FolderFiles:
    local: Path

    @property
    def place(self) -> str:
        return str(self.local)

    def prepare(self) -> None:
        """Make the folder, check that it can be written, and remove what killed writers left a day ago."""
        probe = self._temporary()
        try:
            probe.parent.mkdir(parents=True, exist_ok=True)
            probe.touch()
            probe.unlink()
        except OSError as error:
            raise StoreError(
                f"store: can't write to {self.place!r} ({error.strerror}). Give a folder of your own with --store."
            ) from None
        for entry in probe.parent.iterdir():
            with contextlib.suppress(OSError):
                if time.time() - entry.stat().st_mtime > WRITING_S:
                    shutil.rmtree(entry, ignore_errors=True)

    def look(self, key: str) -> Artifact | None:
        """One read and a stat for each file."""
        place = f"{self.local}/{key}"
        try:
            return present(key, _content(f"{place}/{MANIFEST}"), lambda name, _: os.stat(f"{place}/{name}").st_size)
        except FileNotFoundError:
            if os.path.exists(place):
                raise
            return None

    def everything(self) -> None:
        """Return None, since a single look costs microseconds."""

    def names(self, key: str) -> list[str]:
        try:
            return os.listdir(f"{self.local}/{key}")
        except (FileNotFoundError, NotADirectoryError):
            return []

    def read(self, key: str, name: str, entry: FileEntry | None = None) -> bytes:
        return _content(f"{self.local}/{key}/{name}")

    def measured(self, key: str, name: str, entry: FileEntry) -> FileEntry:
        """See `StoreFiles.measured`; a damaged file may be larger than memory."""
        with _opened(f"{self.local}/{key}/{name}") as file:
            size = os.fstat(file.fileno()).st_size
            return FileEntry(hashlib.file_digest(file, "sha256").hexdigest() if size == entry.size else "", size)

    def write(
        self, artifact: Artifact, files: Mapping[str, bytes], sidecar: Mapping[str, bytes], manifest: bytes
    ) -> StoreError | None:
        """Write to a temporary folder and rename that."""
        prepared, place = self._temporary(), self.local / artifact.key
        try:
            prepared.mkdir(parents=True)
            for name, content in {**sidecar, **files, MANIFEST: manifest}.items():
                (prepared / name).write_bytes(content)
        except OSError as error:
            shutil.rmtree(prepared, ignore_errors=True)
            raise self._unwritable(error) from None
        try:
            place.parent.mkdir(parents=True, exist_ok=True)
            prepared.rename(place)
        except OSError as error:  # somebody put this key, or removed a folder above it while it was empty
            shutil.rmtree(prepared, ignore_errors=True)
            return self._unwritable(error)
        return None

    def delete(self, keys: list[str]) -> None:
        """Move each artifact aside whole, then delete it and the empty folders above."""
        for key in keys:
            aside = self._temporary()
            with contextlib.suppress(OSError):  # another process was first
                aside.parent.mkdir(exist_ok=True)
                (self.local / key).rename(aside)
            shutil.rmtree(aside, ignore_errors=True)
            with contextlib.suppress(OSError):  # where something else lies they stay
                for folder in Path(key).parents[:-1]:
                    (self.local / folder).rmdir()

    def listed(self, stages: Iterable[str]) -> Iterator[Listed]:
        for stage in stages:
            for folder, _, names in os.walk(self.local / stage):
                key = Path(folder).relative_to(self.local).as_posix()
                for name in names:
                    with contextlib.suppress(OSError):  # deleted meanwhile
                        status = os.stat(f"{folder}/{name}")
                        yield Listed(key, name, status.st_size, status.st_mtime)

    def _unwritable(self, error: OSError) -> StoreError:
        return StoreError(
            f"store: can't write to {self.place!r} ({error.strerror}). Make room there or give another folder "
            "with --store. What was finished is kept."
        )

    def _temporary(self) -> Path:
        return self.local / _TEMPORARY / uuid.uuid4().hex


def _content(path: str) -> bytes:
    with _opened(path) as file:
        return file.read() or b""  # None of a file of the kernel that has nothing yet


def _opened(path: str) -> FileIO:
    """Open a regular file without waiting for a pipe's writer; pathlib and a buffer would double the time.

    Raises:
        ValueError: it is something else.
    """
    file = os.open(path, os.O_RDONLY | os.O_CLOEXEC | getattr(os, "O_NONBLOCK", 0))
    if not stat.S_ISREG(os.fstat(file).st_mode):
        os.close(file)
        raise ValueError(f"{os.path.basename(path)} is no regular file")
    return FileIO(file)
