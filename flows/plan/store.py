"""A store that is only looked at: what would be written stays in this process."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from vastflow.tasks.local_store import LocalStore
from vastflow.tasks.store import Artifact, Holding, Lost, Store, entry_of, store_address, store_root


class UntouchedFolder(LocalStore):
    """A local store, which need not exist: a damaged artifact stays where it is, and is as good as missing."""

    def discard(self, key: str, why: str) -> None:
        """Leave it."""


def untouched(place: str | None) -> Store:
    """The store at `place`, as `vastflow.tasks.store.open_store` has it, for looking only.

    Raises:
        StoreError: it can't be read.
    """
    if (address := store_address(place)) is None:
        return UntouchedFolder(store_root(place))
    from vastflow.tasks.object_store import ObjectStore

    class UntouchedObjects(ObjectStore):
        def discard(self, key: str, why: str) -> None:
            """Leave it."""

    store = UntouchedObjects(address)
    store.survey()
    return store


@dataclass
class Overlay:
    """A store over another one: what is put here is here only, and what is discarded here seems gone."""

    below: Store
    _put: dict[str, tuple[Artifact, Mapping[str, bytes]]] = field(default_factory=dict)
    _gone: set[str] = field(default_factory=set)

    @property
    def place(self) -> str:
        """Of the store below."""
        return self.below.place

    @property
    def local(self) -> Path:
        """Of the store below."""
        return self.below.local

    def survey(self) -> None:
        """See `Store.survey`."""
        self.below.survey()

    def changed(self, key: str) -> None:
        """See `Store.changed`."""
        self.below.changed(key)

    def find(self, key: str) -> Artifact | None:
        """See `Store.find`."""
        if key in self._put:
            return self._put[key][0]
        return None if key in self._gone else self.below.find(key)

    def under(self, key: str) -> tuple[str, ...]:
        """See `Store.under`."""
        return self.below.under(key)

    def load(self, artifact: Artifact, name: str) -> bytes:
        """See `Store.load`."""
        if artifact.key in self._put:
            return self._put[artifact.key][1][name]
        try:
            return self.below.load(artifact, name)
        except Lost:
            self._gone.add(artifact.key)
            raise

    def read(self, key: str, name: str) -> bytes:
        """See `Store.read`."""
        artifact = self.find(key)
        if artifact is None or name not in artifact.files:
            raise Lost(f"{key}: {name} is not in the store")
        return self.load(artifact, name)

    def beside(self, key: str, name: str) -> bytes | None:
        """See `Store.beside`."""
        return self.below.beside(key, name)

    def put(
        self,
        key: str,
        files: Mapping[str, bytes],
        info: Mapping[str, Any] | None = None,
        sidecar: Mapping[str, bytes] | None = None,
    ) -> Artifact:
        """See `Store.put`."""
        artifact = Artifact(key, {name: entry_of(content) for name, content in files.items()}, dict(info or {}))
        self._put[key] = artifact, dict(files)
        return artifact

    def discard(self, key: str, why: str) -> None:
        """Let it seem gone."""
        self._gone.add(key)

    def holdings(self) -> list[Holding]:
        """Of the store below."""
        return self.below.holdings()

    def fault(self, key: str) -> str | None:
        """Of an artifact of the store below."""
        return self.below.fault(key)

    def remove(self, keys: Iterable[str]) -> None:
        """Let them seem gone."""
        self._gone.update(keys)
