"""Events of a campaign: the format of their lines, and the reader that follows them."""

import json
import os
import subprocess
import sys
import threading
import time
from datetime import UTC, datetime
from pathlib import Path

import pytest
from table import each_row

from vastflow.oracles.results.events import EVENT_NAMES, EVENTS, Event, EventReader, event_of, follow
from vastflow.oracles.results.unfinished import (
    PARTIAL,
    RUNNING,
    STOP,
    WRITER,
    ask_to_stop,
    final_of,
    is_running,
    place_of,
    stop_reason,
    unfinished,
    writer,
)
from vastflow.sim.model.faults import UserError

AT = datetime(2026, 11, 21, 6, 5, 4, 123456, tzinfo=UTC)
NAME = "room-2026-11-21-060504"
DOCS = Path(__file__).parents[2] / "docs" / "read-the-report.md"


@pytest.fixture
def running(tmp_path):
    """The folder of a campaign that this process runs."""
    place = tmp_path / RUNNING.format(NAME)
    place.mkdir()
    (place / WRITER).write_text(json.dumps(writer()))
    return place


def appended(place, *events, half=b""):
    with (place / EVENTS).open("ab") as file:
        file.write(b"".join(event.line for event in events) + half)


def test_line_has_time_event_and_values():
    event = Event(AT, "verdicts", {"configuration": "röm-1", "judgment": "fail", "reason": None, "runs": [0, 3]})
    assert event.line == (
        b'{"at":"2026-11-21T06:05:04.123+00:00","event":"verdicts","configuration":"r\\u00f6m-1",'
        b'"judgment":"fail","reason":null,"runs":[0,3]}\n'
    )
    assert event_of(event.line).values == event.values


def test_documentation_lists_each_event():
    section = DOCS.read_text(encoding="utf-8").partition("### Events")[2]
    rows = [line.split("|")[1].strip(" `") for line in section.splitlines() if line.startswith("| `")]
    assert rows == [*EVENT_NAMES]


def test_reader_keeps_half_written_line_for_later(running):
    reader, began = EventReader(running), Event(AT, "began", {"name": "röm"})
    assert reader.new() == []
    appended(running, began, half=began.line[:20])
    assert [event.event for event in reader.new()] == ["began"]
    assert reader.new() == []
    appended(running, half=began.line[20:])
    (event,) = reader.new()
    assert event.values == {"name": "röm"} and event.at.year == 2026


def test_reader_counts_damaged_lines(running):
    for line in (b"\0\0\n", b"[]\n", b'{"event": "ended"}\n', b'{"at": 1, "event": "ended"}\n', b"\n"):
        appended(running, half=line)
    appended(running, Event(AT, "began"))
    reader = EventReader(running)
    assert [event.event for event in reader.new()] == ["began"] and reader.damaged == 4


def test_reader_goes_on_under_next_name_of_directory(running, tmp_path):
    reader = EventReader(tmp_path / NAME)
    appended(running, Event(AT, "began"))
    assert [event.event for event in reader.new()] == ["began"]
    partial = running.rename(tmp_path / PARTIAL.format(NAME))
    appended(partial, Event(AT, "stage"))
    assert [event.event for event in reader.new()] == ["stage"]
    final = partial.rename(tmp_path / NAME)
    appended(final, Event(AT, "ended"))
    assert [event.event for event in reader.new()] == ["ended"]


def test_follow_yields_events_as_they_are_written(running, tmp_path):
    appended(running, Event(AT, "began"))
    threading.Timer(0.3, lambda: appended(running, Event(AT, "notice"), Event(AT, "ended"), Event(AT, "stage"))).start()
    events = follow(str(tmp_path / NAME), poll_s=0.05)
    assert [event.event for event in events] == ["began", "notice", "ended"]


def test_follow_ends_after_process_is_gone(running):
    appended(running, Event(AT, "began"), half=b'{"at"')
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    (running / WRITER).write_text(json.dumps({**writer(), "pid": ended.pid}))
    *_, last = events = list(follow(running, poll_s=0.01))
    assert len(events) == 2 and (last.event, last.values) == ("stopped", {"reason": "its process is gone"})


def test_follow_of_whole_directory_without_events_yields_nothing(tmp_path):
    (tmp_path / NAME).mkdir()
    assert list(follow(tmp_path / NAME, poll_s=0.01)) == []


def test_unfinished_yields_hidden_folders_of_campaigns_alone(running, tmp_path):
    for name in (NAME, ".out.123.partial", f".{NAME}.other", ".git"):
        (tmp_path / name).mkdir()
    (tmp_path / PARTIAL.format("hall-2026-11-21-060504-2")).mkdir()
    assert {final_of(place).name for place in unfinished(tmp_path)} == {NAME, "hall-2026-11-21-060504-2"}
    assert place_of(tmp_path / NAME) == running and place_of(tmp_path / "none") is None


@each_row(
    ("host", "age_s", "runs"),
    [(None, 1e6, True), ("elsewhere", 1.0, True), ("elsewhere", 300.0, False)],
)
def test_directory_runs_by_process_or_by_signs_of_life(running, host, age_s, runs):
    (running / WRITER).write_text(json.dumps({**writer(), **({"host": host} if host else {})}))
    then = time.time() - age_s
    os.utime(running, (then, then))
    assert is_running(running) is runs


def test_directory_without_readable_writer_does_not_run(running):
    (running / WRITER).write_text("{")
    assert not is_running(running)


def test_stop_gives_its_reason_to_running_campaign_only(running, tmp_path):
    assert stop_reason(running) is None
    ask_to_stop(tmp_path / NAME, " wrong\nnoise ")
    assert stop_reason(running) == "wrong noise"
    (running / STOP).write_text("{")
    assert stop_reason(running) == "no reason given"
    (running / WRITER).unlink()
    with pytest.raises(UserError, match=f"{NAME}: expected a running campaign, got one that has ended"):
        ask_to_stop(tmp_path / NAME, "late")


def test_stop_request_follows_no_link(running, tmp_path):
    mine = tmp_path / "mine"
    mine.write_text("precious")
    for name in (STOP, f".{STOP}.{os.getpid()}", f".{STOP}"):
        (running / name).symlink_to(mine)
    ask_to_stop(tmp_path / NAME, "wrong noise")
    assert (mine.read_text(), stop_reason(running)) == ("precious", "wrong noise")
    assert not (running / STOP).is_symlink()
