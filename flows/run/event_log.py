"""The events of a running campaign, written to its folder, in which a reader may ask it to stop."""

import logging
import os
import platform
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from datetime import datetime
from pathlib import Path
from typing import Any, Final

from vastflow.flows.request.run_request import RunRequest
from vastflow.flows.results.directory import NewDirectory, new_directory
from vastflow.flows.results.summary import Results
from vastflow.flows.results.trust import remember_running
from vastflow.flows.run.computing import Computing
from vastflow.flows.run.prepared import PreparedCampaign
from vastflow.oracles.results.events import EVENTS, Event, EventName
from vastflow.oracles.results.unfinished import BEAT_S, stop_reason
from vastflow.sim.model.faults import FileError, UserError
from vastflow.tasks.engine.executor import PoolClosed
from vastflow.tasks.engine.progress import Progress
from vastflow.tasks.prefect import campaign_log

LOGGER: Final = logging.getLogger("vastflow.events")

INTERVAL_S: Final = 1.0
"""Time between two writes."""
PROGRESS_SHARE: Final = 0.001
"""Share of the elapsed time between two lines of progress: a campaign of hours writes fewer."""

_MOST_REASON: Final = 500


class CampaignStopped(UserError):
    """A reader asked the campaign to stop, see `vastflow.oracles.results.unfinished.ask_to_stop`."""


class EventLog:
    """Appends the events of a campaign to its file, at most once a second, and looks whether it shall stop.

    An error of the disk costs events, never the campaign.

    Attributes:
        stopped_by: The reason that a reader gave; None as long as nobody asked.
    """

    def __init__(self, directory: NewDirectory, computing: Computing) -> None:
        self.stopped_by: str | None = None
        self.directory = directory
        self._computing = computing
        self._tally = computing.tally
        self._lock = threading.Lock()
        self._began_s = time.monotonic()
        self._shown: Progress | None = None
        self._shown_s = float("-inf")
        self._beat_s = time.monotonic()
        self._torn = False
        self._over = False
        self._cpu_s = 0.0
        self._lines = 0
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._write_on, name="vastflow events", daemon=True)
        try:
            self._file = os.open(directory.running / EVENTS, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
        except OSError as error:
            self._file = -1
            LOGGER.warning("events can't be written (%s)", error.strerror)

    def begin(self, name: str, file: Path, request: RunRequest) -> None:
        """Write the first event, and go on in a thread."""
        self._tally.keep_changes()
        places = {
            "file": str(file.absolute()),
            "directory": str(self.directory.final.absolute()),
            "folder": os.getcwd(),
        }
        asked = request.public().model_dump(mode="json", exclude_defaults=True)
        began = self._event("began", name=name, **places, request=asked, process=os.getpid(), host=platform.node())
        self._append([began])
        shared = {name: asked[name] for name in ("store", "map_dir") if name in asked}
        own = {name: each if "://" in str(each) else os.path.abspath(each) for name, each in shared.items()}
        remember_running(self.directory.final, {**places, "request": {**asked, **own}})
        self._thread.start()

    def close(self, last: EventName, **values: Any) -> None:
        """Write what is left and the last event; later calls do nothing."""
        with self._lock:
            if self._over:
                return
            self._over = True
        self._end.set()
        self._thread.join()
        remember_running(self.directory.final, None)
        began_s = time.thread_time()
        events = self._changes(now=True)
        cost_s = round(self._cpu_s + time.thread_time() - began_s, 4)
        events.append(self._event(last, **values, log={"lines": self._lines + len(events) + 1, "cpu_s": cost_s}))
        self._append(events)
        if self._file >= 0:
            os.close(self._file)
            self._file = -1

    def _write_on(self) -> None:
        while not self._end.wait(INTERVAL_S):
            began_s = time.thread_time()
            self._append(self._changes())
            self._beat()
            if self.stopped_by is None and (reason := stop_reason(self.directory.place)) is not None:
                self.stopped_by = reason
                campaign_log.hush()
                self._computing.engine.close()
            self._cpu_s += time.thread_time() - began_s

    def _beat(self) -> None:
        """Show by the folder's time that somebody is at work, for readers on another host."""
        if time.monotonic() >= self._beat_s + BEAT_S:
            self._beat_s = time.monotonic()
            try:
                os.utime(self.directory.place)
            except OSError as error:
                LOGGER.warning("the campaign directory shows no sign of life (%s)", error.strerror)

    def _changes(self, now: bool = False) -> list[Event]:
        """Return the changes since the last call, and the progress if it is due or `now` is set."""
        at, changes = datetime.now().astimezone(), self._tally.changes()
        events = [Event(at, change.event, change.values) for change in changes]
        progress, now_s = self._tally.progress(), time.monotonic()
        due_s = self._shown_s + max(INTERVAL_S, PROGRESS_SHARE * (now_s - self._began_s)) - INTERVAL_S / 10
        if progress != self._shown and (now or now_s >= due_s or any(each.event == "stage" for each in changes)):
            self._shown, self._shown_s = progress, now_s
            values = {**asdict(progress), "families": [asdict(family) for family in self._tally.families()]}
            del values["notices"]
            values["simulated_s"] = round(progress.simulated_s, 3)
            events.append(Event(at, "progress", values))
        return events

    def _event(self, event: EventName, **values: Any) -> Event:
        return Event(datetime.now().astimezone(), event, values)

    def _append(self, events: list[Event]) -> None:
        if not events or self._file < 0:
            return
        content = b"\n" * self._torn + b"".join(event.line for event in events)
        try:
            self._torn = os.write(self._file, content) < len(content)
            self._lines += len(events)
        except OSError as error:
            self._torn = True
            LOGGER.warning("events are lost, they can't be written (%s)", error.strerror)


@contextmanager
def open_log(run: PreparedCampaign, computing: Computing) -> Iterator[EventLog]:
    """A campaign directory for the body, which computes and writes it, with the events that a reader follows.

    Raises:
        UserError: the folder of results can't be written.
        CampaignStopped: a reader asked for it.
    """
    with new_directory(run.delivery.folder, run.name, computing.created) as directory:
        log = EventLog(directory, computing)
        log.begin(run.name, run.campaign.path, run.request)
        try:
            yield log
        except BaseException as error:
            log.close("stopped", reason=_reason(log, error))
            if isinstance(error, FileError):  # nothing was run, and nothing is to be found
                (directory.running / EVENTS).unlink(missing_ok=True)
            if log.stopped_by is not None and isinstance(error, Exception):
                raise CampaignStopped(f"stopped: {log.stopped_by}") from None
            raise
        finally:  # a flow run that is canceled raises nothing
            log.close("stopped", reason=_reason(log, PoolClosed()))


def log_end(log: EventLog, written: Results) -> None:
    """Write the last event of a campaign that has a directory."""
    counts = written.summary.as_json()
    names = ("configurations", "runs", "passed", "failed", "not_judged", "executed", "reused", "wall_s", "cpu_s")
    counted = {name: counts[name] for name in names}
    log.close("ended", directory=str(written.directory.absolute()), faults=len(written.faults), **counted)


def _reason(log: EventLog, error: BaseException) -> str:
    if log.stopped_by is not None:
        return log.stopped_by
    if isinstance(error, Exception):
        return " ".join(str(error).split())[:_MOST_REASON] or type(error).__name__
    return "interrupted"
