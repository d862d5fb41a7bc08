"""Oracle `barn`: the verdict and the scores of the BARN benchmark."""

from collections.abc import Mapping
from typing import ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from vastflow.oracles.judgment.oracle import Oracle, Parameters
from vastflow.oracles.judgment.verdict import Verdict
from vastflow.oracles.observation.situation import Situation
from vastflow.oracles.observation.trace import Trace
from vastflow.sim.model.elementary import hypots
from vastflow.sim.model.pose import Pose

LEFT_M: Final = 0.1
ARRIVED_M: Final = 1.0
LIMIT_S: Final = 100.0
SPEED_MPS: Final = 2.0
_SLOWEST: Final = 8.0
_FASTEST: Final[Mapping[str, float]] = {"score_2_8": 2.0, "score_4_8": 4.0}
"""Bounds of the time in a score, in optimal times."""


class Barn(Oracle[Parameters]):
    """Passes where the robot came within 1 m of the goal, before any contact and within 100 s.

    The clock starts when the robot is 0.1 m from its start. The benchmark ends a run at the first of the three ends; here a run
    may go on, for Nav2 drives to its own tolerance and contacts end nothing. What comes later does not count. Where Nav2 gives up
    before any of them, the clock runs on to the timeout, as in the benchmark, and so it does where the robot never leaves.

    A score is the optimal time divided by the run's time, which is at least 2 or 4 optimal times and at most 8; it is 0 without
    success. The optimal time is that of `reference_length` at 2 m/s.

    Metrics: `arrived`, `collided`, and `timed_out` (1); `time` (s) from the clock's start to the end, without one where the robot never
    left; `score_2_8` and `score_4_8` (1), without a value where the campaign has no `reference_length`. The benchmark's own tool had the
    bounds 4 and 8 until 2026, with which 0.25 is the most, and has 2 and 8 since.
    """

    Parameters = Parameters
    metrics: ClassVar[Mapping[str, str]] = {
        "arrived": "1",
        "collided": "1",
        "timed_out": "1",
        "time": "s",
        "score_2_8": "1",
        "score_4_8": "1",
    }

    def judge(self, trace: Trace, situation: Situation) -> Verdict:
        if not len(trace) or situation.start is None or not situation.goals:
            return self.not_judged(trace, "there is no robot with a goal")
        t_s, contacts = trace["t_s"], trace.events("contact")
        left_s = _first(t_s, _distances_m(trace, situation.start) >= LEFT_M)
        from_s = np.inf if left_s is None else left_s
        touched = next((event for event in contacts if event.t_s >= from_s), None)
        arrived_s = _first(t_s, _distances_m(trace, situation.goals[-1]) <= ARRIVED_M)
        end_s = min(from_s + LIMIT_S, np.inf if arrived_s is None else arrived_s, touched.t_s if touched else np.inf)
        if trace.run.outcome == "timed_out" and t_s[-1] < (LIMIT_S if left_s is None else end_s):
            reason = f"the run ended after {t_s[-1]:.1f} s, before the benchmark's {LIMIT_S:g} s from the robot's start were over"
            return self.not_judged(trace, reason)
        collided = touched is not None and touched.t_s == end_s
        arrived = arrived_s == end_s and not collided
        metrics: dict[str, float | None] = {
            "arrived": float(arrived),
            "collided": float(collided),
            "timed_out": float(not (arrived or collided)),
            "time": None if left_s is None else round(end_s - left_s, 6),
            **scores(end_s - from_s, situation.reference_length_m, arrived),
        }
        if arrived:
            return self.passed(trace, **metrics)
        what = f"touched {touched.what!r}" if touched and collided else f"not within {ARRIVED_M:g} m of the goal"
        when = "the robot never left its start" if left_s is None else f"{end_s - left_s:.1f} s after it left its start"
        return self.failed(trace, f"{what}: {when}" if left_s is None else f"{what} {when}", **metrics)


def _distances_m(trace: Trace, pose: Pose) -> NDArray[np.float64]:
    return hypots(trace["x_m"] - pose.x_m, trace["y_m"] - pose.y_m)


def _first(t_s: NDArray[np.float64], there: NDArray[np.bool_]) -> float | None:
    found = np.flatnonzero(there)
    return float(t_s[found[0]]) if found.size else None


def scores(time_s: float, length_m: float | None, arrived: bool) -> dict[str, float | None]:
    """The scores of a run by their names; none without a length of the benchmark's path."""
    if length_m is None:
        return {}
    best_s = length_m / SPEED_MPS
    clipped_s = {name: min(max(time_s, least * best_s), _SLOWEST * best_s) for name, least in _FASTEST.items()}
    return {name: best_s / clip_s if arrived else 0.0 for name, clip_s in clipped_s.items()}
