"""Tables of the terminal, and the display of a running campaign: live on a terminal, plain lines elsewhere."""

import sys
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from types import TracebackType
from typing import Final, Self, TextIO

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from vastflow.flows.terminal.progress import (
    Meter,
    Pace,
    counts_text,
    duration_text,
    line_text,
    pace_words,
    phase_text,
    plain_line,
    verdicts_text,
)
from vastflow.tasks.engine.progress import Progress

PLAIN_INTERVAL_S: Final = 5.0
UNCHANGED_INTERVAL_S: Final = 30.0
"""Time between two equal lines."""
PLAIN_SHARE: Final = 0.02
"""Share of the elapsed time between two lines: a campaign of hours prints fewer."""
PASSING_S: Final = 1.0
"""Shorter phases get no line."""
_SPINNER: Final = "⠋⠙⠹⠸⠼⠴⠦⠧⠇⠏"


def view(progress: Progress, pace: Pace) -> Group:
    """Return the live view: the phase and, once there are runs, a bar, the verdicts, and the pace."""
    frame = _SPINNER[int(pace.elapsed_s * 8) % len(_SPINNER)]
    lines: list[Text | Table] = [Text(f"{frame} {phase_text(progress, pace)}  {duration_text(pace.phase_s)}")]
    if progress.runs_total:
        bar = Table.grid(padding=(0, 2))
        done = ProgressBar(total=progress.runs_total, completed=progress.runs_done, width=30)
        bar.add_row(done, *counts_text(progress))
        verdicts = Text("  ").join(Text(*each) for each in verdicts_text(progress))
        lines += [bar, verdicts, Text("  ".join(pace_words(progress, pace)), "dim")]
    return Group(*lines)


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
        while not self._ended.wait(1.0):
            with self._lock:
                self._write_line_if_due()

    def _write_line_if_due(self) -> None:
        if self._closed or self._is_live or self._progress is None:
            return
        now_s = self._clock()
        pace = self._meter.pace(self._progress, now_s)
        waits = self._progress.phase == "starting Prefect" != self._last_phase
        words = line_text(self._progress, pace)
        interval_s = UNCHANGED_INTERVAL_S if words == self._last_words else PLAIN_INTERVAL_S
        pause_s = max(interval_s, PLAIN_SHARE * pace.elapsed_s)
        if waits or (pace.phase_s >= PASSING_S and now_s - self._last_line_s >= pause_s):
            self._last_line_s, self._last_words = now_s, words
            print(plain_line(self._progress, pace), file=self._stream, flush=True)
        self._last_phase = self._progress.phase


def terminal_table(
    names: Sequence[str] = (),
    numbers: Sequence[str] = (),
    words: Sequence[str] = (),
    rows: Iterable[Sequence[str]] = (),
) -> Table:
    """Return a table without lines, and without header if no column is named; `names` and `words` are columns of text."""
    table = Table(
        box=None, show_header=bool(names or numbers), header_style="bold", padding=(0, 2, 0, 0), pad_edge=False
    )
    for name in names:
        table.add_column(name, overflow="fold")
    for name in numbers:
        table.add_column(name, justify="right", no_wrap=True)
    for name in words:
        table.add_column(name, overflow="fold")
    for row in rows:
        table.add_row(*row)
    return table


def print_rows(lines: Iterable[RenderableType]) -> None:
    """Print lines and tables on stdout, each row on one line unless it is a terminal."""
    console = Console(markup=False, highlight=False)
    if not console.is_terminal:
        console = Console(markup=False, highlight=False, width=200)
    for line in lines:
        console.print(line)
