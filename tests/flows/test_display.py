"""The display of a running campaign in a terminal, in a log, and in a notebook."""

import io
import logging
import re
import sys
from types import SimpleNamespace

from rich.console import Console

from vastflow.flows.terminal.display import Display, view
from vastflow.flows.terminal.progress import (
    LoggedNotices,
    Meter,
    NotebookDisplay,
    Pace,
    duration_text,
    notebook_display,
    phase_text,
    plain_line,
)
from vastflow.tasks.engine.progress import Progress


def progress(phase="running", **changes):
    counts = {"configurations_done": 3, "configurations_total": 24, "runs_done": 16, "runs_total": 120}
    counts |= {"executed": 12, "reused": 4, "passed": 9, "failed": 5, "not_judged": 2, "simulated_s": 480.0}
    return Progress(phase=phase, **{**counts, **changes})


def shown(report, pace):
    console = Console(file=io.StringIO(), force_terminal=True, width=120, color_system=None)
    console.print(view(report, pace))
    return re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", console.file.getvalue())


class Terminal(io.StringIO):
    def isatty(self):
        return True


def test_notices_are_logged_once_for_whoever_shows_no_progress(caplog, monkeypatch):
    observer = LoggedNotices()
    for notices in ((), ("no worker",), ("no worker", "back")):
        observer.update(progress(notices=notices))
    monkeypatch.setattr(logging.getLogger("vastflow"), "propagate", False)  # as in a campaign
    observer.update(progress(notices=("no worker", "back", "gone")))
    said = [(each.name, each.levelname, each.getMessage()) for each in caplog.records]
    assert said == [("vastflow.notices", "WARNING", words) for words in ("no worker", "back", "gone")]


def test_view_shows_counts_pace_and_verdicts():
    text = shown(progress(), Pace(20.0, 12.0, 2.0, 81.6, 52.0))
    counts = ("16/120 runs", "3/24 configurations", "4 from the store", "9 passed", "5 failed", "2 not judged")
    for words in (*counts, "2 runs/s", "82 × real time", "about 52 s left"):
        assert words in text
    text = shown(progress("starting Prefect", runs_total=0), Pace(3.0, 2.0))
    assert "starting Prefect, which takes 5–12 s  2 s" in text and "runs" not in text


def test_phase_text_explains_current_work():
    assert phase_text(progress("starting Prefect"), Pace(40.0, 30.0)).endswith("5–12 s, and longer on a busy machine")
    assert "Prefect records" in phase_text(progress(runs_done=120), Pace(20.0, 12.0))
    waiting = progress(executed=0, runs_done=0)
    assert "compiles its kernels" in phase_text(waiting, Pace(12.0, 6.0))
    assert "compiles" not in phase_text(waiting, Pace(12.0, 1.0))
    assert "compiles" not in phase_text(progress(), Pace(20.0, 12.0, 2.0, 80.0, 50.0))
    assert "compiles" not in phase_text(progress(executed=0, reused=120, runs_done=0), Pace(12.0, 6.0))


def test_plain_line_has_pace_once_it_is_known():
    assert plain_line(progress(), Pace(80.0, 12.0, 2.0, 81.6, 52.0)) == (
        "[  1:20] running, 16/120 runs, 3/24 configurations, 4 from the store, 2 runs/s, 82 × real time, "
        "about 52 s left, 9 passed, 5 failed, 2 not judged"
    )
    line = plain_line(progress(at_most=True), Pace(10.0, 9.0, 2.0, 30.0, 52.0))
    assert "16/120 runs at most" in line and "at most 52 s left" in line
    line = plain_line(progress(executed=0, reused=0), Pace(20.0, 12.0))
    assert "runs/s" not in line and "left" not in line


def test_duration_text_reads_like_a_clock_from_a_minute_on():
    assert [duration_text(s) for s in (0.2, 59.4, 59.6, 65, 3723)] == ["0 s", "59 s", "1:00", "1:05", "1:02:03"]


def test_pace_counts_executed_runs_after_first():
    meter = Meter(0.0)
    meter.note(progress(executed=0, reused=0, runs_done=0, simulated_s=0.0), 5.0)
    meter.note(progress(executed=10, reused=50, runs_done=60, simulated_s=300.0), 6.0)
    last = progress(executed=30, reused=50, runs_done=80, simulated_s=900.0)
    meter.note(last, 10.0)
    pace = meter.pace(last, 10.0)
    assert (pace.runs_per_s, pace.times_real_time, pace.left_s) == (5.0, 150.0, 8.0)


def test_pace_covers_last_minute_of_phase():
    meter = Meter(0.0)
    for second in range(201):
        last = progress(executed=1 + (second if second < 100 else 100 + (second - 100) * 10), runs_total=10_000)
        meter.note(last, float(second))
    assert meter.pace(last, 200.0).runs_per_s == 10.0
    meter = Meter(0.0)
    meter.note(progress("scanning"), 0.0)
    meter.note(progress("starting Prefect"), 1.0)
    pace = meter.pace(progress("starting Prefect"), 4.0)
    assert (pace.elapsed_s, pace.phase_s) == (4.0, 3.0)


def lines(*reports):
    """Return the lines that a display without a terminal writes of reports at times (s)."""
    stream, clock = io.StringIO(), SimpleNamespace(now_s=0.0)
    with Display(stream, lambda: clock.now_s) as display:
        for now_s, report in reports:
            clock.now_s = float(now_s)
            if report is None:
                display._write_line_if_due()
            else:
                display.update(report)
    return stream.getvalue().splitlines()


def test_plain_display_writes_fewer_lines_with_the_hours():
    assert len(lines(*((0.1 * k, progress(executed=k, runs_done=k)) for k in range(200)))) == 4
    assert 80 < len(lines(*((60 * k, progress(runs_done=k)) for k in range(600)))) < 250
    waiting = progress(executed=0, reused=0, runs_done=0)
    said = lines(*((k, waiting) for k in range(120)))
    assert sum("compiles its kernels" in line for line in said) == 4


def test_plain_display_skips_short_phases_and_announces_start_of_prefect():
    assert lines((0.0, progress("scanning")), (0.5, progress("instantiating")), (1.0, progress("reporting"))) == []
    scanning, starting = (progress(phase, runs_total=0) for phase in ("scanning", "starting Prefect"))
    assert "5–12 s" in lines((0, scanning), (0.5, starting))[-1]
    assert "compiles its kernels" in lines((0, progress(executed=0, runs_done=0)), (30, None))[-1]


def test_live_display_is_drawn_and_gives_back_cursor(monkeypatch):
    monkeypatch.setenv("TERM", "xterm")
    stream = Terminal()
    with Display(stream) as display:
        display.update(progress())
        display._live.refresh()
    text = stream.getvalue()
    assert "16/120 runs" in text
    assert text.rindex("\x1b[?25h") > text.rindex("\x1b[?25l")


def test_dumb_terminal_gets_plain_lines(monkeypatch):
    monkeypatch.setenv("TERM", "dumb")
    stream = Terminal()
    with Display(stream) as display:
        display.update(progress("starting Prefect"))
    assert stream.getvalue().startswith("[") and "\x1b" not in stream.getvalue()


def test_closed_display_writes_last_words_once():
    stream = io.StringIO()
    with Display(stream) as display:
        display.close("interrupted")
        display.close("again")
        display.update(progress())
    assert stream.getvalue() == "interrupted\n"


def test_notebook_display_renews_one_output_and_ends_with_all_runs_done():
    states, times = [], iter([0.0, 0.1, 0.2, 0.9, 1.0])
    display = NotebookDisplay(SimpleNamespace(update=states.append), lambda html: html, lambda: next(times))
    for done in (1, 2, 3, 4):
        display.update(Progress("running", runs_done=done, runs_total=4, passed=done, notices=("a <note>",)))
    assert [re.search(r'value="(\d)"', shown)[1] for shown in states] == ["1", "3", "4"]
    assert "4/4 runs" in states[-1] and "a &lt;note&gt;" in states[-1]


def test_notebook_display_needs_kernel_of_notebook(monkeypatch):
    monkeypatch.setitem(sys.modules, "IPython", None)
    assert notebook_display() is None
    shown = SimpleNamespace(HTML=lambda html: html, display=lambda what, display_id: None)
    for shell, found in ((None, False), (SimpleNamespace(), False), (SimpleNamespace(kernel="kernel"), True)):
        ipython = SimpleNamespace(get_ipython=lambda shell=shell: shell, display=shown)
        monkeypatch.setitem(sys.modules, "IPython", ipython)
        assert (notebook_display() is not None) is found
