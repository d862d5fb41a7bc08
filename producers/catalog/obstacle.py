"""The producer of obstacles along a configuration's path."""

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Any, Final, Literal, Self, TypeVar

import numpy as np
from pydantic import AliasChoices, BaseModel, ConfigDict, Field, model_validator

from vastflow.producers.model import producer
from vastflow.producers.model.configuration import DRAW, REQUESTED, Fragment, Rejection
from vastflow.producers.model.numbers import DEFAULT_ROBOT_DIAMETER_M, Amount, Count, NotNegatives, Positive, Seed
from vastflow.producers.model.producer import ROOM_KEY, Draws, Producer
from vastflow.producers.places.clearance import shortest_path_properties
from vastflow.producers.places.ground import MapParameter, ground_of, map_key, map_needed, map_of, room_of
from vastflow.producers.places.placement import Site, Wanted, place, place_as_v1
from vastflow.producers.places.stops import (
    GOAL_KEY,
    GOALS_KEY,
    PATH_KEY,
    PATH_LENGTH_KEY,
    START_KEY,
    KeyParameter,
    given_goals,
    given_start,
    goals_key,
    start_key,
)
from vastflow.sim.model.digest import Value, digest
from vastflow.sim.model.faults import Invalid
from vastflow.sim.model.obstacle import Obstacle, obstacle_of
from vastflow.sim.model.pose import Pose
from vastflow.sim.model.scenario import Dimension

MOST_OBSTACLES: Final = 1_000
"""Maximum number in one configuration."""
ROUNDING: Final = 1e-9
"""Tolerance of floor(amount_per_m × length), so that 0.29/m on 100 m is 29."""

LIST_KEY: Final = "static_objects"
"""The usual key of a list of obstacles."""
LISTS_KEY: Final = "_obstacles"
"""Key to list of the obstacles that producers placed so far, for those that place more."""
DIFFERS: Final = "Obstacles keep clear of walls and of each other. Version 1 of RoboVAST places them otherwise, as does placement: as_v1."
"""Note on the default placement, if the other rule gives other places."""


def _with_args(schema: dict[str, Any]) -> None:
    schema["properties"]["args"] = {
        **schema["properties"]["xacro_arguments"],
        "title": "Args",
        "description": "`xacro_arguments` for short.",
    }


class ObstacleConfig(BaseModel):
    """One kind of obstacle."""

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True, json_schema_extra=_with_args)

    amount: Annotated[Amount, Field(le=MOST_OBSTACLES)] | None = None
    """Number of obstacles of this kind. This or `amount_per_m`."""
    amount_per_m: NotNegatives | None = None
    """Number per meter of path, rounded down; one value or several. This or `amount`."""
    max_distance: NotNegatives
    """Greatest distance of a center from the path (m); one value or several."""
    model: str = "box"
    """`box` or `cylinder`, or a model file whose name contains one of these words."""
    xacro_arguments: str = Field("", validation_alias=AliasChoices("xacro_arguments", "args"))
    """The size (m): `width:=0.5, length:=0.5` of a box, `radius:=0.2` or `diameter:=0.4` of a cylinder; 0.5 m where none is given.
    `args` for short."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        if (self.amount is None) == (self.amount_per_m is None):
            found = "neither amount nor amount_per_m is" if self.amount is None else "amount and amount_per_m are both"
            raise Invalid(f"{found} given", "keep one of them")
        self.pattern()
        return self

    @property
    def places_any(self) -> bool:
        """Whether any of its listed values asks for an obstacle."""
        return bool(self.amount) or any(self.amount_per_m or ())

    def pattern(self) -> Obstacle:
        """The obstacle of this kind at any pose."""
        entry: dict[str, Value] = {
            "spawn_pose": {"x": 0.0, "y": 0.0},
            "model": self.model,
            "xacro_arguments": self.xacro_arguments,
        }
        return obstacle_of(entry, "xacro_arguments")

    def choices(self) -> list["ObstacleConfig"]:
        """Every combination of its listed values, as configs of one value each."""
        return [
            self.model_copy(update={"amount_per_m": None if per_m is None else (per_m,), "max_distance": (distance_m,)})
            for per_m in self.amount_per_m or (None,)
            for distance_m in self.max_distance
        ]

    def requested(self) -> dict[str, Value]:
        return {
            **({"amount": self.amount} if self.amount_per_m is None else {"amount_per_m": self.amount_per_m[0]}),
            "max_distance": self.max_distance[0],
            "model": self.model,
            "xacro_arguments": self.xacro_arguments,
        }

    def wanted(self, length_m: float) -> Wanted:
        """The obstacles on a path of `length_m`, of a config of one value each."""
        per_m = self.amount_per_m
        amount = (self.amount or 0) if per_m is None else math.floor(per_m[0] * length_m + ROUNDING)
        return Wanted(amount, self.pattern(), self.max_distance[0])


class ObstacleParameters(producer.Parameters):
    """Parameters of `ObstacleVariation`."""

    name: KeyParameter = LIST_KEY
    """Key of the list of obstacles. What is in there already stays."""
    obstacle_configs: list[ObstacleConfig] = Field(min_length=1)
    """The kinds of obstacle in each configuration. Listed values are combined, within a kind and over the kinds."""
    count: Count = 1
    """Placements drawn of each combination."""
    placement: Literal["constructive", "as_v1"] = "constructive"
    """`constructive`: clear of walls, of each other, and of the robot. `as_v1`: as version 1 of RoboVAST places them, with centers apart
    and a path left, but into walls and into each other."""
    seed: Seed = 0
    """Seed of the draws of places."""
    robot_diameter: Positive = DEFAULT_ROBOT_DIAMETER_M
    """Diameter of the robot that must stand at its stops and find a path (m)."""
    map_file: MapParameter = None
    """A map for the places, in place of the configuration's own."""


O = TypeVar("O", bound=ObstacleParameters)


class ObstacleProducer(Producer[O]):
    """Base of producers that place obstacles along the path."""

    @property
    def reads(self) -> tuple[str, ...]:
        """The keys of the map, the path, start and goals, and of the lists of obstacles that are there already."""
        start, goals = self._stops
        keys = (map_key(self.parameters.map_file), ROOM_KEY, PATH_KEY, PATH_LENGTH_KEY, start_key(start))
        return tuple(
            dict.fromkeys((*keys, goals_key(goals), GOAL_KEY, GOALS_KEY, LISTS_KEY, LIST_KEY, self.parameters.name))
        )

    @property
    def needs(self) -> tuple[str, ...]:
        return map_needed(self.parameters.map_file)

    @property
    def writes(self) -> Mapping[str, Dimension | None]:
        return {self.parameters.name: self.parameters.dimension or "environment"}

    @property
    def most_choices(self) -> int:
        return self.parameters.count * math.prod(
            len(config.amount_per_m or (None,)) * len(config.max_distance)
            for config in self.parameters.obstacle_configs
        )

    @property
    def remarks(self) -> tuple[str, ...]:
        asked = self.parameters
        if "placement" in asked.model_fields_set or not any(config.places_any for config in asked.obstacle_configs):
            return ()
        return (DIFFERS,)

    def produce(self, inputs: Mapping[str, Value], draws: Draws) -> Iterator[Fragment | Rejection]:
        """Yield `count` placements of each combination, earlier kinds and amounts outermost.

        A placement depends on the seed, what is read, its combination and its number among equals.
        """
        site = self._site(inputs)
        for given in self._given:
            for kinds in itertools.product(*(config.choices() for config in self.parameters.obstacle_configs)):
                for number in range(1, self.parameters.count + 1):
                    configs: list[Value] = [kind.requested() for kind in kinds]
                    requested: dict[str, Value] = {**given, "obstacle_configs": configs, "placement": number}
                    part = site if isinstance(site, str) else self._part(site, kinds, given)
                    entries = part if isinstance(part, str) else self._placed(part, kinds, draws, requested)
                    if isinstance(site, str) or isinstance(entries, str):
                        yield Rejection(str(entries), requested)
                    else:
                        yield from self._fragments(inputs, site, entries, given, asked_for(kinds, number))

    @property
    def _given(self) -> Sequence[Mapping[str, Any]]:
        return [{}]

    @property
    def _stops(self) -> tuple[str | Pose, str | tuple[Pose, ...]]:
        return START_KEY, GOALS_KEY

    def _site(self, inputs: Mapping[str, Value]) -> Site | str:
        """Return the site, or the reason why there is no path or an obstacle is unreadable."""
        start_at, goals_at = self._stops
        try:
            map_file = map_of(inputs, self.parameters.map_file)
            start = given_start(inputs, start_at)
            goals = next(filter(None, (given_goals(inputs, key) for key in (goals_at, GOALS_KEY, GOAL_KEY))), ())
            standing = _standing(_lists(inputs, self.parameters.name))
        except ValueError as error:
            return str(error)
        ground = ground_of(map_file, self.parameters.robot_diameter, room_of(inputs))
        stops = [(pose.x_m, pose.y_m) for pose in ((start, *goals) if start is not None and goals else ())]
        for stop in stops:
            if not ground.occupancy.contains(*ground.occupancy.cell_of(*stop)):
                return f"the start or a goal, ({stop[0]:g}, {stop[1]:g}), lies beyond the map"
        if PATH_KEY in inputs and PATH_LENGTH_KEY in inputs and {type(start_at), type(goals_at)} == {str}:
            path_xy_m, length_m = np.array(inputs[PATH_KEY], dtype=np.float64), float(inputs[PATH_LENGTH_KEY])  # type: ignore[arg-type]
            return Site(ground, path_xy_m, length_m, stops or [tuple(path_xy_m[0]), tuple(path_xy_m[-1])], standing)
        if not stops:
            return f"there is no path to place obstacles at: no {START_KEY} with {GOAL_KEY} or {GOALS_KEY} was written before"
        from vastflow.sim.world import octile

        path = octile.shortest_path(ground.occupancy, ground.passable, np.array(stops))
        if path is None:
            return f"there is no path from the start to the goals for {ground.robot_text}"
        return Site(ground, *path, stops, standing)

    def _part(self, site: Site, kinds: Sequence[ObstacleConfig], given: Mapping[str, Any]) -> Site | str:
        """Return the part of a site that obstacles may occupy, or the reason why it is empty."""
        return site

    def _placed(
        self, site: Site, kinds: Sequence[ObstacleConfig], draws: Draws, requested: Mapping[str, Value]
    ) -> list[dict[str, Value]] | str:
        """Return random obstacles as entries of a list, or the reason why there is no room."""
        wanted = [kind.wanted(site.length_m) for kind in kinds]
        if (total := sum(each.amount for each in wanted)) > MOST_OBSTACLES:
            return f"{total} obstacles were asked for, and the most are {MOST_OBSTACLES}"
        find = place if self.parameters.placement == "constructive" else place_as_v1
        obstacles = find(site, wanted, draws(int(digest(dict(requested))[:16], 16)))
        if isinstance(obstacles, str):
            return obstacles
        kind_of_each = (kind for kind, each in zip(kinds, wanted, strict=True) for _ in range(each.amount))
        taken = {obstacle.name for obstacle in site.standing}
        names = (name for i in itertools.count(len(site.standing)) if (name := f"obstacle_{i}") not in taken)
        return [
            {
                "entity_name": name,
                "model": kind.model,
                "spawn_pose": obstacle.pose.value(),
                "xacro_arguments": kind.xacro_arguments,
            }
            for name, kind, obstacle in zip(names, kind_of_each, obstacles, strict=False)
        ]

    def _fragments(
        self,
        inputs: Mapping[str, Value],
        site: Site,
        entries: Sequence[Mapping[str, Value]],
        given: Mapping[str, Any],
        asked: Mapping[str, Value],
    ) -> Iterator[Fragment]:
        """Yield the list extended by `entries`, notes on it and the request, and the path's surroundings."""
        name, lists = self.parameters.name, _lists(inputs, self.parameters.name)
        mine: list[Value] = [*lists.get(name, ()), *entries]
        placed = _standing({name: entries})
        is_known = PATH_KEY in inputs and not placed and not site.standing
        around = {} if is_known else shortest_path_properties(site, placed)
        # A second producer of the same list does not overwrite what was requested of the first.
        note = f"{REQUESTED}{name}{'+' if name in lists else ''}"
        yield Fragment({name: mine, LISTS_KEY: {**lists, name: mine}, note: {**asked}, **around})


def _lists(inputs: Mapping[str, Value], name: str) -> dict[str, list[Value]]:
    """Lists of obstacles so far by their keys, that called `name` among them; a ValueError where one is none."""
    noted = inputs.get(LISTS_KEY)
    found = dict(noted) if isinstance(noted, Mapping) else {}
    found |= {key: inputs[key] for key in (LIST_KEY, name) if key in inputs}
    lists: dict[str, list[Value]] = {}
    for key, value in found.items():
        match value:
            case [*entries]:
                lists[key] = entries
            case _:
                raise ValueError(f"{key}: expected a list of obstacles, got {value!r}")
    return lists


def _standing(lists: Mapping[str, Sequence[Value]]) -> tuple[Obstacle, ...]:
    """All obstacles of the lists, including ones that appear later, as new ones must not overlap them."""
    return tuple(
        obstacle_of({name: value for name, value in entry.items() if name != "spawn_trigger"}, f"{key}[{i}]")
        for key, entries in lists.items()
        for i, entry in enumerate(entries)
        if isinstance(entry, Mapping) and "spawn_pose" in entry
    )


class ObstacleVariation(ObstacleProducer[ObstacleParameters]):
    """Boxes and cylinders on free cells near the path that leave the robot a path.

    They keep clear of walls, unknown space, each other, obstacles that are there already, and the robot at its start and
    goals, unless they are placed as version 1 does. The path is the one a path producer drew, else the shortest one from start to goals.
    """

    Parameters = ObstacleParameters


def asked_for(kinds: Sequence[ObstacleConfig], number: int) -> dict[str, Value]:
    """The listed values of a placement by their names in the file, and its index among equal ones."""
    asked: dict[str, Value] = {}
    for k, kind in enumerate(kinds, start=1):
        asked |= {f"{name} of kind {k}" if kinds[1:] else name: value for name, value in kind.requested().items()}
    return {**asked, DRAW: number}
