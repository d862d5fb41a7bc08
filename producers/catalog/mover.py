"""The producer of a body that follows waypoints, and the base of all that add bodies that move."""

import itertools
import math
from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Annotated, ClassVar, Literal, Self, TypeAlias, TypeVar

from pydantic import Field, model_validator

from vastflow.producers.model import producer
from vastflow.producers.model.configuration import REQUESTED, Fragment, Rejection
from vastflow.producers.model.numbers import NotNegative, NotNegatives, Number, Positive, Positives
from vastflow.producers.model.producer import Draws, Producer
from vastflow.producers.places.ground import MapParameter, ground_of, map_key, map_needed, map_of
from vastflow.sim.model.digest import Value
from vastflow.sim.model.scenario import Dimension
from vastflow.sim.reading.movers import MOVERS_KEY, mover_shapes, movers_of

Entries: TypeAlias = Sequence[Mapping[str, Value]]
"""Movers as the key `movers` has them."""


class NamedParameters(producer.Parameters):
    """Parameters of a producer of bodies that move."""

    name: Annotated[str, Field(min_length=1)] = "mover"
    """Name of the body, or the beginning of several names."""
    map_file: MapParameter = None
    """Map or world in whose walls none may stand; by default the configuration's."""


P = TypeVar("P", bound=NamedParameters)


class MoverProducer(Producer[P]):
    """Base of producers that add bodies that move to those that are there."""

    names: ClassVar[tuple[str, ...]]
    """Parameters with the values of each factor; earlier ones vary outermost."""
    stops: ClassVar[tuple[str, ...]] = ()
    """Keys of the robot's start and goals that are read."""

    @property
    def needs(self) -> tuple[str, ...]:
        return map_needed(self.parameters.map_file)

    @property
    def reads(self) -> tuple[str, ...]:
        return map_key(self.parameters.map_file), *self.stops, MOVERS_KEY

    @property
    def writes(self) -> Mapping[str, Dimension | None]:
        return {MOVERS_KEY: self.parameters.dimension}

    @property
    def factors(self) -> Mapping[str, Sequence[Value]]:
        return {name: getattr(self.parameters, name) for name in self.names}

    @abstractmethod
    def maker(self, inputs: Mapping[str, Value], draws: Draws) -> Callable[..., Entries | str] | str:
        """Return the function from a value of each factor to bodies.

        A text in place of either says why there are none.
        """

    @property
    def most_choices(self) -> int:
        return math.prod(map(len, self.factors.values()))

    def produce(self, inputs: Mapping[str, Value], draws: Draws) -> Iterator[Fragment | Rejection]:
        """Yield the bodies of each combination of factors."""
        make, known = self.maker(inputs, draws), inputs.get(MOVERS_KEY, ())
        so_far: Entries = known if isinstance(known, list | tuple) else ()
        # A further producer does not overwrite what was requested of those before.
        provenance = f"{REQUESTED}{MOVERS_KEY}.{self.parameters.name}"
        for values in itertools.product(*self.factors.values()):
            requested = dict(zip(self.factors, values, strict=True))
            found = make if isinstance(make, str) else make(*values)
            if isinstance(found, str):
                yield Rejection(found, requested)
            else:
                yield Fragment({MOVERS_KEY: [*so_far, *found], provenance: requested})


class BodyParameters(NamedParameters):
    """Parameters of a body."""

    shape: dict[str, Positive] = Field(default_factory=lambda: {"radius_m": 0.25})
    """`{radius_m: …}` or `{length_m: …, width_m: …}`."""

    @property
    def diameter_m(self) -> float:
        (shape,) = mover_shapes({MOVERS_KEY: [{"name": self.name, "shape": self.shape}]}).values()
        return 2 * shape.circumradius_m

    @model_validator(mode="after")
    def _check_shape(self) -> Self:
        _ = self.diameter_m  # a ValueError
        return self


class MoverParameters(BodyParameters):
    """Parameters of `MoverVariation`: those of an entry of `movers`, some of them one value or several."""

    waypoints: list[list[Number]]
    """Two or more places `[x, y]` in the map's frame (m)."""
    speed_m_s: Positives = (1.0,)
    """Speed between waypoints (m/s); one value or several."""
    loop: Literal["once", "back_and_forth", "around"] = "once"
    """After the last waypoint it stays, goes back, or goes on to the first."""
    pause_s: NotNegatives = (0.0,)
    """Time at each waypoint (s); one value or several."""
    start_s: NotNegatives = (0.0,)
    """Time of the run at which it leaves the first waypoint (s); one value or several."""
    phase_s: NotNegative = 0.0
    """Greatest time by which it is ahead of that, drawn for each run (s)."""

    def entry(self, speed_m_s: float, pause_s: float, start_s: float) -> dict[str, Value]:
        chosen = {"speed_m_s": speed_m_s, "pause_s": pause_s, "start_s": start_s}
        return {**self.model_dump(exclude={"dimension", "map_file"}), **chosen}

    @model_validator(mode="after")
    def _check(self) -> Self:
        for values in itertools.product(self.speed_m_s, self.pause_s, self.start_s):
            movers_of({MOVERS_KEY: [self.entry(*values)]})  # a ValueError
        return self


class MoverVariation(MoverProducer[MoverParameters]):
    """A body that follows waypoints whatever it meets.

    A waypoint where it would stand in a wall is a rejection; between waypoints nothing stops it. Other bodies that move are kept.
    """

    Parameters = MoverParameters
    names = ("speed_m_s", "pause_s", "start_s")

    def maker(self, inputs: Mapping[str, Value], draws: Draws) -> Callable[..., Entries | str] | str:
        asked, ground = self.parameters, ground_of(map_of(inputs, self.parameters.map_file), self.parameters.diameter_m)
        for at in asked.waypoints:
            if not ground.stands(*at):
                return f"{asked.name} would stand in a wall at {at}"
        return lambda *values: [asked.entry(*values)]
