"""The base class of planners: parameters in Nav2's style and a kernel that plans on the global costmap."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vastflow.sim.model.parameter import ParameterGroup
from vastflow.sim.nav2.parameters.costmap import Costmap

START_OUTSIDE, GOAL_OUTSIDE, START_OCCUPIED, GOAL_OCCUPIED, TIMEOUT, NO_VALID_PATH = 203, 204, 205, 206, 207, 208
"""Nav2's error codes of ComputePathToPose; those of ComputePathThroughPoses are 100 greater."""

NOTHING: Final = (0, 0, 0, 0)


class PlannerInput(NamedTuple):
    """A planner's input. Poses and points are in the frame of the map's grid, in meters and radians.

    Attributes:
        costs: (H, W) uint8 global costmap.
        place: (3,) x and y of its lower left corner, and the resolution.
        outline: (V, 2) padded footprint in the robot's frame.
        start, goal: (x, y, yaw).
        path: (M, 3) which the poses of the path are written to.
        leg: Number of the goal in a path through several, else 0.
        changed: Rows from and to, columns from and to of the cells that may have changed since the last call.
    """

    costs: Any
    place: Any
    outline: Any
    start: Any
    goal: Any
    path: Any
    leg: int = 0
    changed: Any = NOTHING


@dataclass(frozen=True, slots=True)
class PlannerSetting:
    """The settings that a planner can prepare its memory for.

    Attributes:
        costs: (H, W) uint8 global costmap with nothing marked; `PlannerInput.changed` counts from it.
        free_costs: The same with unknown cells taken for free: no cell will ever cost less.
        costmap: Parameters of the global costmap.
        legs: Greatest number of legs of a path.
        prepared: Result of the planner's `prepare`.
    """

    costs: NDArray[np.uint8]
    free_costs: NDArray[np.uint8]
    costmap: Costmap
    resolution_m: float
    origin_xy_m: tuple[float, float]
    legs: int = 1
    prepared: Any = ()


class Planner(ParameterGroup):
    """Base of all planners: a subclass has its parameters as fields (see `parameter`), and its kernel as an attribute.

    Attributes:
        compute_path: Kernel (parameters, memory, `PlannerInput`) to the number of poses of the path, which `given.path` begins
            with then, or to minus an error code. `parameters.name` is a field's value: a flag is 0 or 1, a tuple an array.
        overlaps: Whether a leg begins at the pose at which the leg before ends.
    """

    compute_path: ClassVar[Callable[..., Any]]
    overlaps: ClassVar[bool] = True

    def prepare(self, setting: PlannerSetting) -> Any:
        """Return what missions on one map share: computed once, found in `setting.prepared`, and never written to."""
        return ()

    def memory(self, setting: PlannerSetting) -> Any:
        """Return state and working space for a mission: a NamedTuple of arrays; the kernel changes them in place."""
        return ()
