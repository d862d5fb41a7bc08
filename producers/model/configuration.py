"""Configurations and rejected instances: what instantiation yields."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Final

from vastflow.sim.model.digest import Value, digest
from vastflow.sim.model.scenario import DIMENSION_OF_KEY, Dimension, Scenario

REQUESTED: Final = "_requested_"
"""Before the key of a drawn value: provenance of what the file requested there, by the file's names. The report compares it."""
DRAW: Final = "draw"
"""Name, in what was requested, of the number among equals."""


@dataclass(frozen=True, slots=True)
class Fragment:
    """The contribution of a producer to a partial configuration.

    Attributes:
        values: Key to value. Keys that begin with `_` are provenance for later producers and the report;
            they are no part of the scenario.
    """

    values: Mapping[str, Value]


@dataclass(frozen=True, slots=True)
class Rejection:
    """An instance a producer can't build: data, not an error.

    Attributes:
        reason: One sentence on what was asked and what was found.
        requested: The choices that can't be met, such as `{"path_length": 200.0, "path": 3}`.
    """

    reason: str
    requested: Mapping[str, Value] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Step:
    """Provenance of one producer's contribution: who wrote which keys.

    Attributes:
        choice: Place, from 1, of this contribution among all the producer yielded for its input, rejections included:
            the same choice of the same list has the same number, whatever could not be built before it.
        inputs: Digest of what the producer read.
    """

    producer: str
    keys: tuple[str, ...]
    choice: int = 1
    inputs: str = ""


@dataclass(frozen=True, slots=True)
class Partial:
    """A partial configuration between producers.

    Attributes:
        name: Child names append `-k` at each step, k from 1.
        values: Everything written so far, provenance (`_…`) included.
        dimensions: Tags of keys whose dimension a producer or the file gave.
        steps: Which producer wrote what, in order.
    """

    name: str
    values: Mapping[str, Value]
    dimensions: Mapping[str, Dimension] = field(default_factory=dict)
    steps: tuple[Step, ...] = ()

    def restricted(self, keys: tuple[str, ...]) -> dict[str, Value]:
        """The values of `keys` that are present: all that a producer sees."""
        return {key: self.values[key] for key in keys if key in self.values}

    def obstacles(self) -> Iterator[tuple[str, Mapping[str, Value]]]:
        """Yield place and entry of each obstacle in lists of the environment, whatever their keys."""
        for key, value in self.values.items():
            if (self.dimensions.get(key) or DIMENSION_OF_KEY.get(key)) == "environment" and isinstance(
                value, list | tuple
            ):
                for i, entry in enumerate(value):
                    if isinstance(entry, Mapping) and "spawn_pose" in entry:
                        yield f"{key}[{i}]", entry


@dataclass(frozen=True, slots=True)
class Configuration:
    """A named concrete scenario.

    Attributes:
        factors: The values that vary or were fixed, for tables: key to value, without provenance.
        provenance: Keys that begin with `_`: drawn path, lengths, and the like.
        duplicate_of: Name of an earlier configuration of the same content, run in its stead.
    """

    name: str
    family: str
    scenario: Scenario
    factors: Mapping[str, Value]
    provenance: Mapping[str, Value]
    steps: tuple[Step, ...]
    duplicate_of: str | None = None


@dataclass(frozen=True, slots=True)
class RejectedInstance:
    """A rejection with its place in the campaign: which producer, from what, why."""

    family: str
    parent: str
    producer: str
    reason: str
    requested: Mapping[str, Value]
    inputs: Mapping[str, Value]


@dataclass(frozen=True, slots=True)
class ExcludedInstance:
    """A configuration, often a partial one, that a constraint excludes.

    Attributes:
        name: Name of the (partial) configuration; `*` stands for a step whose choice does not matter.
        constraint: The first one that it breaks.
        values: Values that the constraint looked at, by name.
    """

    family: str
    name: str
    constraint: str
    values: Mapping[str, Value]


def restricted_digest(restricted: Mapping[str, Value]) -> str:
    """Digest of a producer's input; equal for partial configurations that differ elsewhere only."""
    return digest(dict(restricted))
