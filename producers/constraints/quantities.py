"""Quantities that constraints name and no producer writes: lengths, clearances and counts of a configuration."""

import functools
import itertools
import math
from collections.abc import Callable, Mapping
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from vastflow.producers.constraints.operations import NotEvaluable
from vastflow.producers.model.configuration import Partial
from vastflow.producers.model.numbers import DEFAULT_ROBOT_DIAMETER_M
from vastflow.producers.model.producer import Producer, may_list_obstacles
from vastflow.producers.places.ground import ground_of
from vastflow.producers.places.stops import (
    GOAL_KEY,
    GOALS_KEY,
    PATH_KEY,
    PATH_LENGTH_KEY,
    START_KEY,
    given_goals,
    given_start,
)
from vastflow.sim.model.digest import FileContent
from vastflow.sim.model.elementary import dist
from vastflow.sim.model.pose import Pose
from vastflow.sim.model.scenario import DIMENSION_OF_KEY, Dimension
from vastflow.sim.world.environment import MAP_KEY, WORLD_KEY, ground_file
from vastflow.sim.world.world import read_grid

MOST_MAPS: Final = 4
MOST_PATHS: Final = 4096
"""Number of cached paths."""
ROUNDING: Final = 9
"""Decimals of a quantity in meters: 20.65 and not 20.650000000000002."""

Points: TypeAlias = tuple[tuple[float, float], ...]
"""Points of a path (m), at least one."""


def quantity(name: str, partial: Partial) -> int | float:
    """The quantity called `name`, a key of `QUANTITIES`.

    Raises:
        NotEvaluable: the configuration has none, and why.
    """
    try:
        found = QUANTITIES[name](partial)
    except (ValueError, NotEvaluable) as error:  # of poses and maps
        raise NotEvaluable(f"{name}: {error}") from None
    return round(found, ROUNDING) if isinstance(found, float) else found


def _path(partial: Partial) -> tuple[Points, float]:
    """Points and octile length (m) of the path that was drawn, else of the shortest from start to goals."""
    values: Mapping[str, Any] = partial.values
    if PATH_KEY in values and PATH_LENGTH_KEY in values:
        return tuple((float(x_m), float(y_m)) for x_m, y_m in values[PATH_KEY]), float(values[PATH_LENGTH_KEY])
    found = _shortest(_map(partial), _stops(partial))
    if found is None:
        raise NotEvaluable(
            f"there is no path from the start to the goals for a robot {DEFAULT_ROBOT_DIAMETER_M:g} m across"
        )
    return found


@functools.lru_cache(MOST_PATHS)
def _shortest(map_file: FileContent, stops: Points) -> tuple[Points, float] | None:
    from vastflow.sim.world import octile

    ground = ground_of(map_file, DEFAULT_ROBOT_DIAMETER_M)
    path = octile.shortest_path(ground.occupancy, ground.passable, np.array(stops))
    return path and (tuple(map(tuple, path[0].tolist())), path[1])


def _clearances(partial: Partial) -> tuple[float, float, float]:
    """Distance (m) to the nearest wall: the least along the path, at its start, at its end."""
    found = _clearances_on(_map(partial), _path(partial)[0])
    if not math.isfinite(found[0]):
        raise NotEvaluable("the map has no walls")
    return found


@functools.lru_cache(MOST_PATHS)
def _clearances_on(map_file: FileContent, path: Points) -> tuple[float, float, float]:
    occupancy, distance_m = read_grid(map_file), _distance_m(map_file)
    points = [path[0]]  # no farther apart than cells
    for one, other in itertools.pairwise(np.array(path)):
        steps = max(1, math.ceil(dist(one, other) / occupancy.resolution_m))
        points += [tuple(one + (other - one) * (k / steps)) for k in range(1, steps + 1)]
    cells = np.array([occupancy.cell_of(*point) for point in points])
    along = distance_m[tuple(np.clip(cells, 0, np.array(distance_m.shape) - 1).T)]
    return float(along.min()), float(along[0]), float(along[-1])


@functools.lru_cache(MOST_MAPS)
def _distance_m(map_file: FileContent) -> NDArray[np.float64]:
    """Distance (H, W) from cells' centers to the near side of the nearest wall's cell; infinite without walls."""
    from scipy import ndimage

    occupancy = read_grid(map_file)
    if not occupancy.occupied.any():
        return np.full(occupancy.shape, math.inf)
    cells = ndimage.distance_transform_edt(~occupancy.occupied)
    return np.asarray(np.maximum(cells - 0.5, 0.0) * occupancy.resolution_m)


def _density(partial: Partial) -> float:
    length_m = _path(partial)[1]
    if length_m <= 0.0:
        raise NotEvaluable("the path has no length")
    return sum(1 for _ in partial.obstacles()) / length_m


def _straight_m(partial: Partial) -> float:
    points: Any = partial.values[PATH_KEY] if PATH_KEY in partial.values else _stops(partial)
    return dist(points[0], points[-1])


QUANTITIES: Final[Mapping[str, Callable[[Partial], int | float]]] = {
    "path_length": lambda partial: _path(partial)[1],
    "narrowest_passage": lambda partial: 2.0 * _clearances(partial)[0],
    "clearance": lambda partial: _clearances(partial)[0],
    "start_clearance": lambda partial: _clearances(partial)[1],
    "goal_clearance": lambda partial: _clearances(partial)[2],
    "obstacle_density": _density,
    "number_of_obstacles": lambda partial: sum(1 for _ in partial.obstacles()),
    "number_of_goals": lambda partial: len(_goals(partial)),
    "straight_distance": _straight_m,
}
"""Lengths and distances in meters; `obstacle_density` per meter of path."""
OF_OBSTACLES: Final = ("obstacle_density", "number_of_obstacles")


def may_write_for(name: str, producer: Producer[Any]) -> bool:
    """Whether the quantity `name` can depend on a producer's keys."""
    return any(
        (name in OF_OBSTACLES and may_list_obstacles(key, tag))
        or (key == WORLD_KEY and MAP_KEY not in producer.reads)  # worlds of files
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


def _map(partial: Partial) -> FileContent:
    found = ground_file(partial.values)
    if found is None:
        raise NotEvaluable(f"the configuration has no {MAP_KEY}")
    return found


def _goals(partial: Partial) -> tuple[Pose, ...]:
    return given_goals(partial.values, GOALS_KEY) or given_goals(partial.values, GOAL_KEY)


def _stops(partial: Partial) -> Points:
    start, goals = given_start(partial.values, START_KEY), _goals(partial)
    if start is None or not goals:
        raise NotEvaluable(f"the configuration has no path: no {START_KEY} with {GOAL_KEY} or {GOALS_KEY}")
    return tuple((pose.x_m, pose.y_m) for pose in (start, *goals))
