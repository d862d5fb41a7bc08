"""Goals that a run reached by ground truth."""

from typing import Final

import numpy as np

from vastflow.oracles.observation.situation import Situation
from vastflow.oracles.observation.trace import Trace
from vastflow.sim.model.elementary import hypots

REMOVED_M: Final = 0.75
"""Distance of the estimate at which Nav2 takes a goal for passed: the 0.7 m of RemovePassedGoals, and the way between two rows."""
PASSED_M: Final = 1.0
"""That of the robot itself, as its estimate is off."""


def missed_goals(trace: Trace, situation: Situation) -> int:
    """Count the goals that Nav2 gave up, and those that the robot never passed in their order.

    Goals to pass are those of a mission through poses but its last. Nav2 ends NavigateThroughPoses as succeeded wherever the last goal is reached, also where the robot stood there at first
    (ros-navigation/navigation2 issue 4304). Where it ended as succeeded at its last goal, that goal counts as reached.
    """
    if trace.run.outcome != "succeeded" or not len(trace):
        return trace.run.missed_goals
    at, missed, limits = 0, 0, [(trace.xy_m, PASSED_M)]
    if "estimated_x_m" in trace.columns:
        limits += [(np.column_stack([trace["estimated_x_m"], trace["estimated_y_m"]]), REMOVED_M)]
    for goal in situation.passed:
        within = [hypots(*(xy_m[at:] - (goal.x_m, goal.y_m)).T) <= limit_m for xy_m, limit_m in limits]
        near = np.flatnonzero(np.all(within, axis=0))
        if near.size:
            at += int(near[0])
        else:
            missed += 1
    return trace.run.missed_goals + missed
