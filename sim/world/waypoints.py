"""The rule of movers that go from waypoint to waypoint."""

import math
from bisect import bisect_right
from collections.abc import Iterator
from functools import cached_property
from itertools import accumulate, pairwise
from typing import Annotated, Final, Literal, NamedTuple, Self, TypeAlias

import numpy as np
from pydantic import AfterValidator, Field

from vastflow.sim.model.elementary import atan2, dist
from vastflow.sim.model.parameter import parameter
from vastflow.sim.world.mover import Mover, Place
from vastflow.sim.world.readers.reader import FARTHEST_M

MOST_WAYPOINTS: Final = 1000
SHORTEST_M: Final = 1e-6
"""Least distance of two waypoints; nearer ones are the same."""

Point: TypeAlias = tuple[float, float]


def _apart(waypoints: tuple[Point, ...]) -> tuple[Point, ...]:
    for k, there in enumerate(waypoints):
        if not max(map(abs, there)) <= FARTHEST_M:
            raise ValueError(f"waypoints within {FARTHEST_M:g} m of the origin, got {list(there)} at index {k}")
        if k and dist(waypoints[k - 1], there) < SHORTEST_M:
            raise ValueError(f"waypoints that differ from the one before, got {list(there)} again at index {k}")
    return waypoints


Route: TypeAlias = Annotated[tuple[Point, ...], Field(max_length=MOST_WAYPOINTS), AfterValidator(_apart)]
"""Waypoints (x, y) in the map's frame (m), each apart from the one before."""


class _Phase(NamedTuple):
    """A leg between two places, or a pause at one in which the body turns to the next leg."""

    duration_s: float
    begin: Place
    end: Place


class Waypoints(Mover):
    """A body that goes straight from waypoint to waypoint, ahead of itself.

    Attributes:
        waypoints: (x, y) in the map's frame (m).
        speed_m_s: Speed between waypoints.
        loop: After the last waypoint it stays (`once`), goes back the same way, backwards (`back_and_forth`), or goes on to
            the first (`around`).
        pause_s: Time that it stays at each waypoint that it reaches, and turns in; without one it turns at once.
        start_s: Time at which it leaves the first waypoint.
        phase_s: Greatest time by which it is ahead of that in a run, drawn for each.
    """

    waypoints: Annotated[Route, Field(min_length=2)]
    speed_m_s: float = parameter(1.0, 0.001, 100.0)
    loop: Literal["once", "back_and_forth", "around"] = "once"
    pause_s: float = parameter(0.0, 0.0, 1e6)
    start_s: float = parameter(0.0, 0.0, 1e6)
    phase_s: float = parameter(0.0, 0.0, 1e6)

    def drawn(self, rng: np.random.Generator) -> Self:
        return self.model_copy(update={"start_s": self.start_s - self.phase_s * rng.random()})

    def pose_at(self, t_s: float) -> Place:
        phases, ends_s = self._path
        t_s = max(t_s - self.start_s, 0.0)
        if self.loop != "once":
            t_s = math.fmod(t_s, ends_s[-1])
        k = bisect_right(ends_s, t_s)
        if k == len(phases):
            return phases[-1].end
        duration_s, begin, end = phases[k]
        share = 1.0 - (ends_s[k] - t_s) / duration_s
        turn_rad = math.remainder(end[2] - begin[2], math.tau)
        x_m, y_m = (a + share * (b - a) for a, b in zip(begin[:2], end[:2], strict=True))
        return x_m, y_m, begin[2] + share * turn_rad

    @cached_property
    def _path(self) -> tuple[list[_Phase], list[float]]:
        """The parts of the path, and the time from the start at which each ends."""
        phases = [*self._phases()]
        return phases, [*accumulate(phase.duration_s for phase in phases)]

    def _phases(self) -> Iterator[_Phase]:
        points = [*self.waypoints]
        if self.loop == "around" and dist(points[0], points[-1]) >= SHORTEST_M:
            points.append(points[0])
        yaws_rad = [atan2(there[1] - here[1], there[0] - here[0]) for here, there in pairwise(points)]
        legs = [((*a, yaw), (*b, yaw)) for (a, b), yaw in zip(pairwise(points), yaws_rad, strict=True)]
        if self.loop == "back_and_forth":
            legs += [(end, begin) for begin, end in reversed(legs)]
        following = [*legs[1:], *(legs[:1] if self.loop != "once" else legs[-1:])]
        for (begin, end), (then, _) in zip(legs, following, strict=True):
            yield _Phase(dist(begin[:2], end[:2]) / self.speed_m_s, begin, end)
            if self.pause_s > 0.0:
                yield _Phase(self.pause_s, end, (*end[:2], then[2]))
