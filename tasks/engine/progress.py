"""Progress of a campaign, counted as results come in, and shown by an observer."""

import contextvars
import functools
import threading
import time
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Final, Literal, Protocol, Self, TypeAlias

Phase: TypeAlias = Literal["scanning", "starting Prefect", "instantiating", "running", "reporting", "postprocessing"]

INTERVAL_S: Final = 0.1
REPEAT_S: Final = 10.0
"""Time after which an unchanged state is shown again."""


@dataclass(frozen=True, slots=True)
class Progress:
    """The progress of a campaign.

    Attributes:
        configurations_total, runs_total: 0 until they are known.
        at_most: True if there may be fewer runs than `runs_total`, as configurations end when their class is decided.
        configurations_done, runs_done: Judged or broken.
        executed, reused: Runs simulated now, and runs whose recordings were in the store.
        passed, failed, not_judged: Parts of the done runs.
        simulated_s: Simulated time of the executed runs.
        notices: Lines for the user.
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
    notices: tuple[str, ...] = ()
    at_most: bool = False


class Observer(Protocol):
    """A display of progress."""

    def update(self, progress: Progress) -> None:
        """Called from one thread, at most ten times a second, and at the end."""


class Tally:
    """Thread-safe counts of results; a run counts once."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._phase: Phase = "scanning"
        self._configurations: dict[str, _ConfigurationProgress] = {}
        self._executed = self._reused = self._judged = 0
        self._simulated_s = 0.0
        self._judgements: Counter[str] = Counter()
        self._configurations_done = 0
        self._notices: tuple[str, ...] = ()

    def notice(self, line: str) -> None:
        """Add a line for the user."""
        with self._lock:
            self._notices = (*self._notices, line)

    def begin(self, phase: Phase) -> None:
        """Enter a phase."""
        with self._lock:
            self._phase = phase

    def expect(self, wanted: Mapping[str, int]) -> None:
        """Set the number of runs of each configuration, before any is counted."""
        with self._lock:
            known = self._configurations
            self._configurations = {
                configuration: known.get(configuration) or _ConfigurationProgress(runs, runs)
                for configuration, runs in wanted.items()
            }

    def want(self, configuration: str, runs: int, most: int) -> None:
        """Let a configuration want `runs` by now and at most `most`; it is done with that many."""
        with self._lock:
            if (of := self._configurations.get(configuration)) is not None:
                was_done = of.done == of.most
                of.runs, of.most = max(of.runs, runs), most
                self._configurations_done += (of.done == most) - was_done

    def reuse(self, configuration: str, runs: Iterable[int]) -> None:
        """Count runs with recordings in the store; runs executed by this call stay executed."""
        with self._lock:
            if (of := self._configurations.get(configuration)) is not None:
                new = of.bits(runs) & ~(of.executed | of.reused)
                of.reused |= new
                self._reused += new.bit_count()

    def execute(self, configuration: str, simulated_s: Mapping[int, float]) -> None:
        """Count runs that were simulated."""
        with self._lock:
            if (of := self._configurations.get(configuration)) is None:
                return
            bits = of.bits(simulated_s)
            self._executed += (bits & ~of.executed).bit_count()
            self._reused -= (bits & of.reused).bit_count()  # their recordings were damaged
            of.executed |= bits
            of.reused &= ~bits
            for run, time_s in simulated_s.items():
                if run < of.runs:
                    self._simulated_s += time_s - of.simulated_s.get(run, 0.0)
                    of.simulated_s[run] = time_s

    def judge(self, configuration: str, judgements: Mapping[int, str]) -> None:
        """Count runs that are done, each with the judgement of all oracles together."""
        with self._lock:
            if (of := self._configurations.get(configuration)) is None:
                return
            for judgement in dict.fromkeys(judgements.values()):
                bits = of.bits(run for run, said in judgements.items() if said == judgement)
                for before, theirs in of.judged.items():
                    again = bits & theirs
                    self._judgements[before] -= again.bit_count()
                    of.judged[before] = theirs & ~again
                of.judged[judgement] = of.judged.get(judgement, 0) | bits
                self._judgements[judgement] += bits.bit_count()
            done, was_done = sum(theirs.bit_count() for theirs in of.judged.values()), of.done
            self._judged += done - was_done
            self._configurations_done += (done == of.most) - (was_done == of.most)
            of.done = done

    def progress(self) -> Progress:
        """Return the current progress."""
        with self._lock:
            return Progress(
                phase=self._phase,
                configurations_done=self._configurations_done,
                configurations_total=len(self._configurations),
                runs_done=self._judged,
                runs_total=sum(of.most for of in self._configurations.values()),
                executed=self._executed,
                reused=self._reused,
                passed=self._judgements["pass"],
                failed=self._judgements["fail"],
                not_judged=self._judgements["not judged"],
                simulated_s=self._simulated_s,
                notices=self._notices,
                at_most=any(of.most > of.runs for of in self._configurations.values()),
            )


@dataclass(slots=True)
class _ConfigurationProgress:
    """Runs of a configuration, sets of them as integers with a bit for each: a campaign has 100,000 runs.

    Attributes:
        runs: Number of wanted runs; a block may hold more.
        most: Maximum number of wanted runs.
        simulated_s: Simulated time of the executed runs.
        judged: Judgement to its runs.
        done: Number of judged runs.
    """

    runs: int
    most: int
    reused: int = 0
    executed: int = 0
    simulated_s: dict[int, float] = field(default_factory=dict)
    judged: dict[str, int] = field(default_factory=dict)
    done: int = 0

    def bits(self, runs: Iterable[int]) -> int:
        """Return the wanted ones of `runs`."""
        if isinstance(runs, range) and runs.step == 1:
            stop = max(min(runs.stop, self.runs), 0)
            return (1 << stop) - (1 << max(runs.start, 0)) if runs.start < stop else 0
        bits = 0
        for run in runs:
            if run < self.runs:
                bits |= 1 << run
        return bits


class Reporter:
    """Shows a tally to an observer from one thread until it is closed.

    Args:
        observer: None shows nothing.
        interval_s: Time between two updates.
    """

    def __init__(self, tally: Tally, observer: Observer | None, interval_s: float = INTERVAL_S) -> None:
        self._tally = tally
        self._interval_s = interval_s
        self._observer = observer
        self._end = threading.Event()
        # In the caller's context, which has Prefect's settings where the observer is a page of Prefect's.
        report = functools.partial(contextvars.copy_context().run, self._report)
        self._thread = threading.Thread(target=report, name="vastflow progress", daemon=True)

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
        at_s = 0.0
        while True:
            last = self._end.wait(self._interval_s if shown else 0)
            progress, now_s = self._tally.progress(), time.monotonic()
            if self._observer is not None and (progress != shown or now_s > at_s + REPEAT_S):
                self._observer.update(progress)
                shown, at_s = progress, now_s
            if last:
                return
