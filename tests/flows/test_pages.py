"""Prefect's pages of a campaign, and logs of its task runs; requests to the API are intercepted."""

import json
import logging
from types import SimpleNamespace
from uuid import uuid4

import pytest
from hypothesis import given
from hypothesis import strategies as st
from prefect.logging.configuration import setup_logging
from prefect.logging.handlers import APILogHandler
from table import each_row

from vastflow.flows.results.summary import Results, Summary
from vastflow.flows.run import pages
from vastflow.flows.run.pages import (
    QUIET_S,
    Page,
    ProgressBar,
    key_of,
    outcome_text,
    progress_text,
    publish,
    size_text,
)
from vastflow.flows.run.task_runs import TASK_RUNS, quiet_task_runs
from vastflow.tasks.engine.progress import Progress

FLOW_RUN = str(uuid4())


class Client:
    """Takes what would be sent."""

    def __init__(self, error=None):
        self.sent = []
        self.flow_runs = []
        self.error = error

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def _take(self, *what):
        self.sent.append(what)
        if self.error is not None:
            raise self.error

    def create_artifact(self, artifact):
        self.flow_runs.append(artifact.flow_run_id)
        self._take("create", artifact.key, artifact.data, artifact.description)
        return SimpleNamespace(id=uuid4())

    def update_artifact(self, _, artifact):
        self._take("update", artifact.data, artifact.description)

    def update_flow_run(self, _, name=None, tags=None):
        self._take("rename", name)


@pytest.fixture
def client(monkeypatch):
    client = Client()
    monkeypatch.setattr(pages, "get_client", lambda sync_client: client)
    return client


@pytest.fixture
def clock(monkeypatch):
    clock = SimpleNamespace(now_s=100.0)
    monkeypatch.setattr(pages.time, "monotonic", lambda: clock.now_s)
    return clock


def test_progress_bar_updates_one_artifact_at_intervals_and_at_end(client, clock):
    bar = ProgressBar("x-progress", str(uuid4()))
    bar.show(0.0, "0 of 4")
    bar.show(0.25, "1 of 4")
    clock.now_s += 3.0
    bar.show(0.5, "2 of 4")
    bar.show(1.0, "4 of 4")
    bar.show(1.0, "4 of 4")
    assert client.sent == [
        ("create", "x-progress", 0.0, "0 of 4"),
        ("update", 50.0, "2 of 4"),
        ("update", 100.0, "4 of 4"),
    ]


def told(client, *states, asked=(5, False)):
    lines = []
    page = Page("Two rooms", str(uuid4()), lines.append, asked)
    for state in states:
        page.update(state)
    return lines


def running(configurations, runs, done=0, **more):
    return Progress(
        "running", configurations_total=configurations, runs_total=runs, runs_done=done, passed=done, **more
    )


@each_row(
    ("states", "asked", "names"),
    [
        (
            [Progress("scanning"), running(24, 120, 20), running(24, 120, 60)],
            (5, False),
            ["Two rooms, 24 configurations × 5 runs"],
        ),
        (
            [running(4, 12, 3), running(4, 12, 12), running(8, 24, 12)],  # a search
            (3, False),
            ["Two rooms, 4 configurations × 3 runs", "Two rooms, 8 configurations × 3 runs"],
        ),
        ([running(24, 222, 222)], (20, True), ["Two rooms, 24 configurations, at most 480 runs"]),
        ([running(24, 120)], None, []),
    ],
)
def test_page_renames_flow_run_by_size_unless_named(client, clock, states, asked, names):
    client.sent.clear()
    lines = told(client, *states, asked=asked)
    assert [sent[1] for sent in client.sent if sent[0] == "rename"] == names
    assert sum("configurations" in line for line in lines) == 1


def test_page_logs_phases_and_no_runs(client, clock):
    states = [running(1000, 100_000, done) for done in range(0, 100_001, 100)]
    lines = told(client, Progress("instantiating"), *states, Progress("reporting", runs_total=100_000))
    assert len(lines) == 4
    assert lines[-1] == "writing the report"


def test_page_pauses_after_refused_request(client, clock, caplog):
    lines = []
    page = Page("Two rooms", str(uuid4()), lines.append, (2, False))
    client.error = RuntimeError("gone")
    with caplog.at_level(logging.WARNING, "vastflow.artifacts"):
        for done in range(4):
            page.update(running(2, 4, done, reused=1))
    refusal = "Prefect does not show the campaign's progress or results: gone"
    assert [record.getMessage() for record in caplog.records] == [refusal]
    client.error = None
    clock.now_s += QUIET_S
    page.update(running(2, 4, 3, reused=1))
    assert [sent[0] for sent in client.sent] == ["rename", "rename", "create"]
    assert client.sent[-1][1] == "two-rooms-progress"
    assert [line for line in lines if "configurations" in line] == [
        "2 configurations × 2 runs; 1 runs are in the store"
    ]


def test_page_shows_pace_and_workers_of_cluster(client, clock):
    rows = [{"worker": name, "state": "paused" if name == "b" else "running"} for name in "abc"]
    page = Page("Two rooms", str(uuid4()), [].append, None, lambda: rows)
    for done in (0, 10, 20):
        page.update(running(4, 80, done, executed=done, simulated_s=60.0 * done))
        clock.now_s += 8.0
    bars = [sent for sent in client.sent if sent[-1].startswith("20 of 80 runs done")]
    assert bars[-1][-1].endswith("0 not judged, 1.25 runs/s, 75 × real time, about 48 s left")
    tables = [sent for sent in client.sent if sent[1] == "two-rooms-workers"]
    assert tables == [("create", "two-rooms-workers", json.dumps(rows), "Workers of the cluster: 2 running, 1 paused")]


def test_publish_shows_results_and_report_and_tolerates_refusing_api(client, monkeypatch, caplog, tmp_path):
    monkeypatch.setattr(pages, "flow_run", SimpleNamespace(id=FLOW_RUN))
    monkeypatch.setattr(pages, "get_run_logger", lambda: pages.LOGGER)
    monkeypatch.setattr(pages, "result_rows", lambda found: [{"family": "room", "runs": 4}])
    summary = Summary(2, 0, 0, 4, 4, 0, 3, 1, 0, 10.0, 1.0, 1.0, "results/x-1", {})
    finished = Results(tmp_path / "x-1", summary, (), ())
    why = [{"family": "room", "stage": "execute", "reused": 0, "computed": 4, "why": "family room is new"}]
    finished.directory.mkdir()
    (finished.directory / "metadata.json").write_text(json.dumps({"why": why}))
    publish(finished, "Two rooms")
    outcome = outcome_text(finished)
    assert outcome == ("2 configurations × 2 runs: 3 passed, 1 failed, 0 not judged; 4 runs executed, 0 from the store")
    (_, table, rows, about), (_, reasons, kept, _), (_, link, text, _) = client.sent
    assert (reasons, json.loads(kept)) == ("two-rooms-why", why)
    assert (table, json.loads(rows)) == ("two-rooms-results", [{"family": "room", "runs": 4}])
    assert about == f"**Two rooms**, {outcome}"
    assert (link, text) == ("two-rooms-report", f"[report.html]({(tmp_path / 'x-1/report.html').as_uri()})")
    assert {str(flow_run_id) for flow_run_id in client.flow_runs} == {FLOW_RUN}
    client.sent.clear()
    publish(finished, "x", "https://lab.example/results/")
    assert client.sent[2][2] == "[report.html](https://lab.example/results/x-1/report.html)"
    client.error = RuntimeError("gone")
    publish(finished, "x")
    assert "does not show the campaign's progress or results: gone" in caplog.text
    client.error = KeyboardInterrupt("now")
    with pytest.raises(KeyboardInterrupt, match="now"):
        publish(finished, "x")


@each_row(
    ("said", "text"),
    [
        (size_text(1, 1), "1 configuration × 1 run"),
        (size_text(0, 0), "0 configurations × 0 runs"),
        (size_text(4, 58), "4 configurations, 58 runs"),
        (
            progress_text(
                Progress("running", runs_total=80, runs_done=6, passed=3, failed=2, not_judged=1, at_most=True)
            ),
            "6 of at most 80 runs done: 3 passed, 2 failed, 1 not judged",
        ),
    ],
)
def test_pages_describe_size_and_progress(said, text):
    assert said == text


@given(st.text())
def test_key_of_any_name_is_valid(name):
    key = key_of(name)
    assert key
    assert set(key) <= set("abcdefghijklmnopqrstuvwxyz0123456789-")


def test_task_runs_send_only_warnings_and_nothing_of_ended_campaign(monkeypatch):
    def passes(name, level):
        return bool(handler.filter(logging.LogRecord(name, level, "", 0, "said", (), None)))

    logger, handler = logging.getLogger(TASK_RUNS), APILogHandler()
    monkeypatch.setattr(logger, "handlers", [handler])
    with quiet_task_runs(SimpleNamespace(closed=False), "x"):
        sent = [passes(TASK_RUNS, level) for level in (logging.INFO, logging.WARNING)]
        assert (sent, passes("prefect.flow_runs", logging.INFO)) == ([False, True], True)
    assert passes(TASK_RUNS, logging.INFO)
    with quiet_task_runs(SimpleNamespace(closed=True), "x"):
        said = [bool(logger.filter(logging.makeLogRecord({"flow_run_id": each, "msg": "x"}))) for each in ("x", "y")]
    assert said == [False, True]


def test_prefect_has_its_handler_at_logger_of_task_runs():
    setup_logging()
    assert any(isinstance(handler, APILogHandler) for handler in logging.getLogger(TASK_RUNS).handlers)
