"""The file system below a store: files by the key of their artifact, read, written, and listed."""

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Final, NamedTuple, Protocol

from vastflow.tasks.store.artifact import Artifact, FileEntry, StoreError

WRITING_S: Final = 24 * 3600.0
"""Age below which a file may belong to a running campaign."""


class Listed(NamedTuple):
    """A file as its file system lists it; `written_s` counts from 1970."""

    key: str
    name: str
    size_bytes: int
    written_s: float


class StoreFiles(Protocol):
    """File system of a store. What can't be read raises an `OSError`, `FileNotFoundError` where it is not there."""

    @property
    def place(self) -> str:
        """See `Store.place`."""

    @property
    def local(self) -> Path:
        """See `Store.local`."""

    def prepare(self) -> None:
        """Make the place ready; raises `StoreError` where nothing can be written."""

    def look(self, key: str) -> Artifact | None:
        """Return the artifact of a key by its manifest and the sizes of its files.

        Raises:
            FileNotFoundError, ValueError: something lies there that is no whole artifact.
        """

    def everything(self) -> Iterator[tuple[str, Artifact | None]] | None:
        """Return every key with a manifest, and its artifact if it seems whole; None where single looks are as cheap."""

    def names(self, key: str) -> Iterable[str]:
        """Return the names of the artifacts directly below a key."""

    def read(self, key: str, name: str, entry: FileEntry | None = None) -> bytes:
        """Return a file of an artifact; without an entry the manifest or a sidecar."""

    def measured(self, key: str, name: str, entry: FileEntry) -> FileEntry:
        """Return a file's actual entry; the digest is omitted if the size differs from `entry`."""

    def write(
        self, artifact: Artifact, files: Mapping[str, bytes], sidecar: Mapping[str, bytes], manifest: bytes
    ) -> StoreError | None:
        """Let an artifact appear at one moment; return the error if something was in its place.

        Raises:
            StoreError: there is no room, or no right to write.
        """

    def delete(self, keys: list[str]) -> None:
        """Delete all entries below each key, manifests first."""

    def listed(self, stages: Iterable[str]) -> Iterator[Listed]:
        """List all files of some stages."""
