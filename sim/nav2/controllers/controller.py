"""The base class of controllers: parameters in Nav2's style and kernels that compute a velocity command."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vastflow.sim.model.parameter import ParameterGroup

if TYPE_CHECKING:
    from vastflow.sim.nav2.costmaps.window import Window

PERIOD_S: Final = 0.05
"""The controller server's period: 20 Hz."""


class ControllerInput(NamedTuple):
    """A controller's input in each cycle. Poses and points are in the odom frame, in meters and radians.

    Attributes:
        window: The local costmap: 254 is lethal, 253 closer than the inscribed radius to that, 255 unknown; `cost_at` looks a
            point up.
        outline: (V, 2) float64, the padded footprint in the robot's frame; `outline_hits` puts it on the costmap.
        inscribed_radius_m: Inscribed radius of the footprint.
        pose: (x, y, yaw) by odometry.
        twist: (v, ω) by odometry, m/s and rad/s.
        plan: (N, 3) float64, N >= 1, x, y, and yaw: the part of the path that `plan_cut` says. NavFn gives every pose but the
            goal's the map's own heading.
        plan_end_yaw_rad: Yaw of its last point.
        goal: (x, y, yaw) of the whole path's end.
        dt_s: Time to the next cycle.
        lateral_mps: Speed to the left by odometry, of an omni robot.
    """

    window: "Window"
    outline: Any
    inscribed_radius_m: float
    pose: Any
    twist: Any
    plan: Any
    plan_end_yaw_rad: float
    goal: Any
    dt_s: float
    lateral_mps: float


@dataclass(frozen=True, slots=True)
class Setting:
    """The settings that a controller can prepare its memory for.

    Attributes:
        rows, columns, resolution_m: Size and resolution of the local costmap.
        xy_goal_tolerance_m, yaw_goal_tolerance_rad: The goal checker's.
        stream: (1,) uint64, the run's random numbers for the controller. Put it into the memory to draw from it by `uniform`,
            `normal_pair` and `integer_below` of `vastflow.sim.kernels.streams`.
        dt_s: Time between two cycles.
        circumscribed_cost: Cost that the local costmap's inflation gives a cell as far from a lethal one as the outline's farthest
            vertex is from the robot's center: where the center costs less, the outline is free.
    """

    rows: int
    columns: int
    resolution_m: float
    xy_goal_tolerance_m: float
    yaw_goal_tolerance_rad: float
    stream: NDArray[np.uint64]
    dt_s: float = PERIOD_S
    circumscribed_cost: float = 0.0

    @property
    def half_edge_m(self) -> float:
        """Half of the local costmap's longer edge."""
        return 0.5 * self.resolution_m * max(self.rows, self.columns)


@dataclass(frozen=True, slots=True)
class PlanCut:
    """The section of the path that a controller gets as its `plan`; earlier points are forgotten.

    Attributes:
        search_m: Length of the path's first segment, in which the part begins.
        within_m: It begins at the first point nearer to the robot than this, or else where the segment ends. With 0 it
            begins at the nearest point.
        two_points: Whether it keeps a point behind the nearest where that is the segment's last.
        ahead_m: Its greatest length.
        around_m: It ends before the first point farther from the robot than this.
        in_window: Whether it ends where the path leaves the local costmap.
        to_inversion: Whether it ends where the path reverses, until the robot is within `inversion_xy_m` and
            `inversion_yaw_rad` of the pose there.
    """

    search_m: float
    within_m: float = 0.0
    two_points: bool = False
    ahead_m: float = float("inf")
    around_m: float = float("inf")
    in_window: bool = False
    to_inversion: bool = False
    inversion_xy_m: float = 0.0
    inversion_yaw_rad: float = 0.0


@dataclass(frozen=True, slots=True)
class SpeedLimits:
    """A controller's response to a speed limit (nav2_core, `Controller::setSpeedLimit`).

    Attributes:
        scaled: Names of its parameters that are scaled.
        full_mps: The speed that a limit in m/s is a share of.
        only_lower: Whether a limit in m/s from there on is left out of account, and what held before holds on.
    """

    scaled: tuple[str, ...]
    full_mps: float
    only_lower: bool = False

    def share(self, limit: float, is_percentage: bool) -> float | None:
        """Return the scale of the parameters: 1 where the limit is 0 (no limit), None for no change."""
        if limit == 0.0:
            return 1.0
        if is_percentage:
            return limit / 100.0
        if self.full_mps <= 0.0 or (self.only_lower and limit >= self.full_mps):
            return None
        return limit / self.full_mps


class Controller(ParameterGroup):
    """Base of all controllers: a subclass has its parameters as fields (see `parameter`), and its kernels as attributes.

    Attributes:
        compute_velocity: Kernel (parameters, memory, `ControllerInput`) to (valid, v, ω): whether there is a command, and what it
            is in m/s and rad/s; or to (valid, v, ω, vy), with the speed to an omni robot's left (m/s). `parameters.name` is a field's value: a flag is 0 or 1, a tuple an array.
        reset: Kernel (memory): a FollowPath action has ended. None where nothing is to be forgotten.
        set_plan: Kernel (memory): the path is a new one, as once a second. None where that changes nothing.
    """

    compute_velocity: ClassVar[Callable[..., Any]]
    reset: ClassVar[Callable[..., Any] | None] = None
    set_plan: ClassVar[Callable[..., Any] | None] = None

    def memory(self, setting: Setting) -> Any:
        """State and working space of a run: a NamedTuple of arrays, and of such again; kernels change them in place."""
        return ()

    def speed_limits(self) -> SpeedLimits | None:
        """Return its response to limits of a speed filter, None if it has none."""
        return None

    @property
    def plan_ahead_m(self) -> float:
        """Length of the plan (m) that the controller gets; infinite for all of it in the local costmap."""
        return float("inf")

    def plan_cut(self, setting: Setting) -> PlanCut:
        """Return the cut of `plan`: from the nearest point, for `plan_ahead_m`, within the local costmap."""
        return PlanCut(search_m=setting.half_edge_m, ahead_m=self.plan_ahead_m, in_window=True)
