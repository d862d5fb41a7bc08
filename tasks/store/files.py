"""What a store asks of a file system: files by the key of their artifact, taken, given and listed."""

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Final, NamedTuple, Protocol

from vastflow.tasks.store.artifact import Artifact, FileEntry, StoreError

WRITING_S: Final = 24 * 3600.0
"""What is younger may be half of what a campaign is just writing."""


class Listed(NamedTuple):
    """A file as its file system lists it.

    Attributes:
        written_s: When it was written (s since 1970).
    """

    key: str
    name: str
    size_bytes: int
    written_s: float


class StoreFiles(Protocol):
    """How a file system takes, gives and lists the files of artifacts; what they promise is the store's affair.

    What can't be read raises an `OSError`, `FileNotFoundError` where it is not there.
    """

    @property
    def place(self) -> str:
        """See `Store.place`."""

    @property
    def local(self) -> Path:
        """See `Store.local`."""

    def prepare(self) -> None:
        """Make the place ready; raises `StoreError` where nothing can be written."""

    def look(self, key: str) -> Artifact | None:
        """The artifact of a key by its manifest and the sizes of its files.

        Raises:
            FileNotFoundError, ValueError, KeyError, TypeError: something lies there that is no whole artifact.
        """

    def everything(self) -> Iterator[tuple[str, Artifact | None]] | None:
        """Every key with a manifest, and its artifact if it seems whole; None where a single look is as cheap."""

    def names(self, key: str) -> Iterable[str]:
        """Names of the artifacts directly below a key."""

    def read(self, key: str, name: str, entry: FileEntry | None = None) -> bytes:
        """A file of an artifact; without an entry the manifest or a sidecar."""

    def measured(self, key: str, name: str, entry: FileEntry) -> FileEntry:
        """What a file is in fact, whose manifest says `entry`; without a digest where it has another size."""

    def write(
        self, artifact: Artifact, files: Mapping[str, bytes], sidecar: Mapping[str, bytes], manifest: bytes
    ) -> StoreError | None:
        """Let an artifact be there, all of it at one moment. The error, if something was in its place.

        Raises:
            StoreError: there is no room, or no right to write.
        """

    def delete(self, keys: list[str]) -> None:
        """Delete what lies under each key; an artifact ceases to be there before its files go."""

    def listed(self, stages: Iterable[str]) -> Iterator[Listed]:
        """All files of some stages."""
