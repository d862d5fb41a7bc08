"""The producer of obstacles along a configuration's path."""

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Annotated, Any, Final, Literal, Self, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import AliasChoices, BaseModel, BeforeValidator, ConfigDict, Field, ValidationInfo, model_validator
from pydantic_core import PydanticCustomError

from vastflow.producers.model import producer
from vastflow.producers.model.configuration import DRAW, Fragment, Rejection
from vastflow.producers.model.numbers import DEFAULT_ROBOT_DIAMETER_M, Amount, Count, NotNegatives, Positive, Seed
from vastflow.producers.model.producer import Draws, Producer
from vastflow.producers.places.cells import centerd_cells
from vastflow.producers.places.ground import Ground, MapParameter, map_needed
from vastflow.producers.places.placement import MAX_ATTEMPTS, Line, Site, Wanted, is_connected, place
from vastflow.producers.places.site import LIST_KEY, SiteRequest
from vastflow.producers.places.stops import KeyParameter
from vastflow.sim.model.digest import Value, digest
from vastflow.sim.model.obstacle import Obstacle, obstacle_of
from vastflow.sim.model.scenario import Dimension

MOST_OBSTACLES: Final = 1_000
"""In one configuration."""
ROUNDING: Final = 1e-9
"""What floor(amount_per_m × length) forgives, so that 0.29/m on 100 m is 29."""


AS_V1: Final = "as_v1"
"""Key of the validation context by which every producer of a file places as version 1 does, whatever the file says."""


def _of_the_file(value: Any, info: ValidationInfo) -> Any:
    return AS_V1 if (info.context or {}).get(AS_V1) else value


Placement: TypeAlias = Annotated[
    Literal["constructive", "as_v1"], BeforeValidator(_of_the_file), Field(validate_default=True)
]
"""How places are found: so that all stand free, or as version 1 of RoboVAST does."""


DIFFERS: Final[Mapping[str, str]] = {
    "constructive": "obstacles keep clear of walls and of each other; version 1 of RoboVAST places them otherwise, as does "
    "--as-v1 or placement: as_v1",
    "as_v1": "obstacles may stand in walls and in each other, as in version 1 of RoboVAST; without --as-v1 they keep clear",
}
"""What there is to say of a placement that nobody chose in the file, where the other one gives other places."""


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
    """How many obstacles of this kind. This or `amount_per_m`."""
    amount_per_m: NotNegatives | None = None
    """How many per meter of path, rounded down; one value or several. This or `amount`."""
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
            raise PydanticCustomError("amount", "{found} given; one of them", {"found": found})
        try:
            self.pattern()
        except ValueError as error:
            raise PydanticCustomError("size", "{error}", {"error": str(error)}) from None
        return self

    @property
    def places_any(self) -> bool:
        """Whether any of its listed values asks for an obstacle."""
        return bool(self.amount) or any(self.amount_per_m or ())

    def pattern(self) -> Obstacle:
        """An obstacle of this kind, wherever it stands."""
        return obstacle_of(
            {"spawn_pose": {"x": 0.0, "y": 0.0}, "model": self.model, "xacro_arguments": self.xacro_arguments},
            "xacro_arguments",
        )

    @property
    def n_choices(self) -> int:
        """Number of `choices`."""
        return len(self.amount_per_m or (None,)) * len(self.max_distance)

    def choices(self) -> list["ObstacleConfig"]:
        """Every combination of its listed values, as configs of one value each."""
        return [
            self.model_copy(update={"amount_per_m": None if per_m is None else (per_m,), "max_distance": (distance_m,)})
            for per_m in self.amount_per_m or (None,)
            for distance_m in self.max_distance
        ]

    def requested(self) -> dict[str, Value]:
        """Return the requested values of a config of one value each."""
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
    """Parameters of `ObstacleVariation`."""

    name: KeyParameter = LIST_KEY
    """Key of the list of obstacles. What is in there already stays."""
    obstacle_configs: list[ObstacleConfig] = Field(min_length=1)
    """The kinds of obstacle in each configuration. Listed values are combined, within a kind and over the kinds."""
    count: Count = 1
    """Placements drawn of each combination."""
    placement: Placement = "constructive"
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
        return self._request.reads

    @property
    def needs(self) -> tuple[str, ...]:
        return map_needed(self.parameters.map_file)

    @property
    def writes(self) -> Mapping[str, Dimension | None]:
        return {self.parameters.name: self.parameters.dimension or "environment"}

    @property
    def most_choices(self) -> int:
        return self.parameters.count * math.prod(config.n_choices for config in self.parameters.obstacle_configs)

    @property
    def remarks(self) -> tuple[str, ...]:
        asked = self.parameters
        if "placement" in asked.model_fields_set or not any(config.places_any for config in asked.obstacle_configs):
            return ()
        return (DIFFERS[asked.placement],)

    def produce(self, inputs: Mapping[str, Value], draws: Draws) -> Iterator[Fragment | Rejection]:
        """Yield `count` placements of each combination, earlier kinds and amounts outermost.

        A placement depends on the seed, what is read, its combination and its number among equals.
        """
        site = self._site(inputs)
        for given in self._given:
            for kinds in combinations(self.parameters.obstacle_configs):
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
        """Values that are combined with the configs', outermost."""
        return [{}]

    @property
    def _request(self) -> SiteRequest:
        return SiteRequest(self.parameters.name, self.parameters.map_file, self.parameters.robot_diameter)

    def _site(self, inputs: Mapping[str, Value]) -> Site | str:
        return self._request.site(inputs)

    def _part(self, site: Site, kinds: Sequence[ObstacleConfig], given: Mapping[str, Any]) -> Site | str:
        """Return the part of a site where obstacles may stand, or why there is none."""
        return site

    def _placed(
        self, site: Site, kinds: Sequence[ObstacleConfig], draws: Draws, requested: Mapping[str, Value]
    ) -> list[dict[str, Value]] | str:
        """Return the obstacles as entries of a list, drawn by the randomness of `requested`; or why there is no room."""
        wanted = [kind.wanted(site.length_m) for kind in kinds]
        if (total := sum(each.amount for each in wanted)) > MOST_OBSTACLES:
            return f"{total} obstacles were asked for; at most {MOST_OBSTACLES}"
        find = place if self.parameters.placement == "constructive" else place_as_v1
        obstacles = find(site, wanted, draws(int(digest(dict(requested))[:16], 16)))
        if isinstance(obstacles, str):
            return obstacles
        kind_of_each = itertools.chain.from_iterable([k] * w.amount for k, w in zip(kinds, wanted, strict=True))
        taken = {obstacle.name for obstacle in site.standing}
        names = (name for i in itertools.count(len(site.standing)) if (name := f"obstacle_{i}") not in taken)
        return [_entry(name, k, o) for name, k, o in zip(names, kind_of_each, obstacles, strict=False)]

    def _fragments(
        self,
        inputs: Mapping[str, Value],
        site: Site,
        entries: list[dict[str, Value]],
        given: Mapping[str, Any],
        asked: Mapping[str, Value],
    ) -> Iterator[Fragment]:
        yield Fragment(self._request.written(inputs, site, entries, asked))


class ObstacleVariation(ObstacleProducer[ObstacleParameters]):
    """Boxes and cylinders near the path, on free cells, so that the robot still finds a path.

    They keep clear of walls, unknown space, each other, obstacles that are there already, and the robot at its start and
    goals, unless they are placed as version 1 does. The path is the one a path producer drew, else the shortest one from start to goals.
    """

    Parameters = ObstacleParameters


def combinations(configs: Sequence[ObstacleConfig]) -> Iterator[tuple[ObstacleConfig, ...]]:
    """Every combination of the configs' listed values, as configs of one value each."""
    return itertools.product(*(config.choices() for config in configs))


def asked_for(kinds: Sequence[ObstacleConfig], number: int) -> dict[str, Value]:
    """The listed values that a placement stands for, each under its name in the file, and its number among equals."""
    several = len(kinds) > 1
    return {
        **{
            f"{name} of kind {k}" if several else name: value
            for k, kind in enumerate(kinds, start=1)
            for name, value in kind.requested().items()
        },
        DRAW: number,
    }


def _entry(name: str, config: ObstacleConfig, obstacle: Obstacle) -> dict[str, Value]:
    return {
        "entity_name": name,
        "model": config.model,
        "spawn_pose": obstacle.pose.value(),
        "xacro_arguments": config.xacro_arguments,
    }


FROM_STOPS: Final = 2.0
"""Least distance of a center from start and goals, in diameters of the robot."""
FROM_EACH_OTHER: Final = 1.5
"""Least distance of two centers, in diameters of the robot."""
TRIES_FOR_EACH: Final = 100
"""Places tried for one kind of obstacle, for each that is wanted of it."""


def place_as_v1(site: Site, wanted: Sequence[Wanted], rng: np.random.Generator) -> list[Obstacle] | str:
    """Draw a place for every obstacle in turn; or say why version 1 would find none.

    Places are drawn as `vastflow.producers.places.placement.place` draws them. One will do where the center is far enough
    from the stops and from other centers. A whole set will do where a path remains: it is drawn `MAX_ATTEMPTS` times at most.
    """
    total = sum(each.amount for each in wanted)
    if total == 0:
        return []
    most, blocking = 0, 0
    for _ in range(MAX_ATTEMPTS):
        obstacles = list(_drawn(site, wanted, rng))
        most = max(most, len(obstacles))
        if len(obstacles) < total:
            continue
        if is_connected(site, _around(site.ground, (*site.standing, *obstacles))):
            return obstacles
        blocking += 1
    if blocking:
        return f"as version 1 places them, {blocking} of {MAX_ATTEMPTS} sets of {total} obstacles left no path to the goals"
    return f"as version 1 places them, at most {most} of {total} obstacles found room in {MAX_ATTEMPTS} attempts"


def _drawn(site: Site, wanted: Sequence[Wanted], rng: np.random.Generator) -> Iterator[Obstacle]:
    """One set, as far as places are found."""
    line = Line.along(site.path_xy_m)
    diameter_m = site.ground.robot_diameter_m
    centers: list[tuple[float, float]] = []
    for each in wanted:
        left = each.amount
        for _ in range(TRIES_FOR_EACH * each.amount):
            if not left:
                break
            pose = line.draw(each.max_distance_m, rng)
            center = pose.x_m, pose.y_m
            if any(math.dist(center, stop) < FROM_STOPS * diameter_m for stop in site.stops_xy_m):
                continue
            if any(math.dist(center, other) < FROM_EACH_OTHER * diameter_m for other in centers):
                continue
            centers.append(center)
            left -= 1
            yield replace(each.pattern, pose=pose)


def _around(ground: Ground, obstacles: Sequence[Obstacle]) -> NDArray[np.bool_]:
    """The passable cells (H, W) when obstacles stand, each grown by the robot's radius to all sides."""
    passable = ground.passable.copy()
    for obstacle in obstacles:
        length_m, width_m = (side_m + ground.robot_diameter_m for side_m in (obstacle.length_m, obstacle.width_m))
        grown = replace(obstacle, length_m=length_m, width_m=width_m)
        cells = centerd_cells(ground.occupancy, grown.footprint())
        passable[cells[:, 0], cells[:, 1]] = False
    return passable
