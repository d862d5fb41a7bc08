"""Placement of obstacles along a path without overlaps, so that a path remains."""

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray
from shapely.geometry import Point, Polygon

from vastflow.producers.places.ground import Ground, touched_cells
from vastflow.sim.model.elementary import atan2, cos_sin, dist, hypots
from vastflow.sim.model.obstacle import Obstacle
from vastflow.sim.model.pose import Pose
from vastflow.sim.model.shape import Box, Disc

Position: TypeAlias = tuple[float, float]

ROUNDING_M: Final = 1e-9
"""Distance to a bound within which polygons are compared exactly."""


class Outline(NamedTuple):
    """An area of the floor in a circle round its center."""

    center_m: Position
    radius_m: float
    area: Polygon | Point

    def nearer_than(self, distance_m: float, other: "Outline") -> bool:
        """Whether two areas are nearer to each other than `distance_m`, which is more than 0."""
        gap_m = dist(self.center_m, other.center_m) - self.radius_m - other.radius_m
        return gap_m <= distance_m + ROUNDING_M and bool(self.area.distance(other.area) < distance_m)


def outline_of(obstacle: Obstacle) -> Outline:
    """Return the area on which an obstacle stands."""
    return Outline((obstacle.pose.x_m, obstacle.pose.y_m), obstacle.shape.circumradius_m, obstacle.footprint())


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
        return cls(corners_m, np.concatenate(([0.0], np.cumsum(hypots(steps[:, 0], steps[:, 1])))))

    def draw(self, max_distance_m: float, rng: np.random.Generator) -> Pose:
        """A pose within `max_distance_m` of the line, uniform along it, across it and in yaw."""
        length_m = float(self.along_m[-1])
        at_m = rng.uniform(0.0, length_m)
        across_m = rng.uniform(-max_distance_m, max_distance_m)
        yaw_rad = rng.uniform(-math.pi, math.pi)
        x_m, y_m = (float(np.interp(at_m, self.along_m, axis)) for axis in self.corners_m.T)
        heading_rad = yaw_rad  # where the path is a single point
        if length_m > 0.0:
            i = int(np.searchsorted(self.along_m[1:-1], at_m, side="right"))
            step_x_m, step_y_m = (self.corners_m[i + 1] - self.corners_m[i]).tolist()
            heading_rad = atan2(step_y_m, step_x_m)
        c, s = cos_sin(heading_rad)
        x_m, y_m = x_m - across_m * s, y_m + across_m * c
        return Pose(round(x_m, 6), round(y_m, 6), round(float(yaw_rad), 6))


MARGIN_M: Final = 0.05
"""Least gap between two obstacles, and between an obstacle and the robot at its stops."""
MAX_TRIES: Final = 100
"""Places tried for an obstacle before the whole set is drawn again."""
MAX_ATTEMPTS: Final = 10
"""Sets drawn before a placement is given up."""
NEIGHBORHOOD_M: Final = 5.0
"""Distance from the path within which another one is searched before the whole map."""


@dataclass(frozen=True)
class Site:
    """The place of obstacles.

    Attributes:
        path_xy_m: (N, 2) the polyline they are placed along.
        length_m: Octile length of the whole path.
        stops_xy_m: Start and goals, which stay clear and connected.
        standing: Obstacles that are there already.
        from_start_m: Least distance of a center from the start.
    """

    ground: Ground
    path_xy_m: NDArray[np.float64]
    length_m: float
    stops_xy_m: Sequence[tuple[float, float]]
    standing: Sequence[Obstacle] = ()
    from_start_m: float = 0.0


@dataclass(frozen=True, slots=True)
class Wanted:
    """A number of obstacles like `pattern`, and the greatest distance of their centers from the path."""

    amount: int
    pattern: Obstacle
    max_distance_m: float


def place(site: Site, wanted: Sequence[Wanted], rng: np.random.Generator) -> list[Obstacle] | str:
    """Draw a place for every obstacle in turn, or return the reason why there is no room.

    A center lies uniformly along the path and uniformly to its left or right, its yaw is uniform. Places that
    won't do are drawn again, `MAX_TRIES` times for each obstacle and `MAX_ATTEMPTS` times for the whole set.
    """
    refusals, most = Counter[str](), 0
    passable = around(site.ground, site.standing)
    if site.standing and not is_connected(site, passable):
        return "the obstacles that are there already leave no path to the goals"
    for _ in range(MAX_ATTEMPTS):
        layout = _Layout(site, passable, refusals)
        if all(layout.add(each, rng) for each in wanted for _ in range(each.amount)):
            return layout.obstacles
        most = max(most, len(layout.obstacles))
    total = refusals.total()
    causes = ", ".join(f"{round(100 * n / total)} % {cause}" for cause, n in refusals.most_common())
    return (
        f"at most {most} of {sum(w.amount for w in wanted)} obstacles fit in {MAX_ATTEMPTS} attempts of "
        f"{MAX_TRIES} tries each. Of the places tried, {causes}"
    )


class _Layout:
    """The obstacles placed so far, and where the robot can still be."""

    def __init__(self, site: Site, passable: NDArray[np.bool_], refusals: Counter[str]) -> None:
        self.obstacles: list[Obstacle] = []
        self._site = site
        self._refusals = refusals
        self._line = Line.along(site.path_xy_m)
        self._stops = [Outline(stop, 0.0, Point(stop)) for stop in site.stops_xy_m]
        self._outlines = [outline_of(obstacle) for obstacle in site.standing]
        self._passable = passable

    def add(self, wanted: Wanted, rng: np.random.Generator) -> bool:
        """Place one more; False where no place was found."""
        for _ in range(MAX_TRIES):
            obstacle = replace(wanted.pattern, pose=self._line.draw(wanted.max_distance_m, rng))
            refusal = self._refusal(outline_of(obstacle))
            if refusal is None:
                self.obstacles.append(obstacle)
                return True
            self._refusals[refusal] += 1
        return False

    def _refusal(self, outline: Outline) -> str | None:
        ground, from_start_m = self._site.ground, self._site.from_start_m
        clear_m = max(ground.robot_diameter_m / 2 + MARGIN_M, ground.room_m + ROUNDING_M)
        if any(outline.nearer_than(clear_m, stop) for stop in self._stops):
            return "left no room for the robot at its start or goals"
        if dist(outline.center_m, self._site.stops_xy_m[0]) < from_start_m:
            return f"lay within {from_start_m:g} m of the start"
        if any(outline.nearer_than(MARGIN_M, other) for other in self._outlines):
            return "came too close to another obstacle"
        covered = covered_cells(ground, outline.area)
        if covered is None:
            return "lay on walls or unknown space"
        passable = without(self._passable, covered, ground.radius_cells)
        if not is_connected(self._site, passable):
            return "left no path to the goals"
        self._outlines.append(outline)
        self._passable = passable
        return None


def is_connected(site: Site, passable: NDArray[np.bool_]) -> bool:
    """Whether a robot that can be on `passable` cells (H, W) gets from the start to every goal."""
    occupancy = site.ground.occupancy
    stops = np.array([occupancy.cell_of(*stop) for stop in site.stops_xy_m])
    margin = math.ceil(NEIGHBORHOOD_M / occupancy.resolution_m)
    near = np.concatenate((stops, [occupancy.cell_of(*point) for point in site.path_xy_m.tolist()]))
    corner, far_corner = np.maximum(near.min(axis=0) - margin, 0), near.max(axis=0) + margin
    window = passable[corner[0] : far_corner[0], corner[1] : far_corner[1]]
    return _joined(window, stops - corner) or _joined(passable, stops)


def _joined(passable: NDArray[np.bool_], cells: NDArray[np.int64]) -> bool:
    from skimage.measure import label

    numbers = label(passable, connectivity=2)[tuple(cells.T)]
    return bool(numbers[0] > 0 and np.all(numbers == numbers[0]))


def covered_cells(ground: Ground, footprint: Polygon) -> NDArray[np.int64] | None:
    """Return row and column (K, 2) of cells that a convex `footprint` touches; None unless all are free."""
    occupancy = ground.occupancy
    at = np.floor(occupancy.in_cells(np.array(footprint.exterior.coords))).astype(np.int64)
    inside = occupancy.contains(*at.min(axis=0)) and occupancy.contains(*at.max(axis=0))
    if not inside or not occupancy.free[tuple(at.T)].all():  # corners are off the free cells most often
        return None
    cells = touched_cells(occupancy, footprint)
    return cells if occupancy.free[tuple(cells.T)].all() else None


def around(ground: Ground, obstacles: Sequence[Obstacle]) -> NDArray[np.bool_]:
    """The passable cells (H, W) around obstacles, which may overlap walls or leave the map."""
    passable = ground.passable
    for obstacle in obstacles:
        touched = touched_cells(ground.occupancy, obstacle.footprint())
        passable = without(passable, touched, ground.radius_cells) if len(touched) else passable
    return passable


def without(passable: NDArray[np.bool_], covered: NDArray[np.int64], radius_cells: int) -> NDArray[np.bool_]:
    """`passable` (H, W) less the cells within `radius_cells` of `covered` (K, 2): as `octile.inflated_free` has it."""
    from scipy import ndimage

    margin = radius_cells + 1
    corner = np.maximum(covered.min(axis=0) - margin, 0)
    far_corner = np.minimum(covered.max(axis=0) + margin + 1, passable.shape)
    window = tuple(map(slice, corner, far_corner))
    uncovered = np.ones(tuple(far_corner - corner), dtype=np.bool_)
    uncovered[tuple((covered - corner).T)] = False
    less = passable.copy()
    less[window] &= ndimage.distance_transform_edt(uncovered) > radius_cells
    return less


FROM_STOPS: Final = 2.0
"""Least distance of a center from start and goals, in diameters of the robot."""
FROM_EACH_OTHER: Final = 1.5
"""Least distance of two centers, in diameters of the robot."""
TRIES_FOR_EACH: Final = 100
"""Places tried for one kind of obstacle, for each that is wanted of it."""


def place_as_v1(site: Site, wanted: Sequence[Wanted], rng: np.random.Generator) -> list[Obstacle] | str:
    """Draw a place for every obstacle in turn; or say why version 1 would find none.

    Places are drawn as `place` draws them. One will do where the center is far enough
    from the stops and from other centers. A whole set will do where a path remains: it is drawn `MAX_ATTEMPTS` times at most.
    """
    total = sum(each.amount for each in wanted)
    most, blocking = 0, 0
    if not total:
        return []
    for _ in range(MAX_ATTEMPTS):
        obstacles = list(_drawn_as_v1(site, wanted, rng))
        most = max(most, len(obstacles))
        if len(obstacles) == total:
            if is_connected(site, _around_as_v1(site.ground, (*site.standing, *obstacles))):
                return obstacles
            blocking += 1
    if blocking:
        return f"as version 1 places them, {blocking} of {MAX_ATTEMPTS} sets of {total} obstacles left no path to the goals"
    return f"as version 1 places them, at most {most} of {total} obstacles fit in {MAX_ATTEMPTS} attempts"


def _drawn_as_v1(site: Site, wanted: Sequence[Wanted], rng: np.random.Generator) -> Iterator[Obstacle]:
    """Draw one set with the obstacles for which a place is found."""
    line = Line.along(site.path_xy_m)
    diameter_m = site.ground.robot_diameter_m
    taken = [(stop, FROM_STOPS * diameter_m) for stop in site.stops_xy_m]
    for each in wanted:
        left = each.amount
        for _ in range(TRIES_FOR_EACH * each.amount):
            if not left:
                break
            pose = line.draw(each.max_distance_m, rng)
            center = pose.x_m, pose.y_m
            if all(dist(center, other) >= least_m for other, least_m in taken):
                taken.append((center, FROM_EACH_OTHER * diameter_m))
                left -= 1
                yield replace(each.pattern, pose=pose)


def _around_as_v1(ground: Ground, obstacles: Sequence[Obstacle]) -> NDArray[np.bool_]:
    """The passable cells (H, W) when obstacles stand, each grown by the robot's radius to all sides."""
    passable = ground.passable.copy()
    for obstacle in obstacles:
        length_m, width_m = (side_m + ground.robot_diameter_m for side_m in (obstacle.length_m, obstacle.width_m))
        is_disc = isinstance(obstacle.shape, Disc)
        grown = replace(obstacle, shape=Disc(length_m / 2) if is_disc else Box(length_m, width_m))
        passable[tuple(touched_cells(ground.occupancy, grown.footprint(), 0.0).T)] = False
    return passable
