"""The growth of a family: what every design does between its producers, and that of a covering array or sample."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from vastflow.producers.campaign_file.sections import DesignSpec
from vastflow.producers.campaign_file.spec import StartCheckKind
from vastflow.producers.constraints.constraint import Checker, Constraint, ConstraintPlace
from vastflow.producers.designs.covering_array import IncompleteDesign, covering_array, verify
from vastflow.producers.designs.sample import sampled
from vastflow.producers.designs.space import DesignSpace, FactorBlock, TooLarge
from vastflow.producers.instantiation.coverage import FamilyCount
from vastflow.producers.model.configuration import ExcludedInstance, Fragment, Partial, RejectedInstance, Rejection
from vastflow.producers.model.faults import CampaignError
from vastflow.producers.model.producer import Producer
from vastflow.producers.places.start_check import StartCheck
from vastflow.sim.model.digest import Value
from vastflow.sim.model.scenario import Dimension


class InstantiableFamily(Protocol):
    """What instantiation needs of `vastflow.producers.instantiation.family.Family`."""

    @property
    def name(self) -> str:
        """First part of every configuration's name."""

    @property
    def values(self) -> Mapping[str, Value]:
        """The fixed parameters."""

    @property
    def dimensions(self) -> Mapping[str, Dimension]:
        """Tags of fixed parameters."""

    @property
    def producers(self) -> Sequence[Producer[Any]]:
        """Π, in order."""

    @property
    def constraints(self) -> Sequence[Constraint]:
        """φ."""

    @property
    def design(self) -> DesignSpec:
        """Which combinations become configurations."""

    @property
    def place(self) -> ConstraintPlace:
        """Where the design stands, for messages."""

    @property
    def start_check(self) -> StartCheckKind:
        """Whether the robot's own footprint must fit where a configuration begins and ends."""

    @property
    def max_configurations(self) -> int:
        """How many there may be."""

    @property
    def overrides(self) -> Mapping[str, Value]:
        """Values that take the place of those of every configuration."""


class Growth(Protocol):
    """A family under way through its producers: `inputs` and `join` in turn for each, then `grown`."""

    def inputs(self) -> dict[str, dict[str, Value]]:
        """Digest to restricted input of everything the next producer must be evaluated on.

        Raises:
            CampaignError: a constraint can't be evaluated, or the design is too large.
        """

    def join(self, results: Mapping[str, Sequence[Fragment | Rejection]]) -> None:
        """Take what `evaluate` gave for each digest of `inputs`; what has no result is dropped.

        Raises:
            CampaignError: a constraint can't be evaluated.
        """

    def grown(self) -> "Grown":
        """The family, once every producer is joined.

        Raises:
            CampaignError: a constraint can't be evaluated, or the design is too large.
        """


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
    """Every producer is evaluated on all combinations of what it reads; then the design's rows are chosen.

    The rows are of those combinations only that can be built and are not excluded, so no row is lost. What producers
    rejected and constraints excluded on the way is told, each partial combination once.
    """

    def __init__(self, family: InstantiableFamily) -> None:
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
        """See `vastflow.producers.instantiation.growth.Growth`."""
        try:
            found = self._space.inputs()
        except TooLarge as error:
            raise self._too_large(error) from None
        self._checker.raise_faults()
        return found

    def join(self, results: Mapping[str, Sequence[Fragment | Rejection]]) -> None:
        """See `vastflow.producers.instantiation.growth.Growth`."""
        self._space.join(results)

    def grown(self) -> Grown:
        """See `vastflow.producers.instantiation.growth.Growth`."""
        try:
            blocks = self._space.blocks()
            self._checker.raise_faults()
            rows = self._rows(blocks)
        except TooLarge as error:
            raise self._too_large(error) from None
        partials = [self._space.partial(row) for row in rows.tolist()]
        for partial in partials:
            if broken := self._checker.excluded(partial, self._family.constraints):
                raise IncompleteDesign(f"{partial.name} breaks {broken.constraint}")
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
        rows = covering_array(blocks, levels, design.t_way.strength)
        verify(rows, blocks, design.t_way.strength)
        return rows

    def _too_large(self, error: TooLarge) -> CampaignError:
        what = f"the design of family {self._family.name!r} is too large: {error}"
        return CampaignError(
            [self._family.place.fault(what, "fewer choices, or constraints that tie fewer producers together")]
        )
