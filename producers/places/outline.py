"""An obstacle's outline and the line it is placed along, asked many thousand times whether a place will do.

Most places that are drawn won't, and most of those are told by a few distances: the polygon is made where these don't decide.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Final, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray
from shapely.geometry import Point, Polygon

from vastflow.sim.model.obstacle import Obstacle
from vastflow.sim.model.pose import Pose
from vastflow.sim.world.occupancy import OccupancyMap

Position: TypeAlias = tuple[float, float]

ROUNDING_M: Final = 1e-9
"""How near to a bound the polygons are asked."""
POLYGON: Final = 0.998
"""Least distance from the center to the outline of a cylinder's polygon, in radii: cos(pi / 64) and some."""


@dataclass(frozen=True)
class ObstacleOutline:
    """Where an obstacle's floor area is."""

    obstacle: Obstacle

    @cached_property
    def center_m(self) -> Position:
        """Its center."""
        return self.obstacle.pose.x_m, self.obstacle.pose.y_m

    @cached_property
    def footprint(self) -> Polygon:
        """The area."""
        return self.obstacle.footprint()

    @cached_property
    def least_m(self) -> float:
        """Least distance from the center to the outline, or a little less."""
        return min(self.obstacle.length_m, self.obstacle.width_m) / 2 * POLYGON

    def nearer_to(self, point: Position, distance_m: float) -> bool:
        """Whether the area is nearer to a point than `distance_m`, which is more than 0."""
        apart_m = math.dist(self.center_m, point)
        if apart_m - self.least_m < distance_m - ROUNDING_M:
            return True
        if apart_m - self.obstacle.circumradius_m > distance_m + ROUNDING_M:
            return False
        return bool(self.footprint.distance(Point(point)) < distance_m)

    def nearer_than(self, distance_m: float, other: "ObstacleOutline") -> bool:
        """Whether two areas are nearer to each other than `distance_m`, which is more than 0."""
        apart_m = math.dist(self.center_m, other.center_m)
        if apart_m - self.least_m - other.least_m < distance_m - ROUNDING_M:
            return True
        if apart_m - self.obstacle.circumradius_m - other.obstacle.circumradius_m > distance_m + ROUNDING_M:
            return False
        return bool(self.footprint.distance(other.footprint) < distance_m)

    def leaves(self, occupancy: OccupancyMap) -> bool:
        """Whether its center, corners or middles of sides are off the free cells; if not, other parts may be."""
        rows, columns = occupancy.shape
        for x_m, y_m in self._marks:
            row, column = occupancy.cell_of(x_m, y_m)
            if not (0 <= row < rows and 0 <= column < columns and occupancy.free[row, column]):
                return True
        return False

    @property
    def _marks(self) -> list[Position]:
        """The corners first, for they are off the free cells most often."""
        obstacle, (x_m, y_m) = self.obstacle, self.center_m
        if obstacle.shape == "cylinder":
            r_m = self.least_m
            return [(x_m, y_m), (x_m + r_m, y_m), (x_m - r_m, y_m), (x_m, y_m + r_m), (x_m, y_m - r_m)]
        cos, sin = math.cos(obstacle.pose.yaw_rad), math.sin(obstacle.pose.yaw_rad)
        # By as little inside that rounding puts none of them into a cell that the area does not touch.
        u_m, v_m = obstacle.length_m / 2 - ROUNDING_M, obstacle.width_m / 2 - ROUNDING_M
        around = ((1, 1), (1, -1), (-1, 1), (-1, -1), (1, 0), (-1, 0), (0, 1), (0, -1), (0, 0))
        return [(x_m + a * u_m * cos - b * v_m * sin, y_m + a * u_m * sin + b * v_m * cos) for a, b in around]


@dataclass(frozen=True, slots=True)
class Line:
    """A polyline that poses are drawn along.

    Attributes:
        corners_m: (N, 2).
        along_m: (N,) distance along the outline from the first corner to each.
    """

    corners_m: NDArray[np.float64]
    along_m: NDArray[np.float64]

    @classmethod
    def along(cls, corners_m: NDArray[np.float64]) -> Self:
        """The line of these corners (N, 2)."""
        steps = np.diff(corners_m, axis=0)
        return cls(corners_m, np.concatenate(([0.0], np.cumsum(np.hypot(steps[:, 0], steps[:, 1])))))

    def draw(self, max_distance_m: float, rng: np.random.Generator) -> Pose:
        """A pose within `max_distance_m` of the line, uniform along it, across it and in yaw."""
        length_m = float(self.along_m[-1])
        at_m = rng.uniform(0.0, length_m)
        across_m = rng.uniform(-max_distance_m, max_distance_m)
        yaw_rad = rng.uniform(-math.pi, math.pi)
        x_m, y_m = (float(one) for one in self.corners_m[0])
        heading_rad = yaw_rad  # where the path is a single point
        if length_m > 0.0:
            i = min(int(np.searchsorted(self.along_m, at_m, side="right")) - 1, len(self.along_m) - 2)
            (x_m, y_m), (next_x_m, next_y_m) = self.corners_m[i].tolist(), self.corners_m[i + 1].tolist()
            step_x_m, step_y_m = next_x_m - x_m, next_y_m - y_m
            share = (at_m - float(self.along_m[i])) / (float(self.along_m[i + 1]) - float(self.along_m[i]))
            x_m, y_m = x_m + step_x_m * share, y_m + step_y_m * share
            heading_rad = math.atan2(step_y_m, step_x_m)
        x_m, y_m = x_m - across_m * math.sin(heading_rad), y_m + across_m * math.cos(heading_rad)
        return Pose(round(x_m, 6), round(y_m, 6), round(float(yaw_rad), 6))
