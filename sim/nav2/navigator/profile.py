"""CPU time of a run by stages of a tick, measured by kernels on request."""

from typing import Any, Final

from numba import types

from vastflow.sim.kernels.numeric import inner

STAGES: Final = (
    *("outside the kernels", "the clock itself", "lidar", "AMCL", "local costmap", "global costmap"),
    *("behavior", "planner", "controller", "command path", "actuators and odometry", "recording", "free motion"),
)
OUTSIDE, CLOCK, LIDAR, AMCL, LOCAL_COSTMAP, GLOBAL_COSTMAP = range(6)
BEHAVIOR, PLANNER, CONTROLLER, COMMAND_PATH, ACTUATORS, RECORDING, MOTION = range(6, 13)

# C's own: CPU time of the process in microseconds (POSIX). A foreign symbol, unlike a Python function, can be cached.
_clock = types.ExternalFunction("clock", types.intp())


@inner
def lap(m: Any, stage: int) -> None:
    """Count the time since the last lap as `stage`'s, where the run is profiled at all.

    Laps come in `m.laps` (stages, 2): microseconds and how many; `m.lapped` is when the last one ended.
    """
    if m.profiling == 0:
        return
    m.laps[stage, 0] += _clock() - m.lapped
    m.laps[stage, 1] += 1.0
    m.lapped = _clock()
