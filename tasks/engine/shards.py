"""Shards: what one Prefect task run takes together. Prefect itself is not needed here."""

from collections.abc import Container, Sequence
from typing import Final

from vastflow.tasks.engine.evaluation import PackedProducer
from vastflow.tasks.engine.index import Member
from vastflow.tasks.engine.instantiation import Evaluation

MOST_TASK_RUNS: Final = 200
"""Task runs of one stage that are aimed at: Prefect's recorder loses rows silently in the thousands."""


class Shard:
    """Members that go through the stages together. No dataclass: Prefect would walk into it."""

    __slots__ = ("members",)

    def __init__(self, members: Sequence[Member]) -> None:
        self.members = members

    @property
    def families(self) -> frozenset[str]:
        """Names of the families that the members are of."""
        return frozenset(member.family for member in self.members)

    def __str__(self) -> str:
        """Such as `12–15 of hall`; in a shard of several families `hall 12 – depot 3`."""
        first, last = self.members[0], self.members[-1]
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


def chunks(digests: Sequence[str], most: int = MOST_TASK_RUNS) -> list[range]:
    """Cut members into shards at places their content chooses, so that an insertion moves one cut.

    A campaign of up to `most` members has one a shard. In a larger one a shard has about `unit` members,
    the smallest power of two with which about that many shards suffice, so that the cuts depend on the number of
    members only when it crosses a boundary.

    Args:
        digests: Hexadecimal digest of each member, in order.
        most: Shards that are aimed at.

    Returns:
        Positions of each shard's members, in order; each position once.
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
    for i, member in enumerate(digests):
        size = i + 1 - begin
        if (size >= least and int(member[:8], 16) % (least + 1) == 0) or size >= largest:
            cuts.append(range(begin, i + 1))
            begin = i + 1
    return [*cuts, range(begin, len(digests))] if begin < len(digests) else cuts


def missing_shards(members: Sequence[Member], incomplete: Container[str], most: int = MOST_TASK_RUNS) -> list[Shard]:
    """Shards in which something is missing; where they are cut depends on all members, so that an edit moves one cut.

    Args:
        incomplete: Names of members of which something is missing.
        most: Shards that are aimed at.
    """
    parts = chunks([member.scenario.digest for member in members], most)
    return [Shard([members[i] for i in part]) for part in parts if any(members[i].name in incomplete for i in part)]
