"""Routes of promised length, drawn constructively: from the places that are that far away.

A route is a start and one goal or several, joined by shortest paths of the 8-connected grid. Each of n legs
takes an equal share of the length and of the tolerance: then the path back is always a leg of the right
length, so that a route which has its first leg never runs into a dead end.
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vastflow.producers.places.ground import Ground
from vastflow.sim.model.elementary import hypots

Cell = tuple[int, int]

MAX_STARTS: Final = 200
"""Starts without a goal after which a request is given up, where it could not be proved infeasible before."""

ROUNDING_M: Final = 1e-9
"""Tolerance of comparisons of lengths, so that 207 cells of 0.05 m are 10.35 m."""
FIELD_ERROR_M: Final = 0.005
"""Bound on the single-precision error of a distance field over 1 km."""


@dataclass(frozen=True, slots=True)
class Leg:
    """A shortest path between two stops.

    Attributes:
        cells: (N, 2) row and column from one stop to the other, both included.
    """

    cells: NDArray[np.int64]
    length_m: float

    @property
    def start(self) -> Cell:
        """The cell where it begins."""
        return int(self.cells[0, 0]), int(self.cells[0, 1])

    @property
    def end(self) -> Cell:
        return int(self.cells[-1, 0]), int(self.cells[-1, 1])

    def reversed(self) -> "Leg":
        """The same path from its end."""
        return Leg(self.cells[::-1], self.length_m)


@dataclass(frozen=True, slots=True)
class LegRequest:
    """The requirements of each leg: octile length `length_m` ± `tolerance_m`, and least straight distance of its ends."""

    length_m: float
    tolerance_m: float
    min_distance_m: float

    def admits(self, length_m: float) -> bool:
        """Whether a path of this length will do."""
        return abs(length_m - self.length_m) <= self.tolerance_m + ROUNDING_M


def leg_of(ground: Ground, cells: NDArray[np.int64]) -> Leg:
    """The leg along adjacent cells (N, 2), its length without the rounding of distance fields."""
    diagonal = int(np.count_nonzero(np.abs(np.diff(cells, axis=0)).sum(axis=1) == 2))
    straight = len(cells) - 1 - diagonal
    return Leg(cells, (straight + diagonal * math.sqrt(2.0)) * ground.occupancy.resolution_m)


def corners(cells: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the cells (M, 2) of a path (N, 2) where it begins, turns and ends."""
    steps = np.diff(cells, axis=0)
    turns = np.any(steps[1:] != steps[:-1], axis=1)
    return cells[np.concatenate(([True], turns, [True]))] if len(cells) > 1 else cells


def shortest_leg(ground: Ground, start: Cell, end: Cell) -> Leg | None:
    """The shortest leg between two passable cells; None where they are not connected."""
    from vastflow.sim.world import octile

    field = octile.distance_field(ground.passable, *end)
    return leg_of(ground, octile.descend(field, *start)) if math.isfinite(field[start]) else None


@dataclass(frozen=True, slots=True)
class Reach:
    """The shortest paths from a cell that are no longer than a limit.

    Attributes:
        corner: The cell of the map that is (0, 0) of `field`.
        field: Distance in cells (h, w) from the start in the part of the map that the paths can be in.
    """

    ground: Ground
    start: Cell
    corner: Cell
    field: NDArray[np.float32]

    def lengths_m(self, cells: NDArray[np.int64]) -> NDArray[np.float64]:
        """Lengths (N,) of the paths to `cells` (N, 2), to `FIELD_ERROR_M`; infinite beyond the limit."""
        local = cells - self.corner
        inside = np.all((local >= 0) & (local < self.field.shape), axis=1)
        lengths = np.full(len(cells), np.inf)
        lengths[inside] = self.field[tuple(local[inside].T)]
        return lengths * self.ground.occupancy.resolution_m

    def around(self, length_m: float, error_m: float) -> NDArray[np.int64]:
        """The cells (N, 2) at a path length of `length_m` ± `error_m`, in row-major order."""
        resolution_m = np.float64(self.ground.occupancy.resolution_m)
        # In single precision first, with a cell to spare: it is the whole field.
        near = np.argwhere(np.abs(self.field - np.float32(length_m / resolution_m)) <= error_m / resolution_m + 1.0)
        exact = np.abs(self.field[tuple(near.T)] * resolution_m - length_m) <= error_m
        return np.asarray(near[exact] + self.corner)

    def leg_to(self, end: Cell) -> Leg:
        """The leg to a cell that is reached."""
        from vastflow.sim.world import octile

        path = octile.descend(self.field, end[0] - self.corner[0], end[1] - self.corner[1])[::-1]
        return leg_of(self.ground, path + np.array(self.corner))


def reach_of(ground: Ground, start: Cell, limit_m: float) -> Reach:
    """The shortest paths of at most `limit_m` from a passable cell."""
    from vastflow.sim.world import octile

    limit_cells = max(limit_m + 2 * FIELD_ERROR_M, 0.0) / ground.occupancy.resolution_m
    # A path does not leave the square of its length round the start, so no more than that is looked at.
    side = math.ceil(min(limit_cells, sum(ground.passable.shape))) + 1
    top, left = max(start[0] - side, 0), max(start[1] - side, 0)
    window = ground.passable[top : start[0] + side + 1, left : start[1] + side + 1]
    field = octile.distance_field(window, start[0] - top, start[1] - left, limit_cells)
    return Reach(ground, start, (top, left), field)


def draw_leg(ground: Ground, start: Cell, request: LegRequest, rng: np.random.Generator) -> Leg | None:
    """A leg from `start` to a stop drawn uniformly from those that `request` admits, or None.

    Draws from `rng` only where there are some.
    """
    reach = reach_of(ground, start, request.length_m + request.tolerance_m)
    ends = reach.around(request.length_m, request.tolerance_m + FIELD_ERROR_M)
    straight_m = hypots(*(ends - start).T) * ground.occupancy.resolution_m
    ends = ends[straight_m >= request.min_distance_m - ROUNDING_M]
    for i in rng.permutation(len(ends)) if len(ends) else ():
        if not ground.stops[ends[i, 0], ends[i, 1]]:
            continue
        leg = reach.leg_to((int(ends[i, 0]), int(ends[i, 1])))
        if request.admits(leg.length_m):
            return leg
    return None


def draw_legs(ground: Ground, start: Cell, n: int, request: LegRequest, rng: np.random.Generator) -> list[Leg] | None:
    """`n` legs, each from the end of the one before; None where `start` has no first leg."""
    legs: list[Leg] = []
    for _ in range(n):
        leg = draw_leg(ground, legs[-1].end if legs else start, request, rng)
        # The path back is missed only if rounding puts it just outside the request.
        leg = leg or (legs[-1].reversed() if legs else None)
        if leg is None:
            return None
        legs.append(leg)
    return legs


def farthest_m(ground: Ground, start: Cell) -> float:
    """Length (m) of the longest shortest path from `start`."""
    field = reach_of(ground, start, math.inf).field
    return float(np.max(field, where=np.isfinite(field), initial=0.0)) * ground.occupancy.resolution_m


class StartSearch:
    """Draws routes with starts uniform over all cells that have a goal at the requested distance.

    Cells proved to have none are remembered, for the next route of the same request. They are only ever
    skipped, so what is drawn does not depend on what was learnt before. The proof: let `slack(x)` be how
    far goal x misses the request from start v, in length or in straight distance, and w a cell at geodesic
    distance d from v. Both measures change by at most d from v to w, so w has no goal where d < min slack.

    Attributes:
        longest_m: Length of the longest shortest path seen where a start failed.
        gave_up: Whether `MAX_STARTS` starts failed and some cells are left that might not.
    """

    def __init__(self, ground: Ground, n_legs: int, request: LegRequest) -> None:
        self.longest_m = 0.0
        self.gave_up = False
        self._ground = ground
        self._n_legs = n_legs
        self._request = request
        self._failed = 0
        self._scouted: set[int] = set()
        longest_path_m = (ground.component_cells - 1) * math.sqrt(2.0) * ground.occupancy.resolution_m
        self._stops = ground.stops[ground.cells[:, 0], ground.cells[:, 1]]
        self._possible = self._stops & (longest_path_m >= request.length_m - request.tolerance_m - ROUNDING_M)

    def draw(self, rng: np.random.Generator) -> list[Leg] | None:
        """The legs of a route; None if none exists, or none was found (`gave_up`)."""
        order = rng.permutation(len(self._possible))
        at, size = 0, 64  # most starts are possible as a rule, and a gather over a large map takes as long as a leg
        while at < len(order) and not self.gave_up:
            found = np.flatnonzero(self._possible[order[at : at + size]])
            if not found.size:
                at, size = at + size, 4 * size
                continue
            at, size = at + int(found[0]), 64
            legs = draw_legs(self._ground, self._cell(order[at]), self._n_legs, self._request, rng)
            if legs is not None:
                return legs
            self._learn(int(order[at]))
            self.gave_up = self._failed >= MAX_STARTS and bool(self._possible.any())
        return None

    def _learn(self, start: int) -> None:
        distance_m = self._exclude_round(start)
        self._possible[start] = False
        self._failed += 1
        component = int(self._ground.component[start])
        if component not in self._scouted:
            # From both ends and the middle of a component most is proved, and its extent seen.
            self._scouted.add(component)
            from_end_m = self._exclude_round(_farthest(distance_m))
            from_other_m = self._exclude_round(_farthest(from_end_m))
            self._exclude_round(int(np.argmin(np.maximum(from_end_m, from_other_m))))

    def _exclude_round(self, start: int) -> NDArray[np.float64]:
        """Drop the starts that can be proved to have no goal from what `start` sees; its distances (N,) in m."""
        ground, request = self._ground, self._request
        resolution_m = ground.occupancy.resolution_m
        rows, columns = ground.cells[:, 0], ground.cells[:, 1]
        row, column = self._cell(start)
        distance_m = reach_of(ground, (row, column), math.inf).lengths_m(ground.cells)
        straight_m = hypots(rows - row, columns - column) * resolution_m
        slack_m = np.maximum(
            np.abs(distance_m - request.length_m) - request.tolerance_m, request.min_distance_m - straight_m
        )
        self._possible &= ~(distance_m < slack_m.min(where=self._stops, initial=math.inf) - FIELD_ERROR_M)
        self.longest_m = max(self.longest_m, float(distance_m[np.isfinite(distance_m)].max()))
        return distance_m

    def _cell(self, index: int) -> Cell:
        return int(self._ground.cells[index, 0]), int(self._ground.cells[index, 1])


def _farthest(distance_m: NDArray[np.float64]) -> int:
    return int(np.argmax(np.where(np.isfinite(distance_m), distance_m, -1.0)))
