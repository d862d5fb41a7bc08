"""Shards: configurations or evaluations that one Prefect task run computes. Prefect itself is not needed here."""

from collections.abc import Container, Sequence
from typing import Final

from vastflow.tasks.engine.evaluation import PackedProducer
from vastflow.tasks.engine.index import ConfigurationRuns
from vastflow.tasks.engine.instantiation import Evaluation

MOST_TASK_RUNS: Final = 200
"""Task runs of one stage that are aimed at: Prefect's recorder loses rows silently in the thousands."""


class Shard:
    """Configurations that go through the stages together. No dataclass: Prefect would walk into it."""

    __slots__ = ("configurations",)

    def __init__(self, configurations: Sequence[ConfigurationRuns]) -> None:
        self.configurations = configurations

    @property
    def families(self) -> frozenset[str]:
        """Names of the families that the configurations are of."""
        return frozenset(configuration.family for configuration in self.configurations)

    def __str__(self) -> str:
        """`12–15 of hall`, or `hall 12 – depot 3` for several families."""
        first, last = self.configurations[0], self.configurations[-1]
        if first.family != last.family:
            return f"{first.family} {first.place} – {last.family} {last.place}"
        places = f"{first.place}" if first is last else f"{first.place}–{last.place}"
        return f"{places} of {first.family}"


class ProducerShard:
    """A producer on some of its distinct restricted inputs."""

    __slots__ = ("evaluations", "families", "name", "packed")

    def __init__(self, family: str, name: str, packed: PackedProducer, evaluations: Sequence[Evaluation]) -> None:
        self.families = frozenset((family,))
        self.name = name
        self.packed = packed
        self.evaluations = evaluations

    def __str__(self) -> str:
        return self.name


def shard_ranges(digests: Sequence[str], most: int = MOST_TASK_RUNS) -> list[range]:
    """Cut configurations into shards at places chosen by content, so that an insertion moves one cut.

    A campaign of up to `most` configurations has one a shard. In a larger one a shard has about `unit` configurations,
    the smallest power of two with which about that many shards suffice, so that the cuts depend on the number of
    configurations only when it crosses a boundary.

    Args:
        digests: Hexadecimal digest of each configuration, in order.
        most: Shards that are aimed at.

    Returns:
        Positions of each shard's configurations, in order; each position once.
    """
    if most == 1 and digests:
        return [range(len(digests))]
    unit = 1
    while len(digests) > most * unit:
        unit *= 2
    if unit == 1:
        return [range(i, i + 1) for i in range(len(digests))]
    least, largest = unit // 2, 3 * unit
    cuts, begin = [], 0
    for i, configuration in enumerate(digests):
        size = i + 1 - begin
        if (size >= least and int(configuration[:8], 16) % (least + 1) == 0) or size >= largest:
            cuts.append(range(begin, i + 1))
            begin = i + 1
    return [*cuts, range(begin, len(digests))] if begin < len(digests) else cuts


def missing_shards(
    configurations: Sequence[ConfigurationRuns], incomplete: Container[str], most: int = MOST_TASK_RUNS
) -> list[Shard]:
    """Return the shards with something missing; an edit of one configuration moves one cut.

    Args:
        incomplete: Names of configurations of which something is missing.
        most: Number of shards that is aimed at.
    """
    parts = shard_ranges([configuration.scenario.digest for configuration in configurations], most)
    return [
        Shard([configurations[i] for i in part])
        for part in parts
        if any(configurations[i].name in incomplete for i in part)
    ]
