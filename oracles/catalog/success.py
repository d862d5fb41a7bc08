"""Oracle `success`: the scenario's own outcome."""

from collections.abc import Mapping
from typing import ClassVar

from vastflow.oracles.judgment.oracle import Oracle, Parameters
from vastflow.oracles.judgment.verdict import Verdict
from vastflow.oracles.observation.goals import missed_goals
from vastflow.oracles.observation.situation import Situation
from vastflow.oracles.observation.trace import Trace
from vastflow.sim.model.elementary import hypot


class SuccessParameters(Parameters):
    """Parameters of `success`.

    Attributes:
        allow_missed: Let a mission pass that gave up or never passed goals along the route. Nav2's own action succeeds then.
    """

    allow_missed: bool = False


class Success(Oracle[SuccessParameters]):
    """Passes where the scenario succeeded and its missions reached every goal.

    The paper takes Nav2's action result as the initial criterion of success. A contact does not fail it, and an error of
    localization alone does not, see `missed_goals`.

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
            final_distance_m = hypot(x_m - goal.x_m, y_m - goal.y_m)
        has_robot, missed = "t_s" in trace.columns, missed_goals(trace, situation)
        metrics: dict[str, float | None] = {
            "final_distance": final_distance_m,
            "time": run.simulated_s,
            "distance": run.distance_m if has_robot else None,
            "recoveries": run.recoveries if has_robot else None,
            "missed_goals": missed if has_robot else None,
        }
        if run.outcome != "succeeded":
            why = f": {run.reason}" if run.reason else ""
            what = "mission" if situation.goals else "scenario"
            return self.failed(trace, f"{what} {run.outcome.replace('_', ' ')}{why}", **metrics)
        if missed and not self.parameters.allow_missed:
            what = "gave up" if run.missed_goals else "never passed"
            return self.failed(trace, f"{what} {missed} of {len(situation.goals)} goals", **metrics)
        return self.passed(trace, **metrics)
