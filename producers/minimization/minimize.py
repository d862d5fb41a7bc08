"""Minimization by delta debugging: what a failing scenario needs to fail, and its candidates as checked scenarios."""

import itertools
from bisect import bisect_left
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, TypeAlias, TypeVar

from vastflow.producers.campaign_file.scenario import AbstractScenario
from vastflow.producers.campaign_file.scenario_values import (
    combined_complaint,
    complaint_of,
    mask_complaints,
)
from vastflow.producers.minimization.circumstance import LEVELS, Circumstance, Subject
from vastflow.producers.model.configuration import Partial
from vastflow.producers.places.start_check import StartCheck
from vastflow.producers.places.stops import GOAL_KEY
from vastflow.sim.model.digest import FileContent, Value
from vastflow.sim.model.faults import Complaint, UserError, message_of
from vastflow.sim.model.scenario import Scenario, scenario_of
from vastflow.sim.system.keys import FILE_KEY

Standing: TypeAlias = Literal["fails", "does not fail", "undecided", "not tried"]
"""`not tried`: it can't be built, or its runs broke."""


@dataclass(frozen=True, slots=True)
class Candidate:
    """A scenario that may fail like the given one.

    Attributes:
        kept: Circumstances of those that can be left out.
        levels: Circumstances nearer to their default, with the eighths of the distance that are left.
    """

    kept: frozenset[Circumstance]
    levels: frozenset[tuple[Circumstance, int]] = frozenset()

    def with_these(self, kept: Collection[Circumstance]) -> "Candidate":
        """Return the candidate with these circumstances alone, at the same levels."""
        levels = frozenset(pair for pair in self.levels if pair[0] in kept or not pair[0].can_be_left_out)
        return Candidate(frozenset(kept), levels)

    def nearer(self, circumstance: Circumstance, level: int) -> "Candidate":
        """Return the candidate with one more circumstance at a level."""
        own = () if level == LEVELS else ((circumstance, level),)
        return Candidate(self.kept, self.levels.union(own))


@dataclass(frozen=True, slots=True)
class Outcome:
    """The outcome of a candidate: its failed and judged runs, or why it was not tried."""

    standing: Standing
    failed: int = 0
    judged: int = 0
    reason: str = ""

    @property
    def text(self) -> str:
        """The outcome in words, such as `fails, 7 of 7 runs`."""
        if self.standing == "not tried":
            return f"not tried: {self.reason}"
        shown = {"undecided": "not shown to fail"}.get(self.standing, self.standing)
        return f"{shown}, {self.failed} of {self.judged} runs fail"


@dataclass(frozen=True)
class Minimum:
    """A failing scenario of which no part can be removed.

    Attributes:
        without: For each circumstance that is kept, what becomes of the scenario without it.
        tried: Every candidate in the order of the questions, with its outcome.
        confirmation: Outcome of runs that no question used.
    """

    candidate: Candidate
    without: dict[Circumstance, Outcome]
    tried: dict[Candidate, Outcome] = field(repr=False)
    confirmation: Outcome

    @property
    def cause(self) -> dict[Circumstance, Outcome]:
        """Circumstances that can't be left out, with the outcome that shows it."""
        return {each: said for each, said in self.without.items() if said.standing != "not tried"}

    @property
    def not_tried(self) -> dict[Circumstance, Outcome]:
        """Circumstances that remain because the scenario without them was not tried."""
        return {each: said for each, said in self.without.items() if said.standing == "not tried"}


@dataclass(frozen=True)
class Unconfirmed:
    """An unconfirmed failure: the outcomes of the given scenario and of fresh runs, if any."""

    outcome: Outcome
    confirmation: Outcome | None = None

    @property
    def text(self) -> str:
        """The reason why the failure is unconfirmed, as a phrase after the scenario's name."""
        if self.confirmation is not None and self.outcome.standing == "fails":
            said = f"{self.confirmation.failed} of {self.confirmation.judged}"
            return f"failed {self.outcome.failed} of {self.outcome.judged} runs, and only {said} fresh ones"
        return f"is {self.outcome.text}" if self.outcome.standing == "undecided" else self.outcome.text


Judge: TypeAlias = Callable[[Candidate], Outcome]


def minimize(circumstances: tuple[Circumstance, ...], judge: Judge, confirm: Judge) -> Minimum | Unconfirmed:
    """The smallest failing scenario that delta debugging finds.

    Circumstances are left out first; those that stay are brought nearer to their defaults, and the path is made shorter; then it
    is asked once more what can be left out. What was found is confirmed; where it is not, the search goes on as if it had not failed.

    Args:
        judge: Says whether a candidate fails; is asked once of each.
        confirm: Says it of a candidate that failed, by runs that `judge` did not use.
    """
    refused: set[Candidate] = set()
    known: dict[Candidate, Outcome] = {}

    def outcome(candidate: Candidate) -> Outcome:
        if candidate not in known:
            known[candidate] = judge(candidate)
        return known[candidate]

    def fails(candidate: Candidate) -> bool:
        return candidate not in refused and outcome(candidate).standing == "fails"

    def with_fewest(candidate: Candidate) -> Candidate:
        things = [each for each in circumstances if each in candidate.kept]
        return candidate.with_these(ddmin(things, lambda kept: fails(candidate.with_these(kept))))

    def nearest(candidate: Candidate, each: Circumstance) -> Candidate:
        return candidate.nearer(each, least_level(lambda level: fails(candidate.nearer(each, level))))

    whole = Candidate(frozenset(each for each in circumstances if each.can_be_left_out))
    confirmation = None
    while fails(whole):
        found = with_fewest(whole)
        for each in circumstances:
            if each.default is not None and (each in found.kept or not each.can_be_left_out):
                found = nearest(found, each)
        found = with_fewest(found)
        confirmation = confirm(found)
        if confirmation.standing == "fails":
            kept = [each for each in circumstances if each in found.kept]
            without = {each: outcome(found.with_these(found.kept - {each})) for each in kept}
            return Minimum(found, without, known, confirmation)
        refused.add(found)
    return Unconfirmed(outcome(whole), confirmation)


T = TypeVar("T")


def ddmin(things: Sequence[T], fails: Callable[[Sequence[T]], bool]) -> tuple[T, ...]:
    """A subset of `things` that fails, while it fails no more without any single one of them.

    The algorithm ddmin of Zeller and Hildebrandt, Simplifying and Isolating Failure-Inducing Input (IEEE Trans. Softw. Eng. 28
    (2002) 183), which asks for nothing at all first.

    Args:
        fails: Whether a subset, in the order of `things`, fails; all of them do. What can't be told counts as no.
    """
    left, parts = tuple(things), 2
    if not left or fails(()):
        return ()
    while len(left) > 1:
        cuts = [len(left) * k // parts for k in range(parts + 1)]
        pieces = [left[start:stop] for start, stop in itertools.pairwise(cuts)]
        # Of two pieces each is the complement of the other.
        subsets = [*pieces, *(tuple(each for each in left if each not in piece) for piece in pieces if parts > 2)]
        found = next((k for k, subset in enumerate(subsets) if fails(subset)), None)
        if found is not None:
            left, parts = subsets[found], 2 if found < parts else parts - 1
        elif parts == len(left):
            break
        else:
            parts = min(2 * parts, len(left))
    return left


def least_level(fails: Callable[[int], bool]) -> int:
    """The least of the levels 1 to `LEVELS` that fails, by bisection: `LEVELS` does, and 0 is taken not to."""
    return 1 + bisect_left(range(1, LEVELS), True, key=fails)


class NotBuilt(UserError, ValueError):
    """A candidate is no scenario."""


@dataclass(frozen=True)
class Candidates:
    """Makes scenarios of candidates of the `whole`; without `start_check`, start and goals are not checked."""

    subject: Subject
    whole: Scenario
    abstract: AbstractScenario
    start_check: StartCheck | None

    def scenario(self, candidate: Candidate) -> Scenario:
        """Return the scenario of a candidate.

        Raises:
            NotBuilt: its values don't go together, or the robot can't begin or end where it says.
        """
        try:
            values = self.subject.reduced(candidate.kept, dict(candidate.levels))
        except ValueError as error:
            raise NotBuilt(str(error)) from None
        whole = {**self.whole.environment, **self.whole.task, **self.whole.system}
        values = {key: whole[key] if isinstance(value, FileContent) else value for key, value in values.items()}
        if complaint := next(self._complaints(values), None):
            raise NotBuilt(message_of(*complaint))
        tags = self.subject.dimensions
        if self.start_check and (rejected := self.start_check.rejected(Partial("minimal", values, tags))):
            raise NotBuilt(rejected.reason)
        abstract, timeout_s, programs = self.whole.abstract, self.whole.timeout_s, self.whole.programs
        return scenario_of(values, tags, abstract=abstract, timeout_s=timeout_s, programs=programs)

    def _complaints(self, values: Mapping[str, Value]) -> Iterator[Complaint]:
        tags = self.subject.dimensions
        system = {key: value for key, value in values.items() if tags[key] == "system"}
        for key, value in values.items():
            if key != FILE_KEY and (
                said := complaint_of(key, value, tags[key], system) or self.abstract.complaint(key, value)
            ):
                yield said
        if combined := combined_complaint(system):
            yield combined[1]
        yield from (said for _, said in mask_complaints(system, values))
        goal = {GOAL_KEY} if self.abstract.goal_keys(values) else set()
        for group in self.abstract.needed:
            if goal.union(values).isdisjoint(group):
                yield f"the scenario needs {' or '.join(group)}", "give it a value"
