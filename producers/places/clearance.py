"""The surroundings of a path: narrowest passage, clearance at its ends, turning, obstacles near it."""

import functools
import itertools
from collections.abc import Sequence
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray
from shapely.geometry import LineString

from vastflow.producers.places.ground import Ground, touched_cells
from vastflow.producers.places.placement import Site, around
from vastflow.producers.places.route import corners
from vastflow.sim.model.digest import Value
from vastflow.sim.model.elementary import atan2s, hypots
from vastflow.sim.model.obstacle import Obstacle
from vastflow.sim.world.occupancy import OccupancyMap

NARROWEST_KEY: Final = "_narrowest_passage_m"
START_CLEARANCE_KEY: Final = "_start_clearance_m"
GOAL_CLEARANCE_KEY: Final = "_goal_clearance_m"
TURNING_KEY: Final = "_turning_rad"
NEAR_KEY: Final = "_obstacles_near_path"

NEAR_M: Final = 1.0
"""Distance of an obstacle's outline from the path up to which it stands by it."""
_FACING: Final = -0.5
_CORNER: Final = 0.5
"""Cosines of the angles at which two nearest points are seen: opposite within 60°, or at least 60° apart."""
_CLOSER_CELLS: Final = 1.0
_EVERY: Final = 2
"""Step between the path's cells that are examined: posts of a door are found from a quarter of its width away."""
_OF_A_CELL: Final = 0.5

Cells = NDArray[np.int64]
Clearance: TypeAlias = tuple[NDArray[np.float64], NDArray[np.int32]]
"""The distance (H, W) from each cell to the nearest one that is not free, in cells between centers; row and column (2, H, W) of that."""


def clearance_of(free: NDArray[np.bool_]) -> Clearance:
    """The clearance of free cells (H, W); cells outside of the grid are not free."""
    from scipy import ndimage

    distance, nearest = ndimage.distance_transform_edt(np.pad(free, 1, constant_values=False), return_indices=True)
    return distance[1:-1, 1:-1], nearest[:, 1:-1, 1:-1] - 1


@functools.lru_cache(maxsize=4)
def _clearance_on(occupancy: OccupancyMap) -> Clearance:
    return clearance_of(occupancy.free)


def path_properties(
    ground: Ground, cells: Cells, stops: Sequence[int], obstacles: Sequence[Obstacle] = ()
) -> dict[str, Value]:
    """The provenance of what surrounds a path; numbers to the millimeter.

    Args:
        cells: (N, 2) row and column along the path, from cell to neighbor.
        stops: Indices into them of the start and the goals.
        obstacles: All that stand there or will appear.
    """
    occupancy = ground.occupancy
    free = occupancy.free.copy() if obstacles else occupancy.free
    for obstacle in obstacles:
        free[tuple(touched_cells(occupancy, obstacle.footprint(), 0.0).T)] = False
    clearance = clearance_of(free) if obstacles else _clearance_on(occupancy)
    room_m = (clearance[0][tuple(cells[list(stops)].T)] - _OF_A_CELL) * occupancy.resolution_m
    narrowest = narrowest_passage_cells(clearance, cells)
    turns = corners(cells)
    path = LineString(occupancy.centers_of(turns if len(turns) > 1 else np.repeat(turns, 2, axis=0)))
    passable = clearance[0] > ground.radius_cells if obstacles else ground.passable
    return {
        START_CLEARANCE_KEY: round(float(room_m[0]), 3),
        GOAL_CLEARANCE_KEY: round(float(room_m[1:].min()), 3),
        TURNING_KEY: round(turning_rad(turns, passable), 3),
        NEAR_KEY: sum(path.distance(obstacle.footprint()) <= NEAR_M for obstacle in obstacles),
        NARROWEST_KEY: None if narrowest is None else round(narrowest * occupancy.resolution_m, 3),
    }


def shortest_path_properties(site: Site, obstacles: Sequence[Obstacle]) -> dict[str, Value]:
    """Return `path_properties` of the shortest path round all obstacles; without a path each value is None."""
    from vastflow.sim.world import octile

    occupancy = site.ground.occupancy
    everything = (*site.standing, *obstacles)
    path = octile.shortest_path(occupancy, around(site.ground, everything), np.array(site.stops_xy_m))
    if path is None:
        return dict.fromkeys((NARROWEST_KEY, START_CLEARANCE_KEY, GOAL_CLEARANCE_KEY, TURNING_KEY, NEAR_KEY))
    cells = np.floor(occupancy.in_cells(path[0])).astype(np.int64)
    stops = [0]
    for stop in site.stops_xy_m[1:]:
        reached = np.flatnonzero((cells[stops[-1] :] == occupancy.cell_of(*stop)).all(axis=1))
        stops.append(stops[-1] + int(reached[0]))
    return path_properties(site.ground, cells, stops, everything)


def narrowest_passage_cells(clearance: Clearance, cells: Cells) -> float | None:
    """Width of the narrowest passage that a path (N, 2) leads through, in cells; None where it leads between nothing.

    From each cell of the path one goes straight off the nearest obstacle, onto the medial axis of the free space: there another
    one comes as near. Where the two are seen in opposite directions they face each other, and their distance is the width of a
    passage; in a corner they are not, which is how spurs of a medial axis are told from its trunk (the object angle of Attali and
    Montanvert, Computer Vision and Image Understanding 67 (1997) 261).
    """
    distance, nearest = clearance
    cells = cells[::_EVERY]
    here = cells.astype(np.float64)
    first = nearest[:, cells[:, 0], cells[:, 1]].T.astype(np.float64)
    away = here - first
    away /= np.maximum(hypots(away[:, 0], away[:, 1]), 1.0)[:, None]
    width = np.inf
    for step in itertools.count(1):
        at = np.rint(here + step * away).astype(np.int64)
        inside = ((at >= 0) & (at < distance.shape)).all(axis=1)
        here, first, away, at = here[inside], first[inside], away[inside], at[inside]
        if not len(here):
            break
        other = nearest[:, at[:, 0], at[:, 1]].T.astype(np.float64)
        to_first, to_other = first - at, other - at
        far, near = hypots(*to_first.T), hypots(*to_other.T)
        cosine = np.where(near > 0, (to_first * to_other).sum(axis=1) / np.maximum(far * near, 1.0), -1.0)
        met = (near < far - _CLOSER_CELLS) & (cosine < _CORNER)
        facing = met & (cosine <= _FACING)
        if facing.any():
            width = min(width, float(hypots(*(first - other)[facing].T).min()) - 2 * _OF_A_CELL)
        # What faces each other is farther apart than either is from here.
        going = ~met & (far <= width + 2 * _OF_A_CELL)
        here, first, away = here[going], first[going], away[going]
    return width if np.isfinite(width) else None


def turning_rad(cells: Cells, passable: NDArray[np.bool_]) -> float:
    """Return the sum of a path's changes of direction (rad) once it is pulled taut.

    The path is given by its corners (N, 2) and stays within `passable` (H, W): the grid's own steps are no turns.
    """
    legs = np.diff(taut(cells, passable), axis=0)
    headings = atan2s(legs[:, 0], legs[:, 1])[np.any(legs != 0, axis=1)]
    turns = np.diff(headings)
    return float(np.abs((turns + np.pi) % (2 * np.pi) - np.pi).sum())


def taut(cells: Cells, passable: NDArray[np.bool_]) -> Cells:
    """Return the corners (M, 2) of a path with corners (N, 2) that is pulled taut within `passable` (H, W)."""
    kept = [cells[0]]
    for k in range(2, len(cells)):
        straight = np.linspace(kept[-1], cells[k], 2 * int(np.abs(cells[k] - kept[-1]).max()) + 1)
        if not passable[tuple(np.rint(straight).astype(np.int64).T)].all():
            kept.append(cells[k - 1])
    return np.array([*kept, cells[-1]])
