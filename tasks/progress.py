"""Progress of a campaign: counted as results come in, shown by an observer."""

import threading
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final, Literal, Protocol, Self, TypeAlias

Phase: TypeAlias = Literal["scanning", "starting Prefect", "instantiating", "running", "reporting"]

INTERVAL_S: Final = 0.1


@dataclass(frozen=True, slots=True)
class Progress:
    """How far a campaign is.

    Attributes:
        configurations_total, runs_total: 0 until they are known.
        configurations_done, runs_done: Judged, or found to be broken by our own fault.
        executed, reused: Runs simulated now, and runs whose recordings were in the store.
        passed, failed, not_judged: Of the runs that are done.
        simulated_s: Simulated time of the executed runs.
    """

    phase: Phase = "scanning"
    configurations_done: int = 0
    configurations_total: int = 0
    runs_done: int = 0
    runs_total: int = 0
    executed: int = 0
    reused: int = 0
    passed: int = 0
    failed: int = 0
    not_judged: int = 0
    simulated_s: float = 0.0


class Observer(Protocol):
    """Whoever shows progress."""

    def update(self, progress: Progress) -> None:
        """Called from one thread, at most ten times a second, and at the end."""


class Tally:
    """Counts as results come in from any thread; a run that is told of twice counts once."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._phase: Phase = "scanning"
        self._wanted: dict[str, int] = {}
        self._reused: set[tuple[str, int]] = set()
        self._executed: dict[tuple[str, int], float] = {}
        self._simulated_s = 0.0
        self._judged: dict[tuple[str, int], str] = {}
        self._judgements: Counter[str] = Counter()
        self._runs_done: Counter[str] = Counter()
        self._members_done = 0

    def begin(self, phase: Phase) -> None:
        """Enter a phase."""
        with self._lock:
            self._phase = phase

    def expect(self, wanted: Mapping[str, int]) -> None:
        """Set what there is to do, before anything of it is told: member to number of runs."""
        with self._lock:
            self._wanted = dict(wanted)

    def reuse(self, member: str, runs: Iterable[int]) -> None:
        """Runs whose recordings were found; those executed by this call stay executed."""
        with self._lock:
            self._reused |= {(member, run) for run in self._of(member, runs)} - self._executed.keys()

    def execute(self, member: str, simulated_s: Mapping[int, float]) -> None:
        """Runs that were simulated."""
        with self._lock:
            for run in self._of(member, simulated_s):
                self._simulated_s += simulated_s[run] - self._executed.get((member, run), 0.0)
                self._executed[member, run] = simulated_s[run]
                self._reused.discard((member, run))  # its recording was damaged

    def judge(self, member: str, judgements: Mapping[int, str]) -> None:
        """Runs that are done, each with what all oracles together say of it."""
        with self._lock:
            for run in self._of(member, judgements):
                before = self._judged.get((member, run))
                self._judged[member, run] = judgements[run]
                self._judgements[judgements[run]] += 1
                if before is not None:
                    self._judgements[before] -= 1
                    continue
                self._runs_done[member] += 1
                self._members_done += self._runs_done[member] == self._wanted[member]

    def progress(self) -> Progress:
        """The state now."""
        with self._lock:
            return Progress(
                phase=self._phase,
                configurations_done=self._members_done,
                configurations_total=len(self._wanted),
                runs_done=len(self._judged),
                runs_total=sum(self._wanted.values()),
                executed=len(self._executed),
                reused=len(self._reused),
                passed=self._judgements["pass"],
                failed=self._judgements["fail"],
                not_judged=self._judgements["not judged"],
                simulated_s=self._simulated_s,
            )

    def _of(self, member: str, runs: Iterable[int]) -> list[int]:
        # A block may hold runs that nobody asked for this time.
        return [run for run in runs if run < self._wanted.get(member, 0)]


class Reporter:
    """Shows a tally to an observer from one thread until it is closed.

    Args:
        observer: None shows nothing.
    """

    def __init__(self, tally: Tally, observer: Observer | None) -> None:
        self._tally = tally
        self._observer = observer
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._report, name="vastflow progress", daemon=True)

    def __enter__(self) -> Self:
        if self._observer is not None:
            self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._end.set()
        if self._observer is not None:
            self._thread.join()

    def _report(self) -> None:
        shown: Progress | None = None
        while True:
            last = self._end.wait(INTERVAL_S if shown else 0)
            progress = self._tally.progress()
            if progress != shown and self._observer is not None:
                self._observer.update(progress)
                shown = progress
            if last:
                return
