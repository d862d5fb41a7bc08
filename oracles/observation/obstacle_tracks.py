"""Obstacle tracks: the obstacles of a run and their places over time."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vastflow.oracles.observation.situation import Situation
from vastflow.sim.model.obstacle import Obstacle
from vastflow.sim.model.pose import Pose
from vastflow.sim.model.recording import Event, Run

_SPAWNED, _MOVED, _DELETED = "spawned", "obstacle_moved", "deleted"
_AWAY: Final = (math.inf, math.inf)
_BEFORE_MS: Final = -1
"""A time before every row of a recording."""


@dataclass(frozen=True, eq=False)
class ObstacleTrack:
    """The places of one obstacle during a run, constant between events.

    Attributes:
        obstacle: Its shape and first pose.
        since_ms: (K >= 1,) start of each place, in order; the first is before the run.
        xy_m: (K, 2) its center; infinite while absent.
        yaw_rad: (K,)
    """

    obstacle: Obstacle
    since_ms: NDArray[np.int64] = field(repr=False)
    xy_m: NDArray[np.float64] = field(repr=False)
    yaw_rad: NDArray[np.float64] = field(repr=False)

    @property
    def appears_s(self) -> float | None:
        """Time of its appearance; None if it is there from the start or never."""
        there = np.flatnonzero(np.isfinite(self.xy_m[:, 0]))
        since_ms = int(self.since_ms[there[0]]) if there.size else 0
        return since_ms / 1000.0 if since_ms > 0 else None

    @property
    def was_there(self) -> bool:
        """Whether it was ever there."""
        return bool(np.isfinite(self.xy_m).any())

    def at(self, t_ms: NDArray[np.int32]) -> NDArray[np.float64]:
        """Its center (N, 2) at the times (N,) of rows, events at these times included."""
        return np.asarray(self.xy_m[self._place(t_ms)])

    def clearance_m(self, t_ms: NDArray[np.int32], xy_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Distances (N,) of points (N, 2) to its outline at the times (N,): 0 inside, infinite while absent."""
        place = self._place(t_ms)
        x_m, y_m = (xy_m - self.xy_m[place]).T
        if self.obstacle.shape == "cylinder":
            return np.asarray(np.maximum(np.hypot(x_m, y_m) - self.obstacle.length_m / 2, 0.0))
        there = np.isfinite(x_m)
        x_m, y_m = np.where(there, x_m, 0.0), np.where(there, y_m, 0.0)
        c, s = np.cos(self.yaw_rad[place]), np.sin(self.yaw_rad[place])
        beyond_x_m = np.maximum(np.abs(c * x_m + s * y_m) - self.obstacle.length_m / 2, 0.0)
        beyond_y_m = np.maximum(np.abs(c * y_m - s * x_m) - self.obstacle.width_m / 2, 0.0)
        return np.where(there, np.hypot(beyond_x_m, beyond_y_m), np.inf)

    def _place(self, t_ms: NDArray[np.int32]) -> NDArray[np.int64]:
        return np.searchsorted(self.since_ms, t_ms, side="right") - 1


def obstacle_tracks_of(situation: Situation, run: Run) -> tuple[ObstacleTrack, ...]:
    """Tracks of the situation's obstacles in order, then of those that the scenario spawned.

    Obstacles without a trigger are there from the start, others from their event `spawned` on; `obstacle_moved` moves and `deleted`
    removes them. Among obstacles of one name an event means the nearest possible one.

    Raises:
        ValueError: an event of an obstacle that the scenario does not have.
    """
    tracks = [_Track(obstacle, there=obstacle.trigger is None) for obstacle in situation.obstacles]
    tracks += [_Track(obstacle, there=False) for obstacle in spawned_by(run)]
    named: dict[str, list[_Track]] = {}
    for track in tracks:
        named.setdefault(track.obstacle.name, []).append(track)
    for event in run.events:
        if event.kind in (_SPAWNED, _MOVED, _DELETED):
            _meant(event, named).note(event)
    return tuple(track.done() for track in tracks)


def spawned_by(run: Run) -> Iterator[Obstacle]:
    """Obstacles that the scenario spawned, at their poses then."""
    known = {entity.name for entity in run.entities}
    events = [event for event in run.events if event.kind == _SPAWNED and event.what in known]
    for entity in run.entities:
        event = next(event for event in events if event.what == entity.name)
        events.remove(event)
        pose = Pose(event.x_m, event.y_m, event.value)
        yield Obstacle(entity.name, entity.shape, pose, entity.length_m, entity.width_m)


class _Track:
    """An obstacle's places, collected event by event."""

    def __init__(self, obstacle: Obstacle, *, there: bool) -> None:
        self.obstacle = obstacle
        self.there = there
        self.last = obstacle.pose.x_m, obstacle.pose.y_m
        self._since_ms = [_BEFORE_MS]
        self._xy_m = [self.last if self.there else _AWAY]
        self._yaw_rad = [obstacle.pose.yaw_rad]

    def note(self, event: Event) -> None:
        self.there = event.kind != _DELETED
        self.last = event.x_m, event.y_m
        self._since_ms.append(round(event.t_s * 1000.0))
        self._xy_m.append(self.last if self.there else _AWAY)
        self._yaw_rad.append(event.value)

    def done(self) -> ObstacleTrack:
        return ObstacleTrack(self.obstacle, np.array(self._since_ms), np.array(self._xy_m), np.array(self._yaw_rad))


def _meant(event: Event, named: Mapping[str, list[_Track]]) -> _Track:
    known = named.get(event.what)
    if known is None:
        raise ValueError(
            f"event {event.kind!r} at {event.t_s:g} s: expected an obstacle of the scenario "
            f"({', '.join(map(repr, named)) or 'none'}), got {event.what!r}"
        )
    possible = [track for track in known if track.there != (event.kind == _SPAWNED)] or known
    return min(possible, key=lambda track: math.dist(track.last, (event.x_m, event.y_m)))
