"""The family, and its growth by a covering array or sample."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vastflow.producers.campaign_file.sections import CARTESIAN, DesignSpec
from vastflow.producers.campaign_file.spec import ExecutionSpec, StartCheckKind
from vastflow.producers.constraints.constraint import NOWHERE, Checker, Constraint
from vastflow.producers.designs.covering_array import covering_array
from vastflow.producers.designs.sample import sampled
from vastflow.producers.designs.space import DesignSpace, FactorBlock, TooLarge
from vastflow.producers.instantiation.coverage import FamilyCount
from vastflow.producers.model.configuration import ExcludedInstance, Fragment, Partial, RejectedInstance, Rejection
from vastflow.producers.model.producer import Producer
from vastflow.producers.places.ground import MAP_KEY
from vastflow.producers.places.start_check import StartCheck
from vastflow.sim.model.digest import Value
from vastflow.sim.model.faults import Fault, FileError, Place
from vastflow.sim.model.scenario import Dimension


@dataclass(frozen=True, slots=True)
class Family:
    """A scenario family F, ready to be instantiated.

    Attributes:
        values: K: the fixed parameters, maps as `FileContent`.
        dimensions: Dimension of each fixed parameter that differs from the usual one of its key.
        producers: Π, in order.
        constraints: φ.
        design: Which combinations of the producers' choices become configurations.
        place: Where the design stands, for messages.
        max_configurations: How many there may be.
        overrides: Values that take the place of those of every configuration.
        start_check: Whether the robot's own footprint must fit where they begin and end.
    """

    name: str
    values: Mapping[str, Value]
    dimensions: Mapping[str, Dimension]
    producers: tuple[Producer[Any], ...]
    constraints: tuple[Constraint, ...] = ()
    design: DesignSpec = CARTESIAN
    place: Place = NOWHERE
    max_configurations: int = ExecutionSpec().max_configurations
    overrides: Mapping[str, Value] = field(default_factory=dict)
    start_check: StartCheckKind = "none"

    @property
    def drives(self) -> bool:
        """Whether a robot may drive in its configurations: without a map nothing does."""
        return any(MAP_KEY in keys for keys in (self.values, self.overrides, *(each.writes for each in self.producers)))


@dataclass(frozen=True, slots=True)
class Grown:
    """A family that went through all its producers.

    Attributes:
        partials: Complete.
        count: What coverage counts.
    """

    partials: Sequence[Partial]
    rejections: Sequence[RejectedInstance]
    excluded: Sequence[ExcludedInstance]
    count: FamilyCount


class DesignGrowth:
    """The growth by a covering array or sample.

    Every producer is evaluated on all combinations of what it reads; then the design's rows are chosen.

    The rows are of those combinations only that can be built and are not excluded, so no row is lost. What producers
    rejected and constraints excluded on the way is told, each partial combination once.
    """

    def __init__(self, family: Family) -> None:
        self._family = family
        self._checker = Checker(family.name)
        self._space = DesignSpace(
            family.name,
            family.values,
            family.dimensions,
            family.producers,
            family.constraints,
            self._checker,
            start_check=StartCheck(family.name, family.overrides) if family.start_check == "footprint" else None,
        )

    def inputs(self) -> dict[str, dict[str, Value]]:
        try:
            found = self._space.inputs()
        except TooLarge as error:
            raise self._too_large(error) from None
        self._checker.raise_faults()
        return found

    def join(self, results: Mapping[str, Sequence[Fragment | Rejection]]) -> None:
        self._space.join(results)

    def grown(self) -> Grown:
        try:
            blocks = self._space.blocks()
            self._checker.raise_faults()
            rows = self._rows(blocks)
        except TooLarge as error:
            raise self._too_large(error) from None
        partials = [self._space.partial(row) for row in rows.tolist()]
        for partial in partials:
            if broken := self._checker.excluded(partial, self._family.constraints):
                raise RuntimeError(f"{partial.name} breaks {broken.constraint}")
        self._checker.raise_faults()
        levels = tuple(self._space.level_counts)
        count = FamilyCount(self._family.name, self._family.producers, self._family.design, levels, blocks)
        return Grown(partials, self._space.rejections, self._space.excluded, count)

    def _rows(self, blocks: Sequence[FactorBlock]) -> NDArray[np.int64]:
        design, levels = self._family.design, self._space.level_counts
        if design.sample is not None:
            return sampled(blocks, len(levels), design.sample)
        if design.t_way is None:
            raise ValueError("a design that is neither a covering array nor a sample")
        return covering_array(blocks, levels, design.t_way.strength)

    def _too_large(self, error: TooLarge) -> FileError:
        what = f"the design of family {self._family.name!r} is too large: {error}"
        return FileError(
            [Fault(self._family.place, what, "fewer choices, or constraints that tie fewer producers together")]
        )
