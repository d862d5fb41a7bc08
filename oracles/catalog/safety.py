"""Oracle `safety`: the separation from obstacles, and the reaction time to one that appears."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Final, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from vastflow.oracles.judgment.oracle import Oracle, Parameters
from vastflow.oracles.judgment.verdict import Verdict
from vastflow.oracles.observation.obstacle_tracks import ObstacleTrack, obstacle_tracks_of
from vastflow.oracles.observation.situation import Situation
from vastflow.oracles.observation.trace import CLEARANCES, Trace
from vastflow.sim.model.elementary import hypots
from vastflow.sim.model.shape import Box

_RESOLUTION_M: Final = 1e-3
"""Resolution of a recording: a robot that stops before an obstacle is nearest to it until it leaves."""


@dataclass(frozen=True, slots=True)
class Braking:
    """Definition of braking: a loss of `lost_mps` of the speed |v| within `within_s`, or a stop.

    Attributes:
        stopped_mps: Speed up to which a robot stands.
    """

    lost_mps: float
    within_s: float
    stopped_mps: float


def approach_mps(track: ObstacleTrack, trace: Trace) -> NDArray[np.float64]:
    """Return the speed (N,) of a mover toward the robot at each row, 0 where it moves away.

    It is that of their centers, from the rows before and after.
    """
    t_s = trace["t_s"]
    if len(t_s) < 2:
        return np.zeros(len(t_s))
    at_m = track.at(np.rint(t_s * 1000.0).astype(np.int32))
    toward_m = trace.xy_m - at_m
    along = (np.gradient(at_m, t_s, axis=0) * toward_m).sum(axis=1)
    return np.asarray(np.maximum(along / np.maximum(hypots(*toward_m.T), _RESOLUTION_M), 0.0))


def responses(trace: Trace, situation: Situation, braking: Braking) -> list[float | None]:
    """Times (s) until the robot braked for each obstacle that appeared and was approached; None without braking.

    The time is from the first row with the obstacle to the row at which braking begins (`Braking`), at a resolution of 0.1 s; 0 for a
    standing robot. Only rows until the robot leaves the place nearest to the obstacle count.
    """
    found: list[float | None] = []
    for track in obstacle_tracks_of(situation, trace.run):
        if track.appears_s is None or not len(trace):
            continue
        t_s = trace["t_s"]
        apart_m = hypots(*(trace.xy_m - track.at(np.rint(t_s * 1000.0).astype(np.int32))).T)
        first = int(np.searchsorted(t_s, track.appears_s - 1e-9))
        if first >= len(t_s) or not np.isfinite(apart_m[first]) or np.argmin(apart_m[first:]) == 0:
            continue
        apart_m = apart_m[first:]
        end = first + int(np.flatnonzero(apart_m <= apart_m.min() + _RESOLUTION_M)[-1]) + 1
        begins = _begins(t_s[first:end], np.abs(trace["speed_mps"][first:end]), braking)
        found.append(None if begins is None else round(float(t_s[first + begins] - t_s[first]), 3))
    return found


def _begins(t_s: NDArray[np.float64], speed_mps: NDArray[np.float64], braking: Braking) -> int | None:
    """Index of the last row before a tenth of the speed is lost that makes a braking; None without braking."""
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


Reading: TypeAlias = Literal["footprint", "cube"]
READINGS: Final[tuple[Reading, ...]] = ("footprint", "cube")


class SafetyParameters(Parameters):
    """Parameters of `safety`; the default speed and deceleration are the paper's TurtleBot 4's.

    Attributes:
        obstacle_radius: Meaning of r_obstacle: in the plane of the `footprint`, or to a corner of the `cube` in space.
        robot_radius_m: Radius of the robot (m); by default circumscribed.
        max_speed_mps: v, its greatest speed (m/s).
        max_deceleration_mps2: a, its greatest deceleration (m/s²).
        fail_on_contact: Contacts that fail a run: `none`, with an `obstacle`, or with `any` thing, walls too.
        braking_mps: Loss of speed that is braking (m/s): a fifth of the greatest; uneven driving loses at most half of that.
        braking_s: Time within which that is lost (s).
        stopped_speed_mps: Speed up to which the robot stands (m/s).
    """

    obstacle_radius: Reading = "footprint"
    robot_radius_m: float | None = Field(default=None, ge=0)
    max_speed_mps: float = Field(default=0.5, ge=0)
    max_deceleration_mps2: float = Field(default=2.5, gt=0)
    fail_on_contact: Literal["none", "obstacle", "any"] = "obstacle"
    braking_mps: float = Field(default=0.1, gt=0)
    braking_s: float = Field(default=0.5, gt=0)
    stopped_speed_mps: float = Field(default=0.02, ge=0)


class Safety(Oracle[SafetyParameters]):
    """Fails where the robot ever comes closer to an obstacle than it could stop within: the paper's criterion.

    d_min = r_obstacle + r_robot + v²/(2a), all in m, between centers in the plane. The paper's r_obstacle is "the maximum distance from
    the cube center to a corner", and `obstacle_radius` says which corner:

    - `footprint` (default): of the floor area, √2/2 of a cube's edge. With r_robot = 0.15 m, 0.5 m cube: 0.354 + 0.15 + 0.05 = 0.554 m;
      0.8 m: 0.766 m.
    - `cube`: of the cube, √3/2 of its edge, the words as they stand: 0.633 m and 0.893 m. A box counts as the cube of its longer
      edge, since heights are no part of the plane.

    With a body that moves by itself v is the closing speed: the robot's greatest and that of the mover toward it, row by row. A
    cylinder has one radius. Separation is taken at the recording's rows, from where the obstacles are then; one that appears counts from
    then on, and one that is pushed where it was pushed to. All are rounded to the nanometer, and exactly d_min passes. A run without obstacles passes.

    The paper's other property is collision. One with an obstacle is closer than d_min, and fails the run whatever the robot's
    radius is said to be; one with a wall is counted, and fails it where `fail_on_contact` is `any`.

    How unsafe a run was is measured beside it, as the paper asks ("how close the robot comes to obstacles under safety
    violations"). The time of the safety response, which it names without defining it, is that from an obstacle's
    appearance on the robot's path until the robot begins to brake (`vastflow.oracles.catalog.safety`): until it loses `braking_mps` within
    `braking_s`, or comes to a stop.

    Metrics: `smallest_separation` (m), between centers; `margin` (m), the smallest of separation - d_min over
    all obstacles; `footprint_margin` and `cube_margin` (m), the same by either reading, whichever judges; `violation_time` (s), for how long any of them was below 0; `violation_clearance` (m), the smallest distance
    from the robot's rim to the outline of an obstacle during that time, negative where the disc of r_robot overlaps it;
    `response_time` (s), the longest where several obstacles appeared; `unanswered` (1), those that appeared and that it came nearer
    to without braking; `contacts` and `obstacle_contacts` (1). All but the contacts have no value where no obstacle was
    ever there, `violation_clearance` has none without a violation, and `response_time` none where nothing appeared or the robot
    did not brake.
    """

    Parameters = SafetyParameters
    metrics: ClassVar[Mapping[str, str]] = {
        **dict.fromkeys(("smallest_separation", "margin", "footprint_margin", "cube_margin"), "m"),
        "violation_time": "s",
        "violation_clearance": "m",
        "response_time": "s",
        **dict.fromkeys(("unanswered", "contacts", "obstacle_contacts"), "1"),
    }

    def judge(self, trace: Trace, situation: Situation) -> Verdict:
        tracks = obstacle_tracks_of(situation, trace.run, trace.columns)
        radius_m = self.parameters.robot_radius_m
        robot_m = situation.circumscribed_radius_m if radius_m is None else radius_m
        names = {each.obstacle.name for each in tracks}
        touched = [event.what for event in trace.events("contact")]
        obstacles_touched = [what for what in touched if what in names]
        metrics: dict[str, float | None] = {"contacts": len(touched), "obstacle_contacts": len(obstacles_touched)}
        wrong = {"none": [], "obstacle": obstacles_touched, "any": touched}[self.parameters.fail_on_contact]
        # Obstacles of one size class have one required separation, a mover its own at each row.
        closest = {each.group: each for each in tracks}
        if closest and not len(trace):
            return self.not_judged(trace, "the recording has no rows", **metrics)
        if missing := [name for name in closest if f"separation_m/{name}" not in trace.columns]:
            return self.not_judged(trace, f"the trace has no separation from a {missing[0]}", **metrics)
        separation_m = {name: trace[f"separation_m/{name}"] for name in closest}
        there = {name: apart_m for name, apart_m in separation_m.items() if apart_m.min() < math.inf}
        if not there:
            return self._kept(trace, wrong, metrics)
        by_reading = {
            reading: {
                name: np.round(apart_m - self.required_m(closest[name], robot_m, reading, trace), 9)
                for name, apart_m in there.items()
            }
            for reading in READINGS
        }
        margins_m = by_reading[self.parameters.obstacle_radius]
        worst = min(margins_m, key=lambda name: float(margins_m[name].min()))
        violated = np.any([margin_m < 0 for margin_m in margins_m.values()], axis=0)
        metrics |= {
            "smallest_separation": min(float(apart_m.min()) for apart_m in there.values()),
            "margin": float(margins_m[worst].min()),
            **{
                f"{reading}_margin": min(float(m.min()) for m in found.values())
                for reading, found in by_reading.items()
            },
            # Each row stands for half the steps on either side.
            "violation_time": round(
                float((0.5 * np.diff(trace["t_s"]) * (1.0 * violated[1:] + violated[:-1])).sum()), 6
            ),
        }
        kinds = [name for name in CLEARANCES if name in trace.columns]
        if kinds and violated.any():
            metrics["violation_clearance"] = round(min(float(trace[k][violated].min()) for k in kinds) - robot_m, 9)
        if "speed_mps" in trace.columns:
            p = self.parameters
            found = responses(trace, situation, Braking(p.braking_mps, p.braking_s, p.stopped_speed_mps))
            times_s = [time_s for time_s in found if time_s is not None]
            metrics |= {"response_time": max(times_s, default=None), "unanswered": len(found) - len(times_s)}
        if margins_m[worst].min() < 0:
            required_m = self.required_m(closest[worst], robot_m, self.parameters.obstacle_radius, trace)
            row = int(np.argmin(there[worst] - required_m))
            what = repr(worst) if closest[worst].moves else f"a {worst}"
            reason = f"{there[worst][row]:.3f} m from the center of {what}, less than {required_m[row]:.3f} m"
            return self.failed(trace, reason, **metrics)
        return self._kept(trace, wrong, metrics)

    def required_m(self, track: ObstacleTrack, robot_m: float, reading: Reading, trace: Trace) -> NDArray[np.float64]:
        """d_min (N,) in meters between the centers of robot and obstacle at each row of a trace."""
        p, shape = self.parameters, track.obstacle.shape
        radius_m = shape.circumradius_m
        if reading == "cube" and isinstance(shape, Box):
            radius_m = math.sqrt(3) / 2 * max(shape.length_m, shape.width_m)
        closing_mps = p.max_speed_mps + (approach_mps(track, trace) if track.moves else np.zeros(len(trace)))
        return np.asarray(radius_m + robot_m + closing_mps * closing_mps / (2 * p.max_deceleration_mps2))

    def _kept(self, trace: Trace, wrong: list[str], metrics: Mapping[str, float | None]) -> Verdict:
        if not wrong:
            return self.passed(trace, **metrics)
        more = f" and {len(wrong) - 1} more" if len(wrong) > 1 else ""
        return self.failed(trace, f"touched {wrong[0]!r}{more}", **metrics)
