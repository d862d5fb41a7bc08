"""The producer of a body that follows waypoints, and the base of all that add bodies that move."""

import itertools
import math
from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Annotated, Literal, Self, TypeAlias, TypeVar

from pydantic import Field, model_validator

from vastflow.producers.model import producer
from vastflow.producers.model.configuration import REQUESTED, Fragment, Rejection
from vastflow.producers.model.numbers import NotNegative, NotNegatives, Number, Positive, Positives
from vastflow.producers.model.producer import Draws, Producer
from vastflow.producers.places.ground import ground_of, map_of
from vastflow.sim.model.digest import Value
from vastflow.sim.model.scenario import Dimension
from vastflow.sim.reading.movers import MOVERS_KEY, mover_shapes, movers_of
from vastflow.sim.world.environment import MAP_KEY

Entries: TypeAlias = Sequence[Mapping[str, Value]]
"""Movers as the key `movers` has them."""
P = TypeVar("P", bound=producer.Parameters)


class MoverProducer(Producer[P]):
    """Base of producers that add bodies that move to those that are there."""

    needs = (MAP_KEY,)

    @property
    def writes(self) -> Mapping[str, Dimension | None]:
        return {MOVERS_KEY: self.parameters.dimension}

    @property
    @abstractmethod
    def factors(self) -> Mapping[str, Sequence[Value]]:
        """The values of each factor; earlier ones vary outermost."""

    @abstractmethod
    def maker(self, inputs: Mapping[str, Value], draws: Draws) -> Callable[..., Entries | str]:
        """Return the function from a value of each factor to bodies, or to the reason why there are none."""

    @property
    def most_choices(self) -> int:
        return math.prod(map(len, self.factors.values()))

    def produce(self, inputs: Mapping[str, Value], draws: Draws) -> Iterator[Fragment | Rejection]:
        """Yield the bodies of each combination of factors."""
        make, known = self.maker(inputs, draws), inputs.get(MOVERS_KEY, ())
        so_far: Entries = known if isinstance(known, list | tuple) else ()
        # A second producer does not overwrite what was requested of the first.
        provenance = f"{REQUESTED}{MOVERS_KEY}{'+' if known else ''}"
        for values in itertools.product(*self.factors.values()):
            requested = dict(zip(self.factors, values, strict=True))
            found = make(*values)
            if isinstance(found, str):
                yield Rejection(found, requested)
            else:
                yield Fragment({MOVERS_KEY: [*so_far, *found], provenance: requested})


class MoverParameters(producer.Parameters):
    """Parameters of `MoverVariation`: those of an entry of `movers`, some of them one value or several."""

    name: Annotated[str, Field(min_length=1)] = "mover"
    """Name of the body."""
    shape: dict[str, Positive] = Field(default_factory=lambda: {"radius_m": 0.25})
    """`{radius_m: …}` or `{length_m: …, width_m: …}`."""
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

    @property
    def listed(self) -> Mapping[str, Sequence[Value]]:
        """The values of each factor."""
        return {name: getattr(self, name) for name in ("speed_m_s", "pause_s", "start_s")}

    def entry(self, *values: Value) -> dict[str, Value]:
        """Return the mover of a value of each factor."""
        chosen = dict(zip(self.listed, values, strict=True))
        return {**self.model_dump(include={"name", "shape", "waypoints", "loop", "phase_s"}), **chosen}

    @model_validator(mode="after")
    def _check(self) -> Self:
        for values in itertools.product(*self.listed.values()):
            movers_of({MOVERS_KEY: [self.entry(*values)]})  # a ValueError
        return self


class MoverVariation(MoverProducer[MoverParameters]):
    """A body that follows waypoints whatever it meets.

    A waypoint where it would stand in a wall is a rejection; between waypoints nothing stops it. Other bodies that move are kept.
    """

    Parameters = MoverParameters

    reads = (MAP_KEY, MOVERS_KEY)

    @property
    def factors(self) -> Mapping[str, Sequence[Value]]:
        return self.parameters.listed

    def maker(self, inputs: Mapping[str, Value], draws: Draws) -> Callable[..., Entries | str]:
        asked = self.parameters
        (shape,) = mover_shapes({MOVERS_KEY: [asked.entry(1.0, 0.0, 0.0)]}).values()
        ground = ground_of(map_of(inputs), 2 * shape.circumradius_m)
        blocked = next((at for at in asked.waypoints if not ground.stands(*at)), None)
        return lambda *values: (
            [asked.entry(*values)] if blocked is None else f"{asked.name} would stand in a wall at {blocked}"
        )
