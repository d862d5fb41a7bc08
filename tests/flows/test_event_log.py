"""The events of a running campaign: written by its flow, followed in another terminal, and a stop with a reason."""

import json
import os
import signal
import threading
import time
from datetime import UTC, datetime
from types import SimpleNamespace

import pytest
from asleep import gated, sleepers
from command_line import called, refused

from vastflow.flows.request.run_request import RunRequest
from vastflow.flows.results.directory import new_directory
from vastflow.flows.run import event_log
from vastflow.flows.run.event_log import CampaignStopped, EventLog, open_log
from vastflow.flows.terminal.following import lines_of, runs_text
from vastflow.oracles.results.events import EVENTS, Event, EventReader
from vastflow.oracles.results.unfinished import WRITER, ask_to_stop, is_running, place_of, unfinished, writer
from vastflow.sim.model.faults import FileError
from vastflow.tasks.engine.executor import PoolClosed
from vastflow.tasks.engine.progress import Tally

CREATED = datetime(2026, 11, 21, 6, 5, 4)
INTERVAL_S = 0.02


@pytest.fixture(autouse=True)
def often(monkeypatch):
    monkeypatch.setattr(event_log, "INTERVAL_S", INTERVAL_S)


class Engine:
    """An engine that can be closed."""

    closed = False

    def close(self):
        self.closed = True


@pytest.fixture
def campaign(tmp_path):
    """A prepared campaign and its computation, as far as events need them."""
    run = SimpleNamespace(
        name="room",
        delivery=SimpleNamespace(folder=tmp_path),
        campaign=SimpleNamespace(path=tmp_path / "room.vast"),
        request=RunRequest(campaign="room.vast", runs=3),
    )
    return run, SimpleNamespace(tally=Tally(), engine=Engine(), created=CREATED)


def events_in(place):
    return EventReader(place).new()


def counted(tally):
    tally.begin("running")
    tally.expect({"room-1": 3, "hall-1": 2}, {"room-1": "room", "hall-1": "hall"})
    tally.execute("room-1", {0: 1.5, 1: 2.0, 2: 2.5})
    tally.judge("room-1", {0: "pass", 1: "fail", 2: "fail"}, {1: "contact", 2: "lost"})
    tally.judge("room-1", {0: "pass", 1: "fail", 2: "fail"}, {1: "contact", 2: "lost"})
    tally.fault("hall-1", 1, "execute", "broken")
    tally.notice("a notice")


def test_log_has_each_change_once(campaign, tmp_path):
    run, computing = campaign
    with open_log(run, computing) as log:
        counted(computing.tally)
        place = log.directory.place
        log.close("ended", faults=1)
    began, *changes, progress, last = events_in(place)
    file = {"name": "room", "file": str(tmp_path / "room.vast"), "directory": str(log.directory.final)}
    file |= {"folder": os.getcwd(), "request": {"campaign": "room.vast", "runs": 3}}
    assert (began.event, began.values) == ("began", {**file, "process": os.getpid(), "host": os.uname().nodename})
    of = {"configuration": "room-1", "family": "room"}
    assert [(change.event, change.values) for change in changes if change.event != "progress"] == [
        ("stage", {"stage": "running"}),
        ("executed", {**of, "runs": [0, 1, 2], "simulated_s": 6.0}),
        ("verdicts", {**of, "judgment": "pass", "reason": None, "runs": [0]}),
        ("verdicts", {**of, "judgment": "fail", "reason": "contact", "runs": [1]}),
        ("verdicts", {**of, "judgment": "fail", "reason": "lost", "runs": [2]}),
        ("fault", {"configuration": "hall-1", "run_index": 1, "stage": "execute", "error": "broken"}),
        ("notice", {"text": "a notice"}),
    ]
    assert (progress.event, progress.values["phase"], progress.values["runs_total"]) == ("progress", "running", 5)
    assert progress.values["families"] == [
        {"family": "room", "configurations": 1, "runs": 3, "passed": 1, "failed": 2, "not_judged": 0},
        {"family": "hall", "configurations": 1, "runs": 2, "passed": 0, "failed": 0, "not_judged": 0},
    ]
    assert (last.event, last.values["faults"]) == ("ended", 1)
    lines = (place / EVENTS).read_text().splitlines()
    assert last.values["log"]["lines"] == len(lines) and last.values["log"]["cpu_s"] < 0.1


def test_first_event_has_no_credentials(campaign):
    run, computing = campaign
    run.request = RunRequest(
        campaign="room.vast", store="s3://KEY:SECRET@bucket/store", results="sftp://me:pw@host/out"
    )
    with open_log(run, computing) as log:
        text = (log.directory.place / EVENTS).read_text()
        log.close("ended", faults=0)
    assert "SECRET" not in text and "me:pw" not in text
    assert '"s3://bucket/store"' in text


def test_log_writes_while_campaign_runs(campaign):
    run, computing = campaign
    with open_log(run, computing) as log:
        counted(computing.tally)
        reader, found = EventReader(log.directory.final), []
        while "progress" not in found:
            found += [event.event for event in reader.new()]
        assert found[:3] == ["began", "stage", "executed"]
        assert is_running(log.directory.place)


def test_log_survives_full_disk(campaign, tmp_path, caplog):
    run, computing = campaign
    with new_directory(tmp_path, "room", CREATED) as directory:
        (directory.running / EVENTS).symlink_to("/dev/full")
        log = EventLog(directory, computing)
        log.begin("room", run.campaign.path, run.request)
        counted(computing.tally)
        log.close("ended")
    assert "events are lost, they can't be written (No space left on device)" in caplog.text


def test_log_begins_new_line_after_torn_one(campaign, monkeypatch):
    run, computing = campaign
    write = os.write
    with open_log(run, computing) as log:
        monkeypatch.setattr(os, "write", lambda file, content: write(file, content[: len(content) // 2]))
        computing.tally.notice("lost")
        log._append([Event(datetime.now(UTC), "notice", {"text": "torn"})])
        monkeypatch.undo()
        log._append([Event(datetime.now(UTC), "notice", {"text": "whole"})])
        place = log.directory.place
    reader = EventReader(place)
    assert "whole" in [event.values.get("text") for event in reader.new()] and reader.damaged == 1


@pytest.mark.parametrize(
    ("error", "reason"), [(KeyboardInterrupt(), "interrupted"), (ValueError("a\nb"), "a b"), (KeyError(), "KeyError")]
)
def test_log_of_campaign_without_directory_has_reason(campaign, error, reason):
    run, computing = campaign
    with pytest.raises(type(error)), open_log(run, computing) as log:
        raise error
    place = place_of(log.directory.final)
    assert place == log.directory.running and not is_running(place) and not (place / WRITER).exists()
    last = events_in(place)[-1]
    assert (last.event, last.values["reason"]) == ("stopped", reason)


def test_log_of_wrong_campaign_file_leaves_nothing(campaign, tmp_path):
    run, computing = campaign
    with pytest.raises(FileError), open_log(run, computing):
        raise FileError([])
    assert list(tmp_path.iterdir()) == []


def test_stop_closes_engine_and_gives_its_reason(campaign):
    run, computing = campaign
    with pytest.raises(CampaignStopped, match=r"^stopped: wrong noise$"), open_log(run, computing) as log:
        ask_to_stop(log.directory.final, "wrong noise")
        while not computing.engine.closed:
            time.sleep(INTERVAL_S)
        raise PoolClosed
    assert events_in(log.directory.final)[-1].values["reason"] == "wrong noise"
    assert [path.name for path in log.directory.running.iterdir()] == [EVENTS]


def test_log_survives_deleted_folder(campaign):
    run, computing = campaign
    with open_log(run, computing) as log:
        for path in log.directory.running.iterdir():
            path.unlink()
        log.directory.running.rmdir()
        counted(computing.tally)
        with log.directory.writing() as place:
            (place / "report.html").write_text("whole")
        log.close("ended")
    assert [path.name for path in log.directory.final.iterdir()] == ["report.html"]


def followed(place, *events):
    place.mkdir(parents=True, exist_ok=True)
    (place / EVENTS).write_bytes(b"".join(Event(datetime.now(UTC), *event).line for event in events))
    return place


BEGAN = ("began", {"name": "room"})
FAILED = {"configuration": "room-1", "family": "room", "judgment": "fail", "reason": "contact", "runs": [0, 1, 4]}
PROGRESS = {"phase": "running", "runs_done": 4, "runs_total": 4, "configurations_total": 1, "passed": 1, "failed": 3}


def test_show_follow_prints_failures_and_outcome(tmp_path):
    ended = {"passed": 1, "failed": 3, "not_judged": 0}
    place = followed(tmp_path / "room", BEGAN, ("verdicts", FAILED), ("progress", PROGRESS), ("ended", ended))
    shown = called("show", "--follow", place)
    assert shown.exit_code == 0
    assert shown.stderr == "room-1 runs 0–1, 4 failed: contact\n"
    assert shown.stdout == f"1 passed, 3 failed, 0 not judged\nno report, but tables: {place}\n"


def test_show_follow_finds_running_campaign_in_folder(tmp_path):
    place = followed(
        tmp_path / ".room-2026-11-21-060504.running", BEGAN, ("verdicts", FAILED), ("stopped", {"reason": "noise"})
    )
    (place / WRITER).write_text(json.dumps(writer()))
    shown = called("show", "--follow", tmp_path)
    assert (shown.exit_code, shown.stdout) == (130, "room-2026-11-21-060504 stopped: noise\n")
    assert shown.stderr == "room-1 runs 0–1, 4 failed: contact\n"
    rows = called("show", "--follow", "--json", tmp_path).stdout.splitlines()
    assert [json.loads(row)["event"] for row in rows] == ["began", "verdicts", "stopped"]


def test_show_follow_refuses_folder_where_nothing_runs(tmp_path):
    followed(tmp_path / ".room-2026-11-21-060504.running", BEGAN)
    assert refused("show", "--follow", tmp_path).endswith(
        "expected a campaign directory with events.jsonl, or a folder where a campaign runs"
    )
    assert refused("show").startswith("RESULTS: Name a campaign directory")
    assert refused("show", "--follow", "--coverage").startswith("--coverage: expected a finished campaign")


def test_lines_name_runs_that_did_not_pass():
    fault = {"configuration": "", "run_index": None, "stage": "report", "error": "broken"}
    unjudged = {**FAILED, "judgment": "not judged", "reason": None, "runs": [2]}
    events = [("fault", fault), ("verdicts", unjudged), ("verdicts", {**FAILED, "judgment": "pass"}), BEGAN]
    lines = [line for event in events for line in lines_of(Event(datetime.now(UTC), *event))]
    assert lines == ["fault: campaign, report: broken", "room-1 run 2 not judged"]
    assert runs_text([0, 1, 2, 5, 7, 8]) == "runs 0–2, 5, 7–8"


@pytest.fixture
def asleep(tmp_path, prefect_home):
    """Starts a campaign at a gate in its own process, and waits for its first run."""
    commands = [f"{gated(tmp_path, 2)} {k}" for k in range(6)]  # a unit has one or two runs
    with sleepers(tmp_path, prefect_home(tmp_path / "prefect"), commands, runs=2, workers=1) as begun:

        def start(results):
            before = {*unfinished(tmp_path / results)}
            (tmp_path / "begun").unlink(missing_ok=True)
            process = begun(results)
            deadline_s = time.monotonic() + 240
            while process.poll() is None and time.monotonic() < deadline_s:
                for place in {*unfinished(tmp_path / results)} - before:
                    if any(event.event == "executed" for event in EventReader(place).new()):
                        return process, place
                time.sleep(0.1)
            process.kill()
            raise AssertionError(process.communicate()[0])

        yield start


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_running_campaign_is_followed_stopped_killed_and_resumed(asleep, tmp_path):
    process, place = asleep("one")
    assert is_running(place)
    ask_to_stop(place, "wrong noise")
    said, _ = process.communicate(timeout=120)
    assert process.returncode == 130 and "stopped: wrong noise. `vastflow" in said.splitlines()[-1]
    assert events_in(place)[-1].values["reason"] == "wrong noise" and not is_running(place)

    process, place = asleep("two")
    process.send_signal(signal.SIGTERM)
    process.communicate(timeout=120)
    assert (process.returncode, events_in(place)[-1].values["reason"]) == (130, "interrupted")

    process, place = asleep("three")
    process.kill()
    process.communicate(timeout=120)
    assert not is_running(place) and [event.event for event in events_in(place)][-1] not in ("stopped", "ended")
    shown = called("show", "--follow", place)
    assert (shown.exit_code, shown.stdout.split(" stopped: ")[1]) == (130, "its process is gone\n")

    process, place = asleep("two")
    threading.Timer(10.0, (tmp_path / "go").touch).start()
    shown = called("show", "--follow", tmp_path / "two")
    said, _ = process.communicate(timeout=120)
    assert (process.returncode, shown.exit_code) == (0, 0), said
    assert shown.stdout.startswith("100 % passed; ") and "\n12 passed, 0 failed, 0 not judged\nreport: " in shown.stdout
    found = [event for event in events_in(place) if event.event == "verdicts"]
    assert sorted(run for event in found for run in event.values["runs"]) == [*[0] * 6, *[1] * 6]
    last = events_in(place)[-1].values
    assert last["log"]["cpu_s"] <= 0.02 * last["cpu_s"] and last["reused"] > 0
