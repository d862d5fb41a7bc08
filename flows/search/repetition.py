"""Runs of a search's points: as many as the file's rule wants of each, and then those that confirm the best."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

from vastflow.flows.request.stopping import Stopping
from vastflow.tasks.index import FoundMember, Index, Member
from vastflow.tasks.stored import Stored


@dataclass
class PointRuns:
    """Says how many runs a point wants, see `vastflow.tasks.engine.RunsWanted`.

    Runs that confirm come after those that the search used, so they have indices that it never looked at.

    Attributes:
        rule: Ends a point's runs when its class is decided; None where each has `runs`.
        runs: Of each point, at most where there is a rule.
        confirmed: Name of the point that is confirmed; empty as long as there is none.
        confirm: Runs that confirm it.
    """

    rule: Stopping | None
    runs: int
    confirm: int = 0
    confirmed: str = ""

    @property
    def most(self) -> int:
        """Runs that no point exceeds."""
        return self.runs + (self.confirm if self.confirmed else 0)

    def wanted(self, judgements: Mapping[int, str]) -> int:
        """Runs that the search wants of a point by what is known of them."""
        return self.runs if self.rule is None else self.rule.wanted(judgements)

    def used(self, index: Index, member: Member) -> tuple[Member, list[Stored]]:
        """The member with the runs that the search uses of it, and what the store has of these."""
        if self.rule is not None:
            return self.rule.stored(index, member)
        member = replace(member, runs=self.runs)
        return member, index.stored(member)

    def stored(self, index: Index, member: Member) -> tuple[Member, list[Stored]]:
        """The member with the runs that are wanted of it by now, and what the store has of these."""
        member, stored = self.used(index, member)
        if member.name != self.confirmed or not FoundMember(member, tuple(stored)).complete:
            return member, stored
        more = replace(member, runs=member.runs + self.confirm)
        return more, index.stored(more)
