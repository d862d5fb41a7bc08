"""What is in the store of a block of runs."""

from dataclasses import dataclass

from vastflow.tasks.artifact import Artifact


@dataclass(frozen=True, slots=True)
class Block:
    """Consecutive runs of a scenario, recorded.

    Attributes:
        start, stop: First run index and the one after the last.
        content: Content digest of the recordings.
    """

    key: str
    start: int
    stop: int
    content: str


@dataclass(frozen=True, slots=True)
class Stored:
    """All that is in the store of a block."""

    block: Block
    recordings: Artifact
    trace: Artifact | None
    verdicts: Artifact | None
