"""Layers that were asked for: executed in a process of their own, and kept in memory."""

import threading
import weakref
from concurrent.futures import Future
from pathlib import Path
from typing import Any, Final

from vastflow.tasks.engine.executor import Priority
from vastflow.tasks.engine.pool import Pool

KEPT_RUNS: Final = 8
KEPT_BYTES: Final = 64_000_000
"""Most compressed layers in memory; the last ones are kept whatever their size."""


def _prepared() -> None:
    # Imported where runs are executed: kernels would take the server two seconds and 150 MB.
    import vastflow.deployments.explorer.layers  # noqa: F401


def _layers(directory: Path, configuration: str, run_index: int) -> bytes:
    from vastflow.deployments.explorer.layers import compressed_layers

    return compressed_layers(directory, configuration, run_index)


class KeptLayers:
    """The layers of runs, executed in a process of their own; those of the last runs are kept."""

    def __init__(self) -> None:
        self._asked: dict[tuple[Any, ...], Future[bytes]] = {}
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
        recordings = directory / "recordings" / f"{configuration}.parquet"
        try:
            written = recordings.stat().st_mtime_ns
        except OSError:
            written = 0  # a duplicate's are its original's
        key = directory, configuration, run_index, written
        with self._lock:
            known = self._asked.pop(key, None)
            if known is None or (known.done() and known.exception()):
                pool = self._running()
                known = pool.submit(_layers, directory, configuration, run_index, priority=Priority.EXECUTE)
            self._asked[key] = known
            self._shorten()
            return known

    def _shorten(self) -> None:
        """Forget the layers that were asked for longest ago, while there are too many."""
        sizes = {key: len(each.result()) for key, each in self._asked.items() if each.done() and not each.exception()}
        for key in [*sizes][:-1]:
            if len(sizes) <= KEPT_RUNS and sum(sizes.values()) <= KEPT_BYTES:
                return
            del self._asked[key], sizes[key]
