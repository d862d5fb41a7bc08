"""A server that stays where that is allowed: one for all calls, and gone when it is idle, asked to end, or of another Prefect."""

import os
import signal
import subprocess
import sys
import time
import urllib.request

import pytest

from vastflow.sim.model.faults import UserError
from vastflow.tasks.prefect import kept_server
from vastflow.tasks.prefect.kept_server import (
    IDLE_S,
    KeptServer,
    end_kept,
    idle_limit_s,
    kept_servers,
    read_record,
    record_file,
)
from vastflow.tasks.prefect.server import answers

pytestmark = [
    pytest.mark.timeout(900),
    pytest.mark.skipif(sys.platform == "win32", reason="no server stays there"),
]


@pytest.fixture(autouse=True)
def state(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setenv("PREFECT_HOME", str(tmp_path / "prefect"))
    monkeypatch.delenv("PREFECT_API_URL", raising=False)
    yield
    for record in kept_servers():
        if record.process is not None:
            record.process.kill()


def gone(record, timeout_s=60):
    deadline = time.monotonic() + timeout_s
    while record.process is not None and time.monotonic() < deadline:
        time.sleep(0.1)
    return record.process is None


@pytest.mark.slow
def test_one_server_stays_for_the_next_call_is_not_ended_while_used_and_ends_when_idle(tmp_path):
    first = KeptServer(tmp_path / "log", 4.0)
    url = first.url()
    (record,) = kept_servers()
    assert record_file().stat().st_mode & 0o777 == 0o600
    second = KeptServer(tmp_path / "log", 4.0)
    assert second.url() == url == record.url
    assert second.auth == record.auth
    assert kept_servers() == [record]
    first.stop()
    assert end_kept() == [(record, False)], "the second call uses it"
    time.sleep(6)
    assert answers(url), "used for longer than it may be idle"
    second.stop()
    assert gone(record)
    assert not record_file().exists()
    assert not answers(url)


@pytest.mark.slow
def test_a_server_ends_though_who_used_it_was_killed_and_one_that_is_asked_to_ends_at_once(tmp_path):
    script = "import sys, time, pathlib; from vastflow.tasks.prefect.kept_server import KeptServer; "
    script += "KeptServer(pathlib.Path(sys.argv[1]), 600).url(); print('used', flush=True); time.sleep(600)"
    user = subprocess.Popen([sys.executable, "-c", script, tmp_path / "log"], stdout=subprocess.PIPE)
    try:
        assert user.stdout.readline() == b"used\n"
    finally:
        user.send_signal(signal.SIGKILL)
        user.communicate()
    (record,) = kept_servers()
    assert answers(record.url)
    assert end_kept() == [(record, True)]
    assert gone(record)
    assert end_kept() == []


@pytest.mark.slow
def test_a_server_that_dies_while_it_is_used_is_replaced_on_its_port_by_one_that_ends_with_the_call(tmp_path):
    server = KeptServer(tmp_path / "log", 600)
    url = server.url()
    (record,) = kept_servers()
    os.kill(record.pid, signal.SIGKILL)
    try:
        assert gone(record)
        deadline = time.monotonic() + 120
        while not answers(url) and time.monotonic() < deadline:
            time.sleep(0.1)
        with urllib.request.urlopen(f"{url}/health", timeout=30) as response:
            assert response.status == 200
        assert server.auth == record.auth
    finally:
        server.stop(0)
    assert kept_servers() == []
    assert not answers(url)


def test_another_version_of_prefect_or_other_settings_have_another_server(monkeypatch):
    own = record_file()
    assert record_file() == own
    monkeypatch.setenv("PREFECT_SERVER_ANALYTICS_ENABLED", "false")
    assert record_file() == own, "vastflow sets this itself"
    with monkeypatch.context() as changed:
        changed.setattr(kept_server, "version", lambda package: "0.0")
        assert record_file() != own
    monkeypatch.setenv("PREFECT_SERVER_DATABASE_CONNECTION_URL", "sqlite+aiosqlite:////tmp/other.db")
    assert record_file() != own


def test_a_record_of_a_process_that_is_another_by_now_is_not_believed(tmp_path):
    file = tmp_path / "record.json"
    file.write_text(f'{{"port": 1, "pid": {os.getpid()}, "began_s": 1.0, "notices": [], "auth": "a:b"}}')
    assert read_record(file) is None
    file.write_text("damaged")
    assert read_record(file) is None


@pytest.mark.parametrize(("said", "limit_s"), [(None, 0.0), ("", 0.0), ("0", 0.0), ("900", 900.0), ("1.5", 1.5)])
def test_without_the_setting_no_server_stays(monkeypatch, said, limit_s):
    monkeypatch.delenv(IDLE_S, raising=False)
    if said is not None:
        monkeypatch.setenv(IDLE_S, said)
    assert idle_limit_s() == limit_s


@pytest.mark.parametrize("said", ["-1", "ever", "nan", "inf"])
def test_what_is_no_number_of_seconds_is_told(monkeypatch, said):
    monkeypatch.setenv(IDLE_S, said)
    with pytest.raises(UserError, match=rf"VASTFLOW_SERVER_IDLE_S: found '{said}'; seconds that"):
        idle_limit_s()
