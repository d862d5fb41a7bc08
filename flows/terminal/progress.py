"""The progress of a campaign in words, its measured speed, and its display in a notebook."""

import logging
import sys
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final, Protocol

from markupsafe import Markup

from vastflow.tasks.engine.progress import Progress

LOGGER: Final = logging.getLogger("vastflow.notices")

WINDOW_S: Final = 60.0
"""A campaign's later configurations may be slower than its first, so only the last minute counts."""
COMPILING_AFTER_S: Final = 3.0
PREFECT_STARTS_S: Final = 12.0
"""Upper limit of Prefect's start on an idle machine."""
NOTEBOOK_INTERVAL_S: Final = 0.5

_PHASES: Final[Mapping[str, str]] = {
    "scanning": "checking the store",
    "starting Prefect": f"starting Prefect, which takes 5–{PREFECT_STARTS_S:.0f} s",
    "instantiating": "instantiating configurations",
    "running": "running",
    "reporting": "writing tables, figures and the report",
    "postprocessing": "running postprocessing steps",
}
_SHOWN: Final = Markup(
    '<progress style="width:20em" max="{}" value="{}"></progress><pre style="margin:0;white-space:pre-wrap">{}</pre>'
)


def count_text(n: int, noun: str, plural: str = "") -> str:
    """Return a count such as `1 run`, `1,816 runs`, or `2 families`."""
    return f"{n:,} {noun if n == 1 else plural or f'{noun}s'}"


def bytes_text(size: int) -> str:
    """Return a size such as `4.9 MB`."""
    for power, unit in enumerate(("B", "kB", "MB", "GB")):
        if size / 1000**power < 999.5:
            return f"{size / 1000**power:.3g} {unit}"
    return f"{size / 1e12:.3g} TB"


def duration_text(seconds: float) -> str:
    """`9 s`, `1:05`, `2:03:04`."""
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    minutes, s = divmod(whole, 60)
    hours, m = divmod(minutes, 60)
    return f"{hours}:{m:02}:{s:02}" if hours else f"{m}:{s:02}"


@dataclass(frozen=True, slots=True)
class Pace:
    """Times and speed of a campaign.

    Attributes:
        elapsed_s, phase_s: Time since the campaign and since the phase began.
        runs_per_s: Executed runs per second; None before the second report of executed runs.
        times_real_time: Simulated seconds per second; None if `runs_per_s` is None.
        left_s: Time until the last run is done; None if unknown.
    """

    elapsed_s: float
    phase_s: float
    runs_per_s: float | None = None
    times_real_time: float | None = None
    left_s: float | None = None


class Meter:
    """Measures the pace from reports of progress and their times."""

    def __init__(self, started_s: float) -> None:
        self._started_s = started_s
        self._phase = ""
        self._phase_began_s = started_s
        self._reports: deque[tuple[float, int, float]] = deque()

    def note(self, progress: Progress, now_s: float) -> None:
        """Add a report."""
        if progress.phase != self._phase:
            self._phase, self._phase_began_s = progress.phase, now_s
            self._reports.clear()
        if self._reports and progress.executed and not self._reports[-1][1]:
            self._reports.clear()  # the first run also compiled kernels: the pace counts from its end
        self._reports.append((now_s, progress.executed, progress.simulated_s))
        while len(self._reports) > 2 and now_s - self._reports[1][0] > WINDOW_S:
            self._reports.popleft()

    def pace(self, progress: Progress, now_s: float) -> Pace:
        """Return the pace at `now_s` after the last report `progress`."""
        elapsed_s, phase_s = now_s - self._started_s, now_s - self._phase_began_s
        if not self._reports:
            return Pace(elapsed_s, phase_s)
        began_s, executed, simulated_s = self._reports[0]
        done, time_s = progress.executed - executed, now_s - began_s
        if done <= 0 or time_s <= 0:
            return Pace(elapsed_s, phase_s)
        runs_per_s = done / time_s
        return Pace(
            elapsed_s,
            phase_s,
            runs_per_s,
            (progress.simulated_s - simulated_s) / time_s,
            (progress.runs_total - progress.runs_done) / runs_per_s,
        )


def phase_text(progress: Progress, pace: Pace) -> str:
    """Return the phase and why the user waits for it."""
    text = _PHASES.get(progress.phase, progress.phase)
    if progress.phase == "starting Prefect" and pace.phase_s > PREFECT_STARTS_S:
        return f"{text}, and longer on a busy machine"
    if progress.phase != "running":
        return text
    if progress.runs_done == progress.runs_total:
        return "all runs are done, Prefect records its task runs"
    if not progress.executed and progress.reused < progress.runs_total and pace.phase_s > COMPILING_AFTER_S:
        return f"{text} (the first run of a version compiles its kernels)"
    return text


def pace_words(progress: Progress, pace: Pace) -> list[str]:
    """Return cached runs, speed, and time left, as far as known."""
    words = [f"{progress.reused} from the store"] if progress.reused else []
    if pace.runs_per_s is not None and (factor := pace.times_real_time) is not None:
        words += [f"{pace.runs_per_s:.3g} runs/s", f"{factor:{',.0f' if factor >= 10 else '.2g'}} × real time"]
    if pace.left_s is not None and progress.runs_done < progress.runs_total:
        words.append(f"{'at most' if progress.at_most else 'about'} {duration_text(pace.left_s)} left")
    return words


def counts_text(progress: Progress) -> list[str]:
    """Return done and expected runs and configurations."""
    runs = f"{progress.runs_done}/{progress.runs_total} runs{' at most' * progress.at_most}"
    return [runs, f"{progress.configurations_done}/{progress.configurations_total} configurations"]


def verdicts_text(progress: Progress) -> list[tuple[str, str]]:
    """Return the verdicts with their colors."""
    counts = (
        (progress.passed, "passed", "green"),
        (progress.failed, "failed", "red"),
        (progress.not_judged, "not judged", "yellow"),
    )
    return [(f"{n} {said}", color if n else "dim") for n, said, color in counts if n or said != "not judged"]


def line_text(progress: Progress, pace: Pace) -> str:
    """Return the progress on one line."""
    words = [phase_text(progress, pace)]
    if progress.runs_total:
        words += [*counts_text(progress), *pace_words(progress, pace)]
    if progress.runs_done:
        words += [said for said, _ in verdicts_text(progress)]
    return ", ".join(words)


def plain_line(progress: Progress, pace: Pace) -> str:
    """Return the progress on one line, after the elapsed time."""
    return f"[{duration_text(pace.elapsed_s):>6}] {line_text(progress, pace)}"


class Output(Protocol):
    """An output of a notebook's cell: a handle of `IPython.display.display`."""

    def update(self, shown: Any) -> None:
        """Replace the shown object."""


class NotebookDisplay:
    """An observer of a campaign that shows its progress, as `html`, in the `output` of a notebook's cell."""

    def __init__(self, output: Output, html: Callable[[str], Any], clock: Callable[[], float] = time.monotonic) -> None:
        self._output = output
        self._html = html
        self._clock = clock
        self._meter = Meter(clock())
        self._shown_s = float("-inf")

    def update(self, progress: Progress) -> None:
        """Show `progress` at most twice a second, and always when all runs are done."""
        now_s = self._clock()
        self._meter.note(progress, now_s)
        if now_s - self._shown_s >= NOTEBOOK_INTERVAL_S or 0 < progress.runs_total == progress.runs_done:
            self._shown_s = now_s
            line = plain_line(progress, self._meter.pace(progress, now_s))
            words = "\n".join([*progress.notices, line])
            self._output.update(self._html(str(_SHOWN.format(progress.runs_total or 1, progress.runs_done, words))))


class LoggedNotices:
    """An observer that logs notices, such as that a cluster has no workers, where nothing else shows them."""

    def __init__(self) -> None:
        self._logged = 0

    def update(self, progress: Progress) -> None:
        """Log the notices that are new."""
        for notice in progress.notices[self._logged :]:
            record = LOGGER.makeRecord(LOGGER.name, logging.WARNING, __file__, 0, notice, (), None)
            LOGGER.handle(record)
            if not logging.getLogger("vastflow").propagate:  # as in a campaign, whose records are for its log
                logging.getLogger().handle(record)
        self._logged = len(progress.notices)


def notebook_display() -> NotebookDisplay | None:
    """Return the display of the current notebook cell, or None outside of a notebook."""
    ipython = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython is not None else None
    if ipython is None or getattr(shell, "kernel", None) is None:
        return None
    shown = ipython.display
    return NotebookDisplay(shown.display(shown.HTML(""), display_id=True), shown.HTML)
