"""Shards: the members that one Prefect task run takes together."""

from collections.abc import Sequence
from typing import Final

MOST_TASK_RUNS: Final = 200
"""Task runs of one stage that are aimed at: Prefect's recorder loses rows silently in the thousands."""


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
