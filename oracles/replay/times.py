"""Times: which ticks of a run shall be looked at."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from vastflow.sim.model.faults import UserError
from vastflow.sim.model.rates import TICK_S

_EXACT_S: Final = 1e-6


class TimeError(UserError, ValueError):
    """A time that a run does not have; says what was asked for and what would be right."""


@dataclass(frozen=True, slots=True)
class Span:
    """Ticks of a run, both ends included."""

    first: int
    last: int

    def every(self, step: int) -> list[int]:
        """Each `step`-th tick, and the last."""
        return sorted({*range(self.first, self.last + 1, step), self.last})


def whole_run(simulated_s: float) -> Span:
    """All ticks of a run that took so long; its last one began a tick before its end."""
    return Span(0, max(round(simulated_s / TICK_S) - 1, 0))


def tick_at(what: str, t_s: float, run: Span) -> int:
    """The tick nearest to a time; the run's end is its last tick.

    Args:
        what: The option's name, for the message.

    Raises:
        TimeError: a time before or after the run.
    """
    end_s = (run.last + 1) * TICK_S
    if not 0.0 <= t_s <= end_s + _EXACT_S:  # also catches NaN
        raise TimeError(f"{what} {t_s:g}: outside the run, which goes from 0 to {end_s:.2f} s")
    return min(math.floor(t_s / TICK_S + 0.5), run.last)


def span_of(from_s: float | None, to_s: float | None, run: Span) -> Span:
    """The part of a run between two times, its ends where one is not given.

    Raises:
        TimeError: a time outside the run, or an end before the beginning.
    """
    first = run.first if from_s is None else tick_at("--from", from_s, run)
    last = run.last if to_s is None else tick_at("--to", to_s, run)
    if last < first:
        raise TimeError(f"--from {from_s:g} --to {to_s:g}: ends before it begins")
    return Span(first, last)


def step_of(every_s: float) -> int:
    """Ticks between two pictures.

    Raises:
        TimeError: no positive time.
    """
    if not (every_s > 0.0 and math.isfinite(every_s)):
        raise TimeError(f"--every {every_s:g}: a time greater than 0 s, {TICK_S:g} s or more")
    return max(1, math.floor(every_s / TICK_S + 0.5))


def rounded(what: str, asked_s: Iterable[float]) -> list[str]:
    """A line for each time that is no tick's."""
    return [
        f"{what} {t_s:g}: the nearest tick of {TICK_S * 1e3:.0f} ms is {tick * TICK_S:.2f} s"
        for t_s in asked_s
        if abs((tick := math.floor(t_s / TICK_S + 0.5)) * TICK_S - t_s) > _EXACT_S
    ]
