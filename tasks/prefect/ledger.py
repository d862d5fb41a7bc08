"""The ledger of flow runs: which process of this host runs which, so that a later call can end those whose process is gone.

Prefect hears nothing of a kill -9, and shows such a flow run as `Running` for ever. A file for each flow run lies in the
user's state folder while it runs; who finds one whose process is gone tells Prefect that the flow run has crashed. Prefect
chooses a flow run's identity, so until its first line is executed it is in the ledger by a tag that nothing else has.
"""

import contextlib
import contextvars
import json
import logging
import os
import platform
import time
import uuid
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import platformdirs
import psutil

from vastflow.tasks.prefect.adapter import ApiRoute, current_tags, exact_tags, post
from vastflow.tasks.prefect.server import redacted

if TYPE_CHECKING:
    from prefect.client.orchestration import SyncPrefectClient
    from prefect.client.schemas.objects import FlowRun

LOGGER: Final = logging.getLogger("vastflow.ledger")

MARK: Final = "vastflow-begins-"
"""What the tag of a flow run that is to begin starts with."""

MESSAGE: Final = "Its process ended without a word: killed, or out of memory. What was finished is in the store."
TIMEOUT_S: Final = 5.0
CALLED_OFF_S: Final = 30.0
"""A worker looks every 10 s whether one of its flow runs is to end. One that is gone itself is not waited for longer."""

LATE: Final = "It was called off as it ended by itself, or its worker is gone. What was finished is in the store."
"""Of a flow run that nobody will end any more: Prefect would show it as `Cancelling` for ever."""

_API: Final = contextvars.ContextVar[str]("vastflow_ledger_api")

_AT_A_TIME: Final = 50
_BATCHES: Final = 20
_POLL_S: Final = 0.5

_FORGOTTEN_S: Final = 30 * 24 * 3600.0
_SAME_S: Final = 2.0
"""A process began when it says, give or take what clocks are set by."""


@dataclass(frozen=True, slots=True)
class Entry:
    """A flow run and the process that runs it.

    Attributes:
        flow_run_id: Its identity, or the tag of one that is to begin.
        api: Address of Prefect's API without a password, or for an embedded one the folder of its database.
        host: Name of the host, and of the space in which its process numbers hold.
        began_s: When the process began, which tells it from a later one of the same number.
    """

    flow_run_id: str
    api: str
    host: str
    pid: int
    began_s: float

    @property
    def orphan(self) -> bool:
        """Whether nobody runs it any more."""
        if self.host != _host():
            return False
        began_s = _began_s(self.pid)
        return began_s is None or abs(began_s - self.began_s) > _SAME_S


def enter(flow_run_id: str, api: str) -> None:
    """Say that this process runs a flow run."""
    pid = os.getpid()
    entry = Entry(flow_run_id, redacted(api), _host(), pid, _began_s(pid) or 0.0)
    with contextlib.suppress(OSError):  # a home that can't be written: a container's, say
        folder().mkdir(parents=True, exist_ok=True)
        _file(flow_run_id).touch(0o600)
        _file(flow_run_id).write_text(json.dumps(asdict(entry)), encoding="utf-8")


@contextlib.contextmanager
def announced(api: str) -> Iterator[None]:
    """Enter a flow run that begins in this context before Prefect knows of it; `begun` has it from then on."""
    from prefect import tags

    mark = f"{MARK}{uuid.uuid4().hex}"
    enter(mark, api)
    token = _API.set(api)
    try:
        with tags(mark):
            yield
    finally:
        _API.reset(token)


@contextlib.contextmanager
def begun(flow_run_id: str, api: str) -> Iterator[None]:
    """Enter a flow run that has begun, by its identity; its task runs do not get the tag by which it was announced.

    Args:
        api: Of one that was not announced.
    """
    enter(flow_run_id, _API.get(api))
    tags = current_tags()
    marks = {tag for tag in tags if tag.startswith(MARK)}
    for mark in marks:
        leave(mark)
    with exact_tags(tags - marks):
        yield


def is_announced() -> bool:
    """Whether the flow run that this is called from was announced by its process."""
    return _API.get("") != ""


def leave(flow_run_id: str) -> None:
    """Say that Prefect knows how a flow run ended."""
    with contextlib.suppress(OSError):
        _file(flow_run_id).unlink(missing_ok=True)


def orphans() -> list[Entry]:
    """Flow runs of this host whose process is gone. What nobody could tell Prefect of in a month is forgotten."""
    gone = []
    for file in sorted(folder().glob("*.json")):
        with contextlib.suppress(OSError, ValueError, TypeError):
            if time.time() - file.stat().st_mtime > _FORGOTTEN_S:
                file.unlink()
                continue
            entry = Entry(**json.loads(file.read_text(encoding="utf-8")))
            if entry.orphan:
                gone.append(entry)
    return gone


def end_orphans(api: str) -> int:
    """Tell Prefect's API, which is `api` and the one in use, that the flow runs of processes that are gone have crashed.

    Imports Prefect only if there are any. What the API refuses stays in the ledger, with a line in the log.

    Returns:
        How many were still open.
    """
    ended = 0
    for entry in orphans():
        if entry.api == redacted(api):
            try:
                ended += _ended(entry)
            except Exception as error:  # noqa: BLE001 - a campaign does not fail for an earlier one's account
                LOGGER.warning("flow run %s of a process that is gone stays open: %s", entry.flow_run_id, error)
                break
    return ended


def folder() -> Path:
    """Where the entries lie."""
    return Path(platformdirs.user_state_dir("vastflow")) / "flow-runs"


def _ended(entry: Entry) -> bool:
    from prefect.client.orchestration import get_client
    from prefect.states import Crashed

    with get_client(httpx_settings={"timeout": TIMEOUT_S}, sync_client=True) as client:
        flow_runs = _flow_runs(client, entry.flow_run_id)
        unfinished = [run for run in flow_runs if run.state is None or not run.state.is_final()]
        for run in unfinished:
            client.set_flow_run_state(run.id, Crashed(message=MESSAGE), force=True)
            _call_off(client, str(run.id))
    leave(entry.flow_run_id)
    return bool(unfinished)


def _flow_runs(client: "SyncPrefectClient", flow_run_id: str) -> "list[FlowRun]":
    """The flow run of an entry; none if it was deleted meanwhile, or its process died before Prefect heard of it."""
    from prefect.client.schemas.filters import FlowRunFilter, FlowRunFilterId, FlowRunFilterTags

    if flow_run_id.startswith(MARK):
        wanted = FlowRunFilter(tags=FlowRunFilterTags(all_=[flow_run_id]))
    else:
        wanted = FlowRunFilter(id=FlowRunFilterId(any_=[uuid.UUID(flow_run_id)]))
    return client.read_flow_runs(flow_run_filter=wanted)


def _call_off(client: "SyncPrefectClient", flow_run_id: str) -> None:
    """Cancel what a flow run asked a work pool for, and wait for its workers: they would execute what others do now.

    What no worker has ended by then is ended here.
    """

    def asked(route: ApiRoute, *but: str, **values: Any) -> Any:
        some = {
            "parent_flow_run_id": {"any_": [flow_run_id]},
            "deployment_id": {"is_null_": False},
            "state": {"type": {"not_any_": ["COMPLETED", "FAILED", "CRASHED", "CANCELLED", *but]}},
        }
        return post(client, route, {"flow_runs": some, **values})

    deadline = time.monotonic() + CALLED_OFF_S
    while asked("/flow_runs/count", "CANCELLING") and time.monotonic() < deadline:
        asked("/flow_runs/bulk_set_state", "CANCELLING", state={"type": "CANCELLING"}, limit=_AT_A_TIME)
    while asked("/flow_runs/count") and time.monotonic() < deadline:
        time.sleep(_POLL_S)
    for _ in range(_BATCHES):
        if not asked("/flow_runs/count"):
            return
        asked("/flow_runs/bulk_set_state", state={"type": "CANCELLED", "message": LATE}, force=True, limit=_AT_A_TIME)


def _file(flow_run_id: str) -> Path:
    return folder() / f"{flow_run_id}.json"


def _host() -> str:
    """Containers may share a host's name, and none sees the other's processes."""
    try:
        return f"{platform.node()} {os.readlink('/proc/self/ns/pid')}"
    except OSError:
        return platform.node()


def _began_s(pid: int) -> float | None:
    try:
        process = psutil.Process(pid)
        return None if process.status() == psutil.STATUS_ZOMBIE else process.create_time()
    except psutil.Error:
        return None
