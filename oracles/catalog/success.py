"""Oracle `success`: the scenario's own outcome."""

import math
from collections.abc import Mapping
from typing import ClassVar

from vastflow.oracles.judgement.oracle import Oracle, Parameters
from vastflow.oracles.judgement.verdict import Verdict
from vastflow.oracles.observation.situation import Situation
from vastflow.oracles.observation.trace import Trace


class SuccessParameters(Parameters):
    """Parameters of `success`.

    Attributes:
        allow_missed: Let a waypoint mission pass that gave goals up along the route. Nav2's own action succeeds then.
    """

    allow_missed: bool = False


class Success(Oracle[SuccessParameters]):
    """Passes where the scenario succeeded and its missions reached every goal.

    The paper takes Nav2's action result as the initial criterion of success. A contact does not fail it.

    Metrics: `final_distance` (m), distance of the true final position, not the estimate, to the last goal;
    `time` (s), simulated, from the run's start to the scenario's end; `distance` (m), true path driven; `recoveries` and
    `missed_goals` (1), counted. Without a robot there is only `time`.
    """

    Parameters = SuccessParameters
    metrics: ClassVar[Mapping[str, str]] = {
        "final_distance": "m",
        "time": "s",
        "distance": "m",
        "recoveries": "1",
        "missed_goals": "1",
    }

    def judge(self, trace: Trace, situation: Situation) -> Verdict:
        run = trace.run
        final_distance_m = None
        if len(trace) and situation.goals:
            (x_m, y_m), goal = trace.xy_m[-1], situation.goals[-1]
            final_distance_m = math.hypot(x_m - goal.x_m, y_m - goal.y_m)
        has_robot = "t_s" in trace.columns
        metrics: dict[str, float | None] = {
            "final_distance": final_distance_m,
            "time": run.simulated_s,
            "distance": run.distance_m if has_robot else None,
            "recoveries": run.recoveries if has_robot else None,
            "missed_goals": run.missed_goals if has_robot else None,
        }
        if run.outcome != "succeeded":
            why = f": {run.reason}" if run.reason else ""
            what = "mission" if situation.goals else "scenario"
            return self.failed(trace, f"{what} {run.outcome.replace('_', ' ')}{why}", **metrics)
        if run.missed_goals and not self.parameters.allow_missed:
            return self.failed(trace, f"gave up {run.missed_goals} of {len(situation.goals)} goals", **metrics)
        return self.passed(trace, **metrics)
