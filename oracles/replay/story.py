"""The story of a replayed run: its times, highlights, view, and words."""

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vastflow.oracles.figures.style import COLORS
from vastflow.oracles.judgment.verdict import Judgment
from vastflow.oracles.query.scene import NO_ZONES, Zones, known_extent_m
from vastflow.oracles.replay.bands import SLOW_S
from vastflow.sim.loop.event_words import event_words
from vastflow.sim.model.faults import UserError
from vastflow.sim.model.pose import Pose
from vastflow.sim.model.rates import TICK_S
from vastflow.sim.model.recording import Event, Run
from vastflow.sim.replay import Activity, Box, Moment
from vastflow.sim.world.occupancy import OccupancyMap

_ACTIVITIES: Final[Mapping[Activity, str]] = {
    "starting": "waiting for the first scan",
    "spin": "recovery: spin",
    "wait": "recovery: wait",
    "back up": "recovery: back up",
    "pausing": "pause at a waypoint",
    "resting": "without a mission",
}


def doing(moment: Moment, run: Run) -> str:
    """Words for the robot's activity; `run` has its ending."""
    if moment.activity == "ended":
        return {"succeeded": "mission succeeded", "aborted": "mission given up"}.get(run.outcome, "mission ended")
    if moment.activity != "following":
        words = _ACTIVITIES[moment.activity]
        return f"{words}, held by the collision monitor" if moment.stopped else words
    if moment.stopped:
        return "stopped by the collision monitor"
    if not moment.planned:
        return "waiting for a plan"
    if moment.no_command_s > 0.0:
        return f"no valid command for {moment.no_command_s:.2f} s"
    if moment.no_progress_s > SLOW_S:
        return f"following, no progress for {moment.no_progress_s:.0f} s"
    return "following the plan"


def numbers(moment: Moment) -> str:
    """Motion, localization error, recoveries so far."""
    turning = f", {abs(moment.yaw_rate_degps):.0f}°/s" if abs(moment.yaw_rate_degps) >= 0.5 else ""
    recoveries = f"{moment.recoveries} {'recovery' if moment.recoveries == 1 else 'recoveries'}"
    # + 0.0 turns the -0.00 of a robot that is pushed out of a wall into 0.00.
    speed = f"{round(moment.speed_mps, 2) + 0.0:.2f} m/s{turning}"
    return f"{speed} · localization {moment.error_m * 100:.0f} cm off · {recoveries}"


FRAMES: Final = 12
"""Most pictures of a run by default."""
FEWEST: Final = 8
"""Fewest pictures; others are added between events."""
_BETWEEN: Final = 2
"""Pictures reserved for times without events."""
APART_S: Final = 0.4
"""Time within which events share a picture."""

_GREAT_RECOVERIES: Final = ("spin", "wait", "back up")
_RANKED: Final = (
    ("contact", "spawned", "deleted"),
    ("goal_missed", "stood_still"),
    ("plan_failed", "control_failed"),
    ("recovery",),
    ("goal_reached", "stopped_by_monitor"),
)
"""Kinds of events, the most important first."""


def tick_of(event: Event) -> int:
    """The first tick after an event."""
    return math.ceil(event.t_s / TICK_S - 1e-6)


def highlights(run: Run, first: int, last: int) -> list[int]:
    """At most `FRAMES` ticks from `first` to `last`: both ends, events by rank, then the middles of the widest gaps."""
    chosen = sorted({first, last})
    events = [event for event in run.events if first < tick_of(event) < last]
    great = {tick_of(event) for event in events if event.kind == "recovery" and event.what in _GREAT_RECOVERIES}
    for rank, kinds in enumerate(_RANKED):
        _choose(chosen, {tick_of(event) for event in events if event.kind in kinds} | (great if rank == 1 else set()))
    for _ in range((FEWEST if len(chosen) + _BETWEEN <= FEWEST else FRAMES) - len(chosen)):
        before, after = max(pairwise(chosen), key=lambda gap: gap[1] - gap[0], default=(0, 0))
        if after - before > 1:
            chosen = sorted([*chosen, (before + after) // 2])
    return chosen


def _choose(chosen: list[int], candidates: Iterable[int]) -> None:
    """Add the candidates farthest from the chosen ones while room and distance allow."""

    def distance(tick: int) -> int:
        return min(abs(tick - other) for other in chosen)

    left = sorted(candidates)
    while left and len(chosen) < FRAMES - _BETWEEN:
        best = max(left, key=distance)
        if distance(best) * TICK_S < APART_S:
            return
        left.remove(best)
        chosen.append(best)
        chosen.sort()


WHOLE_M: Final = 6.5
"""Size of runs that are shown whole."""
FOLLOWED_M: Final = 5.5
"""Size of the square that follows the robot."""
RECENT_TICKS: Final = 10
"""Ticks for which events are told."""
_SMALLEST_M: Final = 4.0
_MARGIN_M: Final = 0.9
_EDGE_M: Final = 0.3
_FREE_M: Final = 1.25
_WIDEST, _NARROWEST = 1.6, 0.8


def view_of(moments: Sequence[Moment], goals: Sequence[Pose]) -> list[Box]:
    """The part of the map shown at each tick: a small run as a whole, else a square that follows."""
    points = np.array([(p.x_m, p.y_m) for p in (*(m.true for m in moments), *goals)])
    low, high = points.min(axis=0) - _MARGIN_M, points.max(axis=0) + _MARGIN_M
    if max(high - low) <= WHOLE_M:
        width, height = np.maximum(high - low, _SMALLEST_M).tolist()
        whole = _box((low + high) / 2, max(width, height * _NARROWEST), max(height, width / _WIDEST))
        return [whole] * len(moments)
    boxes, center = [], points[0]
    for point in points[: len(moments)]:
        if abs(point - center).max() > _FREE_M:  # a background that stands still halves a film
            center = point
        boxes.append(_box(center, FOLLOWED_M, FOLLOWED_M))
    return boxes


def _box(center: NDArray[np.float64], width_m: float, height_m: float) -> Box:
    x, y = center.tolist()
    return Box(x - width_m / 2, y - height_m / 2, x + width_m / 2, y + height_m / 2)


@dataclass(frozen=True, eq=False)
class Story:
    """A replayed run.

    Attributes:
        title: Configuration and run.
        subtitle: Campaign and its time.
        run: Its row of this execution.
        warning: Difference from the recorded run; empty without one.
        occupancy: Actual walls.
        moments, view: One for each tick.
    """

    title: str
    subtitle: str
    run: Run
    judgment: Judgment
    warning: str
    occupancy: OccupancyMap = field(repr=False)
    moments: Sequence[Moment] = field(repr=False)
    view: Sequence[Box] = field(repr=False)
    zones: Zones = NO_ZONES

    @property
    def color(self) -> str:
        return COLORS[self.judgment]

    @property
    def ending(self) -> str:
        outcome = self.run.outcome.replace("_", " ")
        how = f"{outcome}: {self.run.reason}" if self.run.reason else outcome
        return f"{how}  ·  {self.run.simulated_s:.2f} s, {self.run.distance_m:.1f} m"

    def contacts_until(self, tick: int) -> NDArray[np.float64]:
        """Places (n, 2) of contacts up to `tick`."""
        contacts = [(e.x_m, e.y_m) for e in self.run.events if e.kind == "contact" and tick_of(e) <= tick]
        return np.array(contacts, dtype=np.float64).reshape(-1, 2)

    def happenings(self, after: int, until: int) -> list[str]:
        """Distinct happenings after tick `after` up to tick `until`."""
        events = [e for e in self.run.events if after < tick_of(e) <= until]
        found = (
            re.sub(r" \([A-Z_]+\)$", "", text) for event in events if (text := event_words(event))
        )  # without names
        return list(dict.fromkeys(found))

    @cached_property
    def known(self) -> Box:
        """Bounds of the known part of the map, with a margin."""
        x0, x1, y0, y1 = known_extent_m(self.occupancy, _EDGE_M - self.occupancy.resolution_m / 2)
        return Box(x0, y0, x1, y1)

    @cached_property
    def true_xy_m(self) -> NDArray[np.float64]:
        """True positions (ticks, 2)."""
        return np.array([(m.true.x_m, m.true.y_m) for m in self.moments])

    @cached_property
    def estimated_xy_m(self) -> NDArray[np.float64]:
        """Estimated positions (ticks, 2)."""
        return np.array([(m.estimate.x_m, m.estimate.y_m) for m in self.moments])


_EXACT_S: Final = 1e-6


class Span(NamedTuple):
    first: int
    last: int

    def every(self, step: int) -> list[int]:
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
