"""Resources: the processor time and memory of all processes of a run, once a second of host time."""

import threading
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Final

import psutil

from vastflow.sim.model.runlog import Use

PERIOD_S: Final = 1.0


class ResourceSampler:
    """A thread that samples a run's processes.

    Args:
        pids: Gives the ids of the run's living processes.
        period_s: Host time from sample to sample.
    """

    def __init__(self, pids: Callable[[], Iterable[int]], period_s: float = PERIOD_S) -> None:
        self._pids = pids
        self._period_s = period_s
        self._start_s = time.monotonic()
        self._cpu_s: dict[psutil.Process, float] = {}
        self._rows = [self._sample()]  # here, not in the thread: a run of milliseconds has a row too
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._sample_on, name="resources", daemon=True)
        self._thread.start()

    def stop(self) -> tuple[Use, ...]:
        """Stop sampling and return all rows."""
        self._stopped.set()
        self._thread.join()
        return self.rows

    @property
    def rows(self) -> tuple[Use, ...]:
        """Every row so far."""
        return tuple(self._rows)

    @property
    def processes(self) -> set[psutil.Process]:
        """Every process seen so far, whether it lives or not."""
        return set(self._cpu_s)

    def _sample_on(self) -> None:
        while True:
            next_s = self._start_s + len(self._rows) * self._period_s
            if self._stopped.wait(max(0.0, next_s - time.monotonic())):
                return
            self._rows.append(self._sample())

    def _sample(self) -> Use:
        t_s, rss_bytes, processes = time.monotonic() - self._start_s, 0, 0
        for pid in self._pids():
            try:
                process = psutil.Process(pid)
                with process.oneshot():
                    times, rss = process.cpu_times(), process.memory_info().rss
            except (psutil.NoSuchProcess, psutil.AccessDenied):
                continue
            self._cpu_s[process] = times.user + times.system
            rss_bytes += rss
            processes += 1
        return Use(t_s, sum(self._cpu_s.values()), rss_bytes, processes)


def write_resources(rows: Iterable[Use], file: Path) -> None:
    """Write `rows` as CSV with the columns `t_s,cpu_s,rss_bytes,processes`.

    Raises:
        OSError: the file can't be written.
    """
    lines = (f"{row.t_s:.3f},{row.cpu_s:.2f},{row.rss_bytes},{row.processes}\n" for row in rows)
    file.write_text("t_s,cpu_s,rss_bytes,processes\n" + "".join(lines))
