"""A campaign that another process runs, in the terminal: its progress, its failures, and its end."""

import sys
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import fields
from itertools import groupby
from pathlib import Path
from typing import Any, Final, TextIO

from vastflow.flows.terminal.display import Display
from vastflow.oracles.results.events import EVENTS, Event
from vastflow.oracles.results.unfinished import final_of, is_running, place_of, unfinished
from vastflow.oracles.results.unusable import UnusableDirectory
from vastflow.tasks.engine.progress import Progress

_COUNTS: Final = frozenset(field.name for field in fields(Progress)) - {"notices"}


def followed_directory(results: Path) -> Path:
    """Return the campaign directory to follow: the one named, or the newest one that runs in a folder.

    Raises:
        UnusableDirectory: there is none, or it has no events.
    """
    place = place_of(results)
    if place is not None and (place / EVENTS).is_file():
        return final_of(place)
    if running := [each for each in unfinished(results) if is_running(each)]:
        return final_of(max(running, key=lambda each: each.stat().st_ctime))
    raise UnusableDirectory(
        f"{results}: expected a campaign directory with {EVENTS}, or a folder where a campaign runs"
    )


class FollowedCampaign:
    """Shows events as the campaign's own terminal shows its progress, on the campaign's clock.

    Attributes:
        last: The last event so far.
    """

    def __init__(self, stream: TextIO | None = None) -> None:
        self.last: Event | None = None
        self._stream = stream or sys.stderr
        self._lines: tuple[str, ...] = ()
        self._shown = 0
        self._at_s, self._seen_s = 0.0, time.monotonic()

    def show(self, events: Iterable[Event]) -> None:
        """Show all events, to the last."""
        display: Display | None = None
        try:
            for self.last in events:
                self._at_s, self._seen_s = self.last.at.timestamp(), time.monotonic()
                display = display or Display(self._stream, self._now_s).__enter__()
                self._lines += tuple(lines_of(self.last))
                if self.last.event == "progress":
                    display.update(progress_of(self.last, self._lines))
                    self._shown = len(self._lines)
        finally:
            if display is not None:
                display.close("\n".join(self._lines[self._shown :]))

    def _now_s(self) -> float:
        return self._at_s + time.monotonic() - self._seen_s


def progress_of(event: Event, notices: tuple[str, ...] = ()) -> Progress:
    """Return the counts of an event `progress`."""
    counts: dict[str, Any] = {name: event.values[name] for name in _COUNTS & event.values.keys()}
    return Progress(**counts, notices=notices)


def fault_text(values: Mapping[str, Any]) -> str:
    """Return place, stage, and error of the values of an event `fault`."""
    run = "" if values["run_index"] is None else f" run {values['run_index']}"
    return f"{values['configuration'] or 'campaign'}{run}, {values['stage']}: {values['error']}"


def lines_of(event: Event) -> Iterator[str]:
    """Yield lines for what a user should not miss: notices, faults, and verdicts other than `pass`."""
    values = event.values
    match event.event:
        case "notice":
            yield str(values["text"])
        case "fault":
            yield f"fault: {fault_text(values)}"
        case "verdicts" if values["judgment"] != "pass":
            said = {"fail": "failed"}.get(values["judgment"], values["judgment"])
            reason = f": {values['reason']}" if values["reason"] else ""
            yield f"{values['configuration']} {runs_text(values['runs'])} {said}{reason}"


def runs_text(runs: Sequence[int]) -> str:
    """Return increasing indices of runs as `run 3` or `runs 0–2, 5`."""
    parts = []
    for _, group in groupby(enumerate(runs), lambda each: each[1] - each[0]):
        consecutive = [run for _, run in group]
        first, last = consecutive[0], consecutive[-1]
        parts.append(f"{first}" if first == last else f"{first}–{last}")
    return f"{'run' if len(runs) == 1 else 'runs'} {', '.join(parts)}"
