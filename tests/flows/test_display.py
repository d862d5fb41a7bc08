"""What a user sees while a campaign runs."""

import io
import re

from rich.console import Console

from vastflow.flows.terminal.display import Display, duration_text, phase_text, plain_line, view
from vastflow.flows.terminal.pace import Meter, Pace
from vastflow.tasks.engine.progress import Progress


def progress(phase="running", **changes):
    counts = {
        "configurations_done": 3,
        "configurations_total": 24,
        "runs_done": 16,
        "runs_total": 120,
        "executed": 12,
        "reused": 4,
        "passed": 9,
        "failed": 5,
        "not_judged": 2,
        "simulated_s": 480.0,
    }
    return Progress(phase=phase, **{**counts, **changes})


def shown(report, pace):
    console = Console(file=io.StringIO(), force_terminal=True, width=120, color_system=None)
    console.print(view(report, pace))
    return re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", console.file.getvalue())


class Terminal(io.StringIO):
    def isatty(self):
        return True


class Clock:
    def __init__(self):
        self.now_s = 0.0

    def __call__(self):
        return self.now_s


def test_running_campaign_shows_counts_pace_and_verdicts():
    text = shown(progress(), Pace(20.0, 12.0, 2.0, 81.6, 52.0))
    for words in (
        "16/120 runs",
        "3/24 configurations",
        "4 from the store",
        "2 runs/s",
        "82 × real time",
        "about 52 s left",
        "9 passed",
        "5 failed",
        "2 not judged",
    ):
        assert words in text


def test_while_prefect_starts_the_display_says_so_and_how_long_it_takes():
    text = shown(progress("starting Prefect", runs_total=0), Pace(3.0, 2.0))
    assert "starting Prefect, which takes 5–12 s  2 s" in text
    assert "runs" not in text
    assert phase_text(progress("starting Prefect"), Pace(40.0, 30.0)).endswith("5–12 s, and longer on a busy machine")


def test_long_wait_for_the_first_run_is_explained_by_compiling():
    waiting = progress(executed=0, runs_done=0)
    assert "compiles its kernels" in phase_text(waiting, Pace(12.0, 6.0))
    assert "compiles" not in phase_text(waiting, Pace(12.0, 1.0))
    assert "compiles" not in phase_text(progress(), Pace(20.0, 12.0, 2.0, 80.0, 50.0))
    assert "compiles" not in phase_text(progress(executed=0, reused=120, runs_done=0), Pace(12.0, 6.0))


def test_wait_after_the_last_run_is_explained():
    assert "Prefect records" in phase_text(progress(runs_done=120), Pace(20.0, 12.0))


def test_no_pace_and_no_time_left_are_shown_before_the_first_run_is_done():
    line = plain_line(progress(executed=0, reused=0), Pace(20.0, 12.0))
    assert "runs/s" not in line and "left" not in line


def test_plain_line_is_one_line_that_says_it_all():
    line = plain_line(progress(), Pace(80.0, 12.0, 2.0, 81.6, 52.0))
    assert line == (
        "[  1:20] running, 16/120 runs, 3/24 configurations, 4 from the store, 2 runs/s, 82 × real time, "
        "about 52 s left, 9 passed, 5 failed, 2 not judged"
    )


def test_durations_read_like_a_clock_from_a_minute_on():
    assert [duration_text(s) for s in (0.2, 59.4, 59.6, 65, 3723)] == ["0 s", "59 s", "1:00", "1:05", "1:02:03"]


def test_pace_counts_executed_runs_and_not_those_from_the_store():
    meter = Meter(0.0)
    meter.note(progress(executed=0, reused=0, runs_done=0, simulated_s=0.0), 5.0)
    meter.note(progress(executed=10, reused=50, runs_done=60, simulated_s=300.0), 6.0)
    last = progress(executed=30, reused=50, runs_done=80, simulated_s=900.0)
    meter.note(last, 10.0)
    pace = meter.pace(last, 10.0)
    assert (pace.runs_per_s, pace.times_real_time, pace.left_s) == (5.0, 150.0, 8.0)


def test_time_until_the_first_run_is_done_does_not_slow_the_pace():
    meter = Meter(0.0)
    meter.note(progress(executed=0, simulated_s=0.0), 0.0)
    meter.note(progress(executed=1, simulated_s=40.0), 30.0)
    last = progress(executed=11, simulated_s=440.0)
    meter.note(last, 32.0)
    assert meter.pace(last, 32.0).runs_per_s == 5.0


def test_only_the_last_minute_counts_for_the_pace():
    meter = Meter(0.0)
    for second in range(201):
        last = progress(executed=1 + (second if second < 100 else 100 + (second - 100) * 10), runs_total=10_000)
        meter.note(last, float(second))
    assert meter.pace(last, 200.0).runs_per_s == 10.0


def test_new_phase_starts_its_own_clock():
    meter = Meter(0.0)
    meter.note(progress("scanning"), 0.0)
    meter.note(progress("starting Prefect"), 1.0)
    pace = meter.pace(progress("starting Prefect"), 4.0)
    assert (pace.elapsed_s, pace.phase_s) == (4.0, 3.0)


def test_without_a_terminal_there_is_at_most_one_line_in_five_seconds():
    stream, clock = io.StringIO(), Clock()
    with Display(stream, clock) as display:
        for tick in range(200):
            clock.now_s = tick * 0.1
            display.update(progress(executed=tick, runs_done=tick))
    assert len(stream.getvalue().splitlines()) == 4


def test_without_a_terminal_the_same_words_come_twice_a_minute():
    stream, clock = io.StringIO(), Clock()
    with Display(stream, clock) as display:
        for second in range(120):
            clock.now_s = float(second)
            display.update(progress(executed=0, reused=0, runs_done=0))
    said = [line.partition("] ")[2] for line in stream.getvalue().splitlines()]
    assert sum("compiles its kernels" in words for words in said) == 4


def test_without_a_terminal_a_phase_that_is_over_at_once_gets_no_line():
    stream, clock = io.StringIO(), Clock()
    with Display(stream, clock) as display:
        for phase in ("scanning", "instantiating", "reporting"):
            display.update(progress(phase))
            clock.now_s += 0.5
    assert stream.getvalue() == ""


def test_without_a_terminal_a_line_comes_while_nothing_is_reported():
    stream, clock = io.StringIO(), Clock()
    with Display(stream, clock) as display:
        display.update(progress(executed=0, runs_done=0))
        clock.now_s = 30.0
        display._write_line_if_due()
    assert "compiles its kernels" in stream.getvalue().splitlines()[-1]


def test_without_a_terminal_lines_get_rarer_with_the_hours():
    stream, clock = io.StringIO(), Clock()
    with Display(stream, clock) as display:
        for minute in range(600):
            clock.now_s = minute * 60.0
            display.update(progress(runs_done=minute))
    assert 80 < len(stream.getvalue().splitlines()) < 250


def test_without_a_terminal_the_start_of_prefect_is_announced_at_once():
    stream, clock = io.StringIO(), Clock()
    with Display(stream, clock) as display:
        display.update(progress("scanning", runs_total=0))
        clock.now_s = 0.5
        display.update(progress("starting Prefect", runs_total=0))
    assert "5–12 s" in stream.getvalue().splitlines()[-1]


def test_on_a_terminal_the_display_is_drawn_and_the_cursor_given_back(monkeypatch):
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


def test_last_words_are_written_once_and_nothing_after_them():
    stream = io.StringIO()
    with Display(stream) as display:
        display.close("interrupted")
        display.close("again")
        display.update(progress())
    assert stream.getvalue() == "interrupted\n"


def test_runs_that_may_not_be_needed_are_shown_as_the_most():
    line = plain_line(progress(at_most=True), Pace(10.0, 9.0, 2.0, 30.0, 52.0))
    assert "16/120 runs at most" in line and "at most 52 s left" in line
