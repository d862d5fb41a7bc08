"""The producer of starts and goals on the points of a raster, at a requested path length."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vastflow.producers.catalog.path import LengthParameters, PathProducer, center_m, legs_text, length_text
from vastflow.producers.model.configuration import REQUESTED, Fragment, Rejection
from vastflow.producers.model.numbers import Goals, Number, Positive
from vastflow.producers.model.producer import ROOM_KEY, Draws
from vastflow.producers.places.ground import Ground, ground_of, map_key, map_of, room_of
from vastflow.producers.places.route import FIELD_ERROR_M, Cell, Leg, LegRequest, Reach, reach_of
from vastflow.producers.places.stops import GOAL_KEY, GOALS_KEY, given_start, start_key
from vastflow.sim.model.digest import Value
from vastflow.sim.model.pose import Pose

MAX_POINTS: Final = 5000
"""Points of a raster that is still a raster: of more, the pairs are tens of millions."""
ROUNDING_CELLS: Final = 1e-6
"""Tolerance of a raster point's place, so that three times 0.1 m is the sixth cell of 0.05 m."""


class RasterParameters(LengthParameters):
    """Parameters of `PathVariationRasterized`."""

    num_goal_poses: Goals = 1
    """Number of goals on the path."""
    raster_size: Positive
    """Spacing of the raster's points (m)."""
    raster_offset_x: Number = 0.0
    """Offset of the raster from the map's lower left corner along x (m)."""
    raster_offset_y: Number = 0.0
    """Offset of the raster from the map's lower left corner along y (m)."""


class PathVariationRasterized(PathProducer[RasterParameters]):
    """All ordered pairs of raster points at the requested path length, as start and goal with yaw 0.

    A point is the cell of the map it lies in, where the robot can stand. With several goals there is one path from each
    start: each leg takes an equal share of the length and of the tolerance, and leads to the first point of the
    raster that it can, to one that was not passed yet where there is one. A start that is given already is kept
    and is the only one.
    """

    Parameters = RasterParameters

    @property
    def reads(self) -> tuple[str, ...]:
        return map_key(self.parameters.map_file), ROOM_KEY, start_key(self.parameters.start_pose)

    @property
    def goals_key(self) -> str:
        return GOAL_KEY if self.parameters.num_goal_poses == 1 else GOALS_KEY

    def produce(self, inputs: Mapping[str, Value], draws: Draws) -> Iterator[Fragment | Rejection]:
        """Yield the paths of each length in turn, by start and then by goal in the raster's order.

        One rejection for each length counts the pairs, or starts, that it leaves out. Draws nothing.
        """
        asked = self.parameters
        requests: list[dict[str, Value]] = [
            {"path_length": m, "num_goal_poses": asked.num_goal_poses} for m in asked.path_length
        ]
        try:
            start, map_file = given_start(inputs, asked.start_pose), map_of(inputs, asked.map_file)
        except ValueError as error:
            yield from (Rejection(str(error), requested) for requested in requests)
            return
        ground = ground_of(map_file, asked.robot_diameter, room_of(inputs))
        raster = self._raster(ground, start)
        if isinstance(raster, str):
            yield from (Rejection(raster, requested) for requested in requests)
            return
        n_goals = asked.num_goal_poses
        shares = [LegRequest(m / n_goals, asked.path_length_tolerance / n_goals, 0.0) for m in asked.path_length]
        legs = raster.legs(shares, n_goals)
        for requested, share in zip(requests, shares, strict=True):
            paths = [path for cell in raster.starts for path in _paths(legs[share], cell, n_goals)]
            for path in paths:
                begin, *goals = (Pose(*center_m(ground, cell)) for cell in (path[0].start, *(leg.end for leg in path)))
                values = self._values(inputs, ground, start or begin, goals, path)
                yield Fragment({**values, REQUESTED + self.goals_key: requested})
            if reason := raster.left_out(share, n_goals, len(paths)):
                yield Rejection(reason, requested)

    def _raster(self, ground: Ground, start: Pose | None) -> "_Raster | str":
        asked = self.parameters
        if start is not None and not ground.stands(start.x_m, start.y_m):
            return f"the given start ({start.x_m:g}, {start.y_m:g}) is no place for {ground.robot_text}"
        points = raster_points(ground, asked.raster_size, asked.raster_offset_x, asked.raster_offset_y)
        raster = _Raster(ground, points, None if start is None else ground.occupancy.cell_of(start.x_m, start.y_m))
        if raster.n_others < 1 or len(points) > MAX_POINTS:
            bound = f"at most {MAX_POINTS}" if len(points) > MAX_POINTS else "too few for a path"
            return f"a raster of {asked.raster_size:g} m has {len(points)} points for {ground.stopping_robot_text} on this map, {bound}"
        return raster


def raster_points(ground: Ground, size_m: float, offset_x_m: float, offset_y_m: float) -> NDArray[np.int64]:
    """Return row and column (N, 2) of raster points where the robot can stand, by rows from below."""

    def lines(n_cells: int, offset_m: float) -> NDArray[np.int64]:
        resolution_m = ground.occupancy.resolution_m
        if size_m <= resolution_m:
            return np.arange(n_cells)
        at_m = np.arange(offset_m % size_m, n_cells * resolution_m, size_m)
        cells = (at_m / resolution_m + ROUNDING_CELLS).astype(np.int64)
        return np.asarray(cells[cells < n_cells])

    rows, columns = ground.passable.shape
    grid = np.meshgrid(lines(rows, offset_y_m), lines(columns, offset_x_m), indexing="ij")
    points = np.column_stack([axis.ravel() for axis in grid])
    return np.asarray(points[ground.stops[points[:, 0], points[:, 1]]])


@dataclass(frozen=True, slots=True)
class _Raster:
    """The points of a raster, and the start where it is given and none of them."""

    ground: Ground
    points: NDArray[np.int64]
    start: Cell | None

    @property
    def starts(self) -> list[Cell]:
        """The cells where paths may begin."""
        return self._cells() if self.start is None else [self.start]

    @property
    def n_others(self) -> int:
        """Number of other points, seen from a start."""
        return len(self.points) - int(self.start is None or self.start in self._cells())

    def legs(self, requests: Sequence[LegRequest], n_goals: int) -> dict[LegRequest, dict[Cell, list[Leg]]]:
        """The legs that each request admits from every start and stop, in the raster's order of their ends.

        One distance field for each of them, that ends at the greatest length.
        """
        found: dict[LegRequest, dict[Cell, list[Leg]]] = {request: {} for request in requests}
        limit_m = max(request.length_m + request.tolerance_m for request in requests)
        for i, cell in enumerate(self._cells() if self.start is None or n_goals > 1 else ()):
            reach = reach_of(self.ground, cell, limit_m)
            # What leads to an earlier point is the path from there, turned round.
            for request, legs in found.items():
                for leg in _admitted(reach, self.points[i + 1 :], request):
                    legs.setdefault(leg.start, []).append(leg)
                    legs.setdefault(leg.end, []).append(leg.reversed())
        if self.start is not None:
            reach = reach_of(self.ground, self.start, limit_m)
            for request, legs in found.items():
                legs[self.start] = list(_admitted(reach, self.points, request))
        return found

    def left_out(self, request: LegRequest, n_goals: int, n_paths: int) -> str | None:
        """Return the pairs that the request excludes, with the reason, or None."""
        starts, robot = self.starts, self.ground.robot_text
        n_pairs = len(starts) * self.n_others
        n_asked, of = (n_pairs, "pairs") if n_goals == 1 else (len(starts), "starts")
        if n_paths == n_asked:
            return None
        what = f"{legs_text(n_goals)} of {length_text(request.length_m, request.tolerance_m)} for {robot}"
        n_apart = n_pairs - self._n_connected(starts)
        apart = f". {n_apart} of {n_pairs} pairs are not connected" if n_apart else ""
        longest = (
            "" if n_paths else f". The longest shortest path between two of its points is {self._longest_m():.2f} m"
        )
        return f"{n_asked - n_paths} of {n_asked} {of} on the raster have no {what}{apart}{longest}"

    def _cells(self) -> list[Cell]:
        return [(int(row), int(column)) for row, column in self.points]

    def _n_connected(self, starts: Sequence[Cell]) -> int:
        columns = self.ground.passable.shape[1]
        order = self.ground.cells @ (columns, 1)
        of_points = self.ground.component[np.searchsorted(order, self.points @ (columns, 1))]
        of_starts = self.ground.component[np.searchsorted(order, np.array(starts) @ (columns, 1))]
        sizes = np.bincount(of_points, minlength=int(of_starts.max()) + 1)
        return int(sizes[of_starts].sum()) - len(starts) * (len(self.points) - self.n_others)

    def _longest_m(self) -> float:
        lengths = [reach_of(self.ground, cell, math.inf).lengths_m(self.points) for cell in self.starts]
        return float(max(m.max(where=np.isfinite(m), initial=0.0) for m in lengths))


def _admitted(reach: Reach, points: NDArray[np.int64], request: LegRequest) -> Iterator[Leg]:
    misses_m = np.abs(reach.lengths_m(points) - request.length_m)
    for row, column in points[misses_m <= request.tolerance_m + FIELD_ERROR_M]:
        leg = reach.leg_to((int(row), int(column)))
        if request.admits(leg.length_m) and leg.start != leg.end:
            yield leg


def _paths(legs: Mapping[Cell, list[Leg]], start: Cell, n_goals: int) -> list[list[Leg]]:
    """Return the paths from a start: one of each leg, or with several goals one at most.

    A given start off the raster has no path back to it.
    """
    if n_goals == 1:
        return [[leg] for leg in legs.get(start, ())]
    path: list[Leg] = []
    passed = {start}
    for _ in range(n_goals):
        onward = legs.get(path[-1].end if path else start, [])
        if not onward:
            return []
        path.append(next((leg for leg in onward if leg.end not in passed), onward[0]))
        passed.add(path[-1].end)
    return [path]
