"""Obstacle tracks: the obstacles of a run and their places over time."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vastflow.oracles.observation.situation import Situation
from vastflow.sim.model.elementary import cos_sin, dist, hypots
from vastflow.sim.model.obstacle import Obstacle
from vastflow.sim.model.pose import Pose
from vastflow.sim.model.recording import Run
from vastflow.sim.model.shape import Disc

_SPAWNED, _MOVED, _DELETED = "spawned", "obstacle_moved", "deleted"
_AWAY: Final = (math.inf, math.inf)
_BEFORE_MS: Final = -1
"""A time before every row of a recording."""


@dataclass(frozen=True, eq=False)
class ObstacleTrack:
    """The places of one obstacle during a run, constant between events; a mover's between rows.

    Attributes:
        obstacle: Its shape and first pose.
        since_ms: (K >= 1,) start of each place, in order; the first is before the run.
        xy_m: (K, 2) its center; infinite while absent.
        yaw_rad: (K,)
        moves: True for a body that moves by itself.
    """

    obstacle: Obstacle
    since_ms: NDArray[np.int64] = field(repr=False)
    xy_m: NDArray[np.float64] = field(repr=False)
    yaw_rad: NDArray[np.float64] = field(repr=False)
    moves: bool = False

    @property
    def group(self) -> str:
        """Obstacles whose separation is one signal: those of its size, or a mover's name."""
        return self.obstacle.name if self.moves else str(self.obstacle.shape)

    @property
    def appears_s(self) -> float | None:
        """Time of its appearance; None if it is there from the start or never."""
        there = np.flatnonzero(np.isfinite(self.xy_m[:, 0]))
        since_ms = int(self.since_ms[there[0]]) if there.size else 0
        return since_ms / 1000.0 if since_ms > 0 else None

    @property
    def was_there(self) -> bool:
        return bool(np.isfinite(self.xy_m).any())

    def at(self, t_ms: NDArray[np.int32]) -> NDArray[np.float64]:
        """Its center (N, 2) at the times (N,) of rows, events at these times included."""
        return np.asarray(self.xy_m[self._place(t_ms)])

    def outline_m(self, t_ms: int) -> NDArray[np.float64]:
        """Its outline (K, 2) at a time; empty while absent."""
        k = int(self._place(np.array([t_ms], dtype=np.int32))[0])
        x_m, y_m = self.xy_m[k].tolist()
        if not math.isfinite(x_m):
            return np.empty((0, 2))
        placed = replace(self.obstacle, pose=Pose(x_m, y_m, float(self.yaw_rad[k])))
        return np.asarray(placed.footprint().exterior.coords)

    def clearance_m(self, t_ms: NDArray[np.int32], xy_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Distances (N,) of points (N, 2) to its outline at the times (N,): 0 inside, infinite while absent."""
        place = self._place(t_ms)
        x_m, y_m = (xy_m - self.xy_m[place]).T
        shape = self.obstacle.shape
        if isinstance(shape, Disc):
            return np.asarray(np.maximum(hypots(x_m, y_m) - shape.radius_m, 0.0))
        there = np.isfinite(x_m)
        x_m, y_m = np.where(there, x_m, 0.0), np.where(there, y_m, 0.0)
        c, s = np.array([cos_sin(yaw_rad) for yaw_rad in self.yaw_rad.tolist()]).T[:, place]
        beyond_x_m = np.maximum(np.abs(c * x_m + s * y_m) - shape.length_m / 2, 0.0)
        beyond_y_m = np.maximum(np.abs(c * y_m - s * x_m) - shape.width_m / 2, 0.0)
        return np.where(there, hypots(beyond_x_m, beyond_y_m), np.inf)

    def _place(self, t_ms: NDArray[np.int32]) -> NDArray[np.int64]:
        return np.searchsorted(self.since_ms, t_ms, side="right") - 1


def obstacle_tracks_of(
    situation: Situation, run: Run, signals: Mapping[str, NDArray[np.float64]] | None = None
) -> tuple[ObstacleTrack, ...]:
    """Tracks of the situation's obstacles in order, then of spawned ones, then of movers.

    Obstacles without a trigger are there from the start, others from their event `spawned` on; `obstacle_moved` moves and `deleted`
    removes them. Among obstacles of one name an event means the nearest possible one.

    Args:
        signals: Signals of a trace, which have the poses of movers; without them there are no tracks of movers.

    Raises:
        ValueError: an event of an obstacle that the scenario does not have.
    """
    spawned = [*spawned_by(run)]
    obstacles = [*situation.obstacles, *spawned]
    there = [obstacle.trigger is None for obstacle in situation.obstacles] + [False] * len(spawned)
    last = [(obstacle.pose.x_m, obstacle.pose.y_m) for obstacle in obstacles]
    yaw_rad = [obstacle.pose.yaw_rad for obstacle in obstacles]
    places = [[(_BEFORE_MS, *(last[k] if there[k] else _AWAY), yaw_rad[k])] for k in range(len(obstacles))]
    for event in run.events:
        if event.kind not in (_SPAWNED, _MOVED, _DELETED):
            continue
        known = [k for k, obstacle in enumerate(obstacles) if obstacle.name == event.what]
        if not known:
            names = ", ".join(dict.fromkeys(repr(obstacle.name) for obstacle in obstacles)) or "none"
            what = f"expected an obstacle of the scenario ({names}), got {event.what!r}"
            raise ValueError(f"event {event.kind!r} at {event.t_s:g} s: {what}")
        possible = [k for k in known if there[k] != (event.kind == _SPAWNED)] or known
        k = min(possible, key=lambda k: dist(last[k], (event.x_m, event.y_m)))
        there[k], last[k] = event.kind != _DELETED, (event.x_m, event.y_m)
        places[k].append((round(event.t_s * 1000.0), *(last[k] if there[k] else _AWAY), event.value))
    columns = [np.array(each).T for each in places]
    standing = (
        ObstacleTrack(obstacle, since_ms.astype(np.int64), np.column_stack((x_m, y_m)), yaw_rad)
        for obstacle, (since_ms, x_m, y_m, yaw_rad) in zip(obstacles, columns, strict=True)
    )
    return (*standing, *_moving(situation, signals or {}))


def _moving(situation: Situation, signals: Mapping[str, NDArray[np.float64]]) -> Iterator[ObstacleTrack]:
    for name, shape in situation.movers.items():
        if len(signals.get(f"mover_x_m/{name}", ())):
            x_m, y_m, yaw_rad = (signals[f"mover_{part}/{name}"] for part in ("x_m", "y_m", "yaw_rad"))
            since_ms = np.rint(signals["t_s"] * 1000.0).astype(np.int64)
            since_ms[0] = _BEFORE_MS
            pose = Pose(float(x_m[0]), float(y_m[0]), float(yaw_rad[0]))
            obstacle = Obstacle(name, shape, pose)
            yield ObstacleTrack(obstacle, since_ms, np.column_stack((x_m, y_m)), yaw_rad, moves=True)


def spawned_by(run: Run) -> Iterator[Obstacle]:
    """Obstacles that the scenario spawned, at their poses then."""
    known = {entity.name for entity in run.entities}
    events = [event for event in run.events if event.kind == _SPAWNED and event.what in known]
    for entity in run.entities:
        event = next(event for event in events if event.what == entity.name)
        events.remove(event)
        yield entity.at(Pose(event.x_m, event.y_m, event.value))
