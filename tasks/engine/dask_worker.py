"""The worker side of a Dask cluster: workers check their code, prepare their machine, and run units.

A worker's plug-in comes with its first unit. If the scheduler gave it, a worker that joins and can't import it would hang.

A worker shares only the store with the campaign. Importing this module imports Dask.
"""

import ctypes
import functools
import os
import pickle
import platform
import sys
import threading
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import distributed
import locket
import platformdirs
from distributed.diagnostics.plugin import WorkerPlugin
from pydantic import TypeAdapter

from vastflow.sim.model.digest import digest
from vastflow.sim.plug_ins.effects import Interrupted
from vastflow.tasks.engine.bundle import Bundle, content_of
from vastflow.tasks.engine.machine_check import check_folders
from vastflow.tasks.engine.work import Broken, Executed, broken
from vastflow.tasks.keys.keys import EXECUTE_SOURCE, JUDGE_SOURCE, OBSERVE_SOURCE, numeric_class
from vastflow.tasks.keys.source import installed_tree
from vastflow.tasks.store.artifact import artifact_of, inside, manifest_of
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


@dataclass(frozen=True, slots=True)
class Answer:
    """The answer of a worker, which is data and comes back as JSON: nothing that a worker says is unpickled.

    Attributes:
        unusable: Why the store, or a folder, can't be used.
        value: The result if it is neither `Executed` nor `Broken`.
        cpu_s: CPU time of the unit and what it waited for here, such as kernels; with threads, of all in the process.
    """

    executed: Executed | None = None
    broken: Broken | None = None
    other: OtherCode | None = None
    unusable: str | None = None
    value: Any = None
    cpu_s: float = 0.0


_ANSWERS: Final = TypeAdapter(Answer)


def write_answer(answer: Answer) -> bytes:
    return _ANSWERS.dump_json(answer)


def read_answer(text: str | bytes) -> Answer:
    """Read an answer; the artifacts in it are checked as if the store had given them.

    Raises:
        ValueError: it is something else, such as a pickle.
    """
    answer = _ANSWERS.validate_json(text)
    for artifact in answer.executed.artifacts if answer.executed else ():
        inside(Path(), artifact.key)
        artifact_of(artifact.key, manifest_of(artifact))
    return answer


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
        raise StoreError(f"store: {place!r} is not a folder. Expected {right}")
    check_folders()
    return Store(place, sources=own_code()[1])


@functools.lru_cache(maxsize=16)
def _shared(place: str, sha256: str) -> Bundle:
    bundle: Bundle = pickle.loads(content_of(_store(place), sha256))
    return bundle


def shared_value(place: str, sha256: str) -> Any:
    """Return the value of a bundle in the store, which is read once in a process."""
    return _shared(place, sha256).opened(_store(place))


def run_unit(message: bytes) -> bytes:
    """Run a unit on a worker, and return its `Answer`."""
    before_s = sum(os.times()[:4])
    return write_answer(replace(_answer(message), cpu_s=sum(os.times()[:4]) - before_s))


def _answer(message: bytes) -> Answer:
    received: Message = pickle.loads(message)
    worker = distributed.get_worker()
    if worker.state.tasks[worker.active_threads[threading.get_ident()]].state == "cancelled":
        return Answer()  # before it had a thread that could be interrupted
    if (own := own_code()[0]) != received.code:
        return Answer(other=OtherCode(worker.address, own))
    if Interrupting.name not in worker.plugins:
        worker.loop.add_callback(worker.plugin_add, Interrupting())
    try:
        store = _store(received.place)
        if received.before is not None:
            with _PREPARING:
                _prepare_once(received.before, received.place)
        function, *arguments = received.unit.opened(store)
        found = function(*arguments)
    except StoreError as error:
        return Answer(unusable=f"on {platform.node()}: {error}")
    except Exception as error:  # noqa: BLE001 - what can't be unpickled here, say
        found = broken(error)
    if isinstance(found, Executed):
        return Answer(executed=found)
    return Answer(broken=found) if isinstance(found, Broken) else Answer(value=found)


@functools.lru_cache(maxsize=16)
def _prepare_once(before: Bundle, place: str) -> None:
    """Make a call once in this process, and not at the same time as another process of this machine."""
    folder = Path(platformdirs.user_cache_dir("vastflow"))
    with locket.lock_file(str(folder / "kernels.lock")):
        function, *arguments = before.opened(_store(place))
        function(*arguments)


class Interrupting(WorkerPlugin):
    """Interrupts units that are canceled while they run."""

    name = "vastflow"

    def setup(self, worker: Any) -> None:
        self._worker = worker

    def transition(self, key: Any, start: str, finish: str, **_: Any) -> None:
        """Interrupt a unit that was canceled while it ran."""
        if start == "executing" and finish == "released":
            with self._worker.active_threads_lock:
                for thread, of_thread in self._worker.active_threads.items():
                    if of_thread == key:
                        interrupted = ctypes.py_object(Interrupted)
                        ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(thread), interrupted)


def identity() -> bytes:
    """Return the digest of a worker's code; Dask sends bytes as they are."""
    return own_code()[0].encode()


def serve(workers: int) -> None:
    """Serve a cluster of this machine's own until standard input, which begins with its pickled `Security`, ends.

    Prints the scheduler's address.
    """
    with distributed.LocalCluster(
        n_workers=workers,
        threads_per_worker=1,
        processes=True,
        dashboard_address=None,
        memory_limit=0,
        security=pickle.load(sys.stdin.buffer),
        protocol="tls://",
    ) as cluster:
        print(cluster.scheduler_address, flush=True)
        os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
        sys.stdin.buffer.read()
