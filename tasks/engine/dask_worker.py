"""The worker side of a Dask cluster: workers check their code, prepare their machine, and run units.

A worker shares only the store with the campaign. Importing this module imports Dask.
"""

import ctypes
import functools
import os
import pickle
import platform
import sys
import threading
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import distributed
import locket
import platformdirs
from distributed.diagnostics.plugin import WorkerPlugin

from vastflow.sim.model.digest import digest
from vastflow.sim.plug_ins.effects import Interrupted
from vastflow.tasks.engine.bundle import Bundle, content_of
from vastflow.tasks.keys.keys import EXECUTE_SOURCE, JUDGE_SOURCE, OBSERVE_SOURCE, numeric_class
from vastflow.tasks.keys.source import installed_tree
from vastflow.tasks.store.source_files import SourceFiles
from vastflow.tasks.store.store import Store, StoreError, store_address

_PREPARING: Final = threading.Lock()
"""Threads of one worker: a cached function that two call at once is called twice."""
_READING: Final = threading.Lock()
"""The same; and before Python 3.11.8 and 3.12.2, source that two threads parse at once may raise SystemError."""


@dataclass(frozen=True, slots=True)
class Message:
    """A message to a worker.

    Attributes:
        code: Digest of the code that it must have.
        place: The store's.
        unit: Function and arguments.
        before: A call without which none is to be made; once for each machine.
    """

    code: str
    place: str
    unit: Bundle
    before: Bundle | None


@dataclass(frozen=True, slots=True)
class OtherCode:
    """The answer of a worker that has other code."""

    worker: str
    code: str


def own_code() -> tuple[str, SourceFiles]:
    """Return the digest of all that runs, traces, and verdicts follow from here, and its files."""
    with _READING:
        return _own_code()


@functools.lru_cache(maxsize=1)
def _own_code() -> tuple[str, SourceFiles]:
    tree = installed_tree()
    files = tree.files()
    stages = (tree.digest(*each) for each in (EXECUTE_SOURCE, OBSERVE_SOURCE, JUDGE_SOURCE))
    return digest(numeric_class(), *stages), files


@functools.lru_cache(maxsize=4)
def _store(place: str) -> Store:
    if store_address(place) is None and not os.path.isdir(place):
        right = "a folder that all machines share under one path, or an address such as s3://bucket/prefix"
        raise StoreError(f"store: {place!r} is not a folder on {platform.node()}; expected {right}")
    return Store(place, sources=own_code()[1])


@functools.lru_cache(maxsize=16)
def _shared(place: str, sha256: str) -> Bundle:
    bundle: Bundle = pickle.loads(content_of(_store(place), sha256))
    return bundle


def shared_value(place: str, sha256: str) -> Any:
    """Return the value of a bundle in the store, which is read once in a process."""
    return _shared(place, sha256).opened(_store(place))


def run_unit(message: bytes) -> Any:
    """Run a unit on a worker."""
    received: Message = pickle.loads(message)
    worker = distributed.get_worker()
    if worker.state.tasks[worker.active_threads[threading.get_ident()]].state == "cancelled":
        return None  # before it had a thread that could be interrupted
    if (own := own_code()[0]) != received.code:
        return OtherCode(worker.address, own)
    if received.before is not None:
        _prepared(received.before, received.place)
    function, *arguments = received.unit.opened(_store(received.place))
    return function(*arguments)


def _prepared(before: Bundle, place: str) -> None:
    with _PREPARING:
        _prepare_once(before, place)


@functools.lru_cache(maxsize=16)
def _prepare_once(before: Bundle, place: str) -> None:
    """Make a call once in this process, and not at the same time as another process of this machine."""
    folder = Path(platformdirs.user_cache_dir("vastflow"))
    folder.mkdir(parents=True, exist_ok=True)
    with locket.lock_file(str(folder / "kernels.lock")):
        function, *arguments = before.opened(_store(place))
        function(*arguments)


class UnitPlugin(WorkerPlugin):
    """Prepares workers, late ones included, and interrupts canceled units."""

    def __init__(self, name: str, before: bytes | None) -> None:
        self.name = name
        self._before = before

    def setup(self, worker: Any) -> None:
        """Begin the call that units need; a nanny gives up a worker that joins late (`--death-timeout`)."""
        self._worker = worker
        if self._before is not None:
            threading.Thread(target=self._prepare, args=(self._before,), name="vastflow prepares", daemon=True).start()

    def transition(self, key: Any, start: str, finish: str, **_: Any) -> None:
        """Interrupt a unit that was canceled while it ran."""
        # One plug-in of a worker does: a second interrupt would meet Dask's own code, and take the thread with it.
        first = next(each for each in self._worker.plugins.values() if isinstance(each, UnitPlugin))
        if first is self and start == "executing" and finish == "released":
            with self._worker.active_threads_lock:
                for thread, of_thread in self._worker.active_threads.items():
                    if of_thread == key:
                        interrupted = ctypes.py_object(Interrupted)
                        ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(thread), interrupted)

    @staticmethod
    def _prepare(message: bytes) -> None:
        received: Message = pickle.loads(message)
        with suppress(Exception):  # units make the call again, and tell
            if own_code()[0] == received.code and received.before is not None:
                _prepared(received.before, received.place)


def identity(dask_worker: Any) -> str:
    """Return the digest of a worker's code; Dask hands over the worker by the argument's name."""
    return own_code()[0]


def serve(workers: int) -> None:
    """Serve a cluster of this machine's own until standard input ends; prints the scheduler's address."""
    with distributed.LocalCluster(
        n_workers=workers, threads_per_worker=1, processes=True, dashboard_address=None, memory_limit=0
    ) as cluster:
        print(cluster.scheduler_address, flush=True)
        os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
        sys.stdin.buffer.read()
