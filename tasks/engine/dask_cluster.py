"""A Dask cluster as executor: its scheduler hands units to workers that share only the store with this machine.

Results are in the store; what comes back is small. Producers are evaluated on this machine, where the files that they make have to be.
`vastflow.tasks.engine.dask_worker` runs the units. Importing this module imports Dask.
"""

import functools
import hashlib
import logging
import os
import pickle
import queue
import threading
import time
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final
from urllib.request import urlopen

from vastflow.sim.model.files import Unreadable, read_json
from vastflow.tasks.engine import dask_worker
from vastflow.tasks.engine.bundle import Bundle, Packer
from vastflow.tasks.engine.dask_client import call_workers, pickled_error, plain_client
from vastflow.tasks.engine.dask_scheduler import LOCAL, OwnScheduler
from vastflow.tasks.engine.dask_worker import Answer, Message, OtherCode, identity, read_answer, run_unit, shared_value
from vastflow.tasks.engine.executor import ClusterError, Executor, PoolClosed, Priority, Shared, WorkerDied, end
from vastflow.tasks.engine.progress import Tally
from vastflow.tasks.store.store import Store, StoreError, store_address

CONNECT_S: Final = 20.0
AWAY_S: Final = 600.0
"""Time that the scheduler may be away, when the campaign begins and later."""

NO_WORKER_S: Final = 10.0
_WATCH_S: Final = 1.0
_END_S: Final = 2.0
_GROUP: Final = "vastflow"
_DASK: Final = logging.getLogger("distributed.client")
_SILENT: Final = "CommClosedError", "ConnectionRefusedError", "ConnectionResetError", "OSError", "TimeoutError"
_UNUSABLE: Final = TypeError, ValueError, LookupError
"""Errors of an address without a port, a file of something else, and missing certificates, at which waiting doesn't help."""


@dataclass(slots=True, eq=False)
class _Job:
    number: int
    message: bytes
    priority: Priority
    outcome: "Future[Any]" = field(default_factory=Future)
    future: Any = None
    sent: int = 0


class DaskCluster:
    """The executor of a Dask cluster; it connects when the first evaluation or unit comes.

    Args:
        address: `tcp://…`, `tls://…`, a scheduler file, or `local:N`.
        store: The store that the workers share.
        local: Evaluates producers.
        tally: Is given lines for the user, and the CPU time of workers that are no processes below this one.
        log: File that takes what workers of `local:N` print.
    """

    def __init__(self, address: str, store: Store, local: Executor, tally: Tally, log: Path | None = None) -> None:
        self.closed = False
        self._address = address
        self._place = store.place if store_address(store.place) else os.path.abspath(store.place)
        self._packer = Packer(store)
        self._local = local
        self._notice, self._spend = tally.notice, tally.spend
        self._lock = threading.RLock()
        self._client: Any = None
        self._error: ClusterError | None = None
        self._own = OwnScheduler(int(address.removeprefix(LOCAL)), log) if address.startswith(LOCAL) else None
        self._threads = 0
        self._before: Bundle | None = None
        self._open: dict[int, _Job] = {}
        self._suspects: list[_Job] = []
        self._numbers = 0
        self._connecting: threading.Thread | None = None
        self._landed: queue.SimpleQueue[tuple[_Job, Any]] = queue.SimpleQueue()
        self._seen_s: dict[Any, float] = {}
        self._told_dashboard = False
        self._refused: set[OtherCode] = set()
        # Of a scheduler that is away, Dask would print tracebacks; `_away` tells in one sentence.
        self._level = _DASK.level
        _DASK.setLevel(logging.CRITICAL)

    @property
    def workers(self) -> int:
        """Number of threads of the workers, at least one; workers may come and go."""
        return max(self._threads, 1)

    def submit(self, function: Callable[..., Any], /, *arguments: Any, priority: Priority) -> "Future[Any]":
        if priority is Priority.EVALUATE:
            with self._lock:
                self._connect()  # a cluster that is away or has no worker is told while this machine evaluates
            return self._local.submit(function, *arguments, priority=priority)
        try:
            unit = self._packer.packed((function, *arguments))
            message = pickle.dumps(Message(dask_worker.own_code()[0], self._place, unit, self._before))
        except Exception as error:  # noqa: BLE001 - what can't be sent is a fault of one configuration
            failed: Future[Any] = Future()
            failed.set_exception(error)
            return failed
        with self._lock:
            self._numbers += 1
            job = _Job(self._numbers, message, priority)
            job.outcome.add_done_callback(lambda outcome: self._forget(job) if outcome.cancelled() else None)
            if self.closed or self._error is not None:
                end(job.outcome, self._error or PoolClosed())
                return job.outcome
            self._open[job.number] = job
            if self._client is not None:
                self._send(job)
            self._connect()
        return job.outcome

    def shared(self, value: object) -> Shared:
        """See `Executor`; the value is in the store."""
        sha256 = self._packer.put(pickle.dumps(self._packer.packed(value)))
        return functools.partial(shared_value, self._place, sha256)

    def prepare(self, function: Callable[..., Any], /, *arguments: Any) -> "Future[Any]":
        """See `Executor`; each worker makes the call before its first unit."""
        self._before = self._packer.packed((function, *arguments))
        ready: Future[Any] = Future()
        ready.set_result(None)
        return ready

    def workers_table(self) -> list[dict[str, Any]]:
        """See `Executor`; a unit counts from the first table that has it."""
        client, now_s = self._client, time.time()
        if client is None:
            return []
        try:
            workers, processing = client.scheduler_info(n_workers=-1)["workers"], client.processing()
        except Exception:  # noqa: BLE001 - a scheduler that is away, of which `_watch` tells
            return []
        keys = {key for each in processing.values() for key in each}
        self._seen_s = {key: self._seen_s.get(key, now_s) for key in keys}
        busy_s = {
            worker: now_s - min(map(self._seen_s.__getitem__, each)) for worker, each in processing.items() if each
        }
        return [
            {
                "worker": str(about["name"]),
                "state": about["status"],
                "busy for": f"{busy_s[address]:.0f} s" if address in busy_s else "–",
                "heard": f"{max(now_s - about['last_seen'], 0.0):.0f} s ago",
                "CPU": f"{about['metrics'].get('cpu', 0.0):.0f} %",
                "memory": f"{about['metrics'].get('memory', 0) / 2**20:.0f} MiB",
            }
            for address, about in sorted(workers.items(), key=lambda each: -busy_s.get(each[0], -1.0))
        ]

    def rest(self) -> None:
        """See `Executor`; workers stay."""
        self._local.rest()

    def close(self) -> None:
        """See `Executor`; units under way on workers are interrupted."""
        with self._lock:
            if self.closed:
                return
            self.closed = True
            client, self._client = self._client, None
            jobs = [*self._open.values()]
            self._open.clear()
        for job in jobs:
            end(job.outcome, PoolClosed())
        if client is not None:
            with suppress(Exception):
                client.cancel([job.future for job in jobs if job.future is not None], asynchronous=False)
            with suppress(Exception):
                client.close(_END_S)
        _DASK.setLevel(self._level)  # not before: a client that is reconnecting when it is closed prints a traceback
        self._local.close()
        if self._own is not None:
            self._own.end()

    def _forget(self, job: _Job) -> None:
        with self._lock:
            self._open.pop(job.number, None)
            if job.future is not None:
                job.future.cancel()

    def _connect(self) -> None:
        """Connect from a thread where nothing is connected, and send all that is open then."""
        if self._client is None and self._connecting is None:
            self._connecting = threading.Thread(target=self._connected, name="vastflow cluster", daemon=True)
            self._connecting.start()

    def _connected(self) -> None:
        deadline_s, told = time.monotonic() + AWAY_S, False
        while not self.closed:
            try:
                client = self._opened()
            except ClusterError as error:
                self._fail(error)
                return
            except Exception as error:  # noqa: BLE001 - whatever a network raises
                if isinstance(error, _UNUSABLE) and not self._threads:
                    self._fail(ClusterError(f"--cluster: {self._address!r} can't be used ({_said(error)})"))
                    return
                if not told:
                    told = True
                    self._notice(f"{self._away(error)}. Waiting up to {AWAY_S:.0f} s")
                if time.monotonic() > deadline_s:
                    self._fail(ClusterError(f"{self._away(error)}. It did not come back within {AWAY_S:.0f} s"))
                    return
                time.sleep(_WATCH_S)
                continue
            with self._lock:
                self._connecting = None
                if self.closed:
                    _quietly(functools.partial(client.close, _END_S))
                    return
                self._client = client
                for job in self._open.values():
                    if job not in self._suspects[1:]:
                        self._send(job)
            threading.Thread(target=self._take, args=(client,), name="vastflow results", daemon=True).start()
            if not self._told_dashboard:
                self._told_dashboard = True
                with suppress(Exception), urlopen(client.dashboard_link, timeout=_END_S):
                    self._notice(f"Dask's dashboard: {client.dashboard_link}")  # without one there is an address, too
            self._watch(client)
            return

    def _away(self, error: Exception) -> str:
        return f"--cluster: no Dask scheduler answers at {self._address!r} ({_said(error)})"

    def _opened(self) -> Any:
        """Return a client of workers with this code.

        Raises:
            ClusterError: one of them has not.
        """
        address = self._scheduler()
        security = self._own.security if self._own else None
        client = plain_client(address, security, timeout=CONNECT_S, name=_GROUP)
        try:
            for worker, answer in call_workers(client, identity).items():
                silent, said = pickled_error(answer) if isinstance(answer, str) else ("", answer.get("exception_text"))
                if silent in _SILENT:  # it is dead or stopped, which the scheduler notices in its time
                    continue
                if said is not None:
                    raise ClusterError(
                        f"worker {worker} can't run this vastflow ({said}). Install the same version there."
                    )
                if answer["result"] != dask_worker.own_code()[0]:
                    raise ClusterError(self._other(OtherCode(worker, answer["result"])))
        except BaseException:
            client.close(_END_S)
            raise
        return client

    def _other(self, other: OtherCode) -> str:
        return (
            f"worker {other.worker} has other code ({other.code[:12]}) than this campaign ({dask_worker.own_code()[0][:12]}). Give all "
            "workers the same version of vastflow and its libraries, on one kind of machine."
        )

    def _scheduler(self) -> str:
        if self._own is not None:
            return self._own.address()
        file = Path(self._address)
        try:
            return str(read_json(file)["address"]) if file.is_file() else self._address
        except (Unreadable, LookupError, TypeError):
            raise ClusterError(f"--cluster: expected a file that a scheduler of Dask wrote, got {file}") from None

    def _watch(self, client: Any) -> None:
        """Count the workers that compute, as long as this client is in use, and free units of those that pause."""
        lonely_s, told, idle = time.monotonic() if self._threads else -NO_WORKER_S, False, frozenset[str]()
        while self._client is client:
            with suppress(Exception):
                workers = client.scheduler_info(n_workers=-1)["workers"]
                self._threads = sum(each["nthreads"] for each in workers.values() if each["status"] != "paused")
                if self._threads:
                    lonely_s, told = time.monotonic(), False
                    idle = self._free(client, workers, idle)
                elif time.monotonic() - lonely_s > NO_WORKER_S and not told:
                    told = True
                    self._notice(self._no_worker(len(workers)))
            time.sleep(_WATCH_S)

    def _no_worker(self, paused: int) -> str:
        if not paused:
            command = f"dask worker {self._address} --nthreads 1 --dashboard-address 127.0.0.1:0"
            return f"no worker at {self._address}. Start one, unless some are starting: {command}"
        return (
            f"all workers at {self._address} ({paused}) are paused by Dask, as they use more memory than their limit allows. "
            "Start others, or these anew, with a higher --memory-limit or with --memory-limit 0."
        )

    def _free(self, client: Any, workers: Mapping[str, Mapping[str, Any]], before: frozenset[str]) -> frozenset[str]:
        """Send the units again that wait on paused workers, where Dask leaves the last one (distributed #5235).

        Args:
            before: The last answer: what a worker executes is known only some time after it has begun.

        Returns:
            The paused workers that execute nothing.
        """
        idle = frozenset(
            address
            for address, each in workers.items()
            if each["status"] == "paused" and not each["metrics"]["task_counts"].get("executing")
        )
        if held := idle & before:
            waiting = {key for keys in client.processing([*held]).values() for key in keys}
            with self._lock:
                for job in [each for each in self._open.values() if each.future and each.future.key in waiting]:
                    there = job.future
                    self._send(job)
                    there.cancel()  # only now, as it is no longer the job's own, whose cancellation means a lost scheduler
        return idle

    def _send(self, job: _Job) -> None:
        job.sent += 1
        key = _GROUP, f"{hashlib.sha256(job.message).hexdigest()}-{job.number}-{job.sent}"
        with suppress(Exception):  # a client that has just lost its scheduler; all open jobs are sent to the next
            job.future = self._client.submit(
                run_unit, job.message, key=key, priority=-int(job.priority), pure=False, fifo_timeout="0 ms"
            )
            job.future.add_done_callback(lambda future: self._landed.put((job, future)))

    def _take(self, client: Any) -> None:
        """Take results as long as this client is in use, many at a time: each costs the scheduler a message."""
        while self._client is client:
            landed: list[tuple[_Job, Any]] = []
            with suppress(queue.Empty):
                landed.append(self._landed.get(timeout=_WATCH_S))
                while True:
                    landed.append(self._landed.get_nowait())
            # What a lost connection canceled when it closed has been sent again; what was canceled here is not open.
            landed = [(job, future) for job, future in landed if future is job.future and job.number in self._open]
            finished = {job: future for job, future in landed if future.status == "finished"}
            with suppress(Exception):  # a worker died with its results: each is asked for alone
                for job, result in zip(finished, client.gather([*finished.values()]), strict=True):
                    self._take_one(job, result, None)
                landed = [(job, future) for job, future in landed if job not in finished]
            for job, future in landed:
                try:
                    result, error = future.result(), None
                except Exception as raised:  # noqa: BLE001 - of the unit, or of the network
                    result, error = None, raised
                    if future.status != "error":
                        self._lost(client)
                        return
                self._take_one(job, result, error)

    def _take_one(self, job: _Job, text: Any, error: Exception | None) -> None:
        """Take the outcome of a job, or try again."""
        answer, killed = Answer(), False
        if error is not None:
            name, said = pickled_error(str(error))
            killed, error = name == "KilledWorker", RuntimeError(f"{name}, raised by Dask on its worker: {said}")
        else:
            try:
                answer = read_answer(text)
            except (ValueError, TypeError, LookupError) as wrong:
                said = " ".join(str(wrong).split())[:200]
                error = RuntimeError(f"a worker answered something else than this vastflow does ({said})")
        if self._own is None:  # else its workers are processes below this one
            self._spend(answer.cpu_s)
        with self._lock:
            if job.number not in self._open:
                return
            if answer.other is not None:
                if answer.other not in self._refused:  # units that are on their way come back, too
                    self._refused.add(answer.other)
                    self._notice(f"{self._other(answer.other)}. It gets no more units")
                with suppress(Exception):
                    self._client.retire_workers([answer.other.worker], close_workers=True)
                self._send(job)
                return
            if killed:
                if job not in self._suspects:
                    self._suspects.append(job)
                    if len(self._suspects) == 1:
                        self._send(job)
                    return
                error = WorkerDied("each worker process that ran this died, at last with no other suspect beside it")
            del self._open[job.number]
            if job in self._suspects:
                self._suspects.remove(job)
                if self._suspects:
                    self._send(self._suspects[0])
        if answer.unusable is not None:
            error = StoreError(answer.unusable)
        end(job.outcome, error, answer.executed or answer.broken or answer.value)

    def _lost(self, client: Any) -> None:
        """Reconnect to the scheduler or its successor at the same address, whose state is lost."""
        with self._lock:
            if self._client is not client or self.closed:
                return
            self._client = None
            for job in self._open.values():
                job.future = None
            threading.Thread(target=_quietly, args=(functools.partial(client.close, _END_S),), daemon=True).start()
            self._connect()

    def _fail(self, error: ClusterError) -> None:
        with self._lock:
            self._error = error
            jobs = [*self._open.values()]
            self._open.clear()
        for job in jobs:
            end(job.outcome, error)


def _said(error: Exception) -> str:
    return f"{type(error).__name__}: {' '.join(str(error).split())[:200]}"


def _quietly(call: Callable[[], Any]) -> None:
    with suppress(Exception):
        call()
