"""Standstills: the failed runs whose robot was sent and never moved, shown apart from the others."""

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from vastflow.oracles.results.column import texts
from vastflow.oracles.results.tables import Tables
from vastflow.sim.loop.standstill import CAUSES


@dataclass(frozen=True, slots=True)
class Standstills:
    """How many runs stood still at the start. They have failed, and are in every rate.

    Attributes:
        causes: Cause to runs, the most frequent first; one of `vastflow.sim.loop.standstill.CAUSES`.
        configurations: Configuration to runs, in the order of the table; those without any are not there.
    """

    causes: Mapping[str, int]
    configurations: Mapping[str, int]

    @property
    def runs(self) -> int:
        """All of them."""
        return sum(self.configurations.values())

    @property
    def text(self) -> str:
        """`stood still at the start: 12 runs (10: the collision monitor …; 2: …)`."""
        why = "; ".join(f"{n:,}: {CAUSES.get(cause, cause)}" for cause, n in self.causes.items())
        return f"stood still at the start: {self.runs:,} run{'' if self.runs == 1 else 's'}" + (
            f" ({why})" if why else ""
        )

    def of(self, names: Iterable[str]) -> int:
        """Those of some configurations."""
        return sum(self.configurations.get(name, 0) for name in names)


def standstills_of(tables: Tables) -> Standstills:
    """The standstills of a campaign; none are known of a directory that an earlier version wrote."""
    if "stood_still" not in tables.runs.column_names:
        return Standstills({}, {})
    columns = texts(tables.runs["configuration"]), texts(tables.runs["stood_still"])
    found = [(name, cause) for name, cause in zip(*columns, strict=True) if cause is not None]
    return Standstills(
        dict(Counter(cause for _, cause in found).most_common()), dict(Counter(name for name, _ in found))
    )
