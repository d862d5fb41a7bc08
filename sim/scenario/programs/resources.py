"""Resource samples of a run: what its processes and containers use, once a second."""

import glob
import threading
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Final

import psutil

from vastflow.sim.model.recording import Use

if TYPE_CHECKING:
    from vastflow.sim.scenario.programs.cgroup import Cgroup

SAMPLED_S: Final = 1.0


def waits(pids: Iterable[int]) -> dict[str, float]:
    """Return how long (s) each thread of processes, and the calling one, waited for a CPU.

    It was ready to run then. Keys are folders of `/proc`. Empty where the system does not count it.
    """
    found = {}
    for place in ["/proc/thread-self", *(place for pid in pids for place in glob.iglob(f"/proc/{pid}/task/*"))]:
        with suppress(OSError, LookupError):  # it has ended
            found[place] = int(Path(place, "schedstat").read_text("ascii").split()[1]) / 1e9
    return found


class ResourceSampler:
    """A thread that samples a run's processes once a second of host time.

    Attributes:
        rows: The samples so far.
    """

    def __init__(
        self, pids: Callable[[], Iterable[int]], containers: Callable[[], Iterable[tuple["Cgroup", int]]] = tuple
    ) -> None:
        """Begin; `pids` gives the ids of the run's living processes, `containers` their control groups, see `RunContainers.cgroups`."""
        self._pids = pids
        self._containers = containers
        self._container_cpu_s: dict[Cgroup, float] = {}
        self._start_s = time.monotonic()
        self._cpu_s: dict[psutil.Process, float] = {}
        self.rows = [self._sample()]  # here, not in the thread: a run of milliseconds has a row too
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._sample_on, name="resources", daemon=True)
        self._thread.start()

    def stop(self) -> tuple[Use, ...]:
        """Stop sampling and return all rows."""
        self._stopped.set()
        self._thread.join()
        return tuple(self.rows)

    @property
    def processes(self) -> set[psutil.Process]:
        """Every process seen so far, whether it lives or not."""
        return set(self._cpu_s)

    def _sample_on(self) -> None:
        while True:
            next_s = self._start_s + len(self.rows) * SAMPLED_S
            if self._stopped.wait(max(0.0, next_s - time.monotonic())):
                return
            self.rows.append(self._sample())

    def _sample(self) -> Use:
        t_s, rss_bytes, processes = time.monotonic() - self._start_s, 0, 0
        measured: set[int] = set()
        for cgroup, client in self._containers():
            inside = cgroup.pids()
            measured |= {*inside, client}  # the runtime's client is none of the run
            if used := cgroup.usage():
                self._container_cpu_s[cgroup] = used[0]
                rss_bytes += used[1]
                processes += len(inside)
        for pid in {*self._pids()} - measured:
            try:
                process = psutil.Process(pid)
                with process.oneshot():
                    times, rss = process.cpu_times(), process.memory_info().rss
            except (psutil.NoSuchProcess, psutil.AccessDenied):
                continue
            self._cpu_s[process] = times.user + times.system
            rss_bytes += rss
            processes += 1
        cpu_s = sum(self._cpu_s.values()) + sum(self._container_cpu_s.values())
        return Use(t_s, cpu_s, rss_bytes, processes)
