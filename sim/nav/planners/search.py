"""What a search for a path is given, and what it is set to: the same for all planners that search."""

from dataclasses import dataclass
from typing import Any, Final, NamedTuple

from vastflow.sim.kernels.numeric import inner
from vastflow.sim.nav.inflation import INSCRIBED, UNKNOWN

START_OUTSIDE, GOAL_OUTSIDE, START_OCCUPIED, GOAL_OCCUPIED, TIMEOUT, NO_VALID_PATH = 203, 204, 205, 206, 207, 208
"""Nav2's error codes of ComputePathToPose; those of ComputePathThroughPoses are 100 greater."""

WHOLE: Final = 252.0
"""The greatest cost of a cell that is free."""


@dataclass(frozen=True, slots=True)
class Search:
    """Parameters of a search under the names of its kernels: lengths in cells, but for the map's frame; times as iterations.

    Attributes:
        resolution, origin_x, origin_y: Of the map, in meters.
        bins: Headings a turn is divided into; 1 where a path has none.
        radius: The least radius of a turn.
        circumscribed_cost: Below it the whole polygon of a robot is free; the robot is a disc where `polygon` is 0.
        smoother_iterations: 0 where the path stays as it is searched.
        table: Edge of the window round the goal in which distances of curves are known.
    """

    resolution: float
    origin_x: float
    origin_y: float
    tolerance: float
    allow_unknown: bool
    max_iterations: int
    max_on_approach_iterations: int
    cost_penalty: float
    smoother_tolerance: float
    smoother_iterations: int
    w_data: float
    w_smooth: float
    refinements: int
    polygon: bool = False
    circumscribed_cost: float = 0.0
    bins: int = 1
    radius: float = 1.0
    reverses: bool = False
    interpolates: bool = False
    change_penalty: float = 0.0
    non_straight_penalty: float = 1.0
    reverse_penalty: float = 1.0
    travel_distance_reward: float = 1.0
    quadratic: bool = False
    halves: bool = False
    expansion_ratio: float = 1.0
    expansion_length: float = 0.0
    expansion_cost: float = 252.0
    expansion_override: bool = False
    table: int = 1


class PlannerInput(NamedTuple):
    """What a planner is given. Poses and points are in the frame of the map's grid, in meters and radians.

    Attributes:
        costs: (H, W) uint8 global costmap.
        place: (3,) x and y of its lower left corner, and the resolution.
        outline: (V, 2) padded footprint in the robot's frame.
        start, goal: (x, y, yaw).
        path: (M, 3) which the poses of the path are written to.
    """

    costs: Any
    place: Any
    outline: Any
    start: Any
    goal: Any
    path: Any


@inner
def collides(q: Any, cost: int) -> bool:
    """Whether the center of a robot can't be in a cell of this cost."""
    return bool(cost >= INSCRIBED and not (cost == UNKNOWN and q.allow_unknown != 0))
