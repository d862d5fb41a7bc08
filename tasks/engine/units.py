"""Units: missing runs of configurations in blocks of seconds, the longest expected first, and short ones at the end."""

import math
import threading
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field
from typing import Any, Final

from vastflow.tasks.engine.index import ConfigurationRuns, run_blocks

MOST_RUNS: Final = 20
"""Maximum number of runs of a unit."""

LEAST_S: Final = 1.0
MOST_S: Final = 20.0
"""Expected time of a unit: a shorter one costs more than it is worth, behind a longer one others wait."""

_UNITS_A_WORKER: Final = 4
_IN_FLIGHT: Final = 5
"""Units under way for each worker; those behind are put in order by what a run costs when their turn comes."""


@dataclass(frozen=True, slots=True)
class Unit:
    """Runs `start` to `stop` - 1 of a configuration under way."""

    start: int
    stop: int
    future: "Future[Any]"


@dataclass(slots=True)
class Units:
    """The units of a configuration's missing runs."""

    configuration: ConfigurationRuns
    missing: list[int]
    changed: threading.Condition = field(default_factory=threading.Condition)
    begun: list[Unit] = field(default_factory=list)
    all_begun: bool = False
    error: Exception | None = None

    def wait(self) -> list[Unit]:
        """Wait until all units are submitted and return them; raise the error that prevented one."""
        with self.changed:  # one for all: a campaign has 50,000 configurations, and an event takes 3 kB
            self.changed.wait_for(lambda: self.all_begun)
        if self.error is not None:
            raise self.error
        return self.begun


class Backlog:
    """Missing runs that are not submitted yet, and the mean cost of a run of each family."""

    def __init__(self) -> None:
        self._families: dict[str, deque[Units]] = {}
        self._costs: dict[str, tuple[int, float]] = {}
        self._runs = 0

    def add(self, units: Units) -> None:
        """Add the missing runs of a configuration."""
        self._families.setdefault(units.configuration.family, deque()).append(units)
        self._runs += len(units.missing)

    def took(self, family: str, runs: int, time_s: float) -> None:
        """Count what runs of a family took."""
        before, before_s = self._costs.get(family, (0, 0.0))
        self._costs[family] = before + runs, before_s + time_s

    def take(self, workers: int) -> tuple[Units, int, int] | None:
        """Return start and stop of the next unit, in order of expected time; None at the end.

        A family of which nothing is known comes first. Every worker should get several units.
        """
        if not self._families:
            return None
        most = -(-self._runs // (_UNITS_A_WORKER * workers))

        def sized(family: str) -> tuple[float, int]:
            runs, time_s = self._costs.get(family, (0, 0.0))
            cost_s = time_s / runs if time_s else math.inf
            least, longest = (1, MOST_RUNS) if math.isinf(cost_s) else (LEAST_S / cost_s, MOST_S / cost_s)
            size = max(1, min(max(most, math.ceil(least)), int(longest), MOST_RUNS))
            return cost_s * min(size, len(self._families[family][0].missing)), size

        family = max(self._families, key=lambda each: sized(each)[0])
        waiting = self._families[family]
        units, size = waiting[0], sized(family)[1]
        ((start, stop), *_) = run_blocks(units.missing[:size], size)
        del units.missing[: stop - start]
        self._runs -= stop - start
        if not units.missing:
            waiting.popleft()
        if not waiting:
            del self._families[family]
        return units, start, stop


class Feeder:
    """Hands units to an executor from a thread, as many at a time as keep its workers busy.

    Args:
        workers: Returns the number of workers, which may change.
        submit: Hands one unit to the executor.
    """

    def __init__(
        self, workers: Callable[[], int], submit: Callable[[ConfigurationRuns, int, int], "Future[Any]"]
    ) -> None:
        self._workers = workers
        self._submit = submit
        self._backlog = Backlog()
        self._ready = threading.Condition()
        self._feeds = False
        self._in_flight = 0

    def add(self, wanted: Iterable[tuple[ConfigurationRuns, Sequence[int]]]) -> list[Units]:
        """Add missing runs of configurations; units begin once all are known."""
        added = [Units(configuration, list(runs), self._ready) for configuration, runs in wanted]
        with self._ready:
            for units in added:
                if units.missing:
                    self._backlog.add(units)
                else:
                    units.all_begun = True
            if not self._feeds:
                self._feeds = True
                threading.Thread(target=self._feed, name="vastflow units", daemon=True).start()
        return added

    def took(self, family: str, runs: int, time_s: float) -> None:
        """Count what runs of a family took."""
        with self._ready:
            self._backlog.took(family, runs, time_s)

    def _feed(self) -> None:
        while True:
            with self._ready:
                while self._in_flight >= _IN_FLIGHT * (workers := self._workers()):
                    self._ready.wait(1.0)
                if (taken := self._backlog.take(workers)) is None:
                    self._feeds = False
                    return
                self._in_flight += 1
            units, start, stop = taken
            try:
                future = self._submit(units.configuration, start, stop)
            except Exception as error:  # noqa: BLE001 - whoever waits for the configuration raises it
                units.error = error
                self._landed()
            else:
                units.begun.append(Unit(start, stop, future))
                future.add_done_callback(self._landed)
            if not units.missing:
                with self._ready:
                    units.all_begun = True
                    self._ready.notify_all()

    def _landed(self, *_: Any) -> None:
        with self._ready:
            self._in_flight -= 1
            self._ready.notify_all()
