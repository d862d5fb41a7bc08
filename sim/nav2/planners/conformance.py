"""The planner's contract, as checks that a planner's author can call in a test."""

import functools
import math
import pickle
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from vastflow.sim.kernels.binding import Bound
from vastflow.sim.kernels.conformance import guarded, least_us, must_at
from vastflow.sim.kernels.numeric import njit
from vastflow.sim.nav2.costmaps.inflation import INSCRIBED, LETHAL, inflate
from vastflow.sim.nav2.costmaps.outline import inscribed_radius_m, outline_of
from vastflow.sim.nav2.parameters.costmap import global_costmap
from vastflow.sim.nav2.planners.binding import RunningPlanner, compute_path, prepared, running
from vastflow.sim.nav2.planners.planner import Planner, PlannerInput, PlannerSetting

MOST_US: Final = 1e6
"""CPU time of a plan that a campaign can bear: as long as the simulated second for which it is made."""

RESOLUTION_M: Final = 0.05
NEAR_M: Final = 0.5
"""Maximum distance of a path's ends from start and goal: the goal tolerance of Nav2's planners."""

_ROWS, _COLUMNS = 120, 160
_ROOM: Final = 4096


@dataclass(frozen=True, slots=True)
class Errand:
    """A start and a goal (x, y, yaw) on a floor with lethal boxes (x0, y0, x1, y1), in meters."""

    name: str
    start: tuple[float, float, float]
    goal: tuple[float, float, float]
    boxes: tuple[tuple[float, float, float, float], ...] = ()
    is_possible: bool = True

    def given(self) -> PlannerInput:
        """Return the planner's input for it."""
        costmap = global_costmap()
        costs = np.zeros((_ROWS, _COLUMNS), dtype=np.uint8)
        costs[[0, -1]], costs[:, [0, -1]] = LETHAL, LETHAL
        for box in self.boxes:
            x0, y0, x1, y1 = (round(at / RESOLUTION_M) for at in box)
            costs[y0:y1, x0:x1] = LETHAL
        outline = outline_of(costmap)
        costs = inflate(costs, RESOLUTION_M, inscribed_radius_m(outline), 0.7, 3.0)
        place = np.array([0.0, 0.0, RESOLUTION_M])
        return PlannerInput(costs, place, outline, self.start, self.goal, np.zeros((_ROOM, 3)))


ERRANDS: Final = (
    Errand("an empty floor", (1.0, 3.0, 0.0), (6.5, 3.0, 0.0)),
    Errand("a wall with a door", (1.0, 1.5, 0.0), (7.0, 1.5, 0.0), ((3.9, 0.0, 4.1, 3.0), (3.9, 4.5, 4.1, 6.0))),
    Errand("a goal right ahead", (2.0, 3.0, 0.0), (2.6, 3.0, 0.0)),
    Errand("a closed wall", (1.0, 3.0, 0.0), (7.0, 3.0, 0.0), ((3.9, 0.0, 4.1, 6.0),), is_possible=False),
)


def check_planner(planner: Planner) -> None:
    """Run all `CHECKS` on `planner`; raise an `AssertionError` with place, actual, and expected behavior."""
    for check in CHECKS:
        check(planner)


def check_paths(planner: Planner) -> None:
    """Check that it compiles, raises nothing, and finds paths through free cells or gives an error code."""
    for errand in ERRANDS:
        given = errand.given()
        n = _planned(_started(planner, given), given)
        if not errand.is_possible:
            _must(n < 0, planner, f"must return minus an error code in {errand.name!r}, got {n}")
            continue
        _must(0 < n <= _ROOM, planner, f"must find a path in {errand.name!r}, got {n}")
        path = given.path[:n]
        _must(np.isfinite(path).all(), planner, f"must give finite poses in {errand.name!r}")
        for where, pose, wanted in (("begin", path[0], errand.start), ("end", path[-1], errand.goal)):
            away_m = math.dist(pose[:2], wanted[:2])
            _must(away_m <= NEAR_M, planner, f"must {where} within {NEAR_M} m, got {away_m:.2f} m in {errand.name!r}")
        dearest = max(int(given.costs[int(y_m / RESOLUTION_M), int(x_m / RESOLUTION_M)]) for x_m, y_m, _ in path)
        _must(dearest < INSCRIBED, planner, f"must keep to free cells, found a cost of {dearest} in {errand.name!r}")


def check_determinism(planner: Planner) -> None:
    """Check that equal memory and situation give a bit-equal path, independent of other planners."""
    given, other = ERRANDS[1].given(), ERRANDS[0].given()
    alone, one = _path(_started(planner, given), given), _started(planner, given)
    _path(_started(planner, other), other)
    right = "must give the same path again. It keeps something outside of its memory."
    _must(alone == _path(one, ERRANDS[1].given()), planner, right)


def check_changes(planner: Planner) -> None:
    """It sees cells that changed since its last call."""
    open_floor, closed = ERRANDS[0].given(), ERRANDS[3].given()
    found = _started(planner, open_floor)
    _planned(found, open_floor)
    open_floor.costs[:] = closed.costs
    n = _planned(found, open_floor._replace(changed=(0, _ROWS, 0, _COLUMNS)))
    _must(n < 0, planner, f"must plan on the costs that it is given, got {n} poses through a wall that is new")


def check_inputs_are_kept(planner: Planner) -> None:
    """It leaves costmap and footprint as they are, and what it prepared: the stack and other missions read them."""
    for errand in ERRANDS:
        given = errand.given()
        setting = _setting(planner, given)
        before = pickle.dumps((given.costs, given.place, given.outline, tuple(setting.prepared)))
        _planned(guarded(planner, "compute_path", lambda setting=setting: running(planner, setting)), given)  # type: ignore[misc]
        kept = before == pickle.dumps((given.costs, given.place, given.outline, tuple(setting.prepared)))
        _must(kept, planner, f"must not change what it is given in {errand.name!r}")


def check_time(planner: Planner, most_us: float = MOST_US) -> None:
    """A plan takes at most `most_us` of CPU time, the fastest of several."""
    for errand in ERRANDS:
        given = errand.given()
        found = _started(planner, given)
        took_us = least_us(lambda found=found, given=given: _planned(found, given))  # type: ignore[misc]
        right = f"must take at most {most_us:g} µs a plan, took {took_us:.0f} in {errand.name!r}"
        _must(took_us <= most_us, planner, right)


CHECKS: Final[tuple[Callable[[Planner], None], ...]] = (
    check_paths,
    check_determinism,
    check_changes,
    check_inputs_are_kept,
    check_time,
)
"""All checks, for a test that is parametrized with them and reports each on its own."""


@njit
def _once(bound: Bound, given: PlannerInput) -> int:
    return compute_path(bound, given)


def _started(planner: Planner, given: PlannerInput) -> RunningPlanner:
    return guarded(planner, "compute_path", lambda: running(planner, _setting(planner, given)))


def _setting(planner: Planner, given: PlannerInput) -> PlannerSetting:
    setting = PlannerSetting(given.costs, given.costs, global_costmap(), RESOLUTION_M, (0.0, 0.0))
    return prepared(planner, setting)


def _planned(found: RunningPlanner, given: PlannerInput) -> int:
    return guarded(found.plug_in, "compute_path", lambda: int(_once(found.bound, given)))


def _path(found: RunningPlanner, given: PlannerInput) -> bytes:
    poses: Any = given.path[: max(_planned(found, given), 0)]
    return bytes(poses.tobytes())


_must = functools.partial(must_at, "compute_path")
