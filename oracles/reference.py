"""The reference path: the shortest path a robot of this size could have gone, had it known the obstacles."""

import itertools

import numpy as np
import shapely
from numpy.typing import NDArray

from vastflow.oracles.situation import Situation
from vastflow.oracles.trace import MaybeReference, NoReference, Reference
from vastflow.sim.model.obstacle import Obstacle
from vastflow.sim.world.occupancy import OccupancyMap
from vastflow.sim.world.octile import inflated_free, shortest_path


def reference_path(occupancy: OccupancyMap | None, situation: Situation, radius_m: float) -> MaybeReference:
    """The A* reference of the paper: shortest octile path through start and goals, loops repeated.

    Cells not known to be free and cells whose center lies in one of the situation's obstacles, at the pose where it stands
    first, are blocked, and inflated by `radius_m`
    (paper: "the environment is inflated by the robot radius before planning"). A start or goal on a
    blocked cell, as drawn for a smaller robot, is taken at the nearest passable cell if that is at most `radius_m`
    away. The path's ends are cell centers, so up to 0.71 cells from the poses.
    """
    if occupancy is None:
        return NoReference("the scenario has no map")
    if situation.start is None or not situation.goals:
        return NoReference("the scenario has no start or no goal")
    free = inflated_free(occupancy.free & ~_covered(occupancy, situation.obstacles), radius_m / occupancy.resolution_m)
    poses = {"start": situation.start, **{f"goal {i}": goal for i, goal in enumerate(situation.goals, 1)}}
    stops: list[tuple[str, tuple[float, float]]] = []
    for name, pose in poses.items():
        stop = _nearest_passable(occupancy, free, pose.x_m, pose.y_m, radius_m)
        if stop is None:
            return NoReference(
                f"{name} at ({pose.x_m:.2f}, {pose.y_m:.2f}) m is more than {radius_m:g} m from any place "
                f"where a robot of radius {radius_m:g} m fits"
            )
        stops.append((name, stop))
    legs: dict[tuple[tuple[float, float], tuple[float, float]], tuple[NDArray[np.float64], float] | None] = {}
    points: list[NDArray[np.float64]] = []
    length_m = 0.0
    for (name, stop), (next_name, next_stop) in itertools.pairwise(stops):
        if (stop, next_stop) not in legs:  # loops repeat legs
            legs[stop, next_stop] = shortest_path(occupancy, free, np.array((stop, next_stop)))
        leg = legs[stop, next_stop]
        if leg is None:
            return NoReference(f"no path for a robot of radius {radius_m:g} m from {name} to {next_name}")
        points.append(leg[0])
        length_m += leg[1]
    return Reference(_corners(np.concatenate(points)), round(length_m, 3))


def _covered(occupancy: OccupancyMap, obstacles: tuple[Obstacle, ...]) -> NDArray[np.bool_]:
    """(H, W), True where a cell's center lies in an obstacle."""
    covered = np.zeros(occupancy.shape, dtype=np.bool_)
    frame, occupancy = occupancy.frame, occupancy.upright
    for obstacle in obstacles:
        footprint = obstacle.in_grid(frame).footprint()
        x0, y0, x1, y1 = footprint.bounds
        row0, column0 = (max(index, 0) for index in occupancy.cell_of(x0, y0))
        row1, column1 = (max(index + 1, 0) for index in occupancy.cell_of(x1, y1))
        window = covered[row0:row1, column0:column1]
        x, y = (np.arange(n) + 0.5 for n in window.shape[::-1])
        x_m = (x + column0) * occupancy.resolution_m + occupancy.origin_xy_m[0]
        y_m = (y + row0) * occupancy.resolution_m + occupancy.origin_xy_m[1]
        window |= shapely.contains_xy(footprint, *np.meshgrid(x_m, y_m))
    return covered


def _nearest_passable(
    occupancy: OccupancyMap, free: NDArray[np.bool_], x_m: float, y_m: float, within_m: float
) -> tuple[float, float] | None:
    """Center of the pose's own cell if that is passable, else of the nearest passable one within `within_m`."""
    row, column = occupancy.cell_of(x_m, y_m)
    if occupancy.contains(row, column) and free[row, column]:
        return occupancy.center_of(row, column)
    reach = int(within_m / occupancy.resolution_m) + 1
    row0, column0 = max(row - reach, 0), max(column - reach, 0)
    window = free[row0 : max(row + reach + 1, 0), column0 : max(column + reach + 1, 0)]
    rows, columns = np.nonzero(window)
    if not rows.size:
        return None
    centers = [occupancy.center_of(int(r) + row0, int(c) + column0) for r, c in zip(rows, columns, strict=True)]
    distances = np.hypot(*(np.array(centers) - (x_m, y_m)).T)
    nearest = int(np.argmin(distances))
    return centers[nearest] if distances[nearest] <= within_m else None


def _corners(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """`points` (N, 2) without repetitions and without those on a straight stretch, to the millimeter."""
    points_mm = np.rint(points * 1000.0)
    moves = np.any(np.diff(points_mm, axis=0) != 0, axis=1)
    points, points_mm = points[np.r_[True, moves]], points_mm[np.r_[True, moves]]
    if len(points) < 3:
        return np.asarray(points_mm * 1e-3)
    steps = np.diff(points, axis=0)
    headings = np.round(np.arctan2(steps[:, 1], steps[:, 0]), 6)
    turns = headings[1:] != headings[:-1]
    return np.asarray(points_mm[np.r_[True, turns, True]] * 1e-3)
