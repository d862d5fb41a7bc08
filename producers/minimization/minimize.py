"""Minimization by delta debugging: what of a failing scenario its failure needs, asked of whoever tells whether a candidate fails."""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Literal, TypeAlias, TypeVar

from vastflow.producers.minimization.circumstance import LEVELS, Circumstance

Standing: TypeAlias = Literal["fails", "does not fail", "undecided", "not tried"]
"""`not tried`: it can't be built, or its runs broke."""


@dataclass(frozen=True, slots=True)
class Candidate:
    """A scenario that may fail like the one that was given.

    Attributes:
        kept: Circumstances of those that can be left out.
        levels: Circumstances nearer to their default, with the eighths of the distance that are left.
    """

    kept: frozenset[Circumstance]
    levels: frozenset[tuple[Circumstance, int]] = frozenset()


@dataclass(frozen=True, slots=True)
class Outcome:
    """The outcome of a candidate.

    Attributes:
        failed, judged: Of its runs.
        reason: Why it was not tried; empty where it was.
    """

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
    """A scenario that fails, and of which nothing can be left out.

    Attributes:
        without: For each circumstance that is kept, what becomes of the scenario without it.
        tried: Every candidate in the order of the questions, with its outcome.
        confirmation: Of runs that no question used.
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
    """An unconfirmed failure.

    Attributes:
        outcome: Of the scenario that was given; what it lacks to be called failing.
    """

    outcome: Outcome
    confirmation: Outcome | None = None

    @property
    def text(self) -> str:
        """The failure's lack in words, to follow the name of what was given."""
        if self.confirmation is not None and self.outcome.standing == "fails":
            said = f"{self.confirmation.failed} of {self.confirmation.judged}"
            return f"failed {self.outcome.failed} of {self.outcome.judged} runs, and only {said} fresh ones"
        return f"is {self.outcome.text}" if self.outcome.standing == "undecided" else self.outcome.text


Judge: TypeAlias = Callable[[Candidate], Outcome]


@dataclass
class _Trials:
    """Outcomes of candidates, each judged once."""

    judge: Judge
    refused: set[Candidate] = field(default_factory=set)
    known: dict[Candidate, Outcome] = field(default_factory=dict)

    def outcome(self, candidate: Candidate) -> Outcome:
        if candidate not in self.known:
            self.known[candidate] = self.judge(candidate)
        return self.known[candidate]

    def fails(self, candidate: Candidate) -> bool:
        return candidate not in self.refused and self.outcome(candidate).standing == "fails"


def minimize(circumstances: tuple[Circumstance, ...], judge: Judge, confirm: Judge) -> Minimum | Unconfirmed:
    """The smallest scenario that fails, as far as delta debugging finds it.

    Circumstances are left out first; those that stay are brought nearer to their defaults, and the path is made shorter; then it
    is asked once more what can be left out. What was found is confirmed; where it is not, the search goes on as if it had not failed.

    Args:
        judge: Says whether a candidate fails.
        confirm: Says it of a candidate that failed, by runs that `judge` did not use.
    """
    trials = _Trials(judge)
    whole = Candidate(frozenset(each for each in circumstances if each.can_be_left_out))
    confirmation = None
    while trials.fails(whole):
        found = _minimum(circumstances, whole, trials)
        confirmation = confirm(found)
        if confirmation.standing == "fails":
            without = {each: trials.outcome(_without(found, each)) for each in circumstances if each in found.kept}
            return Minimum(found, without, trials.known, confirmation)
        trials.refused.add(found)
    return Unconfirmed(trials.outcome(whole), confirmation)


def _minimum(circumstances: tuple[Circumstance, ...], whole: Candidate, trials: _Trials) -> Candidate:
    found = _left(circumstances, whole, trials)
    for each in circumstances:
        if each.default is not None and (each in found.kept or not each.can_be_left_out):
            found = _nearer(found, each, trials)
    return _left(circumstances, found, trials)


def _left(circumstances: tuple[Circumstance, ...], candidate: Candidate, trials: _Trials) -> Candidate:
    """The candidate with as few circumstances as fail at its levels."""

    def with_these(kept: tuple[Circumstance, ...]) -> Candidate:
        levels = frozenset(
            (each, level) for each, level in candidate.levels if each in kept or not each.can_be_left_out
        )
        return Candidate(frozenset(kept), levels)

    things = [each for each in circumstances if each in candidate.kept]
    return with_these(ddmin(things, lambda kept: trials.fails(with_these(tuple(kept)))))


def _nearer(candidate: Candidate, circumstance: Circumstance, trials: _Trials) -> Candidate:
    """The candidate with one circumstance as near to its default as fails."""

    def at(level: int) -> Candidate:
        own = () if level == LEVELS else ((circumstance, level),)
        return Candidate(candidate.kept, candidate.levels.union(own))

    return at(least_level(lambda level: trials.fails(at(level))))


def _without(candidate: Candidate, circumstance: Circumstance) -> Candidate:
    levels = frozenset((each, level) for each, level in candidate.levels if each != circumstance)
    return Candidate(candidate.kept - {circumstance}, levels)


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
        pieces = _split(left, parts)
        # Of two pieces each is the complement of the other.
        subsets = [*pieces, *(_complement(left, piece) for piece in pieces if parts > 2)]
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
    passes, least = 0, LEVELS
    while least - passes > 1:
        middle = (passes + least) // 2
        if fails(middle):
            least = middle
        else:
            passes = middle
    return least


def _split(things: tuple[T, ...], parts: int) -> list[tuple[T, ...]]:
    """`things` in order, in parts of about equal size."""
    cuts = [len(things) * k // parts for k in range(parts + 1)]
    return [things[start:stop] for start, stop in itertools.pairwise(cuts)]


def _complement(things: tuple[T, ...], piece: tuple[T, ...]) -> tuple[T, ...]:
    return tuple(each for each in things if each not in piece)
