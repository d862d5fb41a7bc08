"""Goals that a run reached by ground truth."""

from typing import Final

import numpy as np

from vastflow.oracles.observation.situation import Situation
from vastflow.oracles.observation.trace import Trace

PASSED_M: Final = 1.0
"""Distance at which a goal is passed: the 0.7 m of Nav2's RemovePassedGoals, and 0.3 m for its estimate of the robot's position."""


def missed_goals(trace: Trace, situation: Situation) -> int:
    """Count the goals that Nav2 gave up, and those that the robot never passed in their order.

    Goals to pass are those of a mission through poses but its last. Nav2 ends NavigateThroughPoses as succeeded wherever the last goal is reached, also where the robot stood there at first
    (ros-navigation/navigation2 issue 4304). Where it ended as succeeded at its last goal, that goal counts as reached.
    """
    if trace.run.outcome != "succeeded" or not len(trace):
        return trace.run.missed_goals
    at, missed = 0, 0
    for goal in situation.passed:
        near = np.flatnonzero(np.hypot(*(trace.xy_m[at:] - (goal.x_m, goal.y_m)).T) <= PASSED_M)
        if near.size:
            at += int(near[0])
        else:
            missed += 1
    return trace.run.missed_goals + missed
