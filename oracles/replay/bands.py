"""Bands of activities: the robot's doing over time, as a time line shows it."""

from collections.abc import Iterator, Sequence
from itertools import groupby
from typing import Final

from vastflow.sim.replay import Moment

SLOW_S: Final = 3.0
"""Time without progress that is told."""


def bands(moments: Sequence[Moment]) -> Iterator[tuple[int, int, str]]:
    """Spans of ticks (first, last) in which the robot did the same thing, and what."""
    first = 0
    for kind, group in groupby(moments, _kind):
        last = first + len(list(group)) - 1
        yield first, last, kind
        first = last + 1


def _kind(moment: Moment) -> str:
    if moment.stopped:
        return "stopped"
    if moment.no_command_s > 0.0:
        return "no command"
    return "no progress" if moment.no_progress_s > SLOW_S else moment.activity
