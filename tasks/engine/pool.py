"""The worker pool: long-lived processes below one priority queue, for a whole campaign.

One thread owns all state; calls from elsewhere are queued for it. Workers know nothing of Prefect and need no `__main__` guard
in a user's script (loky). At most two units a worker are handed on at a time, so that a unit of higher priority overtakes those
that wait. One worker starts with the first unit, the others where it would take long alone.
"""

import functools
import heapq
import itertools
import multiprocessing.resource_tracker
import os
import pickle
import signal
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import loky
from loky.backend import resource_tracker

from vastflow.tasks.engine.executor import PoolClosed, Priority, Shared, WorkerDied, end
from vastflow.tasks.engine.process import SAFE_PATH, safe_path


def cores() -> int:
    """Return the number of processors this process may use, by its affinity and its control group."""
    return int(loky.cpu_count())


TRIES: Final = 3
"""Attempts at a unit whose worker died, the last one alone in a process of its own."""

MANY: Final = 4
"""Waiting units per worker with which all workers start at once."""

WAITS_S: Final = 10.0
"""Time that a unit waits for the first worker before the others start; two or three starts of a worker take as long."""

_IN_FLIGHT_PER_WORKER: Final = 2
_WATCH_S: Final = 0.5

WORKER_ENVIRONMENT: Final = {
    # One worker a core: threads inside a worker would only compete, and change sums with their number.
    **dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1"),
    # Prepared maps are kept in a worker on purpose; loky would take 0.3 GB for a leak and begin anew.
    "LOKY_MAX_MEMORY_LEAK_SIZE": "4e9",
    SAFE_PATH: "1",
}


@dataclass(order=True)
class _Unit:
    priority: int
    number: int
    function: Callable[..., Any] = field(compare=False)
    arguments: tuple[Any, ...] = field(compare=False)
    outcome: "Future[Any]" = field(default_factory=Future, compare=False)
    tries: int = field(default=0, compare=False)
    queued_s: float = field(default_factory=time.monotonic, compare=False)


class _Lane:
    """Processes of loky, with the number of their units."""

    def __init__(self, workers: int, log: Path | None) -> None:
        self.workers = workers
        self.in_flight = 0
        self.log = log
        self.renew()

    def renew(self) -> None:
        with safe_path():  # Python's and loky's processes that clean up after others
            multiprocessing.resource_tracker.ensure_running()
            resource_tracker.ensure_running()
        self.executor = loky.ProcessPoolExecutor(
            self.workers, initializer=_begin, initargs=(os.getpid(), self.log), env=WORKER_ENVIRONMENT
        )

    def submit(self, unit: _Unit) -> Any:
        try:
            return self.executor.submit(unit.function, *unit.arguments)
        except BrokenProcessPool:  # what was on it is under way here; this unit wasn't
            self.renew()
            return self.executor.submit(unit.function, *unit.arguments)


class Pool:
    """The executor of this machine.

    Args:
        workers: Maximum number of processes.
        log: File that takes what workers print.
    """

    def __init__(self, workers: int, log: Path | None = None) -> None:
        self.workers = workers
        self.closed = False
        self._log = log
        # Among equals of a priority the oldest first; units themselves have no order.
        self._numbers = itertools.count()
        self._lanes: list[_Lane] = []
        self._solo: _Lane | None = None
        self._waiting: list[_Unit] = []
        self._suspects: list[_Unit] = []
        self._open: dict[int, _Unit] = {}
        self._timer: threading.Timer | None = None
        # A process inherits the mask of the thread that starts it: Ctrl-C can't hit a worker that is only starting.
        block = getattr(signal, "pthread_sigmask", lambda *_: None)
        self._owner = ThreadPoolExecutor(1, "vastflow pool", block, (getattr(signal, "SIG_BLOCK", 0), {signal.SIGINT}))

    def submit(self, function: Callable[..., Any], /, *arguments: Any, priority: Priority) -> "Future[Any]":
        unit = _Unit(priority, next(self._numbers), function, arguments)
        if not self._own(self._add, unit):
            end(unit.outcome, PoolClosed())
        return unit.outcome

    def shared(self, value: object) -> Shared:
        return functools.partial(pickle.loads, pickle.dumps(value))

    def prepare(self, function: Callable[..., Any], /, *arguments: Any) -> "Future[Any]":
        """See `Executor`; in one worker, as two at once would do the same."""
        return self.submit(function, *arguments, priority=Priority.EVALUATE)

    def workers_table(self) -> list[dict[str, Any]]:
        return []

    def bound(self, workers: int) -> None:
        """Go on with at most so many workers, at once if no unit is open."""
        self.workers = min(self.workers, workers)
        self._own(self._shrink)

    def rest(self) -> None:
        self._own(self._rest)

    def close(self, timeout_s: float = 3.0) -> None:
        """See `Executor`; return at the latest after `timeout_s`."""
        if not self.closed:
            self.closed = True
            ended = self._owner.submit(self._end)
            self._owner.shutdown(wait=False)
            with suppress(TimeoutError):
                ended.result(timeout_s)

    def _own(self, call: Callable[..., None], *arguments: Any) -> bool:
        """Queue a call for the owner; False if it is closed."""
        with suppress(RuntimeError):
            self._owner.submit(call, *arguments)
            return True
        return False

    def _add(self, unit: _Unit) -> None:
        self._open[unit.number] = unit
        heapq.heappush(self._waiting, unit)
        if not self.closed:  # nothing is begun only to be killed
            self._hand_on()

    def _hand_on(self) -> None:
        """Hand units on while workers are idle or may have one more wait, and start workers."""
        while self._waiting:
            if self._waiting[0].outcome.cancelled():
                del self._open[heapq.heappop(self._waiting).number]
                continue
            # One worker first, the others when there is much to do: to start one takes longer than judging many runs.
            grown = len(self._lanes) >= min(self.workers, 2)
            lane = next((each for each in self._lanes if each.in_flight < each.workers), None)
            if lane is None and not grown and (not self._lanes or self._is_much()):
                lane = _Lane(self.workers - 1 if self._lanes else 1, self._log)
                self._lanes.append(lane)
            if lane is None and grown:
                # One more unit a worker lies ready, so that no worker waits for this process while its answer travels.
                free = (each for each in self._lanes if each.in_flight < _IN_FLIGHT_PER_WORKER * each.workers)
                lane = next(free, None)
            if lane is None:
                break
            self._start(heapq.heappop(self._waiting), lane)
        if self._waiting and self._timer is None and len(self._lanes) < min(self.workers, 2):
            self._timer = threading.Timer(WAITS_S, self._own, (self._look_again,))
            self._timer.daemon = True
            self._timer.start()
        # What was on a pool when it died is retried alone: only so can be told which unit kills its worker.
        if self._suspects:
            self._solo = self._solo or _Lane(1, self._log)
            if not self._solo.in_flight:
                self._start(self._suspects.pop(0), self._solo)

    def _is_much(self) -> bool:
        """True if many units wait, or one waits long: judging takes less than a worker's start."""
        longest_s = time.monotonic() - min(unit.queued_s for unit in self._waiting)
        long = sum(unit.priority not in (Priority.OBSERVE, Priority.JUDGE) for unit in self._waiting)
        return long >= MANY * self.workers or longest_s >= WAITS_S

    def _look_again(self) -> None:
        self._timer = None
        self._hand_on()

    def _start(self, unit: _Unit, lane: _Lane) -> None:
        lane.in_flight += 1
        try:
            future = lane.submit(unit)
        except Exception as error:  # noqa: BLE001 - no process can be started, say: who waits must hear of it
            lane.in_flight -= 1
            self._close(unit, error)
            return
        executor = lane.executor
        future.add_done_callback(lambda done: self._own(self._landed, unit, lane, executor, done))

    def _landed(self, unit: _Unit, lane: _Lane, executor: Any, done: "Future[Any]") -> None:
        lane.in_flight -= 1
        error = done.exception()
        if not isinstance(error, BrokenProcessPool):
            self._close(unit, error, None if error else done.result())
        else:
            # All units of a dead pool land here; the first renews it.
            if lane.executor is executor:
                lane.renew()
            unit.tries += 1
            if unit.tries == TRIES:
                died = f"the worker process died {TRIES} times, the last time with this job alone"
                self._close(unit, WorkerDied(died))
            elif unit.tries == TRIES - 1:
                self._suspects.append(unit)
            else:
                heapq.heappush(self._waiting, unit)
        self._hand_on()

    def _close(self, unit: _Unit, error: BaseException | None, result: Any = None) -> None:
        del self._open[unit.number]
        end(unit.outcome, error, result)

    def _rest(self) -> None:
        if not self._open:
            for lane in self._lanes:
                lane.executor.shutdown(wait=True, kill_workers=True)
            self._lanes.clear()

    def _shrink(self) -> None:
        if sum(lane.workers for lane in self._lanes) > self.workers:
            self._rest()

    def _end(self) -> None:
        for lane in filter(None, (*self._lanes, self._solo)):
            lane.executor.shutdown(wait=True, kill_workers=True)
        for unit in self._open.values():
            end(unit.outcome, PoolClosed())


def _begin(parent: int, log: Path | None) -> None:
    """Start a worker: deaf to Ctrl-C, silent on the terminal, ended with its parent."""
    os.environ.pop(SAFE_PATH, None)  # programs of runs are started as the user would
    # A handler and not SIG_IGN, which the programs of a run would inherit: then no SIGINT could end them.
    signal.signal(signal.SIGINT, lambda *_: None)
    if log is not None:
        with open(log, "ab") as file:
            os.dup2(file.fileno(), sys.stdout.fileno())
            os.dup2(file.fileno(), sys.stderr.fileno())
    threading.Thread(target=_end_with, args=(parent,), daemon=True).start()


def _end_with(parent: int) -> None:
    # Polled: only Linux has a signal of a parent's death.
    while os.getppid() == parent:
        time.sleep(_WATCH_S)
    os._exit(1)
