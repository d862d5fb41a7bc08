"""Quantities that constraints name and no producer writes: lengths, clearances and counts of a configuration."""

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vastflow.producers.constraints.operations import NotEvaluable
from vastflow.producers.model.configuration import Partial
from vastflow.producers.model.numbers import DEFAULT_ROBOT_DIAMETER_M
from vastflow.producers.model.producer import Producer, may_list_obstacles
from vastflow.producers.places.cells import shortest_path
from vastflow.producers.places.ground import MAP_KEY, ground_of
from vastflow.producers.places.stops import (
    GOAL_KEY,
    GOALS_KEY,
    PATH_KEY,
    PATH_LENGTH_KEY,
    START_KEY,
    given_goals,
    given_start,
)
from vastflow.sim.model.digest import FileContent, Value
from vastflow.sim.model.scenario import DIMENSION_OF_KEY, Dimension
from vastflow.sim.world.map_file import load_map
from vastflow.sim.world.occupancy import OccupancyMap

MOST_MAPS: Final = 4
"""Maps whose distances are kept; the next one pushes the oldest out."""
ROUNDING: Final = 9
"""Decimals of a quantity in meters: 20.65 and not 20.650000000000002."""


@dataclass(frozen=True, slots=True)
class Drawn:
    """The path of a configuration.

    Attributes:
        xy_m: (N, 2) its points, N >= 1.
        length_m: Octile.
    """

    xy_m: NDArray[np.float64]
    length_m: float


class Quantities:
    """Computes quantities of partial configurations when they are asked for, once for each map and path."""

    def __init__(self) -> None:
        self._walls: dict[str, tuple[OccupancyMap, NDArray[np.float64]]] = {}
        self._clearances: dict[Any, tuple[float, float, float]] = {}
        self._paths: dict[Any, Drawn | str] = {}

    def of(self, name: str, partial: Partial) -> int | float:
        """The quantity called `name`, a key of `QUANTITIES`.

        Raises:
            NotEvaluable: the configuration has none, and why.
        """
        found = QUANTITIES[name](self, partial)
        return round(found, ROUNDING) if isinstance(found, float) else found

    def path(self, partial: Partial) -> Drawn:
        """The path that was drawn, or else the shortest one between start and goals."""
        values: Mapping[str, Any] = partial.values
        if PATH_KEY in values and PATH_LENGTH_KEY in values:
            return Drawn(np.array(values[PATH_KEY], dtype=np.float64), float(values[PATH_LENGTH_KEY]))
        stops = _stops(values)
        map_file = _map(values)
        key = (map_file.digest, tuple(stops))
        if key not in self._paths:
            ground = ground_of(map_file, DEFAULT_ROBOT_DIAMETER_M)
            path = shortest_path(ground.occupancy, ground.passable, np.array(stops))
            across = f"a robot {DEFAULT_ROBOT_DIAMETER_M:g} m across"
            self._paths[key] = Drawn(*path) if path else f"there is no path from the start to the goals for {across}"
        found = self._paths[key]
        if isinstance(found, str):
            raise NotEvaluable(found)
        return found

    def clearances(self, partial: Partial) -> tuple[float, float, float]:
        """Distance (m) to the nearest wall: the least along the path, at its start, at its end."""
        map_file, path = _map(partial.values), self.path(partial)
        key = (map_file.digest, path.xy_m.tobytes())
        if key not in self._clearances:
            occupancy, distance_m = self._distance_m(map_file)
            cells = np.array([occupancy.cell_of(*point) for point in _dense(path.xy_m, occupancy.resolution_m)])
            inside = np.clip(cells, 0, np.array(distance_m.shape) - 1)
            along = distance_m[inside[:, 0], inside[:, 1]]
            self._clearances[key] = float(along.min()), float(along[0]), float(along[-1])
        found = self._clearances[key]
        if not math.isfinite(found[0]):
            raise NotEvaluable("the map has no walls")
        return found

    def _distance_m(self, map_file: FileContent) -> tuple[OccupancyMap, NDArray[np.float64]]:
        if map_file.digest not in self._walls:
            occupancy = load_map(map_file.path)
            if occupancy.digest != map_file.digest:
                raise NotEvaluable(f"{map_file.path} changed since the campaign was read")
            from scipy import ndimage

            cells = ndimage.distance_transform_edt(~occupancy.occupied)
            # From the center of a cell to the near side of the wall's cell.
            meters = np.maximum(cells - 0.5, 0.0) * occupancy.resolution_m
            if not occupancy.occupied.any():
                meters = np.full(meters.shape, math.inf)
            while len(self._walls) >= MOST_MAPS:
                del self._walls[next(iter(self._walls))]
            self._walls[map_file.digest] = occupancy, meters
        return self._walls[map_file.digest]


def obstacle_count(partial: Partial) -> int:
    """Return the number of obstacles in the environment, under whatever keys."""
    return sum(
        isinstance(entry, Mapping) and "spawn_pose" in entry
        for key, value in partial.values.items()
        if (partial.dimensions.get(key) or DIMENSION_OF_KEY.get(key)) == "environment"
        and isinstance(value, list | tuple)
        for entry in value
    )


def _density(quantities: Quantities, partial: Partial) -> float:
    length_m = quantities.path(partial).length_m
    if length_m <= 0.0:
        raise NotEvaluable("the path has no length")
    return obstacle_count(partial) / length_m


def _straight_m(quantities: Quantities, partial: Partial) -> float:
    if PATH_KEY in partial.values:
        points: Any = partial.values[PATH_KEY]
        return math.dist(points[0], points[-1])
    stops = _stops(partial.values)
    return math.dist(stops[0], stops[-1])


def _goals(quantities: Quantities, partial: Partial) -> int:
    try:
        goals = given_goals(partial.values, GOALS_KEY) or given_goals(partial.values, GOAL_KEY)
    except ValueError as error:
        raise NotEvaluable(str(error)) from None
    return len(goals)


QUANTITIES: Final[Mapping[str, Callable[[Quantities, Partial], int | float]]] = {
    "path_length": lambda quantities, partial: quantities.path(partial).length_m,
    "narrowest_passage": lambda quantities, partial: 2.0 * quantities.clearances(partial)[0],
    "clearance": lambda quantities, partial: quantities.clearances(partial)[0],
    "start_clearance": lambda quantities, partial: quantities.clearances(partial)[1],
    "goal_clearance": lambda quantities, partial: quantities.clearances(partial)[2],
    "obstacle_density": _density,
    "number_of_obstacles": lambda quantities, partial: obstacle_count(partial),
    "number_of_goals": _goals,
    "straight_distance": _straight_m,
}
"""Lengths and distances in meters; `obstacle_density` per meter of path."""
OF_OBSTACLES: Final = ("obstacle_density", "number_of_obstacles")


def may_write_for(name: str, producer: Producer[Any]) -> bool:
    """Whether the quantity called `name` can depend on what a producer writes."""
    return any(
        (name in OF_OBSTACLES and may_list_obstacles(key, tag))
        or _bears_on(name, key, tag or DIMENSION_OF_KEY.get(key))
        for key, tag in producer.writes.items()
    )


def _bears_on(name: str, key: str, dimension: Dimension | None) -> bool:
    if dimension == "environment" and key != MAP_KEY:
        return name in OF_OBSTACLES  # lists of obstacles have any key
    if name == "number_of_obstacles":
        return False
    if name == "number_of_goals":
        return key in (GOAL_KEY, GOALS_KEY)
    return key in (MAP_KEY, START_KEY) or dimension == "task"  # start and goals can have keys of their own


def _map(values: Mapping[str, Value]) -> FileContent:
    found = values.get(MAP_KEY)
    if not isinstance(found, FileContent):
        raise NotEvaluable(f"the configuration has no {MAP_KEY}")
    return found


def _stops(values: Mapping[str, Value]) -> list[tuple[float, float]]:
    try:
        start = given_start(values, START_KEY)
        goals = given_goals(values, GOALS_KEY) or given_goals(values, GOAL_KEY)
    except ValueError as error:
        raise NotEvaluable(str(error)) from None
    if start is None or not goals:
        raise NotEvaluable(f"the configuration has no path: no {START_KEY} with {GOAL_KEY} or {GOALS_KEY}")
    return [(pose.x_m, pose.y_m) for pose in (start, *goals)]


def _dense(xy_m: NDArray[np.float64], spacing_m: float) -> Sequence[tuple[float, float]]:
    """Points of a polyline not further apart than `spacing_m`, its corners among them."""
    points = [tuple(xy_m[0])]
    for one, other in itertools.pairwise(xy_m):
        steps = max(1, math.ceil(math.dist(one, other) / spacing_m))
        points += [tuple(one + (other - one) * (k / steps)) for k in range(1, steps + 1)]
    return points
