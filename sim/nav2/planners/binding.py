"""The seam between the loop and a planner."""

from dataclasses import replace
from typing import Any, Final, TypeAlias

import numba
import numpy as np
from numba import types

from vastflow.sim.kernels.binding import Bound, Running, Seam, calling, forwarding
from vastflow.sim.kernels.numeric import inner
from vastflow.sim.nav2.planners.planner import Planner, PlannerInput, PlannerSetting

RunningPlanner: TypeAlias = Running[Planner]


_POSE: Final = (0.0, 0.0, 0.0)
_GIVEN: Final = numba.typeof(
    PlannerInput(np.zeros((1, 1), dtype=np.uint8), np.zeros(3), np.zeros((1, 2)), _POSE, _POSE, np.zeros((1, 3)))
)
_call: Final = calling(types.int64, _GIVEN)
_forward: Final = forwarding(0, types.int64, _GIVEN)


def _path_entry(layout: Any, given: Any) -> int:
    return int(_forward(layout, given))


_SEAM: Final = Seam(
    "compute_path",
    _GIVEN,
    lambda found: isinstance(types.unliteral(found), types.Integer),
    "the number of poses, or minus an error code",
    compute_path=_path_entry,
)


def prepared(planner: Planner, setting: PlannerSetting) -> PlannerSetting:
    """Return the setting with what the planner prepares for it."""
    return replace(setting, prepared=planner.prepare(setting))


def running(planner: Planner, setting: PlannerSetting) -> RunningPlanner:
    """Return a planner with the memory of one mission; raises `ContractError` as `Seam.running` does."""
    return _SEAM.running(planner, planner.memory(setting))


@inner
def compute_path(planner: Bound, given: PlannerInput) -> int:
    """Plan into `given.path`; return the number of poses, or minus an error code."""
    return int(_call(planner.entries[0], planner.table, given))
