"""A survey: what one listing of a store found, and what has been learnt since."""

import threading
from collections.abc import Iterable

from vastflow.tasks.artifact import Artifact


class Survey:
    """Artifacts by key. What is known to be there stays known until somebody says otherwise.

    Args:
        artifacts: All that were there.
    """

    def __init__(self, artifacts: Iterable[Artifact]) -> None:
        self._lock = threading.Lock()
        self._artifacts: dict[str, Artifact] = {}
        self._below: dict[str, set[str]] = {}
        self._changed: set[str] = set()
        for artifact in artifacts:
            self._add(artifact)

    def knows(self, key: str) -> bool:
        """Whether `find` is to be believed of this key."""
        with self._lock:
            return key in self._artifacts or self._changed.isdisjoint((key, _home(key)))

    def knows_under(self, key: str) -> bool:
        """Whether `under` is to be believed of this key."""
        with self._lock:
            return key not in self._changed

    def find(self, key: str) -> Artifact | None:
        """The artifact of this key, if it is there."""
        with self._lock:
            return self._artifacts.get(key)

    def under(self, key: str) -> tuple[str, ...]:
        """Names of the artifacts directly below `key`, sorted."""
        with self._lock:
            return tuple(sorted(self._below.get(key, ())))

    def add(self, artifact: Artifact) -> None:
        """An artifact is there."""
        with self._lock:
            self._add(artifact)

    def drop(self, key: str) -> None:
        """An artifact is gone."""
        with self._lock:
            self._drop(key)

    def changed(self, key: str) -> None:
        """Nothing is known any more of `key` and of what is directly below."""
        with self._lock:
            for name in list(self._below.get(key, ())):
                self._drop(f"{key}/{name}")
            self._drop(key)
            self._changed.add(key)

    def _add(self, artifact: Artifact) -> None:
        home = _home(artifact.key)
        self._artifacts[artifact.key] = artifact
        self._below.setdefault(home, set()).add(artifact.key[len(home) + 1 :])

    def _drop(self, key: str) -> None:
        home = _home(key)
        if self._artifacts.pop(key, None) is not None:
            self._below[home].discard(key[len(home) + 1 :])


def _home(key: str) -> str:
    return key.rpartition("/")[0]
