"""The producer of start and goals at a requested path length."""

import itertools
import math
from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final, Self, TypeAlias, TypeVar

import numpy as np
from pydantic import model_validator

from vastflow.producers.model import producer
from vastflow.producers.model.configuration import REQUESTED, Fragment, Rejection
from vastflow.producers.model.numbers import (
    DEFAULT_ROBOT_DIAMETER_M,
    MOST_GOALS,
    Count,
    Goals,
    NotNegative,
    Positive,
    Positives,
    Seed,
)
from vastflow.producers.model.producer import ROOM_KEY, Draws, Producer
from vastflow.producers.places.clearance import path_properties
from vastflow.producers.places.ground import Ground, MapParameter, ground_of, map_key, map_needed, map_of, room_of
from vastflow.producers.places.route import (
    MAX_STARTS,
    Cell,
    Leg,
    LegRequest,
    StartSearch,
    corners,
    draw_leg,
    draw_legs,
    farthest_m,
    shortest_leg,
)
from vastflow.producers.places.stops import (
    GOAL_KEY,
    GOALS_KEY,
    PATH_KEY,
    PATH_LENGTH_KEY,
    START_KEY,
    GoalsParameter,
    StartParameter,
    given_goals,
    given_start,
    goals_key,
    start_key,
)
from vastflow.sim.model.digest import FileContent, Value, digest
from vastflow.sim.model.elementary import atan2
from vastflow.sim.model.faults import Invalid
from vastflow.sim.model.pose import Pose
from vastflow.sim.model.scenario import Dimension
from vastflow.sim.world.environment import MAP_KEY

ARRIVAL_M: Final = 0.5
"""The end of a leg whose direction is the goal's yaw: long enough that a grid step does not decide it."""

UNPROVED: Final = "nor proved impossible"
"""Text of a rejection that another draw may contradict."""

Drawer: TypeAlias = Callable[[np.random.Generator], list[Leg] | str]
"""Draws the legs of one path, or says why there is none."""


class LengthParameters(producer.Parameters):
    """Base of the parameters of paths of a promised length."""

    path_length: Positives
    """Length of the shortest path on the map's grid, from the start through the goals (m); one value or several."""
    path_length_tolerance: NotNegative = 0.5
    """Maximum deviation from `path_length` (m)."""
    robot_diameter: Positive = DEFAULT_ROBOT_DIAMETER_M
    """Diameter of the disc that must fit all along the path (m)."""
    start_pose: StartParameter = START_KEY
    """Key of the start, or the start itself: `{x, y, yaw}` in meters and radians."""
    map_file: MapParameter = None
    """A map for the path, in place of the configuration's own; it becomes the configuration's map where that has none."""


P = TypeVar("P", bound=LengthParameters)


class PathProducer(Producer[P]):
    """Base of producers that write a start and goals."""

    @property
    @abstractmethod
    def goals_key(self) -> str:
        """The key of the goals."""

    @property
    def needs(self) -> tuple[str, ...]:
        return map_needed(self.parameters.map_file)

    @property
    def writes(self) -> Mapping[str, Dimension | None]:
        tag = self.parameters.dimension or "task"
        written: dict[str, Dimension | None] = {start_key(self.parameters.start_pose): tag, self.goals_key: tag}
        return {**written, MAP_KEY: "environment"} if isinstance(self.parameters.map_file, FileContent) else written

    def _values(
        self, inputs: Mapping[str, Value], ground: Ground, start: Pose, goals: Sequence[Pose], legs: Sequence[Leg]
    ) -> dict[str, Value]:
        """Return a path's values: the map, start and goals unless given, and provenance."""
        asked, values = self.parameters, dict[str, Value]()
        if isinstance(asked.map_file, FileContent) and MAP_KEY not in inputs:
            values[MAP_KEY] = asked.map_file
        if start_key(asked.start_pose) not in inputs:
            values[start_key(asked.start_pose)] = start.value()
        if self.goals_key not in self.reads or self.goals_key not in inputs:
            written: list[Value] = [goal.value() for goal in goals]
            values[self.goals_key] = written[0] if self.goals_key == GOAL_KEY else written
        return {**values, **path_values(ground, legs)}


class PathParameters(LengthParameters):
    """Parameters of `PathVariationRandom`."""

    num_paths: Count = 1
    """Paths drawn for each length and number of goals."""
    min_distance: NotNegative = 1.0
    """Least straight distance (m) between a stop and the next."""
    num_goal_poses: Goals | None = None
    """Number of goals; 1 where neither this nor `num_goal_poses_per_m` is given."""
    num_goal_poses_per_m: Positives | None = None
    """Goals per meter of `path_length`, rounded, at least one; one value or several. Instead of `num_goal_poses`."""
    seed: Seed = 0
    """Seed of the draws of start and goals."""
    goal_poses: GoalsParameter = GOALS_KEY
    """Key of the goals, or the goals themselves, one or several. The key `goal_pose` holds one pose, any other a list."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.num_goal_poses is not None and self.num_goal_poses_per_m is not None:
            raise Invalid("num_goal_poses and num_goal_poses_per_m are both given", "keep one of them")
        if self.goal_poses == GOAL_KEY and (self.num_goal_poses_per_m is not None or (self.num_goal_poses or 1) > 1):
            raise Invalid("goal_poses is '@goal_pose', which holds one goal", "write '@goal_poses' for several")
        return self


class PathVariationRandom(PathProducer[PathParameters]):
    """Start and goals, drawn uniformly from all at the requested path length.

    The start is uniform over the cells that have such a goal, the goal over those goals; both are centers of
    cells. With several goals each leg takes an equal share of the length and of the tolerance. The start's
    yaw is uniform; a goal's yaw is the direction in which the path arrives, so that the length is the task
    and not a turn on the spot. Start or goals that are given already are kept, and only the rest is drawn.
    """

    Parameters = PathParameters

    @property
    def goals_key(self) -> str:
        return goals_key(self.parameters.goal_poses)

    @property
    def reads(self) -> tuple[str, ...]:
        asked = self.parameters
        return map_key(asked.map_file), ROOM_KEY, start_key(asked.start_pose), self.goals_key

    @property
    def most_choices(self) -> int:
        asked = self.parameters
        return asked.num_paths * len(asked.path_length) * len(asked.num_goal_poses_per_m or (None,))

    def produce(self, inputs: Mapping[str, Value], draws: Draws) -> Iterator[Fragment | Rejection]:
        """Yield `num_paths` paths for each number of goals and, within it, for each length.

        A path depends on the seed, what is read, its length, its number of goals and its number among
        equals; another length in the list leaves it as it is.
        """
        asked, goals = self.parameters, tuple[Pose, ...]()
        try:
            start, goals = given_start(inputs, asked.start_pose), given_goals(inputs, asked.goal_poses)
            map_file = map_of(inputs, asked.map_file)
        except ValueError as error:
            yield from (Rejection(str(error), requested) for requested in self._requests(goals))
            return
        ground = ground_of(map_file, asked.robot_diameter, room_of(inputs))
        drawer: Drawer | None = None
        for requested in self._requests(goals):
            if drawer is None or requested["path"] == 1:
                drawer = self._drawer(ground, start, goals, requested["path_length"], requested["num_goal_poses"])
            rng = draws(int(digest(requested)[:16], 16))
            legs = drawer(rng)
            if isinstance(legs, str):
                yield Rejection(legs, requested)
                continue
            begin = start or Pose(*center_m(ground, legs[0].start), float(rng.uniform(-math.pi, math.pi)))
            ends = goals or tuple(Pose(*center_m(ground, leg.end), _arrival_rad(ground, leg)) for leg in legs)
            size = {name: requested[name] for name in ("path_length", "num_goal_poses")}
            yield Fragment({**self._values(inputs, ground, begin, ends, legs), REQUESTED + self.goals_key: size})

    def _requests(self, goals: Sequence[Pose]) -> Iterator[dict[str, Any]]:
        asked = self.parameters
        for per_m in asked.num_goal_poses_per_m or (None,):
            for length_m in asked.path_length:
                n_goals = len(goals) or asked.num_goal_poses or max(1, round(length_m * (per_m or 0.0)))
                for path in range(1, asked.num_paths + 1):
                    yield {"path_length": length_m, "num_goal_poses": n_goals, "path": path}

    def _drawer(
        self, ground: Ground, start: Pose | None, goals: Sequence[Pose], length_m: float, n_goals: int
    ) -> Drawer:
        """Return what draws paths of this length through so many goals, on a ground with the stops that are given."""
        asked, tolerance_m = self.parameters, self.parameters.path_length_tolerance
        if n_goals > MOST_GOALS:
            return _always(f"a path of {length_m:g} m was to have {n_goals} goals, and the most are {MOST_GOALS}")
        for name, pose in (("start", start), *((f"goal {i}", goal) for i, goal in enumerate(goals, 1))):
            if pose is not None and not ground.stands(pose.x_m, pose.y_m):
                return _always(f"the given {name} ({pose.x_m:g}, {pose.y_m:g}) is no place for {ground.robot_text}")
        if goals:
            return _to_given_goals(ground, start, goals, LegRequest(length_m, tolerance_m, asked.min_distance))
        request = LegRequest(length_m / n_goals, tolerance_m / n_goals, asked.min_distance)
        what = f"{legs_text(n_goals)} of {length_text(request.length_m, request.tolerance_m)}"
        if asked.min_distance > request.length_m + request.tolerance_m:
            return _always(f"a {what} can't lead {asked.min_distance:g} m away in a straight line")
        what = f"{what} and >= {asked.min_distance:g} m in a straight line"
        robot = ground.stopping_robot_text
        if start is not None:
            cell = ground.occupancy.cell_of(start.x_m, start.y_m)
            return lambda rng: (
                draw_legs(ground, cell, n_goals, request, rng)
                or (
                    f"from the given start there is no {what} for {robot}; "
                    f"the longest shortest path from there is {farthest_m(ground, cell):.2f} m"
                )
            )
        search = StartSearch(ground, n_goals, request)

        def anywhere(rng: np.random.Generator) -> list[Leg] | str:
            if legs := search.draw(rng):
                return legs
            unproved = f"for {robot} no {what} was found from {MAX_STARTS} starts, {UNPROVED}"
            reason = unproved if search.gave_up else f"this map has no {what} for {robot}"
            return f"{reason}. The longest shortest path found is {search.longest_m:.2f} m"

        return anywhere


def path_values(ground: Ground, legs: Sequence[Leg]) -> dict[str, Value]:
    """The provenance of a path: where it begins, turns and ends (m), its length (m), and what surrounds it."""
    cells = np.concatenate([legs[0].cells, *(leg.cells[1:] for leg in legs[1:])])
    stops = list(itertools.accumulate((len(leg.cells) - 1 for leg in legs), initial=0))
    return {
        **path_properties(ground, cells, stops),
        PATH_KEY: [list(center_m(ground, (int(row), int(column)))) for row, column in corners(cells)],
        PATH_LENGTH_KEY: math.fsum(leg.length_m for leg in legs),
    }


def _to_given_goals(ground: Ground, start: Pose | None, goals: Sequence[Pose], request: LegRequest) -> Drawer:
    legs: list[Leg] = []
    cells = [ground.occupancy.cell_of(pose.x_m, pose.y_m) for pose in ((start,) if start else ()) + tuple(goals)]
    for one, other in itertools.pairwise(cells):
        leg = shortest_leg(ground, one, other)
        if leg is None:
            return _always(f"there is no path for {ground.robot_text} through the given poses")
        legs.append(leg)
    given_m = math.fsum(leg.length_m for leg in legs)
    length = length_text(request.length_m, request.tolerance_m)
    if start is not None:
        return _always(legs if request.admits(given_m) else f"the given poses are {given_m:.2f} m apart, not {length}")
    if given_m > request.length_m + request.tolerance_m:
        return _always(f"the given goals alone are {given_m:.2f} m apart, more than {length}")
    rest = replace(request, length_m=request.length_m - given_m)

    def to_given_goals(rng: np.random.Generator) -> list[Leg] | str:
        if leg := draw_leg(ground, cells[0], rest, rng):
            return [leg.reversed(), *legs]
        return (
            f"no start is {length_text(rest.length_m, rest.tolerance_m)} from the first given goal for "
            f"{ground.stopping_robot_text}. The longest shortest path from there is {farthest_m(ground, cells[0]):.2f} m"
        )

    return to_given_goals


def _always(answer: list[Leg] | str) -> Drawer:
    return lambda rng: answer


def legs_text(n_legs: int) -> str:
    """Return words for a path of so many legs; their length follows."""
    return "path" if n_legs == 1 else f"path of {n_legs} legs, each"


def length_text(length_m: float, tolerance_m: float) -> str:
    """A promised length for a sentence, such as `20 m ± 1 m`."""
    return f"{length_m:.4g} m ± {tolerance_m:.2g} m"


def _arrival_rad(ground: Ground, leg: Leg) -> float:
    """Direction of the last `ARRIVAL_M` of a leg."""
    back = min(math.ceil(ARRIVAL_M / ground.occupancy.resolution_m), len(leg.cells) - 1)
    row, column = leg.cells[-1] - leg.cells[-1 - back]
    return math.remainder(atan2(int(row), int(column)) + ground.occupancy.yaw_rad, math.tau)


def center_m(ground: Ground, cell: Cell) -> tuple[float, float]:
    """A cell's center, rounded to a micrometer."""
    x_m, y_m = ground.occupancy.center_of(*cell)
    return round(x_m, 6), round(y_m, 6)
