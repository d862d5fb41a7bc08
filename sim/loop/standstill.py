"""Standstills: robots that were sent somewhere and never moved, and what held them."""

from collections.abc import Iterable, Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vastflow.sim.model.recording import Event

STANDSTILL_M: Final = 0.1
"""A robot with a mission that drove less has stood still (m)."""

STOOD_STILL: Final = "stood_still"
"""Kind of the event; `what` is one of `CAUSES`."""

POINTS_IN_FOOTPRINT: Final = "points in footprint"
COLLISION_MONITOR: Final = "collision monitor"
NO_COMMAND: Final = "no command"
OTHER: Final = "other"

CAUSES: Final[Mapping[str, str]] = {
    POINTS_IN_FOOTPRINT: "the collision monitor stopped every command: scan points inside the footprint",
    COLLISION_MONITOR: "the collision monitor stopped most commands",
    NO_COMMAND: "neither controller nor recovery gave a command",
    OTHER: "for another cause",
}
"""Causes in words."""

_MOST: Final = 0.5


def standstill(columns: Mapping[str, NDArray[np.int32]], events: Iterable[Event], sent_s: float) -> Event:
    """Return the standstill event of a run, at the time of its first mission (s).

    The monitor stops a robot without a command only where the scan has points inside its footprint, so an earlier stop tells that
    cause.

    Args:
        columns: All columns of a recording.
    """
    commanded, sent = (
        np.any([columns[name] != 0 for name in columns if name.startswith(f"{which}_")], axis=0)
        for which in ("command", "sent")
    )
    stopped = commanded & ~sent
    at_rest = any(event.kind == "stopped_by_monitor" and event.t_s <= sent_s for event in events)
    if not commanded.any():
        cause = NO_COMMAND
    elif at_rest and stopped.sum() == commanded.sum():
        cause = POINTS_IN_FOOTPRINT
    else:
        cause = COLLISION_MONITOR if stopped.sum() > _MOST * commanded.sum() else OTHER
    return Event(round(sent_s, 3), STOOD_STILL, columns["x_mm"][0] / 1e3, columns["y_mm"][0] / 1e3, cause)


def told(standstill: Event) -> str:
    """Describe a standstill in words."""
    return f"the robot stood still at the start: {CAUSES[standstill.what]}"
