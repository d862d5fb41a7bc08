"""Highlights: the moments of a run that are worth a picture."""

import math
from collections.abc import Iterable, Mapping
from itertools import pairwise
from typing import Final

from vastflow.sim.model.rates import TICK_S
from vastflow.sim.model.recording import Event, Run

FRAMES: Final = 12
"""Pictures of a run where nothing else is asked for, at the most."""
FEWEST: Final = 8
"""With fewer there are pictures between the events."""
_BETWEEN: Final = 2
"""So many are kept for the times in which nothing happened."""
APART_S: Final = 0.4
"""What happens within such a time makes one picture."""

_GREAT_RECOVERIES: Final = ("spin", "wait", "back up")
_RANKS: Final[Mapping[str, int]] = {
    "contact": 0,
    "spawned": 0,
    "deleted": 0,
    "goal_missed": 1,
    "recovery": 3,
    "plan_failed": 2,
    "control_failed": 2,
    "goal_reached": 4,
    "stopped_by_monitor": 4,
    "stood_still": 1,
}


def tick_of(event: Event) -> int:
    """The first tick that knows of an event; a contact happens between two."""
    return math.ceil(event.t_s / TICK_S - 1e-6)


def highlights(run: Run, first: int, last: int) -> list[int]:
    """At most `FRAMES` ticks from `first` to `last`, both included.

    Both ends; then events by rank: contacts and obstacles that appear or disappear, recoveries that move the robot or let it wait, failures,
    clearings, the rest; among equals those far from what is chosen already. Then the middles of the widest gaps.
    """
    chosen = sorted({first, last})
    events = [e for e in run.events if first < tick_of(e) < last]
    for rank in sorted(set(_RANKS.values())):
        _choose(chosen, {tick_of(e) for e in events if _rank(e) == rank}, FRAMES - _BETWEEN)
    for _ in range((FEWEST if len(chosen) + _BETWEEN <= FEWEST else FRAMES) - len(chosen)):
        before, after = max(pairwise(chosen), key=lambda gap: gap[1] - gap[0], default=(0, 0))
        if after - before > 1:
            chosen = sorted([*chosen, (before + after) // 2])
    return chosen


def _rank(event: Event) -> int | None:
    if event.kind == "recovery" and event.what in _GREAT_RECOVERIES:
        return 1
    return _RANKS.get(event.kind)


def _choose(chosen: list[int], candidates: Iterable[int], most: int) -> None:
    """Add the candidate farthest from what is chosen, again and again, while there is room and distance."""

    def distance(tick: int) -> int:
        return min(abs(tick - other) for other in chosen)

    left = sorted(candidates)
    while left and len(chosen) < most:
        best = max(left, key=distance)
        if distance(best) * TICK_S < APART_S:
            return
        left.remove(best)
        chosen.append(best)
        chosen.sort()
