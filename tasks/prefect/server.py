"""Prefect's embedded API: started for a campaign where the user has configured none."""

import contextlib
import contextvars
import logging
import os
import secrets
import subprocess
import threading
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from vastflow.tasks.engine.process import own_environment, python_command
from vastflow.tasks.prefect.adapter import SERVER_SETTINGS, post, unsent

STARTUP_S: Final = 120.0
"""A new database takes 12 s on an idle machine, 35 s on a busy one."""

STARTS: Final = 4
"""Maximum number of starts of an embedded API that is killed again and again."""

QUIET: Final = 60
"""Answers without a new record, some 20 s, after which the missing ones are taken as lost with a killed server."""
QUIET_UNSENT: Final = 200
"""The same while this process has not sent all, as a busy server lets a connection wait."""

SENDING_S: Final = 5.0
"""Maximum time for Prefect's services to send their queues when a flow has ended."""

_POLL_S: Final = 0.1
_FINAL_STATES: Final = ("COMPLETED", "FAILED", "CRASHED", "CANCELLED")

LOGGER: Final = logging.getLogger("vastflow.server")
AUTH: Final = "PREFECT_SERVER_API_AUTH_STRING"

_EMBEDDED: Final = contextvars.ContextVar[bool]("vastflow_embedded", default=False)


class PrefectUnavailable(RuntimeError):
    """Prefect's API does not start or answer."""


class ApiServer:
    """An embedded API server, started with the object.

    A killed one is restarted on its port, and Prefect's clients retry for a minute. One that ends by itself stays away.

    Args:
        log: File for its output.

    Attributes:
        answers: True once it has answered.
        lost: True once it has ended for good.
        notices: Lines for the user.
    """

    def __init__(self, log: Path) -> None:
        self._log = log
        # A random password, and no foreign origin.
        private = {AUTH: f"vastflow:{secrets.token_urlsafe(32)}", "PREFECT_SERVER_API_CORS_ALLOWED_ORIGINS": ""}
        self._environment = {**SERVER_SETTINGS, **own_environment(), **private}
        if home := os.environ.get("PREFECT_HOME"):
            self._environment["PREFECT_HOME"] = os.path.abspath(os.path.expanduser(home))
        self.auth = self._environment[AUTH]
        self.answers = False
        self.lost = False
        self.notices: list[str] = []
        self._port = 0
        self._stopping = False
        self._lock = threading.Lock()
        self._process = self._started()
        threading.Thread(target=self._watch, name="vastflow server", daemon=True).start()

    def url(self, timeout_s: float = STARTUP_S) -> str:
        """Wait until it answers and return its address.

        Raises:
            PrefectUnavailable: it ended or was too slow.
        """
        deadline = time.monotonic() + timeout_s
        while not (self.lost or self._stopping):
            if self._port and answers(address := f"http://127.0.0.1:{self._port}/api"):
                self.answers = True
                return address
            if time.monotonic() > deadline:
                raise PrefectUnavailable(f"Prefect's API did not start within {timeout_s:.0f} s, see {self._log}")
            time.sleep(_POLL_S)
        raise PrefectUnavailable(f"Prefect's API ended while it started, see {self._log}")

    def stop(self, grace_s: float = 3.0) -> None:
        """Stop the server, after `grace_s` at the latest; may be called twice."""
        with self._lock:
            self._stopping = True
        if self._process.poll() is None and grace_s > 0:
            self._process.terminate()
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(grace_s)
        self._process.kill()
        self._process.wait()

    def _started(self) -> "subprocess.Popen[bytes]":
        with open(self._log, "ab") as sink:
            return subprocess.Popen(
                python_command("vastflow.tasks.prefect.api_server", str(self._port)),
                cwd=os.sep,  # Prefect reads settings in its working directory
                stdin=subprocess.PIPE,  # never written: it ends when this process does
                stdout=subprocess.PIPE,
                stderr=sink,
                env=self._environment,
                start_new_session=True,  # a terminal's Ctrl-C is for the campaign, which then ends in order
            )

    def _watch(self) -> None:
        for restarts_left in reversed(range(STARTS)):
            assert self._process.stdout is not None
            for line in map(bytes.strip, self._process.stdout):
                if line.isdigit():
                    self._port = int(line)
                    break
                self.notices.append(line.decode(errors="replace"))
            is_killed = self._process.wait() < 0
            with self._lock:
                if self._stopping or not is_killed or not restarts_left:
                    break
                LOGGER.warning("Prefect's API was killed. It is started again")
                self._process = self._started()
        self.lost = True


def answers(address: str) -> bool:
    """True if an API of Prefect answers at an address."""
    with contextlib.suppress(OSError), urllib.request.urlopen(f"{address}/health", timeout=5) as response:
        return bool(response.status == 200)
    return False


def configured_url() -> str | None:
    """Return the API in the user's environment, profile, or settings file."""
    from prefect.settings import get_current_settings

    url = get_current_settings().api.url
    return str(url) if url else None


@contextlib.contextmanager
def embedded(url: str, auth: str) -> Iterator[None]:
    """Use the embedded API at `url` in this context and the threads it starts."""
    from prefect.settings import temporary_settings

    from vastflow.tasks.prefect.adapter import end_services

    end_services(
        SENDING_S
    )  # a client that this process had before would send our events to the server that it was made for
    token = _EMBEDDED.set(True)
    try:
        api = {"api.url": url, "api.auth_string": auth}
        with temporary_settings({**api, "logging.to_api.enabled": False, "server.analytics_enabled": False}):
            yield
    finally:
        _EMBEDDED.reset(token)


def is_embedded() -> bool:
    """True if Prefect uses an embedded API here, which has no visible pages."""
    return _EMBEDDED.get()


def drain(flow_run_id: str, task_runs: int) -> bool:
    """Wait until the server has recorded the ended task runs of a flow run; log and return False if not."""
    try:
        return _drained(flow_run_id, task_runs)
    except Exception as error:  # noqa: BLE001 - the work is done, whatever becomes of Prefect's account of it
        LOGGER.warning("Prefect does not say what it has recorded: %s", error)
        return False


def _drained(flow_run_id: str, task_runs: int) -> bool:
    from prefect.client.orchestration import get_client

    from vastflow.tasks.prefect.retry import AT_THE_END_S, retried

    states = {"type": {"any_": list(_FINAL_STATES)}}
    condition = {"task_runs": {"flow_run_id": {"any_": [flow_run_id]}, "state": states}}
    quiet, state = 0, (0, 0)
    with get_client(sync_client=True) as client:
        while True:
            recorded = int(retried(lambda: post(client, "/task_runs/count", condition), AT_THE_END_S))
            if recorded >= task_runs:
                return True
            before, state = state, (recorded, unsent())
            # Answers and not seconds: a server that is slow to record is as slow to answer.
            quiet = quiet + 1 if state == before else 0
            if quiet >= (QUIET_UNSENT if state[1] else QUIET):
                LOGGER.warning("Prefect recorded %s of %s task runs", recorded, task_runs)
                return False
            time.sleep(3 * _POLL_S)
