"""Proposals, and what was found at them."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, Literal, TypeAlias

from vastflow.producers.search.space import Point

FAMILY: Final = "search"
"""Of all points of a search, in tables and in the report."""
BASELINE: Final = "random"
"""The family of points that are drawn beside those of the strategy."""

Standing: TypeAlias = Literal["judged", "rejected", "not judged"]
"""`rejected`: nothing can be built there, so nothing was run. `not judged`: it was run, and its runs do not give the objective."""


@dataclass(frozen=True, slots=True)
class Proposal:
    """A point that a strategy wants to know of.

    Attributes:
        number: Of all that were proposed, from 1; one of the baseline has that of the point beside which it is drawn.
        batch: From 0.
        family: `FAMILY`, or `BASELINE` where it is a point of the search beside.
    """

    number: int
    batch: int
    point: Point
    family: str = FAMILY

    @property
    def name(self) -> str:
        """Of its configuration, such as `point-0017`."""
        return f"{'point' if self.family == FAMILY else self.family}-{self.number:04}"


@dataclass(frozen=True, slots=True)
class Evaluation:
    """What was found at a proposal.

    Attributes:
        objective: None unless `judged`.
        measures: Name to value of what the strategy asked beside; those that could not be had are missing.
        runs: Over which the objective was taken.
        simulated_s: Simulated time of these.
        reason: Why it is not judged; empty where it is.
    """

    proposal: Proposal
    standing: Standing
    objective: float | None = None
    measures: Mapping[str, float] = field(default_factory=dict)
    runs: int = 0
    simulated_s: float = 0.0
    reason: str = ""
