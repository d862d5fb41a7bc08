"""Layers that were asked for: executed in a process of their own, and kept in memory."""

import threading
import weakref
from concurrent.futures import Future
from pathlib import Path
from typing import Final

from vastflow.tasks.engine.executor import Priority
from vastflow.tasks.engine.pool import Pool

KEPT_RUNS: Final = 8
"""Runs whose compressed layers stay in memory, some megabytes each."""


def _prepared() -> None:
    # Imported where runs are executed: kernels would take the server two seconds and 150 MB.
    import vastflow.deployments.explorer.layers  # noqa: F401


def _layers(directory: Path, configuration: str, run_index: int) -> bytes:
    from vastflow.deployments.explorer.layers import compressed_layers

    return compressed_layers(directory, configuration, run_index)


class KeptLayers:
    """The layers of runs, executed in a process of their own; those of the last runs are kept."""

    def __init__(self) -> None:
        self._asked: dict[tuple[Path, str, int], Future[bytes]] = {}
        self._lock = threading.Lock()
        self._pool: Pool | None = None

    def prepare(self) -> None:
        """Start the process, so that it is ready when layers are asked for."""
        with self._lock:
            if self._pool is None:
                self._running().prepare(_prepared)

    def _running(self) -> Pool:
        if self._pool is None:
            self._pool = Pool(1)
            # At the interpreter's exit the pool ends by itself, before finalizers could ask for it.
            weakref.finalize(self, self._pool.close).atexit = False
        return self._pool

    def layers(self, directory: Path, configuration: str, run_index: int) -> "Future[bytes]":
        """Return the compressed layers of a run; the future may raise `UnusableDirectory` or `WorkerDied`."""
        key = directory, configuration, run_index
        with self._lock:
            known = self._asked.pop(key, None)
            if known is None or (known.done() and known.exception()):
                known = self._running().submit(_layers, *key, priority=Priority.EXECUTE)
            self._asked[key] = known
            if len(self._asked) > KEPT_RUNS:
                del self._asked[next(iter(self._asked))]
            return known
