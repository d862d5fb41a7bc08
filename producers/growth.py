"""The growth of a family: what every design does between its producers."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from vastflow.producers.configuration import ExcludedInstance, Fragment, Partial, RejectedInstance, Rejection
from vastflow.producers.constraints.constraint import Constraint, ConstraintPlace
from vastflow.producers.coverage import FamilyCount
from vastflow.producers.producer import Producer
from vastflow.producers.vast.design import DesignSpec
from vastflow.producers.vast.spec import StartCheckKind
from vastflow.sim.model.digest import Value
from vastflow.sim.model.scenario import Dimension


class InstantiableFamily(Protocol):
    """What instantiation needs of `vastflow.producers.family.Family`."""

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
