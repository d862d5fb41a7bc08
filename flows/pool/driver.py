"""The driver: a campaign's configurations as shards in a work pool, until each is computed or known to be broken.

What counts is what the store has. A shard whose flow run failed, crashed or fell silent is asked for again with what is
missing of it, then cut in two until the configuration is alone that takes its worker with it.
"""

import time
from collections import deque
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Final, Protocol

from vastflow.flows.pool.service import Seen
from vastflow.flows.request.work_pool import WorkersFailed, WorkPool, shard_count
from vastflow.tasks.engine.engine import Engine, RunFault, judgements
from vastflow.tasks.engine.executor import PoolClosed
from vastflow.tasks.engine.index import ConfigurationRuns, missing
from vastflow.tasks.engine.progress import Tally
from vastflow.tasks.engine.remote_shard import read_part
from vastflow.tasks.engine.shards import Shard, shard_ranges
from vastflow.tasks.prefect.deployment import OTHER_CODE, STORE_AWAY
from vastflow.tasks.store.store import StoreError

TRIES: Final = 3
"""A shard that fails is given to a worker as often before it is cut."""

POLL_S: Final = 1.5
IDLE_S: Final = 60.0
"""When nothing has been taken for so long, the user is told how to start a worker."""
SILENT_S: Final = 120.0
"""A flow run that has given no sign of life for so long is dead."""

TAKEN_S: Final = 300.0
"""One that a worker took and has not begun for so long, neither."""

MOST_IN_VAIN: Final = 4
"""Of a shard with one poison a half is computed. When as many halves in a row are not, something else is wrong."""

LISTEN_S: Final = 10.0
"""Between two looks whether a shard that is being computed has more to tell."""

_STEP_S: Final = 0.2


class Service(Protocol):
    """A service that runs shards elsewhere, see `vastflow.flows.pool.service.PoolService`."""

    def submit(self, bundle: str, name: str) -> str: ...

    def seen(self, ids: Collection[str]) -> Mapping[str, Seen]: ...

    def cancel(self, ids: Collection[str]) -> None: ...

    def give_up(self, flow_run: str, why: str) -> None: ...

    def workers_online(self) -> int: ...


@dataclass(frozen=True, slots=True)
class Attempt:
    """Configurations that go to a worker together.

    Attributes:
        failed: How often it was tried in vain.
        cut: Whether it is what a cut left of a larger one.
    """

    configurations: tuple[ConfigurationRuns, ...]
    failed: int = 0
    cut: bool = False


@dataclass(slots=True)
class _Run:
    """An attempt under way.

    Attributes:
        sign: Its last sign of life, at `beaten_s`.
        told: How many messages of its report were read, at `listened_s`.
        whole: Whether these are all.
    """

    attempt: Attempt
    name: str
    sign: tuple[str, str] = ("", "")
    beaten_s: float = field(default_factory=time.monotonic)
    told: int = 0
    listened_s: float = field(default_factory=time.monotonic)
    whole: bool = False


class Driver:
    """Brings configurations into the store by way of a work pool.

    Args:
        packed: Puts a bundle of some configurations into the store and gives its key.
        say: Writes a line for the user.
        poll_s: Between two looks at the flow runs.
        idle_s, silent_s: See `IDLE_S` and `SILENT_S`.
        taken_s: After which a flow run that was taken and not begun is given up; None where it may wait for ever.
    """

    def __init__(
        self,
        service: Service,
        packed: Callable[[Sequence[ConfigurationRuns]], str],
        engine: Engine,
        tally: Tally,
        pool: WorkPool,
        say: Callable[[str], None],
        *,
        poll_s: float = POLL_S,
        idle_s: float = IDLE_S,
        silent_s: float = SILENT_S,
        taken_s: float | None = None,
    ) -> None:
        self._service = service
        self._packed = packed
        self._engine = engine
        self._index = engine.index
        self._tally = tally
        self._pool = pool
        self._say = say
        self._poll_s = poll_s
        self._idle_s = idle_s
        self._silent_s = silent_s
        self._taken_s = taken_s
        self._waiting: deque[Attempt] = deque()
        self._open: dict[str, _Run] = {}
        self._known: dict[str, frozenset[int]] = {}
        self._wanted: dict[str, int] = {}
        self._shards = 0
        self._in_vain = 0

    def run(
        self, configurations: Sequence[ConfigurationRuns], show: Callable[[int, int], None] = lambda done, total: None
    ) -> None:
        """Return when every configuration is complete in the store or has a fault in the engine.

        Called again for configurations that want more runs than before, it goes on counting.

        Args:
            show: Is given how many shards are done, and of how many.

        Raises:
            WorkersFailed: no worker can compute it, or none took anything in time.
            StoreError: the store can't be used, here or by the workers.
            PrefectUnavailable: Prefect's API stayed away.
            PoolClosed: the campaign was ended.
        """
        for configuration in configurations:
            blocks = self._index.blocks(configuration)
            absent = frozenset(missing(blocks, configuration.runs))
            known, before = self._known.get(configuration.name, frozenset()), self._wanted.get(configuration.name, 0)
            self._known[configuration.name] = known | frozenset(range(before, configuration.runs)) - absent
            self._wanted[configuration.name] = configuration.runs
        self._waiting.extend(self._attempts(self._incomplete(configurations)))
        self._shards += len(self._waiting)
        try:
            self._drive(show)
        finally:
            with suppress(Exception):  # whatever ended the campaign is what the user has to hear of
                self._service.cancel(self._open)

    def _attempts(self, configurations: Sequence[ConfigurationRuns]) -> list[Attempt]:
        if not configurations:
            return []
        runs = sum(len(missing(self._index.blocks(each), each.runs)) for each in configurations)
        count = shard_count(self._pool, len(configurations), max(runs, len(configurations)))
        ranges = shard_ranges([each.scenario.digest for each in configurations], count)
        return [Attempt(tuple(configurations[i] for i in chosen)) for chosen in ranges]

    def _drive(self, show: Callable[[int, int], None]) -> None:
        lively_s, told = time.monotonic(), False
        while self._waiting or self._open:
            while self._waiting:
                self._submit(self._waiting.popleft())
            self._pause()
            seen = self._service.seen(self._open)
            if any(each.standing != "waiting" for each in seen.values()):
                lively_s, told = time.monotonic(), False
            idle_s = time.monotonic() - lively_s
            if idle_s > self._idle_s and not told:
                told = True
                self._tell_idle()
            if self._pool.wait_s is not None and idle_s > self._pool.wait_s:
                raise WorkersFailed(f"no worker of the work pool {self._pool.name!r} took anything for {idle_s:.0f} s")
            self._land(seen)
            show(self._shards - len(self._open) - len(self._waiting), self._shards)

    def _submit(self, attempt: Attempt) -> None:
        name = str(Shard(attempt.configurations)) + (f", try {attempt.failed + 1}" if attempt.failed else "")
        self._open[self._service.submit(self._packed(attempt.configurations), name)] = _Run(attempt, name)

    def _pause(self) -> None:
        until_s = time.monotonic() + self._poll_s
        while time.monotonic() < until_s:
            if self._engine.closed:
                raise PoolClosed
            time.sleep(min(_STEP_S, self._poll_s))

    def _tell_idle(self) -> None:
        online = self._service.workers_online()
        name = self._pool.name
        if online:
            workers = "worker" if online == 1 else "workers"
            self._say(
                f"{online} {workers} of the work pool {name!r} took nothing for {self._idle_s:.0f} s; still waiting"
            )
        else:
            self._say(f"no worker of the work pool {name!r} is there; start one: prefect worker start --pool {name}")

    def _land(self, seen: Mapping[str, Seen]) -> None:
        """Hear of those that are under way, and take those that ended.

        A flow run that told to its end what it made is believed; only for another one the store is looked at.
        """
        now_s = time.monotonic()
        landed: list[tuple[_Run, Seen]] = []
        for flow_run, run in list(self._open.items()):
            found = seen.get(flow_run) or Seen("ended", "Crashed", "the flow run was deleted", "")
            if (found.standing, found.beat) != run.sign:
                run.sign, run.beaten_s = (found.standing, found.beat), now_s
            most_s = {"running": self._silent_s, "taken": self._taken_s}.get(found.standing)
            if most_s is not None and now_s - run.beaten_s > most_s:
                why = f"no sign of life for {most_s:.0f} s: its worker is gone"
                self._service.give_up(flow_run, why)
                found = Seen("ended", "Crashed", why, found.beat)
            if found.standing == "ended":
                landed.append((run, found))
                del self._open[flow_run]
            if found.standing == "ended" or now_s - run.listened_s > LISTEN_S:
                self._listen(flow_run, run)
        if not all(run.whole for run, _ in landed):
            self._index.store.refresh()
        for run, found in landed:
            self._take(run, found)

    def _take(self, run: _Run, found: Seen) -> None:
        broken = self._engine.broken
        incomplete = [each for each in self._incomplete(run.attempt.configurations) if each.name not in broken]
        if len(incomplete) < len(run.attempt.configurations):
            self._in_vain = 0
        if not incomplete:
            return
        if found.state == "Cancelled":
            self._give_up(incomplete, "its flow run was cancelled")
            return
        failed = run.attempt.failed + 1
        if failed >= TRIES and found.state in (OTHER_CODE, STORE_AWAY):
            if found.state == STORE_AWAY:
                raise StoreError(f"store: a worker of the work pool {self._pool.name!r} can't use it: {found.message}")
            raise WorkersFailed(f"workers of the work pool {self._pool.name!r}: {found.message}")
        ended = f"{found.state}: {found.message}" if found.message else found.state
        if failed < TRIES:
            self._say(f"{run.name} will be tried again: {ended}")
            self._again(Attempt(tuple(incomplete), failed))
        elif len(incomplete) > 1:
            self._in_vain += run.attempt.cut
            if self._in_vain == MOST_IN_VAIN:
                raise WorkersFailed(
                    f"workers of the work pool {self._pool.name!r} fail whatever they are given, at last with {ended}"
                )
            self._say(f"{run.name} failed {failed} times and is cut in two: {ended}")
            half = len(incomplete) // 2
            for some in (incomplete[:half], incomplete[half:]):
                self._again(Attempt(tuple(some), TRIES - 1, cut=True))
        else:
            self._give_up(incomplete, f"its worker's process ended each time, at last with it alone; {ended}")

    def _again(self, attempt: Attempt) -> None:
        self._waiting.append(attempt)
        self._shards += 1

    def _give_up(self, configurations: Sequence[ConfigurationRuns], why: str) -> None:
        self._engine.add_faults([RunFault(each.name, None, "execute", why) for each in configurations])
        for each in configurations:
            verdicts = [stored.verdicts for stored in self._index.stored(each) if stored.verdicts]
            judged = {run for artifact in verdicts for run in judgements(artifact)}
            self._tally.judge(each.name, dict.fromkeys(set(range(each.runs)) - judged, "not judged"))

    def _listen(self, flow_run: str, run: _Run) -> None:
        """Count the results that a flow run has reported since the last call."""
        run.listened_s = time.monotonic()
        heard = False
        while not run.whole and (news := read_part(self._index.store, flow_run, run.told)) is not None:
            heard, run.told, run.whole = True, run.told + 1, news.last
            self._index.store.learn(news.artifacts)
            self._engine.add_faults(news.faults)
        if heard:
            self._incomplete(run.attempt.configurations)

    def _incomplete(self, configurations: Sequence[ConfigurationRuns]) -> list[ConfigurationRuns]:
        """Return the incomplete configurations, and count what the store has."""
        incomplete = []
        for configuration in configurations:
            stored = self._index.stored(configuration)
            known = self._known[configuration.name]
            for each in stored:
                simulated_s = {int(run): float(s) for run, s in each.recordings.info["runs"] if run not in known}
                self._tally.execute(configuration.name, simulated_s)
                if each.verdicts is not None:
                    self._tally.judge(configuration.name, judgements(each.verdicts))
            absent = missing([each.block for each in stored], configuration.runs)
            if absent or not all(each.verdicts for each in stored):
                incomplete.append(configuration)
        return incomplete
