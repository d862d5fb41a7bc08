"""Times of a replay: the ticks of a run that are shown."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from vastflow.sim.model.faults import UserError
from vastflow.sim.model.rates import TICK_S

_EXACT_S: Final = 1e-6


@dataclass(frozen=True, slots=True)
class Span:
    """Ticks of a run, both ends included."""

    first: int
    last: int

    def every(self, step: int) -> list[int]:
        """Each `step`-th tick, and the last."""
        return sorted({*range(self.first, self.last + 1, step), self.last})


def whole_run(simulated_s: float) -> Span:
    """All ticks of a run of `simulated_s`; the last begins a tick before the end."""
    return Span(0, max(round(simulated_s / TICK_S) - 1, 0))


def tick_at(option: str, t_s: float, run: Span) -> int:
    """The tick nearest to a time; the end of the run is its last tick.

    Raises:
        UserError: a time outside the run, given by `option`.
    """
    end_s = (run.last + 1) * TICK_S
    if not 0.0 <= t_s <= end_s + _EXACT_S:  # also catches NaN
        raise UserError(f"{option}: expected a time of the run, from 0 to {end_s:.2f} s, got {t_s:g}")
    return min(_nearest(t_s), run.last)


def span_of(from_s: float | None, to_s: float | None, run: Span) -> Span:
    """The part of a run between two times, by default its ends.

    Raises:
        UserError: a time outside the run, or an end before the start.
    """
    first = run.first if from_s is None else tick_at("--from", from_s, run)
    last = run.last if to_s is None else tick_at("--to", to_s, run)
    if last < first:
        raise UserError(f"--to: expected a time after --from {from_s:g}, got {to_s:g}")
    return Span(first, last)


def step_of(every_s: float) -> int:
    """Number of ticks between two pictures.

    Raises:
        UserError: `every_s` is not positive.
    """
    if not (every_s > 0.0 and math.isfinite(every_s)):
        raise UserError(f"--every: expected a time above 0 s, got {every_s:g}")
    return max(1, _nearest(every_s))


def rounded(option: str, times_s: Iterable[float]) -> list[str]:
    """A note on each time that is not a tick's."""
    return [
        f"{option} {t_s:g}: the nearest tick of {TICK_S * 1e3:.0f} ms is {_nearest(t_s) * TICK_S:.2f} s"
        for t_s in times_s
        if abs(_nearest(t_s) * TICK_S - t_s) > _EXACT_S
    ]


def _nearest(t_s: float) -> int:
    return math.floor(t_s / TICK_S + 0.5)
