"""The events of a campaign: the lines that its flow appends to `events.jsonl`, and a reader that follows them."""

import json
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any, Final, Literal, TypeAlias, get_args

from vastflow.oracles.results.former import renamed_keys
from vastflow.oracles.results.unfinished import final_of, is_running, place_of
from vastflow.oracles.results.unusable import DAMAGE
from vastflow.sim.model.files import json_value, open_file

EVENTS: Final = "events.jsonl"

EventName: TypeAlias = Literal[
    "began", "stage", "executed", "verdicts", "fault", "notice", "progress", "stopped", "ended"
]
EVENT_NAMES: Final = get_args(EventName)
LAST: Final = ("stopped", "ended")
"""Events of which one is the last of a campaign."""

_POLL_S: Final = 0.5
_MOST_BYTES: Final = 64 * 2**20
"""Maximum size of what one call reads, and of a line."""
_LOOKS: Final = 2
"""Looks in a row that find no process, before it counts as gone: a folder may be renamed during one."""


@dataclass(frozen=True, slots=True)
class Event:
    """A line of `events.jsonl`; `docs/read-the-report.md` has the values of each event.

    Attributes:
        at: When it was written, with the zone of the writing host.
        event: One of `EVENT_NAMES`, or one of a later version.
    """

    at: datetime
    event: str
    values: Mapping[str, Any] = field(default_factory=dict)

    @property
    def line(self) -> bytes:
        """The line that is written."""
        row = {"at": self.at.isoformat(timespec="milliseconds"), "event": self.event, **self.values}
        return json.dumps(row, ensure_ascii=True, separators=(",", ":")).encode() + b"\n"


def event_of(line: bytes) -> Event | None:
    """Return the event of a line; None if it is none."""
    try:
        row = renamed_keys(json_value(line))
        return Event(datetime.fromisoformat(row.pop("at")), str(row.pop("event")), row)
    except DAMAGE:
        return None


class EventReader:
    """Reads the events of a campaign by and by, wherever its directory is.

    Args:
        directory: Path of the campaign directory, whole or not yet.

    Attributes:
        damaged: Number of lines that are no events.
        gone: True once no process was found for some calls of `new`, and nothing is to come.
    """

    def __init__(self, directory: str | Path) -> None:
        self.directory = final_of(Path(directory))
        self.damaged = 0
        self._looks = 0
        self._read = 0
        self._half = b""

    @property
    def gone(self) -> bool:
        return self._looks >= _LOOKS

    def new(self) -> list[Event]:
        """Return the events since the last call; a half-written line comes with a later call.

        Raises:
            OSError, Unreadable: the file can't be read.
        """
        place = place_of(self.directory)
        looks, self._looks = self._looks + 1, 0
        content = b""
        is_gone = place is None or not is_running(place)
        try:
            # After the look at the process, which may have written its last line since.
            if place is not None:
                with open_file(place / EVENTS, "the events of a campaign") as file:
                    file.seek(self._read)
                    content = file.read(_MOST_BYTES)
        except FileNotFoundError:  # not begun, or renamed between two looks
            pass
        finally:
            self._looks = looks if is_gone and len(content) < _MOST_BYTES else 0
        self._read += len(content)
        *lines, self._half = (self._half + content).split(b"\n")
        if len(self._half) > _MOST_BYTES:
            lines, self._half = [*lines, self._half], b""
        told = [event_of(line) for line in lines if line]
        self.damaged += told.count(None)
        return [event for event in told if event is not None]


def follow(directory: str | Path, poll_s: float = _POLL_S) -> Iterator[Event]:
    """Yield the events of a campaign as they are written, until one of `LAST`.

    A campaign whose process is gone ends with an event `stopped` that is not in the file; a whole directory without events has none.

    Raises:
        OSError, Unreadable: the file can't be read.
    """
    reader = EventReader(directory)
    while not reader.gone:
        for event in reader.new():
            yield event
            if event.event in LAST:
                return
        time.sleep(poll_s)
    if place_of(reader.directory) != reader.directory:
        yield gone_event()


def gone_event() -> Event:
    """Return the last event of a campaign whose process is gone."""
    return Event(datetime.now().astimezone(), "stopped", {"reason": "its process is gone"})
