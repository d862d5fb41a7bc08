"""The worker pool: long-lived processes below one priority queue, for a whole campaign.

One thread owns all state; everything reaches it through a queue. Workers know nothing of Prefect and need no `__main__` guard
in a user's script (loky). At most two jobs a worker are handed on at a time, so that a job of higher priority overtakes those
that wait. One worker starts with the first job, the others once they pay.
"""

import heapq
import itertools
import os
import queue
import signal
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future, InvalidStateError
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from dataclasses import dataclass, field
from enum import IntEnum
from pathlib import Path
from typing import Any, Final, TypeAlias

import loky


def cores() -> int:
    """Return the number of processors this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


TRIES: Final = 3
"""Attempts at a job whose worker died, the last one alone in a process of its own."""

MANY: Final = 4
"""Waiting jobs per worker with which all workers start at once."""

FIRST_ANSWER_S: Final = 20.0
"""Time without an answer of the first worker after which the others start."""

_IN_FLIGHT_PER_WORKER: Final = 2
_WATCH_S: Final = 0.5

WORKER_ENVIRONMENT: Final = {
    # One worker a core: threads inside a worker would only compete, and change sums with their number.
    **dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1"),
    # Prepared maps are kept in a worker on purpose; loky would take 0.3 GB for a leak and begin anew.
    "LOKY_MAX_MEMORY_LEAK_SIZE": "4e9",
}


class Priority(IntEnum):
    """Priorities of jobs: the nearest to a verdict goes first."""

    EVALUATE = 0
    JUDGE = 1
    OBSERVE = 2
    EXECUTE = 3


class WorkerDied(RuntimeError):
    """The process of a job died each time, at last with this job alone."""


class PoolClosed(RuntimeError):
    """The pool was closed before this job was done."""

    def __init__(self) -> None:
        super().__init__("the campaign was ended before this was computed")


class Pool:
    """Worker processes with priorities; it outlives the death of its workers.

    Args:
        workers: Most processes.
        log: File that takes what workers print.
    """

    def __init__(self, workers: int, log: Path | None = None) -> None:
        self.workers = workers
        self._inbox: queue.SimpleQueue[_Message] = queue.SimpleQueue()
        self._numbers = itertools.count()
        self._closed = threading.Event()
        owner = _Owner(self._inbox, workers, log)
        self._thread = threading.Thread(target=owner.run, name="vastflow pool", daemon=True)
        self._thread.start()

    @property
    def closed(self) -> bool:
        """True if it takes no more jobs."""
        return self._closed.is_set()

    def submit(self, priority: Priority, function: Callable[..., Any], /, *arguments: Any) -> "Future[Any]":
        """Queue a call of a module-level function.

        The future ends with its result, its exception, `WorkerDied`, or `PoolClosed`.
        """
        job = _Job(priority, next(self._numbers), function, arguments)
        self._inbox.put(job)
        if self._closed.is_set():  # nobody may read the inbox any more
            job.end(PoolClosed())
        return job.outcome

    def rest(self) -> None:
        """Let idle workers go, if no job is open; the next job starts new ones."""
        self._inbox.put(_Rest())

    def close(self, timeout_s: float = 3.0) -> None:
        """Kill the workers and end all open jobs with `PoolClosed`. May be called twice."""
        self._closed.set()
        self._inbox.put(None)
        self._thread.join(timeout_s)


@dataclass(order=True)
class _Job:
    priority: int
    number: int
    function: Callable[..., Any] = field(compare=False)
    arguments: tuple[Any, ...] = field(compare=False)
    outcome: "Future[Any]" = field(default_factory=Future, compare=False)
    tries: int = field(default=0, compare=False)
    began_s: float = field(default=0.0, compare=False)

    def end(self, error: BaseException | None, result: Any = None) -> None:
        with suppress(InvalidStateError):  # closing may overtake a result
            if error is None:
                self.outcome.set_result(result)
            else:
                self.outcome.set_exception(error)


class _Lane:
    """An executor with its number of jobs."""

    def __init__(self, workers: int, log: Path | None) -> None:
        self._workers = workers
        self._log = log
        self._in_flight = 0
        self._executor = self._new()

    @property
    def idle(self) -> bool:
        """True if a worker has nothing to do."""
        return self._in_flight < self._workers

    @property
    def free(self) -> bool:
        """True if one more job may wait for a worker."""
        return self._in_flight < _IN_FLIGHT_PER_WORKER * self._workers

    def start(self, job: _Job, inbox: "queue.SimpleQueue[_Message]") -> None:
        self._in_flight += 1
        try:
            future = self._executor.submit(job.function, *job.arguments)
        except BrokenProcessPool:  # what was on it is under way here; this job wasn't
            self._executor = self._new()
            future = self._executor.submit(job.function, *job.arguments)
        executor = self._executor
        future.add_done_callback(lambda done: inbox.put(_Done(job, self, executor, done)))

    def landed(self, broken: Any) -> None:
        """Count a job that came back; `broken` is the executor that broke under it, if one did."""
        self._in_flight -= 1
        if self._executor is broken:
            self._executor = self._new()

    def kill(self) -> None:
        self._executor.shutdown(wait=True, kill_workers=True)

    def _new(self) -> Any:
        return loky.ProcessPoolExecutor(
            self._workers, initializer=_begin, initargs=(os.getpid(), self._log), env=WORKER_ENVIRONMENT
        )


@dataclass(frozen=True)
class _Done:
    job: _Job
    lane: _Lane
    executor: Any
    future: "Future[Any]"


class _Rest:
    """A request to let workers go."""


class _Late:
    """A signal that jobs have waited long."""


_Message: TypeAlias = "_Job | _Done | _Rest | _Late | None"


class _Pace:
    """Time of the first worker's start with its first job, and of its jobs since."""

    def __init__(self) -> None:
        self._start_s: float | None = None
        self._busy_s = 0.0
        self._answers = 0

    def answered(self, took_s: float) -> None:
        """Count a job."""
        if self._start_s is None:
            self._start_s = took_s
            return
        self._busy_s += took_s
        self._answers += 1

    def pays(self, waiting: int) -> bool:
        """True if one worker would take longer for these jobs than another one to start."""
        if self._start_s is None or not self._answers:
            return False
        return waiting * self._busy_s / self._answers > self._start_s


class _Owner:
    """All state of a pool, touched by one thread."""

    def __init__(self, inbox: "queue.SimpleQueue[_Message]", workers: int, log: Path | None) -> None:
        self._inbox = inbox
        self._workers = workers
        self._log = log
        self._lanes: list[_Lane] = []
        self._solo: _Lane | None = None
        self._waiting: list[_Job] = []
        self._suspects: list[_Job] = []
        self._open: dict[int, _Job] = {}
        self._pace = _Pace()

    def run(self) -> None:
        if hasattr(signal, "pthread_sigmask"):
            # A process inherits the mask of the thread that starts it: Ctrl-C can't hit a worker that is only starting.
            signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        while (message := self._next()) is not None:
            if isinstance(message, _Job):
                self._open[message.number] = message
                heapq.heappush(self._waiting, message)
            elif isinstance(message, _Rest):
                self._rest()
            elif isinstance(message, _Done):
                self._pace.answered(time.monotonic() - message.job.began_s)
                self._landed(message)
            self._hand_on()
            self._try_a_suspect()
        self._end()

    def _next(self) -> "_Message":
        """Return the next message, or `_Late` where jobs have waited long enough for more workers to start."""
        running = [job.began_s for job in self._open.values() if job.began_s]
        late_s = min(running) + FIRST_ANSWER_S if running and self._waiting and not self._grown else None
        try:
            return self._inbox.get(timeout=None if late_s is None else max(late_s - time.monotonic(), 0.0))
        except queue.Empty:
            return _Late()

    @property
    def _grown(self) -> bool:
        """True if all workers were started."""
        return len(self._lanes) == min(self._workers, 2)

    def _hand_on(self) -> None:
        while self._waiting:
            lane = next((each for each in self._lanes if each.idle), None)
            if lane is None and not self._grown and (not self._lanes or self._more_pay()):
                lane = _Lane(self._workers - 1 if self._lanes else 1, self._log)
                self._lanes.append(lane)
            if lane is None and self._grown:
                lane = next((each for each in self._lanes if each.free), None)
            if lane is None:
                return
            self._start(heapq.heappop(self._waiting), lane)

    def _more_pay(self) -> bool:
        if len(self._waiting) >= MANY * self._workers or self._pace.pays(len(self._waiting)):
            return True
        return any(job.began_s and time.monotonic() - job.began_s >= FIRST_ANSWER_S for job in self._open.values())

    def _rest(self) -> None:
        if not self._open:
            for lane in self._lanes:
                lane.kill()
            self._lanes.clear()
            self._pace = _Pace()

    def _landed(self, done: _Done) -> None:
        error = done.future.exception()
        broken = isinstance(error, BrokenProcessPool)
        done.lane.landed(done.executor if broken else None)
        if not broken:
            self._close(done.job, error, None if error else done.future.result())
            return
        done.job.tries += 1
        if done.job.tries == TRIES:
            self._close(
                done.job, WorkerDied(f"the worker process died {TRIES} times, the last time with this job alone")
            )
        elif done.job.tries == TRIES - 1:
            self._suspects.append(done.job)
        else:
            heapq.heappush(self._waiting, done.job)

    def _try_a_suspect(self) -> None:
        if self._suspects:
            self._solo = self._solo or _Lane(1, self._log)
            if self._solo.idle:
                self._start(self._suspects.pop(0), self._solo)

    def _start(self, job: _Job, lane: _Lane) -> None:
        job.began_s = time.monotonic()
        try:
            lane.start(job, self._inbox)
        except Exception as error:  # noqa: BLE001 - no process can be started, say: who waits must hear of it
            lane.landed(None)
            self._close(job, error)

    def _close(self, job: _Job, error: BaseException | None, result: Any = None) -> None:
        del self._open[job.number]
        job.end(error, result)

    def _end(self) -> None:
        for lane in filter(None, (*self._lanes, self._solo)):
            lane.kill()
        for job in self._open.values():
            job.end(PoolClosed())
        with suppress(queue.Empty):
            while True:
                message = self._inbox.get_nowait()
                if isinstance(message, _Job):
                    message.end(PoolClosed())


def _begin(parent: int, log: Path | None) -> None:
    """Start a worker: deaf to Ctrl-C, silent on the terminal, ended with its parent."""
    # A handler and not SIG_IGN, which the programs of a run would inherit: then no SIGINT could end them.
    signal.signal(signal.SIGINT, lambda *_: None)
    if log is not None:
        with open(log, "ab") as file:
            os.dup2(file.fileno(), sys.stdout.fileno())
            os.dup2(file.fileno(), sys.stderr.fileno())
    threading.Thread(target=_end_with, args=(parent,), daemon=True).start()


def _end_with(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(_WATCH_S)
    os._exit(1)
