import signal
import subprocess
import sys
import textwrap

import psutil
import pytest

from vastflow.tasks.server import ApiServer, PrefectUnavailable

pytestmark = pytest.mark.timeout(60)


def test_the_api_ends_with_a_process_that_is_killed(tmp_path):
    script = textwrap.dedent(f"""
        import pathlib, time
        from vastflow.tasks.server import ApiServer
        server = ApiServer(pathlib.Path({str(tmp_path / "log")!r}))
        print(server._process.pid, flush=True)
        time.sleep(60)
    """)
    parent = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True)
    try:
        server = psutil.Process(int(parent.stdout.readline()))
    finally:
        parent.send_signal(signal.SIGKILL)
        parent.communicate()
    server.wait(10)


def test_an_api_that_ends_while_it_starts_is_told_with_the_log(tmp_path):
    server = ApiServer(tmp_path / "log")
    server.stop(0)
    with pytest.raises(PrefectUnavailable, match=r"ended while it started; see .*log"):
        server.url()


def test_an_api_that_does_not_answer_in_time_is_told(tmp_path):
    server = ApiServer(tmp_path / "log")
    try:
        with pytest.raises(PrefectUnavailable, match="did not start within 0 s"):
            server.url(timeout_s=0)
    finally:
        server.stop(0)
