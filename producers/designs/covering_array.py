"""Covering arrays: few rows that contain every admissible combination of levels of any t factors.

Greedy, a row at a time (as AETG, Cohen et al. 1997): candidates begin with a tuple that is missing yet and take factor
by factor the level that adds most; the best candidate becomes a row. Nothing is random. As a candidate only ever takes
levels that its block's table completes, every row is admissible and every admissible tuple is met in the end.
"""

import itertools
import math
from collections.abc import Mapping, Sequence
from random import Random
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from vastflow.producers.designs.space import FactorBlock, TooLarge

CANDIDATES: Final = 24
MOST_TUPLES: Final = 3_000_000
"""Combinations of t factors' levels that can be looked after."""

Cover: TypeAlias = dict[tuple[int, ...], NDArray[np.bool_]]
"""Factors, ascending, to a flag for each combination of their levels."""


def covering_array(blocks: Sequence[FactorBlock], level_counts: Sequence[int], strength: int) -> NDArray[np.int64]:
    """(N, F) levels of each factor in rows that cover every admissible combination of `strength` factors.

    With fewer factors of more than one level than that, these are combined in all ways.

    Raises:
        TooLarge: more combinations than can be looked after.
    """
    if any(len(block.table) == 0 for block in blocks):
        return np.empty((0, len(level_counts)), np.int64)
    varied = designed_factors(blocks)
    missing = admissible_tuples(blocks, level_counts, varied, min(strength, len(varied)))
    greedy = _Greedy(blocks, level_counts, varied, missing)
    rows = list(iter(greedy.next_row, None))
    return np.unique(np.array(rows, dtype=np.int64).reshape(len(rows), len(level_counts)), axis=0)


def designed_factors(blocks: Sequence[FactorBlock]) -> tuple[int, ...]:
    """Factors with more than one admissible level, ascending."""
    columns = ((f, block.table[:, k]) for block in blocks for k, f in enumerate(block.factors))
    return tuple(sorted(factor for factor, levels in columns if len(np.unique(levels)) > 1))


def admissible_tuples(
    blocks: Sequence[FactorBlock], level_counts: Sequence[int], factors: Sequence[int], strength: int
) -> Cover:
    """A flag for each combination of levels of any `strength` of `factors` that some admissible row has."""
    total = sum(math.prod(level_counts[f] for f in combo) for combo in itertools.combinations(factors, strength))
    if total > MOST_TUPLES:
        raise TooLarge(f"{total} combinations of {strength} choices")
    cover: Cover = {}
    for combo in itertools.combinations(factors, strength):
        flags = np.ones([level_counts[f] for f in combo], dtype=np.bool_)
        for block in blocks:
            inside = [f for f in combo if f in block.factors]
            if inside:
                part = np.zeros([level_counts[f] for f in inside], dtype=np.bool_)
                part[tuple(block.table[:, block.factors.index(f)] for f in inside)] = True
                flags &= part.reshape([level_counts[f] if f in inside else 1 for f in combo])
        cover[combo] = flags
    return cover


def lower_bound(cover: Cover) -> int:
    """Rows that any array needs at least: the most admissible combinations that some t factors have.

    Without dependences and constraints this is the product of the t largest numbers of levels.
    """
    return max((int(flags.sum()) for flags in cover.values()), default=0)


class _Greedy:
    def __init__(
        self, blocks: Sequence[FactorBlock], level_counts: Sequence[int], varied: Sequence[int], missing: Cover
    ) -> None:
        self._blocks = blocks
        self._places = {f: (b, k) for b, block in enumerate(blocks) for k, f in enumerate(block.factors)}
        self._level_counts = level_counts
        self._varied = varied
        self._missing = {combo: flags.copy() for combo, flags in missing.items()}
        self._left = {combo: int(flags.sum()) for combo, flags in missing.items()}
        self._strength = len(next(iter(missing))) if missing else 0
        self._used = [np.zeros(n, dtype=np.int64) for n in level_counts]
        self._rows = 0

    def next_row(self) -> list[int] | None:
        """The next row; None where nothing is missing any more."""
        combos = sorted((combo for combo in self._left if self._left[combo]), key=lambda combo: -self._left[combo])
        if not combos and self._rows:
            return None
        weight = self._weights()
        best: tuple[int, list[int]] = (-1, [])
        for c in range(CANDIDATES if combos else 1):
            candidate = _Candidate(self._blocks, self._places)
            gain = 0
            if combos:
                combo = combos[c % min(len(combos), CANDIDATES)]
                places = np.flatnonzero(self._missing[combo])
                # Spread over what is missing, by a stride that is not a divisor of usual numbers of levels.
                place = places[(c * 7919 + self._rows * 104729) % len(places)]
                for factor, level in zip(combo, np.unravel_index(place, self._missing[combo].shape), strict=True):
                    candidate.take(factor, int(level))
                gain = 1
            gain += self._fill(candidate, weight, c)
            if gain > best[0]:
                best = gain, candidate.row()
        self._cover(best[1])
        return best[1]

    def _weights(self) -> dict[int, NDArray[np.int64]]:
        """Return the number of missing tuples that each level of each factor is in."""
        weight = {f: np.zeros(self._level_counts[f], dtype=np.int64) for f in self._varied}
        for combo, flags in self._missing.items():
            if self._left[combo]:
                for axis, factor in enumerate(combo):
                    others = tuple(a for a in range(len(combo)) if a != axis)
                    weight[factor] += flags.sum(axis=others)
        return weight

    def _fill(self, candidate: "_Candidate", weight: dict[int, NDArray[np.int64]], turn: int) -> int:
        """Give every other factor a level; return the number of newly covered tuples."""
        # Shuffled by the one method of `Random` whose numbers Python promises to keep.
        chance = Random(self._rows * CANDIDATES + turn)
        open_factors = sorted((f for f in self._varied if f not in candidate.levels), key=lambda f: chance.random())
        total = 0
        for factor in open_factors:
            allowed = candidate.allowed(factor, self._level_counts[factor])
            gains = np.zeros(self._level_counts[factor], dtype=np.int64)
            for others in itertools.combinations(sorted(candidate.levels.keys() & weight.keys()), self._strength - 1):
                combo = tuple(sorted((*others, factor)))
                if self._left[combo]:
                    place = tuple(slice(None) if f == factor else candidate.levels[f] for f in combo)
                    gains += self._missing[combo][place]
            # First what it adds now, then what it could still add, then what was taken least; and another in turn.
            n = len(gains)
            order = np.lexsort(
                ((np.arange(n) + turn + self._rows) % n, self._used[factor], -weight[factor], -gains, ~allowed)
            )
            level = int(order[0])
            total += int(gains[level])
            candidate.take(factor, level)
        return total

    def _cover(self, row: Sequence[int]) -> None:
        self._rows += 1
        for combo, flags in self._missing.items():
            place = tuple(row[f] for f in combo)
            if flags[place]:
                flags[place] = False
                self._left[combo] -= 1
        for factor, level in enumerate(row):
            self._used[factor][level] += 1


class _Candidate:
    """A row that grows; every step leaves at least one row of each block's table."""

    def __init__(self, blocks: Sequence[FactorBlock], places: Mapping[int, tuple[int, int]]) -> None:
        self.levels: dict[int, int] = {}
        self._blocks = blocks
        self._places = places
        self._live = [block.table for block in blocks]

    def take(self, factor: int, level: int) -> None:
        b, column = self._places[factor]
        self.levels[factor] = level
        self._live[b] = self._live[b][self._live[b][:, column] == level]

    def allowed(self, factor: int, n: int) -> NDArray[np.bool_]:
        b, column = self._places[factor]
        return np.bincount(self._live[b][:, column], minlength=n) > 0

    def row(self) -> list[int]:
        first = {
            f: n
            for block, live in zip(self._blocks, self._live, strict=True)
            for f, n in zip(block.factors, live[0].tolist(), strict=True)
        }
        return [level for _, level in sorted({**first, **self.levels}.items())]
