import signal
import subprocess
import sys
import textwrap
import time
from contextlib import nullcontext
from itertools import chain, repeat
from types import SimpleNamespace

import httpx
import psutil
import pytest
from prefect import flow, task
from prefect.client.orchestration import get_client
from prefect.events.clients import PrefectEventsClient
from prefect.runtime import flow_run
from websockets.exceptions import ConnectionClosedError

from vastflow.tasks.prefect import server as server_module
from vastflow.tasks.prefect.adapter import end_services
from vastflow.tasks.prefect.server import ApiServer, PrefectUnavailable, drain, embedded

pytestmark = pytest.mark.timeout(900)

API_S = 90


def test_api_ends_after_kill_of_its_process(tmp_path):
    script = textwrap.dedent(f"""
        import pathlib, time
        from vastflow.tasks.prefect.server import ApiServer
        server = ApiServer(pathlib.Path({str(tmp_path / "log")!r}))
        print(server._process.pid, flush=True)
        time.sleep(600)
    """)
    parent = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True)
    try:
        server = psutil.Process(int(parent.stdout.readline()))
    finally:
        parent.send_signal(signal.SIGKILL)
        parent.communicate()
    server.wait(API_S)


def test_api_failing_at_start_is_reported_with_log(tmp_path):
    server = ApiServer(tmp_path / "log")
    server.stop(0)
    with pytest.raises(PrefectUnavailable, match=r"ended while it started, see .*log"):
        server.url()


def test_api_timeout_is_reported(tmp_path):
    server = ApiServer(tmp_path / "log")
    try:
        with pytest.raises(PrefectUnavailable, match="did not start within 0 s"):
            server.url(timeout_s=0)
    finally:
        server.stop(0)


def started_again(server, before):
    deadline = time.monotonic() + 120
    while server._process.pid == before and not server.lost and time.monotonic() < deadline:
        time.sleep(0.01)
    return server._process.pid != before


def test_killed_api_is_restarted_on_same_port(tmp_path):
    server = ApiServer(tmp_path / "log")
    try:
        deadline = time.monotonic() + 120
        while not server._port and time.monotonic() < deadline:
            time.sleep(0.01)
        port, before = server._port, server._process.pid
        server._process.kill()
        assert started_again(server, before)
        assert "-m vastflow.tasks.prefect.api_server" in " ".join(psutil.Process(server._process.pid).cmdline())
        assert server._process.args[-1] == str(port)
    finally:
        server.stop(0)


def test_repeatedly_killed_api_is_given_up(tmp_path):
    server = ApiServer(tmp_path / "log")
    try:
        while not server.lost:
            before = server._process.pid
            server._process.kill()
            if not started_again(server, before):
                break
        with pytest.raises(PrefectUnavailable, match=r"ended while it started, see .*log"):
            server.url()
    finally:
        server.stop(0)


def test_exited_api_is_not_restarted(tmp_path, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    (tmp_path / "sitecustomize.py").write_text(
        "import sys; sys.argv and 'vastflow.tasks.prefect.api_server' in sys.orig_argv and sys.exit(4)"
    )
    server = ApiServer(tmp_path / "log")
    with pytest.raises(PrefectUnavailable, match="ended while it started"):
        server.url(120)
    assert server.lost


def test_embedded_api_requires_authentication(tmp_path, prefect_home, monkeypatch):
    monkeypatch.setenv("PREFECT_HOME", str(prefect_home(tmp_path / "prefect")))
    monkeypatch.setenv("PREFECT_SERVER_CORS_ALLOWED_ORIGINS", "*")
    server = ApiServer(tmp_path / "log")
    try:
        foreign = {"Origin": "http://example.com", "Host": "example.com"}
        answer = httpx.post(f"{server.url()}/flow_runs/filter", json={}, headers=foreign, timeout=API_S)
        assert (answer.status_code, answer.headers.get("access-control-allow-origin")) == (401, None)
        with embedded(server.url(), server.auth), get_client(sync_client=True) as client:
            assert client.read_flow_runs() == []
    finally:
        server.stop(0)


@pytest.fixture
def drained(monkeypatch):
    """Drains three task runs of a server that says these numbers, while this process has so many events to send."""

    def of(said, unsent, answer_s=0.3):
        clock, answers, left = [0.0], iter(said), iter(unsent)

        def post(*_):
            clock[0] += answer_s
            return next(answers)

        fake = SimpleNamespace(monotonic=lambda: clock[0], sleep=lambda s: clock.__setitem__(0, clock[0] + s))
        monkeypatch.setattr(server_module, "time", fake)
        monkeypatch.setattr(server_module, "post", post)
        monkeypatch.setattr(server_module, "unsent", lambda: next(left), raising=False)
        monkeypatch.setattr("prefect.client.orchestration.get_client", lambda sync_client: nullcontext())
        return drain("a-flow-run", 3)

    return of


def test_draining_waits_for_a_server_that_answers_slowly(drained):
    assert drained([0, 0, 1, 1, 3], repeat(0), answer_s=25.0)


def test_draining_waits_while_events_are_sent_and_then_for_the_last_record(drained):
    assert drained(chain([0] * 150, [1] * 50, [3]), chain([5] * 150, repeat(0)))


@pytest.mark.parametrize("unsent", [0, 5])
def test_draining_ends_where_nothing_is_recorded_any_more(drained, caplog, unsent):
    assert not drained(chain([0] * 10, repeat(1)), repeat(unsent))
    assert "Prefect recorded 1 of 3 task runs" in caplog.text


class Deaf:
    """A connection that swallows what is sent and then turns out to be closed."""

    def __init__(self):
        self.swallowed = 0

    async def send(self, text):
        self.swallowed += 1

    async def ping(self):
        raise ConnectionClosedError(None, None)


@flow(persist_result=False)
def two():
    for k in range(2):
        task(lambda k: k, name="one", persist_result=False)(k)
    return drain(str(flow_run.id), 2)


def test_events_go_to_the_embedded_server_after_another_ended(tmp_path, prefect_home, monkeypatch):
    monkeypatch.setenv("PREFECT_HOME", str(prefect_home(tmp_path / "prefect")))
    monkeypatch.setattr(server_module, "QUIET", 6)
    try:
        for number in range(2):
            server = ApiServer(tmp_path / f"log{number}")
            try:
                with embedded(server.url(), server.auth):
                    assert two(), number
            finally:
                server.stop(0)  # and the client of this process stays
    finally:
        end_services(1.0)


def test_events_of_a_broken_connection_are_awaited_until_they_are_sent_again(tmp_path, prefect_home, monkeypatch):
    monkeypatch.setenv("PREFECT_HOME", str(prefect_home(tmp_path / "prefect")))
    monkeypatch.setattr(server_module, "QUIET", 6)
    interval = property(lambda self: 9.0, lambda self, given_s: None)
    monkeypatch.setattr(PrefectEventsClient, "_checkpoint_interval", interval, raising=False)
    shake, deaf = PrefectEventsClient._auth_handshake, Deaf()

    async def shake_and_break(self):
        await shake(self)
        if not deaf.swallowed:
            self._websocket = deaf

    monkeypatch.setattr(PrefectEventsClient, "_auth_handshake", shake_and_break)

    server = ApiServer(tmp_path / "log")
    try:
        with embedded(server.url(), server.auth):
            assert two()
    finally:
        end_services(1.0)
        server.stop(0)
    assert deaf.swallowed
