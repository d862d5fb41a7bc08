"""Progress of a campaign, counted as results come in, and shown by an observer."""

import contextvars
import functools
import threading
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Final, Literal, Protocol, Self, TypeAlias

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


@dataclass(slots=True)
class FamilyProgress:
    """The progress of one family; `runs` are at most so many while configurations may still end early."""

    family: str
    configurations: int = 0
    runs: int = 0
    passed: int = 0
    failed: int = 0
    not_judged: int = 0

    def count(self, judgment: str, runs: int) -> None:
        """Count runs of a judgment, or take some back where `runs` is negative."""
        match judgment:
            case "pass":
                self.passed += runs
            case "fail":
                self.failed += runs
            case _:
                self.not_judged += runs


@dataclass(frozen=True, slots=True)
class Change:
    """A change of a tally: the name and the values of a line of `events.jsonl`, see `vastflow.oracles.results.events`."""

    event: str
    values: Mapping[str, Any]


class Observer(Protocol):
    """A display of progress."""

    def update(self, progress: Progress) -> None:
        """Called from one thread, at most ten times a second, and at the end."""


class Tally:
    """Thread-safe counts of results; a run counts once.

    Attributes:
        elsewhere_cpu_s: CPU time on other machines.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._phase: Phase = "scanning"
        self._configurations: dict[str, _ConfigurationProgress] = {}
        self._families: dict[str, FamilyProgress] = {}
        self._executed = self._reused = self._judged = 0
        self._simulated_s = 0.0
        self.elsewhere_cpu_s = 0.0
        self._configurations_done = 0
        self._notices: tuple[str, ...] = ()
        self._changes: list[Change] | None = None

    def keep_changes(self) -> None:
        """Keep changes from now on, until `changes` takes them."""
        with self._lock:
            self._changes = []

    def changes(self) -> list[Change]:
        """Return the changes since the last call, in order; none unless they are kept."""
        with self._lock:
            if self._changes is None:
                return []
            found, self._changes = self._changes, []
            return found

    def families(self) -> list[FamilyProgress]:
        """Return the current progress of each family, in the order of the campaign file."""
        with self._lock:
            return [replace(each) for each in self._families.values()]

    def notice(self, line: str) -> None:
        """Add a line for the user."""
        with self._lock:
            self._notices = (*self._notices, line)
            self._changed("notice", text=line)

    def spend(self, cpu_s: float) -> None:
        """Count CPU time of another machine."""
        with self._lock:
            self.elsewhere_cpu_s += cpu_s

    def begin(self, phase: Phase) -> None:
        with self._lock:
            if phase != self._phase:
                self._changed("stage", stage=phase)
            self._phase = phase

    def fault(self, configuration: str, run_index: int | None, stage: str, error: str) -> None:
        """Tell of a fault; its runs are counted by `judge`."""
        with self._lock:
            self._changed("fault", configuration=configuration, run_index=run_index, stage=stage, error=error)

    def expect(self, wanted: Mapping[str, int], families: Mapping[str, str] | None = None) -> None:
        """Set the number of runs of each configuration, before any is counted.

        Args:
            families: Configuration to its family, for those that are new.
        """
        with self._lock:
            known, named = self._configurations, families or {}
            self._configurations = {
                configuration: known.get(configuration)
                or _ConfigurationProgress(runs, runs, self._family(named.get(configuration, "")))
                for configuration, runs in wanted.items()
            }
            for family in self._families.values():
                family.configurations = family.runs = 0
            for of in self._configurations.values():
                of.family.configurations += 1
                of.family.runs += of.most

    def _family(self, name: str) -> FamilyProgress:
        return self._families.setdefault(name, FamilyProgress(name))

    def want(self, configuration: str, runs: int, most: int) -> None:
        """Let a configuration want `runs` by now and at most `most`; it is done with that many."""
        with self._lock:
            if (of := self._configurations.get(configuration)) is not None:
                was_done = of.done == of.most
                of.family.runs += most - of.most
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
        """Count runs that were simulated, and the CPU time that they took on other machines."""
        with self._lock:
            if (of := self._configurations.get(configuration)) is None:
                return
            bits = of.bits(simulated_s)
            new = bits & ~of.executed
            self._executed += new.bit_count()
            self._reused -= (bits & of.reused).bit_count()  # their recordings were damaged
            of.executed |= bits
            of.reused &= ~bits
            if new:  # of a run that is executed again the first time counts
                runs = _runs(new)
                took_s = sum(simulated_s[run] for run in runs)
                self._simulated_s += took_s
                of_whom = {"configuration": configuration, "family": of.family.family}
                self._changed("executed", **of_whom, runs=runs, simulated_s=round(took_s, 3))

    def judge(self, configuration: str, judgments: Mapping[int, str], reasons: Mapping[int, str] | None = None) -> None:
        """Count runs that are done, each with the judgment of all oracles together.

        Args:
            reasons: Run to the reason of its judgment, where there is one.
        """
        with self._lock:
            if (of := self._configurations.get(configuration)) is None:
                return
            for judgment in dict.fromkeys(judgments.values()):
                bits = of.bits(run for run, said in judgments.items() if said == judgment)
                new = bits & ~of.judged.get(judgment, 0)
                for before, theirs in of.judged.items():
                    again = bits & theirs
                    of.family.count(before, -again.bit_count())
                    of.judged[before] = theirs & ~again
                of.judged[judgment] = of.judged.get(judgment, 0) | bits
                of.family.count(judgment, bits.bit_count())
                if new and self._changes is not None:
                    self._tell(configuration, of.family.family, judgment, _runs(new), reasons or {})
            done, was_done = sum(theirs.bit_count() for theirs in of.judged.values()), of.done
            self._judged += done - was_done
            self._configurations_done += (done == of.most) - (was_done == of.most)
            of.done = done

    def _tell(
        self, configuration: str, family: str, judgment: str, runs: list[int], reasons: Mapping[int, str]
    ) -> None:
        alike: dict[str | None, list[int]] = {}
        for run in runs:
            alike.setdefault(reasons.get(run), []).append(run)
        of = {"configuration": configuration, "family": family, "judgment": judgment}
        for reason, theirs in alike.items():
            self._changed("verdicts", **of, reason=reason, runs=theirs)

    def _changed(self, event: str, **values: Any) -> None:
        if self._changes is not None:
            self._changes.append(Change(event, values))

    def progress(self) -> Progress:
        with self._lock:
            families = self._families.values()
            return Progress(
                phase=self._phase,
                configurations_done=self._configurations_done,
                configurations_total=len(self._configurations),
                runs_done=self._judged,
                runs_total=sum(family.runs for family in families),
                executed=self._executed,
                reused=self._reused,
                passed=sum(family.passed for family in families),
                failed=sum(family.failed for family in families),
                not_judged=sum(family.not_judged for family in families),
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
        judged: Judgment to its runs.
        done: Number of judged runs.
    """

    runs: int
    most: int
    family: FamilyProgress
    reused: int = 0
    executed: int = 0
    judged: dict[str, int] = field(default_factory=dict)
    done: int = 0

    def bits(self, runs: Iterable[int]) -> int:
        if isinstance(runs, range) and runs.step == 1:
            stop = max(min(runs.stop, self.runs), 0)
            return (1 << stop) - (1 << max(runs.start, 0)) if runs.start < stop else 0
        bits = 0
        for run in runs:
            if run < self.runs:
                bits |= 1 << run
        return bits


def _runs(bits: int) -> list[int]:
    return [run for run in range(bits.bit_length()) if bits >> run & 1]


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
