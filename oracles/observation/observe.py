"""Observation: derived signals of a recording in whole millimeters, and its reference path; `trace_of` joins both."""

import functools
import itertools
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

from vastflow.oracles.observation.obstacle_tracks import ObstacleTrack, obstacle_tracks_of
from vastflow.oracles.observation.situation import Situation, situation_of
from vastflow.oracles.observation.trace import (
    NOWHERE_MM,
    MaybeReference,
    NoReference,
    Reference,
    levelled,
    reference_row,
    signals_of,
)
from vastflow.sim.model.blocks import read_recordings, write_block
from vastflow.sim.model.elementary import atan2s, hypots
from vastflow.sim.model.obstacle import Obstacle
from vastflow.sim.model.recording import Recording, si
from vastflow.sim.model.scenario import Scenario
from vastflow.sim.system.system import system_of
from vastflow.sim.world import bodies
from vastflow.sim.world.environment import world_of
from vastflow.sim.world.occupancy import OccupancyMap
from vastflow.sim.world.octile import inflated_free, shortest_path


def reference_path(occupancy: OccupancyMap | None, situation: Situation, radius_m: float) -> MaybeReference:
    """The A* reference of the paper: shortest octile path through start and goals, loops repeated.

    Cells that are not free or whose center lies in an obstacle are blocked, and inflated by `radius_m`. A start or goal on a
    blocked cell is moved to the nearest passable cell within `radius_m`. The path's ends are cell centers.
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
    """Whether the center of each cell (H, W) is in an obstacle."""
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
    """Center of the nearest passable cell within `within_m`, the pose's own first."""
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
    distances = hypots(*(np.array(centers) - (x_m, y_m)).T)
    nearest = int(np.argmin(distances))
    return centers[nearest] if distances[nearest] <= within_m else None


def _corners(points: NDArray[np.float64]) -> NDArray[np.float64]:
    points_mm = np.rint(points * 1000.0)
    moves = np.any(np.diff(points_mm, axis=0) != 0, axis=1)
    points, points_mm = points[np.r_[True, moves]], points_mm[np.r_[True, moves]]
    if len(points) < 3:
        return np.asarray(points_mm * 1e-3)
    steps = np.diff(points, axis=0)
    headings = np.round(atan2s(steps[:, 1], steps[:, 0]), 6)
    turns = headings[1:] != headings[:-1]
    return np.asarray(points_mm[np.r_[True, turns, True]] * 1e-3)


_CANDIDATES: Final = 9
"""Cells examined for the nearest wall; the error is at most a fifth of a cell."""

STANDING_MPS: Final = 0.01
STANDING_RADPS: Final = 0.01
"""A robot slower than both stands."""


PERSONAL_M: Final = 1.2
"""Outer end of the personal distance of people (Hall, The Hidden Dimension, 1966)."""

_OF_ESTIMATES: Final = ("stopped", "deviation_mm")
"""Derived columns that a robot's estimate of its pose has; it says nothing of what is near."""


class ScenarioObserver:
    """Observer of the runs of a scenario; its reference paths keep the inscribed radius, by default 0.22 m.

    Raises:
        ValueError: mission, map, world, an obstacle, or the robot's radius can't be read, or the map has changed since the campaign was read.
    """

    def __init__(self, scenario: Scenario) -> None:
        self.situation = situation = situation_of(scenario)
        world = world_of(scenario.environment)
        occupancy = None if world is None else world.ground
        radius_m = system_of(scenario.system).inscribed_radius_m

        @functools.cache
        def references(obstacles: tuple[Obstacle, ...]) -> MaybeReference:
            return reference_path(occupancy, replace(situation, obstacles=obstacles), radius_m)

        self.references = references
        # The actual walls, and the centers of occupied cells at their surface, in cells (row, column).
        self._walls = None if world is None else world.walls
        self._bodies = None if world is None else world.bodies
        self._wall_cells: cKDTree | None = None
        if self._walls is not None:
            occupied = self._walls.occupied
            cells = np.argwhere(occupied & ~ndimage.binary_erosion(occupied))
            self._wall_cells = cKDTree(cells) if len(cells) else None

    def observed(self, recording: Recording) -> tuple[MaybeReference, dict[str, NDArray[np.int32]]]:
        """The reference path around the obstacles of one run, and its derived columns (N,).

        `localization_error_mm`: distance between estimated and true position. `stopped`: 1 where the robot stands.
        `wall_clearance_mm`: distance of the robot's center to the nearest occupied cell, 0 inside one. `deviation_mm`: to the
        reference path. `separation_mm/<size class>`: to the nearest obstacle's center; of a mover `separation_mm/<name>`. `static_clearance_mm`,
        `appearing_clearance_mm`, and `moving_clearance_mm`: to the nearest outline of obstacles that stand there from the start, of
        others, and of movers. With movers, `time_to_collision_ms` and `personal_space_intrusions`, see `encounters`. All distances are `NOWHERE_MM` without an object. Where the pose is the robot's own estimate, there are neither
        errors nor distances to anything.

        Raises:
            ValueError: an event of an obstacle that the scenario does not have.
        """
        if not recording.columns:
            return NoReference("the scenario has no robot"), {}
        obstacles = obstacle_tracks_of(self.situation, recording.run, signals_of(recording.columns))
        reference = self.references(tuple(track.obstacle for track in obstacles if track.was_there and not track.moves))
        x_m, y_m = si(recording.columns["x_mm"]), si(recording.columns["y_mm"])
        estimated_x_m, estimated_y_m = si(recording.columns["estimated_x_mm"]), si(recording.columns["estimated_y_mm"])
        derived = {"localization_error_mm": _mm(hypots(estimated_x_m - x_m, estimated_y_m - y_m))}
        slow = np.abs(si(recording.columns["speed_mmps"])) < STANDING_MPS
        if "lateral_speed_mmps" in recording.columns:
            slow &= np.abs(si(recording.columns["lateral_speed_mmps"])) < STANDING_MPS
        slow &= np.abs(si(recording.columns["yaw_rate_mradps"])) < STANDING_RADPS
        derived["stopped"] = slow.astype(np.int32)
        if self._bodies:
            derived["wall_clearance_mm"] = _mm(bodies.distances_to(self._bodies, np.column_stack((x_m, y_m))))
        elif self._walls is not None and self._wall_cells is not None:
            derived["wall_clearance_mm"] = _mm(_clearance_m(self._walls, self._wall_cells, x_m, y_m))
        derived["deviation_mm"] = np.full(len(x_m), NOWHERE_MM, dtype=np.int32)  # runs of a block have the same columns
        if isinstance(reference, Reference):
            corners = reference.points_xy_m
            path = shapely.linestrings(corners) if len(corners) > 1 else shapely.points(corners[0])
            derived["deviation_mm"] = _mm(shapely.distance(path, shapely.points(x_m, y_m)))
        t_ms, xy_m = recording.columns["t_ms"], np.column_stack((x_m, y_m))
        derived |= distances_to(obstacles, t_ms, xy_m)
        derived |= encounters(obstacles, t_ms, xy_m, self.situation.circumscribed_radius_m)
        if recording.run.estimated_by:
            derived = {name: derived[name] for name in _OF_ESTIMATES}
        return reference, derived


def observe_block(scenario: Scenario, recording_block: bytes) -> bytes:
    """Observe a block of recordings of `scenario` as a block of derived columns."""
    observer = ScenarioObserver(scenario)
    recordings = read_recordings(recording_block)
    observed = [observer.observed(recording) for recording in recordings]
    rows: list[dict[str, Any]] = [
        {"run_index": recording.run.run_index, **reference_row(reference)}
        for recording, (reference, _) in zip(recordings, observed, strict=True)
    ]
    return write_block(rows, levelled([columns for _, columns in observed]))


def distances_to(
    obstacles: Sequence[ObstacleTrack], t_ms: NDArray[np.int32], xy_m: NDArray[np.float64]
) -> dict[str, NDArray[np.int32]]:
    """Clearances and separations of the robot's center (N, 2), least over the obstacles of each kind and size class."""
    apart_m: dict[str, list[NDArray[np.float64]]] = {}
    for track in obstacles:
        kind = "moving" if track.moves else "static" if track.was_there and track.appears_s is None else "appearing"
        apart_m.setdefault(f"{kind}_clearance_mm", []).append(track.clearance_m(t_ms, xy_m))
        centers_m = hypots(*(xy_m - track.at(t_ms)).T)
        apart_m.setdefault(f"separation_mm/{track.group}", []).append(centers_m)
    return {name: _mm(np.min(apart_m[name], axis=0)) for name in sorted(apart_m, key=lambda name: ("/" in name, name))}


def encounters(
    obstacles: Sequence[ObstacleTrack], t_ms: NDArray[np.int32], xy_m: NDArray[np.float64], radius_m: float
) -> dict[str, NDArray[np.int32]]:
    """Columns (N,) of a robot's encounters with movers; none without movers.

    `time_to_collision_ms`: least time until the discs about robot and mover touch if neither changes its velocity, that since the row
    before; `NOWHERE_MM` where they don't. `personal_space_intrusions`: number of movers whose outline is within `PERSONAL_M` of the
    robot's disc.
    """
    movers = [track for track in obstacles if track.moves]
    if not movers:
        return {}
    steps_s = np.maximum(np.diff(t_ms), 1) * 1e-3
    soonest_s, intrusions = np.full(len(t_ms), np.inf), np.zeros(len(t_ms), dtype=np.int32)
    for track in movers:
        apart = track.at(t_ms) - xy_m
        closing = np.zeros_like(apart)
        closing[1:] = np.diff(apart, axis=0) / steps_s[:, None]
        a, b, c = (closing * closing).sum(axis=1), (apart * closing).sum(axis=1), (apart * apart).sum(axis=1)
        touching_m = radius_m + track.obstacle.shape.circumradius_m
        c -= touching_m * touching_m
        root = np.sqrt(np.maximum(b * b - a * c, 0.0))
        meets = (b < 0.0) & (b * b >= a * c)
        time_s = np.where(c <= 0.0, 0.0, np.where(meets, (-b - root) / np.where(meets, a, 1.0), np.inf))
        soonest_s = np.minimum(soonest_s, time_s)
        intrusions += track.clearance_m(t_ms, xy_m) - radius_m < PERSONAL_M
    return {"time_to_collision_ms": _mm(soonest_s), "personal_space_intrusions": intrusions}


def _clearance_m(
    occupancy: OccupancyMap, wall_cells: cKDTree, x_m: NDArray[np.float64], y_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Distances (N,) to the square of the nearest occupied cell."""
    at = occupancy.in_cells(np.column_stack((x_m, y_m)))
    candidates = min(_CANDIDATES, wall_cells.n)
    _, nearest = wall_cells.query(at - 0.5, k=candidates)
    centers = wall_cells.data[np.reshape(nearest, (len(at), candidates))] + 0.5
    beyond = np.maximum(np.abs(centers - at[:, None, :]) - 0.5, 0.0)
    clearance = hypots(beyond[..., 0], beyond[..., 1]).min(axis=1)
    rows, columns = np.floor(at).astype(int).T
    on_grid = (rows >= 0) & (columns >= 0) & (rows < occupancy.shape[0]) & (columns < occupancy.shape[1])
    inside = np.zeros(len(at), dtype=np.bool_)
    inside[on_grid] = occupancy.occupied[rows[on_grid], columns[on_grid]]
    return np.where(inside, 0.0, clearance * occupancy.resolution_m)


def _mm(meters: NDArray[np.float64]) -> NDArray[np.int32]:
    return np.rint(np.minimum(meters * 1000.0, NOWHERE_MM)).astype(np.int32)
