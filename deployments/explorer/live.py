"""A running campaign, folded from its events into the state that a page shows."""

from collections import deque
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any, Final

from vastflow.flows.terminal.following import fault_text, progress_of
from vastflow.flows.terminal.progress import Meter, duration_text, pace_words, phase_text
from vastflow.oracles.results.events import LAST, Event
from vastflow.tasks.engine.progress import Progress

MOST_FAILED: Final = 100
MOST_TOLD: Final = 50
"""Faults and notices that are shown, the newest."""
MOST_RECENT: Final = 600
"""Verdicts in the order of their coming."""
_LETTERS: Final = {"pass": "p", "fail": "f"}


class LiveCampaign:
    """The state of a campaign by the events so far."""

    def __init__(self) -> None:
        self._told: dict[str, Any] = {
            "name": "",
            "began": "",
            "last": "",
            "progress": None,
            "families": [],
            "end": None,
        }
        self._progress: Progress | None = None
        self._meter: Meter | None = None
        self._lost: dict[tuple[str, int], dict[str, Any]] = {}
        self._recent: deque[str] = deque(maxlen=MOST_RECENT)
        self._faults: list[str] = []
        self._notices: list[str] = []

    @property
    def over(self) -> bool:
        """True after the last event."""
        return self._told["end"] is not None

    def take(self, event: Event) -> None:
        """Take the next event; those of a later version are passed over.

        Raises:
            KeyError, TypeError, ValueError: an event without its values.
        """
        values = event.values
        self._told["last"] = at = event.at.isoformat(timespec="seconds")
        match event.event:
            case "began":
                self._told |= {"name": str(values.get("name", "")), "began": at}
                self._meter = Meter(event.at.timestamp())
            case "verdicts":
                self._judged(event)
            case "fault":
                self._faults.append(fault_text(values))
            case "notice":
                self._notices.append(str(values["text"]))
            case "progress":
                self._progress = progress_of(event)
                self._told |= {"progress": asdict(self._progress), "families": [*map(_family, values["families"])]}
                if self._meter is not None:
                    self._meter.note(self._progress, event.at.timestamp())
        if event.event in LAST:
            self._told["end"] = {"event": event.event, **values}

    def _judged(self, event: Event) -> None:
        values = event.values
        judgment = str(values["judgment"])
        for run in values["runs"]:
            self._recent.append(_LETTERS.get(judgment, "n"))
            key = (str(values["configuration"]), int(run))
            self._lost.pop(key, None)  # a run that is judged again has the later judgment
            if judgment != "pass":
                reason = str(values["reason"] or "")
                told = {"judgment": judgment, "reason": reason, "at": event.at.isoformat(timespec="seconds")}
                self._lost[key] = {"configuration": key[0], "run": key[1], **told}

    def state(self, now_s: float) -> dict[str, Any]:
        """Return the state as JSON values; of long lists the newest, with the number of all.

        Args:
            now_s: Time since the epoch, by which the pace is measured.
        """
        return {
            **self._told,
            "words": self._words(now_s),
            "recent": "".join(self._recent),
            "lost": list(self._lost.values())[: -MOST_FAILED - 1 : -1],
            "lost_total": len(self._lost),
            "faults": self._faults[: -MOST_TOLD - 1 : -1],
            "faults_total": len(self._faults),
            "notices": self._notices[: -MOST_TOLD - 1 : -1],
            "notices_total": len(self._notices),
        }

    def _words(self, now_s: float) -> list[str]:
        progress, meter = self._progress, self._meter
        if self.over or meter is None:
            return []
        if progress is None:
            return ["starting"]
        pace = meter.pace(progress, now_s)
        return [phase_text(progress, pace), *pace_words(progress, pace), f"{duration_text(pace.elapsed_s)} so far"]


def _family(told: Mapping[str, Any]) -> dict[str, Any]:
    """Return the progress of a family: of runs that are not finished, no rate follows yet."""
    return {**told, **{name: int(told[name]) for name in ("passed", "failed", "not_judged")}}
