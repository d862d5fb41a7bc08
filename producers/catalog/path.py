"""The producer of start and goals, a promised path length apart."""

import itertools
import math
from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Self, TypeAlias, TypeVar

import numpy as np
from pydantic import model_validator
from pydantic_core import PydanticCustomError

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
from vastflow.producers.places.ground import (
    MAP_KEY,
    Ground,
    MapParameter,
    ground_of,
    map_key,
    map_needed,
    map_of,
    room_of,
)
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
from vastflow.sim.model.pose import Pose
from vastflow.sim.model.scenario import Dimension

ARRIVAL_M: Final = 0.5
"""The end of a leg whose direction is the goal's yaw: long enough that a grid step does not decide it."""


UNPROVED: Final = "nor proved impossible"
"""What a rejection says that another draw may contradict."""


class LengthParameters(producer.Parameters):
    """Base of the parameters of paths of a promised length."""

    path_length: Positives
    """Length of the shortest path on the map's grid, from the start through the goals (m); one value or several."""
    path_length_tolerance: NotNegative = 0.5
    """How much a length may miss `path_length` by (m)."""
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
        own_map: dict[str, Dimension | None] = (
            {MAP_KEY: "environment"} if isinstance(self.parameters.map_file, FileContent) else {}
        )
        return {start_key(self.parameters.start_pose): tag, self.goals_key: tag, **own_map}

    def _values(
        self, inputs: Mapping[str, Value], ground: Ground, start: Pose, goals: Sequence[Pose], legs: Sequence[Leg]
    ) -> dict[str, Value]:
        """Return what is written for a path: the map, start and goals unless they are given, and provenance."""
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
            raise PydanticCustomError("goals", "num_goal_poses and num_goal_poses_per_m are both given; one of them")
        if self.goal_poses == GOAL_KEY and (self.num_goal_poses_per_m is not None or (self.num_goal_poses or 1) > 1):
            raise PydanticCustomError(
                "goals", "goal_poses is '@goal_pose', which holds one goal; '@goal_poses' for several"
            )
        return self


class PathVariationRandom(PathProducer[PathParameters]):
    """Start and goals, drawn uniformly from all that are the promised path length apart.

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
        return (
            map_key(self.parameters.map_file),
            ROOM_KEY,
            start_key(self.parameters.start_pose),
            self.goals_key,
        )

    @property
    def most_choices(self) -> int:
        return (
            self.parameters.num_paths
            * len(self.parameters.path_length)
            * len(self.parameters.num_goal_poses_per_m or (None,))
        )

    def produce(self, inputs: Mapping[str, Value], draws: Draws) -> Iterator[Fragment | Rejection]:
        """Yield `num_paths` paths for each number of goals and, within it, for each length.

        A path depends on the seed, what is read, its length, its number of goals and its number among
        equals; another length in the list leaves it as it is.
        """
        try:
            start = given_start(inputs, self.parameters.start_pose)
            goals = given_goals(inputs, self.parameters.goal_poses)
        except ValueError as error:
            yield from (Rejection(str(error), requested) for requested in self._requests(()))
            return
        map_file = map_of(inputs, self.parameters.map_file)
        if isinstance(map_file, Rejection):
            yield from (Rejection(map_file.reason, requested) for requested in self._requests(goals))
            return
        task = _Task(
            ground_of(map_file, self.parameters.robot_diameter, room_of(inputs)), start, goals, self.parameters
        )
        for (length_m, n_goals), instances in itertools.groupby(self._requests(goals), _size):
            draw = task.drawer(length_m, n_goals)
            for requested in instances:
                rng = draws(int(digest(requested)[:16], 16))
                legs = draw(rng)
                if isinstance(legs, str):
                    yield Rejection(legs, requested)
                else:
                    size = {name: requested[name] for name in ("path_length", "num_goal_poses")}
                    yield Fragment({**self._path(inputs, task, legs, rng), REQUESTED + self.goals_key: size})

    def _requests(self, goals: Sequence[Pose]) -> Iterator[dict[str, Value]]:
        asked = self.parameters
        for per_m in asked.num_goal_poses_per_m or (None,):
            for length_m in asked.path_length:
                n_goals = len(goals) or asked.num_goal_poses or max(1, round(length_m * (per_m or 0.0)))
                for path in range(1, asked.num_paths + 1):
                    yield {"path_length": length_m, "num_goal_poses": n_goals, "path": path}

    def _path(
        self, inputs: Mapping[str, Value], task: "_Task", legs: Sequence[Leg], rng: np.random.Generator
    ) -> dict[str, Value]:
        ground = task.ground
        start = task.start or Pose(*center_m(ground, legs[0].start), float(rng.uniform(-math.pi, math.pi)))
        goals = task.goals or tuple(Pose(*center_m(ground, leg.end), _arrival_rad(ground, leg)) for leg in legs)
        return self._values(inputs, ground, start, goals, legs)


def path_values(ground: Ground, legs: Sequence[Leg]) -> dict[str, Value]:
    """The provenance of a path: where it begins, turns and ends (m), its length (m), and what surrounds it."""
    cells = np.concatenate([legs[0].cells, *(leg.cells[1:] for leg in legs[1:])])
    stops = list(itertools.accumulate((len(leg.cells) - 1 for leg in legs), initial=0))
    return {
        **path_properties(ground, cells, stops),
        PATH_KEY: [list(center_m(ground, (int(row), int(column)))) for row, column in corners(cells)],
        PATH_LENGTH_KEY: sum(leg.length_m for leg in legs),
    }


Drawer: TypeAlias = Callable[[np.random.Generator], "list[Leg] | str"]
"""Draws the legs of one path, or says why there is none."""


@dataclass(frozen=True, slots=True)
class _Task:
    """The ground on which paths are drawn, and the stops that are given."""

    ground: Ground
    start: Pose | None
    goals: tuple[Pose, ...]
    asked: PathParameters

    def drawer(self, length_m: float, n_goals: int) -> Drawer:
        """Return what draws paths of this length through so many goals."""
        asked, ground = self.asked, self.ground
        if n_goals > MOST_GOALS:
            return _always(f"a path of {length_m:g} m was to have {n_goals} goals; at most {MOST_GOALS}")
        for name, pose in (("start", self.start), *((f"goal {i}", goal) for i, goal in enumerate(self.goals, 1))):
            if pose is not None and not ground.stands(pose.x_m, pose.y_m):
                return _always(
                    f"the given {name} ({pose.x_m:g}, {pose.y_m:g}) is no place for {self.ground.robot_text}"
                )
        if self.goals:
            return self._to_given_goals(length_m)
        request = LegRequest(length_m / n_goals, asked.path_length_tolerance / n_goals, asked.min_distance)
        what = f"{legs_text(n_goals)} of {length_text(request.length_m, request.tolerance_m)}"
        if asked.min_distance > request.length_m + request.tolerance_m:
            return _always(f"a {what} can't lead {asked.min_distance:g} m away in a straight line")
        what = f"{what} and >= {asked.min_distance:g} m in a straight line"
        if self.start is None:
            return self._anywhere(n_goals, request, what)
        start = self._cell(self.start)

        def from_given_start(rng: np.random.Generator) -> list[Leg] | str:
            return draw_legs(ground, start, n_goals, request, rng) or (
                f"from the given start there is no {what} for {self.ground.stopping_robot_text}; "
                f"the longest shortest path from there is {farthest_m(ground, start):.2f} m"
            )

        return from_given_start

    def _anywhere(self, n_goals: int, request: LegRequest, what: str) -> Drawer:
        search = StartSearch(self.ground, n_goals, request)

        def anywhere(rng: np.random.Generator) -> list[Leg] | str:
            legs = search.draw(rng)
            if legs is not None:
                return legs
            if search.gave_up:
                return (
                    f"for {self.ground.stopping_robot_text} no {what} was found from {MAX_STARTS} starts, {UNPROVED}; "
                    f"the longest shortest path found is {search.longest_m:.2f} m"
                )
            return f"this map has no {what} for {self.ground.stopping_robot_text}; the longest shortest path found is {search.longest_m:.2f} m"

        return anywhere

    def _to_given_goals(self, length_m: float) -> Drawer:
        asked, ground = self.asked, self.ground
        legs: list[Leg] = []
        for one, other in itertools.pairwise(((self.start,) if self.start else ()) + self.goals):
            leg = shortest_leg(ground, self._cell(one), self._cell(other))
            if leg is None:
                return _always(f"there is no path for {self.ground.robot_text} through the given poses")
            legs.append(leg)
        given_m = sum(leg.length_m for leg in legs)
        if self.start is not None:
            if LegRequest(length_m, asked.path_length_tolerance, 0.0).admits(given_m):
                return _always(legs)
            return _always(
                f"the given poses are {given_m:.2f} m apart, not {length_text(length_m, asked.path_length_tolerance)}"
            )
        if given_m > length_m + asked.path_length_tolerance:
            return _always(
                f"the given goals alone are {given_m:.2f} m apart, more than {length_text(length_m, asked.path_length_tolerance)}"
            )
        first_goal = self._cell(self.goals[0])
        request = LegRequest(length_m - given_m, asked.path_length_tolerance, asked.min_distance)

        def to_given_goals(rng: np.random.Generator) -> list[Leg] | str:
            leg = draw_leg(ground, first_goal, request, rng)
            if leg is not None:
                return [leg.reversed(), *legs]
            return (
                f"no start is {length_text(request.length_m, request.tolerance_m)} from the first given goal for "
                f"{self.ground.stopping_robot_text}; the longest shortest path from there is {farthest_m(ground, first_goal):.2f} m"
            )

        return to_given_goals

    def _cell(self, pose: Pose) -> Cell:
        return self.ground.occupancy.cell_of(pose.x_m, pose.y_m)


def _always(answer: list[Leg] | str) -> Drawer:
    return lambda rng: answer


def _size(requested: Mapping[str, Any]) -> tuple[float, int]:
    return requested["path_length"], requested["num_goal_poses"]


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
    return math.remainder(math.atan2(row, column) + ground.occupancy.yaw_rad, math.tau)


def center_m(ground: Ground, cell: Cell) -> tuple[float, float]:
    """A cell's center to the micrometer: what a person would write."""
    x_m, y_m = ground.occupancy.center_of(*cell)
    return round(x_m, 6), round(y_m, 6)
