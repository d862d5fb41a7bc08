"""Prefect's embedded API: started for a campaign where the user has configured none."""

import contextlib
import logging
import os
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Final

ANALYTICS: Final = "PREFECT_SERVER_ANALYTICS_ENABLED"

SETTINGS: Final = {
    ANALYTICS: "false",
    # One row a transaction is Prefect's default; batches cost a quarter of the CPU time and lose fewer rows.
    "PREFECT_SERVER_SERVICES_TASK_RUN_RECORDER_BATCH_SIZE": "200",
    "PREFECT_SERVER_SERVICES_TASK_RUN_RECORDER_READ_BATCH_SIZE": "200",
    "PREFECT_SERVER_SERVICES_TASK_RUN_RECORDER_FLUSH_INTERVAL": "1",
    "PREFECT_SERVER_SERVICES_EVENT_PERSISTER_BATCH_SIZE": "500",
    "PREFECT_SERVER_SERVICES_EVENT_PERSISTER_READ_BATCH_SIZE": "200",
    "PREFECT_SERVER_LOGGING_LEVEL": "WARNING",
    "PREFECT_UI_ENABLED": "0",
    "PREFECT__SERVER_EPHEMERAL": "1",
    "PREFECT__SERVER_FINAL": "1",
}
"""Of the embedded server; what the user has set in the environment goes before."""

STARTUP_S: Final = 120.0
"""A fresh database has to be made: 12 s on an idle machine, 35 s on a busy one."""

DRAIN_S: Final = 60.0

_POLL_S: Final = 0.1
_FINAL_STATES: Final = ("COMPLETED", "FAILED", "CRASHED", "CANCELLED")

LOGGER: Final = logging.getLogger("vastflow.server")


class PrefectUnavailable(RuntimeError):
    """Prefect's API can't be had."""


class ApiServer:
    """An embedded API server. It starts with the object, beside whatever its owner does next.

    Args:
        log: File that takes what it prints.

    Attributes:
        answers: Whether it has ever answered.
    """

    def __init__(self, log: Path) -> None:
        self._log = log
        self.answers = False
        with open(log, "ab") as sink:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "vastflow.tasks.api_server"],
                stdin=subprocess.PIPE,  # never written: it ends when this process does
                stdout=subprocess.PIPE,
                stderr=sink,
                env={**SETTINGS, **os.environ},
                start_new_session=True,  # a terminal's Ctrl-C is for the campaign, which then ends in order
            )

    def url(self, timeout_s: float = STARTUP_S) -> str:
        """The API's address, once it answers.

        Raises:
            PrefectUnavailable: it ended or was too slow.
        """
        deadline = time.monotonic() + timeout_s
        assert self._process.stdout is not None
        port = self._process.stdout.readline().decode().strip()
        address = f"http://127.0.0.1:{port}/api"
        while port and self._process.poll() is None:
            with contextlib.suppress(OSError), urllib.request.urlopen(f"{address}/health", timeout=5) as response:
                if response.status == 200:
                    self.answers = True
                    return address
            if time.monotonic() > deadline:
                raise PrefectUnavailable(f"Prefect's API did not start within {timeout_s:.0f} s; see {self._log}")
            time.sleep(_POLL_S)
        raise PrefectUnavailable(f"Prefect's API ended while it started; see {self._log}")

    def stop(self, grace_s: float = 3.0) -> None:
        """End it, at the latest after `grace_s`. May be called twice."""
        if self._process.poll() is None and grace_s > 0:
            self._process.terminate()
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(grace_s)
        self._process.kill()
        self._process.wait()


def import_prefect() -> None:
    """Import Prefect; without an API of the user's it tells nobody of that (importing starts its analytics)."""
    if "PREFECT_API_URL" not in os.environ:
        os.environ.setdefault(ANALYTICS, SETTINGS[ANALYTICS])
    import prefect.main  # noqa: F401


def configured_url() -> str | None:
    """The API that the user has configured: environment, profile or settings file."""
    from prefect.settings import get_current_settings

    url = get_current_settings().api.url
    return str(url) if url else None


@contextlib.contextmanager
def embedded(url: str) -> Iterator[None]:
    """Make Prefect use the embedded API at `url` in this context and in the threads it starts."""
    from prefect.settings import temporary_settings

    with temporary_settings({"api.url": url, "logging.to_api.enabled": False, "server.analytics_enabled": False}):
        yield


def drain(flow_run_id: str, task_runs: int, timeout_s: float = DRAIN_S) -> bool:
    """Wait until the server has recorded a flow run's task runs in a final state.

    Args:
        task_runs: How many of them ended.

    Returns:
        Whether it has; if not, a line in the log says how many are missing.
    """
    from prefect.client.orchestration import get_client

    states = {"type": {"any_": list(_FINAL_STATES)}}
    condition = {"task_runs": {"flow_run_id": {"any_": [flow_run_id]}, "state": states}}
    deadline = time.monotonic() + timeout_s
    with get_client(sync_client=True) as client:
        while True:
            recorded = client.request("POST", "/task_runs/count", json=condition).json()
            if recorded >= task_runs:
                return True
            if time.monotonic() > deadline:
                LOGGER.warning("Prefect recorded %s of %s task runs within %.0f s", recorded, task_runs, timeout_s)
                return False
            time.sleep(3 * _POLL_S)


def end_services(timeout_s: float = 5.0) -> None:
    """Let Prefect's background threads of this process send what they have and end, before the server does."""
    from prefect.events.worker import EventsWorker
    from prefect.logging.handlers import APILogWorker

    for service in (EventsWorker, APILogWorker):
        service.drain_all(timeout=timeout_s, at_exit=False)
