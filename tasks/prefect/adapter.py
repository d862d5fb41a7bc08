"""Undocumented parts of Prefect that vastflow uses: private names, settings, and routes of its API.

No other module has any. `python tests/proofs/installed.py prefect` tests the oldest and the newest release that are allowed.
Prefect is imported inside the functions, as that takes most of a second.
"""

import contextlib
import logging
import os
import queue
import sys
import tomllib
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal, TypeAlias

from vastflow.sim.model.faults import UserError
from vastflow.sim.model.files import Missing, read_text

if TYPE_CHECKING:
    from prefect import Flow
    from prefect.client.orchestration import SyncPrefectClient

ANALYTICS: Final = "PREFECT_SERVER_ANALYTICS_ENABLED"
DO_NOT_TRACK: Final = "DO_NOT_TRACK"
"""Variable that keeps Prefect from collecting data, which it announces at its first import in a terminal."""

SERVER_APPLICATION: Final = "prefect.server.api.server:create_app"
"""Factory of the application of Prefect's API, for `uvicorn`."""

SERVER_SETTINGS: Final[Mapping[str, str]] = {
    ANALYTICS: "false",
    # One row a transaction is Prefect's default; batches cost a quarter of the CPU time and lose fewer rows.
    "PREFECT_SERVER_SERVICES_TASK_RUN_RECORDER_BATCH_SIZE": "200",
    "PREFECT_SERVER_SERVICES_TASK_RUN_RECORDER_READ_BATCH_SIZE": "200",
    "PREFECT_SERVER_SERVICES_TASK_RUN_RECORDER_FLUSH_INTERVAL": "1",
    "PREFECT_SERVER_SERVICES_EVENT_PERSISTER_BATCH_SIZE": "500",
    "PREFECT_SERVER_SERVICES_EVENT_PERSISTER_READ_BATCH_SIZE": "200",
    "PREFECT_SERVER_LOGGING_LEVEL": "WARNING",
    "PREFECT_UI_ENABLED": "0",
    # Types of blocks, which no campaign uses; any other server of the same database adds them.
    "PREFECT_API_BLOCKS_REGISTER_ON_START": "0",
    # What Prefect's own temporary server sets: no services that only a server of many flows needs.
    "PREFECT__SERVER_EPHEMERAL": "1",
}
"""Settings of an embedded server; the user's environment has precedence."""

ApiRoute: TypeAlias = Literal["/task_runs/count"]
"""Routes for which Prefect's client has no complete method."""


def import_prefect() -> bool:
    """Import Prefect without telemetry, unless the user has set `DO_NOT_TRACK` to 0; True if it was imported before.

    Raises:
        UserError: see `check_working_directory`.
    """
    imported_before = "prefect.main" in sys.modules
    if not imported_before:
        check_working_directory()
    os.environ.setdefault(DO_NOT_TRACK, "1")
    if "PREFECT_API_URL" not in os.environ:
        os.environ.setdefault(ANALYTICS, SERVER_SETTINGS[ANALYTICS])
    import prefect.main  # noqa: F401

    return imported_before


def check_working_directory() -> None:
    """Raise `UserError` if Prefect would take settings from files in the working directory, which may be a stranger's.

    They name the server that gets the user's API key, and a configuration of logging, which calls any function.
    """
    for name in ("prefect.toml", "pyproject.toml", ".env"):
        try:
            text = read_text(name)
            found = name == "prefect.toml" or "prefect_" in text.lower()
            found = bool(tomllib.loads(text).get("tool", {}).get("prefect")) if name == "pyproject.toml" else found
        except Missing:
            continue
        except (ValueError, AttributeError, RecursionError):  # nor can Prefect read it
            found = True
        if found:
            what = f"{Path(name).absolute()}: got settings of Prefect in the working directory"
            raise UserError(f"{what}. Expected them in the environment or in a profile (`prefect config set`)")


def post(client: "SyncPrefectClient", route: ApiRoute, content: Mapping[str, Any]) -> Any:
    """Return the answer of a route.

    Raises:
        httpx.TransportError, PrefectHTTPStatusError: the API is away, or refused the request.
    """
    path: Any = route  # the client's types list some routes and not all that the API has
    return client.request("POST", path, json=content).json()


def database_url() -> str | None:
    """Return the address of the database of this machine's own API; None where Prefect chooses."""
    from prefect.settings import get_current_settings

    url = get_current_settings().server.database.connection_url
    return url.get_secret_value() if url else None


def expect_one_application() -> None:
    """Keep a server from digesting all settings, which takes a tenth of its start."""
    from prefect.settings import Settings

    setattr(Settings, "hash_key", lambda self: "")  # noqa: B010


def migrating_at_start(needed: bool) -> AbstractContextManager[Any]:
    """Let a server that starts in this context migrate its database."""
    from prefect.settings import temporary_settings

    return temporary_settings({} if needed else {"server.database.migrate_on_start": False})


def current_tags() -> frozenset[str]:
    """Return the tags of flow runs and task runs that begin here."""
    from prefect.context import TagsContext

    return frozenset(TagsContext.get().current_tags)


def exact_tags(tags: frozenset[str]) -> AbstractContextManager[Any]:
    """Give runs that begin in this context these tags and no others; `prefect.tags` only adds some."""
    from prefect.context import TagsContext

    return TagsContext(current_tags=set(tags))


def console_handlers(logger: logging.Logger) -> list[logging.Handler]:
    """Return the handlers through which a logger of Prefect's writes to the terminal."""
    from prefect.logging.handlers import PrefectConsoleHandler, _SafeStreamHandler

    return [each for each in logger.handlers if isinstance(each, PrefectConsoleHandler | _SafeStreamHandler)]


@contextlib.contextmanager
def sent_only(logger: str, worth_sending: Callable[[logging.LogRecord], bool]) -> Iterator[None]:
    """Send only the records of a Prefect logger that pass `worth_sending` to Prefect's API."""
    from prefect.logging.handlers import APILogHandler

    handlers = [each for each in logging.getLogger(logger).handlers if isinstance(each, APILogHandler)]
    for handler in handlers:
        handler.addFilter(worth_sending)
    try:
        yield
    finally:
        for handler in handlers:
            handler.removeFilter(worth_sending)


def unsent() -> int:
    """Return the number of events that this process has still to send, or that Prefect's API has not confirmed.

    Those of a broken connection are sent again, within half a minute where no others follow.
    """
    from prefect.events.worker import EventsWorker

    workers: Any = EventsWorker
    instances = tuple(workers._instances.values())
    clients = [getattr(each, "_client", None) for each in instances]
    unconfirmed = sum(len(getattr(client, "_unconfirmed_events", ())) for client in clients)
    return unconfirmed + sum(int(each._queue.unfinished_tasks) for each in instances)


def end_services(timeout_s: float) -> None:
    """Let Prefect's background threads send their queues and end, before the server does.

    What they can't send within `timeout_s` is dropped: for a server that is gone they would try 7 s per event.
    """
    from prefect.events.worker import EventsWorker
    from prefect.logging.handlers import APILogWorker

    services: tuple[Any, ...] = (EventsWorker, APILogWorker)
    for service in services:
        instances = tuple(service._instances.values())
        service.drain_all(timeout=timeout_s, at_exit=False)
        for instance in instances:
            _forget(instance._queue)


def is_generated_name(name: str) -> bool:
    """True if Prefect may have made up the name of a flow run, such as `amber-otter`."""
    from coolname.data import config

    rules: Mapping[str, Any] = config
    known = {word for rule in rules.values() for word in rule.get("words", ())}
    words = name.split("-")
    return len(words) == 2 and known.issuperset(words)


def flow_schema(flow: "Flow[..., Any]") -> dict[str, Any]:
    """Return the schema of a flow's parameters, from which Prefect's pages make a form."""
    from prefect.utilities.callables import parameter_schema

    return parameter_schema(flow).model_dump()


def process_pool_template() -> dict[str, Any]:
    """Return the base job template of a work pool of processes."""
    from prefect.workers.process import ProcessWorker

    return dict(ProcessWorker.get_default_base_job_template())


def _forget(waiting: "queue.Queue[Any]") -> None:
    """Empty the queue of a stopping service."""
    with contextlib.suppress(queue.Empty):
        while True:
            waiting.get_nowait()
    waiting.put_nowait(None)  # what tells it to end may have been among what was taken out
