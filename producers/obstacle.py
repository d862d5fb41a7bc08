"""The producer of obstacles that stand along a configuration's path."""

import itertools
import math
from collections.abc import Iterator, Mapping
from typing import Any, Final, Self

import numpy as np
from pydantic import AliasChoices, BaseModel, ConfigDict, Field, model_validator
from pydantic_core import PydanticCustomError

from vastflow.producers import producer
from vastflow.producers.configuration import Fragment, Rejection
from vastflow.producers.ground import MapParameter, ground_of, map_key, map_of
from vastflow.producers.path import PATH_KEY, PATH_LENGTH_KEY
from vastflow.producers.placement import Site, Wanted, place
from vastflow.producers.producer import Draws, Producer
from vastflow.producers.quantities import (
    DEFAULT_ROBOT_DIAMETER_M,
    Amount,
    Count,
    NotNegatives,
    Positive,
    Seed,
)
from vastflow.producers.stops import GOAL_KEY, GOALS_KEY, START_KEY, given_goals, given_start
from vastflow.sim.digest import FileContent, Value, digest
from vastflow.sim.obstacle import Obstacle, obstacle_of
from vastflow.sim.octile import shortest_path
from vastflow.sim.scenario import Dimension

ROUNDING: Final = 1e-9
"""What floor(amount_per_m × length) forgives, so that 0.29/m on 100 m is 29."""


def _with_args(schema: dict[str, Any]) -> None:
    schema["properties"]["args"] = {**schema["properties"]["xacro_arguments"], "title": "Args"}


class ObstacleConfig(BaseModel):
    """One kind of obstacle.

    Attributes:
        amount: How many.
        amount_per_m: How many per metre of path, rounded down; one value or several. This or `amount`.
        max_distance: Greatest distance of a centre from the path (m), one value or several.
        model: `box` or `cylinder`, or a model file whose name says which.
        xacro_arguments: The size, such as `width:=0.5, length:=0.5`; `args` for short.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, json_schema_extra=_with_args)

    amount: Amount | None = None
    amount_per_m: NotNegatives | None = None
    max_distance: NotNegatives
    model: str = "box"
    xacro_arguments: str = Field("", validation_alias=AliasChoices("xacro_arguments", "args"))

    @model_validator(mode="after")
    def _check(self) -> Self:
        if (self.amount is None) == (self.amount_per_m is None):
            found = "neither amount nor amount_per_m is" if self.amount is None else "amount and amount_per_m are both"
            raise PydanticCustomError("amount", "{found} given; one of them", {"found": found})
        try:
            self.pattern()
        except ValueError as error:
            raise PydanticCustomError("size", "{error}", {"error": str(error)}) from None
        return self

    def pattern(self) -> Obstacle:
        """An obstacle of this kind, wherever it stands."""
        return obstacle_of(
            {"spawn_pose": {"x": 0.0, "y": 0.0}, "model": self.model, "xacro_arguments": self.xacro_arguments},
            "xacro_arguments",
        )

    def choices(self) -> list["ObstacleConfig"]:
        """Every combination of its listed values, as configs of one value each."""
        return [
            self.model_copy(update={"amount_per_m": None if per_m is None else (per_m,), "max_distance": (distance_m,)})
            for per_m in self.amount_per_m or (None,)
            for distance_m in self.max_distance
        ]

    def requested(self) -> dict[str, Value]:
        """What was asked, of a config of one value each."""
        amount: dict[str, Value] = (
            {"amount": self.amount} if self.amount_per_m is None else {"amount_per_m": self.amount_per_m[0]}
        )
        return {
            **amount,
            "max_distance": self.max_distance[0],
            "model": self.model,
            "xacro_arguments": self.xacro_arguments,
        }

    def wanted(self, length_m: float) -> Wanted:
        """The obstacles on a path of `length_m`, of a config of one value each."""
        amount = self.amount or 0
        if self.amount_per_m is not None:
            amount = math.floor(self.amount_per_m[0] * length_m + ROUNDING)
        return Wanted(amount, self.pattern(), self.max_distance[0])


class ObstacleParameters(producer.Parameters):
    """Of `ObstacleVariation`.

    Attributes:
        name: Key of the list of obstacles.
        obstacle_configs: The kinds of obstacle in each configuration. Listed values are combined, within a
            kind and over the kinds.
        count: Placements drawn of each combination.
        robot_diameter: Of the robot that must stand at its stops and find a way (m).
        map_file: A map, in place of the configuration's own.
    """

    name: str = Field("static_objects", min_length=1)
    obstacle_configs: list[ObstacleConfig] = Field(min_length=1)
    count: Count = 1
    seed: Seed = 0
    robot_diameter: Positive = DEFAULT_ROBOT_DIAMETER_M
    map_file: MapParameter = None


class ObstacleVariation(Producer[ObstacleParameters]):
    """Boxes and cylinders near the path, on free cells, so that the robot still finds a way.

    They keep clear of walls, unknown space, each other, and the robot at its start and goals. The path is the
    one a path producer drew, else the shortest one from start to goals.
    """

    Parameters = ObstacleParameters

    @property
    def reads(self) -> tuple[str, ...]:
        """The map, the path, start and goals."""
        return (map_key(self.parameters.map_file), PATH_KEY, PATH_LENGTH_KEY, START_KEY, GOAL_KEY, GOALS_KEY)

    @property
    def needs(self) -> tuple[str, ...]:
        """The map, unless the parameters name a file."""
        map_file = self.parameters.map_file
        return () if isinstance(map_file, FileContent) else (map_key(map_file),)

    @property
    def writes(self) -> Mapping[str, Dimension | None]:
        """The list of obstacles."""
        return {self.parameters.name: self.parameters.dimension or "environment"}

    def produce(self, inputs: Mapping[str, Value], draws: Draws) -> Iterator[Fragment | Rejection]:
        """Yield `count` placements of each combination, earlier kinds and amounts outermost.

        A placement depends on the seed, what is read, its combination and its number among equals.
        """
        found = self._site(inputs)
        for combination in itertools.product(*(config.choices() for config in self.parameters.obstacle_configs)):
            kinds = [config.requested() for config in combination]
            for number in range(1, self.parameters.count + 1):
                requested: dict[str, Value] = {"obstacle_configs": kinds, "placement": number}
                if isinstance(found, str):
                    yield Rejection(found, requested)
                    continue
                site, length_m = found
                wanted = [config.wanted(length_m) for config in combination]
                obstacles = place(site, wanted, draws(int(digest(requested)[:16], 16)))
                if isinstance(obstacles, str):
                    yield Rejection(obstacles, requested)
                else:
                    configs = [c for c, w in zip(combination, wanted, strict=True) for _ in range(w.amount)]
                    entries = [_entry(i, c, o) for i, (c, o) in enumerate(zip(configs, obstacles, strict=True))]
                    yield Fragment({self.parameters.name: entries})

    def _site(self, inputs: Mapping[str, Value]) -> tuple[Site, float] | str:
        """Where to place, and the length of the path in metres; or why there is no path."""
        map_file = map_of(inputs, self.parameters.map_file)
        if isinstance(map_file, Rejection):
            return map_file.reason
        try:
            start = given_start(inputs, START_KEY)
            goals = given_goals(inputs, GOALS_KEY) or given_goals(inputs, GOAL_KEY)
        except ValueError as error:
            return str(error)
        ground = ground_of(map_file, self.parameters.robot_diameter)
        stops = [(pose.x_m, pose.y_m) for pose in ((start, *goals) if start is not None and goals else ())]
        if PATH_KEY in inputs and PATH_LENGTH_KEY in inputs:
            path_xy_m, length_m = np.array(inputs[PATH_KEY], dtype=np.float64), float(inputs[PATH_LENGTH_KEY])  # type: ignore[arg-type]
            return Site(ground, path_xy_m, stops or [tuple(path_xy_m[0]), tuple(path_xy_m[-1])]), length_m
        if not stops:
            return f"there is no path to place obstacles at: no {START_KEY} with {GOAL_KEY} or {GOALS_KEY} was written before"
        way = shortest_path(ground.occupancy, ground.passable, np.array(stops))
        if way is None:
            return f"there is no way from the start to the goals for a robot {ground.robot_diameter_m:g} m across"
        return Site(ground, way[0], stops), way[1]


def _entry(i: int, config: ObstacleConfig, obstacle: Obstacle) -> dict[str, Value]:
    return {
        "entity_name": f"obstacle_{i}",
        "model": config.model,
        "spawn_pose": obstacle.pose.value(),
        "xacro_arguments": config.xacro_arguments,
    }
