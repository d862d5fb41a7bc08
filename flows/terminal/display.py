"""The display of a running campaign: live on a terminal, plain lines elsewhere, always on stderr."""

import sys
import threading
import time
from collections.abc import Callable, Mapping
from types import TracebackType
from typing import Final, Self, TextIO

from rich.console import Console, Group
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from vastflow.flows.terminal.pace import Meter, Pace
from vastflow.tasks.engine.progress import Progress

PLAIN_INTERVAL_S: Final = 5.0
UNCHANGED_INTERVAL_S: Final = 30.0
"""Time between two equal lines."""
PLAIN_SHARE: Final = 0.02
"""Share of the elapsed time between two lines: a campaign of hours prints fewer."""
PASSING_S: Final = 1.0
"""Shorter phases get no line."""
COMPILING_AFTER_S: Final = 3.0
PREFECT_STARTS_S: Final = 12.0
"""Upper limit of Prefect's start on an idle machine."""

_PHASES: Final[Mapping[str, str]] = {
    "scanning": "checking the store",
    "starting Prefect": f"starting Prefect, which takes 5–{PREFECT_STARTS_S:.0f} s",
    "instantiating": "instantiating configurations",
    "running": "running",
    "reporting": "writing tables, figures and the report",
    "postprocessing": "running postprocessing steps",
}
_SPINNER: Final = "⠋⠙⠹⠸⠼⠴⠦⠧⠇⠏"


def view(progress: Progress, pace: Pace) -> Group:
    """Return the live view: the phase, and once there are runs, a bar, the verdicts, and the pace."""
    frame = _SPINNER[int(pace.elapsed_s * 8) % len(_SPINNER)]
    lines: list[Text | Table] = [Text(f"{frame} {phase_text(progress, pace)}  {duration_text(pace.phase_s)}")]
    if progress.runs_total:
        bar = Table.grid(padding=(0, 2))
        bar.add_row(
            ProgressBar(total=progress.runs_total, completed=progress.runs_done, width=30),
            _runs(progress),
            _of(progress.configurations_done, progress.configurations_total, "configurations"),
        )
        verdicts = Text("  ").join(Text(f"{n} {said}", style if n else "dim") for n, said, style in _verdicts(progress))
        lines += [bar, verdicts, Text("  ".join(pace_words(progress, pace)), "dim")]
    return Group(*lines)


def plain_line(progress: Progress, pace: Pace) -> str:
    """Return the progress on one line, after the elapsed time."""
    return f"[{duration_text(pace.elapsed_s):>6}] {_line_words(progress, pace)}"


def _line_words(progress: Progress, pace: Pace) -> str:
    words = [phase_text(progress, pace)]
    if progress.runs_total:
        words += [
            _runs(progress),
            _of(progress.configurations_done, progress.configurations_total, "configurations"),
            *pace_words(progress, pace),
        ]
    if progress.runs_done:
        words += [f"{n} {said}" for n, said, _ in _verdicts(progress)]
    return ", ".join(words)


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
        return f"{text}; the first run of a version compiles its kernels"
    return text


def pace_words(progress: Progress, pace: Pace) -> list[str]:
    """Return cached runs, speed, and time left, as far as they are known."""
    words = [f"{progress.reused} from the store"] if progress.reused else []
    if pace.runs_per_s is not None and pace.times_real_time is not None:
        words += [f"{pace.runs_per_s:.3g} runs/s", f"{_rounded(pace.times_real_time)} × real time"]
    if pace.left_s is not None and progress.runs_done < progress.runs_total:
        words.append(f"{'at most' if progress.at_most else 'about'} {duration_text(pace.left_s)} left")
    return words


def duration_text(seconds: float) -> str:
    """`9 s`, `1:05`, `2:03:04`."""
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    minutes, s = divmod(whole, 60)
    hours, m = divmod(minutes, 60)
    return f"{hours}:{m:02}:{s:02}" if hours else f"{m}:{s:02}"


class Display:
    """An observer of a campaign that shows its progress until it is closed."""

    def __init__(self, stream: TextIO | None = None, clock: Callable[[], float] = time.monotonic) -> None:
        self._stream = stream or sys.stderr
        self._clock = clock
        self._lock = threading.RLock()
        self._progress: Progress | None = None
        self._meter = Meter(clock())
        self._noticed = 0
        self._closed = False
        self._ended = threading.Event()
        self._last_line_s = float("-inf")
        self._last_words = ""
        self._last_phase = ""
        self._console = Console(file=self._stream)
        self._is_live = self._console.is_terminal and not self._console.is_dumb_terminal
        # Standard output stays as it is: nothing but results is ever written there.
        self._live = Live(
            console=self._console,
            get_renderable=self._view,
            refresh_per_second=8,
            transient=True,
            redirect_stdout=False,
            redirect_stderr=False,
        )

    def __enter__(self) -> Self:
        if self._is_live:
            self._live.start()
        else:
            threading.Thread(target=self._go_on, name="vastflow display", daemon=True).start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()

    def update(self, progress: Progress) -> None:
        """Show `progress`; called from one thread."""
        with self._lock:
            for notice in progress.notices[self._noticed :]:
                self._console.print(notice, markup=False, highlight=False, soft_wrap=True)
            self._noticed = len(progress.notices)
            self._progress = progress
            self._meter.note(progress, self._clock())
            self._write_line_if_due()

    def close(self, last_words: str = "") -> None:
        """Clear the display and write `last_words`; later calls do nothing."""
        with self._lock:
            if self._closed:
                return
            self._closed = True
        self._ended.set()
        self._live.stop()
        if last_words:
            print(last_words, file=self._stream, flush=True)

    def _view(self) -> Group:
        with self._lock:
            if self._progress is None:
                return Group()
            return view(self._progress, self._meter.pace(self._progress, self._clock()))

    def _go_on(self) -> None:
        """Print lines while no progress is reported."""
        while not self._ended.wait(1.0):
            with self._lock:
                self._write_line_if_due()

    def _write_line_if_due(self) -> None:
        if self._closed or self._is_live or self._progress is None:
            return
        now_s = self._clock()
        pace = self._meter.pace(self._progress, now_s)
        waits = self._progress.phase == "starting Prefect" != self._last_phase
        words = _line_words(self._progress, pace)
        interval_s = UNCHANGED_INTERVAL_S if words == self._last_words else PLAIN_INTERVAL_S
        pause_s = max(interval_s, PLAIN_SHARE * pace.elapsed_s)
        if waits or (pace.phase_s >= PASSING_S and now_s - self._last_line_s >= pause_s):
            self._last_line_s, self._last_words = now_s, words
            print(plain_line(self._progress, pace), file=self._stream, flush=True)
        self._last_phase = self._progress.phase


def _verdicts(progress: Progress) -> list[tuple[int, str, str]]:
    verdicts = [(progress.passed, "passed", "green"), (progress.failed, "failed", "red")]
    return [*verdicts, (progress.not_judged, "not judged", "yellow")] if progress.not_judged else verdicts


def _rounded(factor: float) -> str:
    return f"{factor:,.0f}" if factor >= 10 else f"{factor:.2g}"


def _runs(progress: Progress) -> str:
    return _of(progress.runs_done, progress.runs_total, "runs at most" if progress.at_most else "runs")


def _of(done: int, total: int, what: str) -> str:
    return f"{done}/{total} {what}"
