"""Responses: how soon a robot brakes for an obstacle that appears in its path."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vastflow.oracles.obstacle_tracks import ObstacleTrack, obstacle_tracks_of
from vastflow.oracles.situation import Situation
from vastflow.oracles.trace import Trace

_RESOLUTION_M: Final = 1e-3
"""Of a recording: a robot that stops before an obstacle is nearest to it until it leaves."""


@dataclass(frozen=True, slots=True)
class Braking:
    """What braking is, and not just uneven driving: `lost_mps` or more of the speed |v| within `within_s`, or a stop.

    Attributes:
        stopped_mps: Speed up to which a robot stands.
    """

    lost_mps: float
    within_s: float
    stopped_mps: float


@dataclass(frozen=True, slots=True)
class Response:
    """What a robot did about an obstacle that appeared while it drove towards it.

    Attributes:
        obstacle: Its name.
        appears_s: When it appeared.
        time_s: From then until the robot braked; None where it passed or ran into the obstacle without.
    """

    obstacle: str
    appears_s: float
    time_s: float | None


def responses(trace: Trace, situation: Situation, braking: Braking) -> Iterator[Response]:
    """The response to each obstacle that appeared and that the robot came nearer to afterwards, in the situation's order.

    The time of a response is from the row at which the obstacle is there first to the row at which the robot begins to brake
    (`Braking`). A robot that stands already has responded at once. Only what it does until it leaves the place nearest to the
    obstacle counts, so that braking for the goal, later, is no response. An obstacle that the robot never comes nearer to asks for none.

    Speeds are those of the recording, true and at 0.1 s, which is the resolution of the time.
    """
    for track in obstacle_tracks_of(situation, trace.run):
        if track.appears_s is not None and len(trace):
            response = _response(trace, track, track.appears_s, braking)
            if response is not None:
                yield response


def _response(trace: Trace, track: ObstacleTrack, appears_s: float, braking: Braking) -> Response | None:
    t_s = trace["t_s"]
    apart_m = np.hypot(*(trace.xy_m - track.at(np.rint(t_s * 1000.0).astype(np.int32))).T)
    first = int(np.searchsorted(t_s, appears_s - 1e-9))
    if first >= len(t_s) or not np.isfinite(apart_m[first]):
        return None
    apart_m = apart_m[first:]
    if np.argmin(apart_m) == 0:
        return None
    end = first + int(np.flatnonzero(apart_m <= apart_m.min() + _RESOLUTION_M)[-1]) + 1
    begins = _begins(t_s[first:end], np.abs(trace["speed_mps"][first:end]), braking)
    time_s = round(float(t_s[first + begins] - t_s[first]), 3) if begins is not None else None
    return Response(track.obstacle.name, appears_s, time_s)


def _begins(t_s: NDArray[np.float64], speed_mps: NDArray[np.float64], braking: Braking) -> int | None:
    """Index of the row (N >= 1,) at which braking begins: the last at which nine tenths of what is lost was not lost yet."""
    if speed_mps[0] <= braking.stopped_mps:
        return 0
    for row in range(1, len(t_s)):
        since = min(int(np.searchsorted(t_s, t_s[row] - braking.within_s - 1e-9)), row - 1)
        before_mps = speed_mps[since:row]
        if round(float(before_mps.max()) - float(speed_mps[row]), 6) >= braking.lost_mps:
            return since + int(np.flatnonzero(before_mps >= before_mps.max() - 0.1 * braking.lost_mps)[-1])
        if speed_mps[row] <= braking.stopped_mps:
            return row - 1
    return None
