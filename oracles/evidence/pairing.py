"""Pairing: which runs of two campaigns belong together."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from vastflow.oracles.results.column import integers, texts
from vastflow.oracles.results.tables import Tables
from vastflow.oracles.results.verdict_table import ABSENT, FAIL, NOT_JUDGED, PASS
from vastflow.oracles.statistics.comparison import Pairs

How: TypeAlias = Literal["equal", "other system"]

_RUNS: Final = 1 << 31


@dataclass(frozen=True, slots=True)
class Match:
    """A configuration of each campaign; `how` says whether they are equal or differ in their system."""

    before: str
    after: str
    how: How


@dataclass(frozen=True, eq=False)
class Pairing:
    """The runs that two campaigns have in common.

    Attributes:
        matches: Configurations that were paired, in the order of the later campaign.
        only_before, only_after: Names of configurations without a counterpart.
        ambiguous: Names, of the later campaign, of configurations that have several counterparts and no reason for one of them.
        oracles: That judged both campaigns; pairs are judged by these alone.
        lonely_before, lonely_after: Runs of paired configurations whose seed the other has not run or not recorded.
        block: (M,) number of each match's block, see `blocks_of`.
        configuration: (P,) index into `matches`.
        run_before, run_after: (P,) run index.
        said_before, said_after: (P, oracles) codes of judgements.
    """

    matches: tuple[Match, ...]
    only_before: tuple[str, ...]
    only_after: tuple[str, ...]
    ambiguous: tuple[str, ...]
    oracles: tuple[str, ...]
    lonely_before: int
    lonely_after: int
    block: NDArray[np.int64] = field(repr=False)
    configuration: NDArray[np.int64] = field(repr=False)
    run_before: NDArray[np.int64] = field(repr=False)
    run_after: NDArray[np.int64] = field(repr=False)
    said_before: NDArray[np.int8] = field(repr=False)
    said_after: NDArray[np.int8] = field(repr=False)

    def judged(self, oracle: str | None) -> tuple[NDArray[np.int8], NDArray[np.int8]]:
        """(P,) what one oracle, or all that judged both together, said before and after."""
        if oracle is None:
            return _together(self.said_before), _together(self.said_after)
        k = self.oracles.index(oracle)
        return self.said_before[:, k], self.said_after[:, k]

    @property
    def unpaired(self) -> str:
        """How many configurations and runs have no counterpart, in words; empty where all have."""
        found = (
            (len(self.only_before), "configuration", "only in A"),
            (len(self.only_after), "configuration", "only in B"),
            (len(self.ambiguous), "configuration", "in B with several counterparts in A"),
            (self.lonely_before, "run", "of A with a seed that B has not"),
            (self.lonely_after, "run", "of B with a seed that A has not"),
        )
        return ", ".join(f"{n:,} {noun}{'' if n == 1 else 's'} {where}" for n, noun, where in found if n)

    def no_longer_judged(self, oracle: str | None = None) -> int:
        """Pairs that were judged before and not after."""
        before, after = self.judged(oracle)
        return int(((before < NOT_JUDGED) & (after >= NOT_JUDGED)).sum())

    def pairs(self, oracle: str | None = None) -> Pairs:
        """The pairs that were judged in both campaigns."""
        before, after = self.judged(oracle)
        both = (before < NOT_JUDGED) & (after < NOT_JUDGED)
        chosen = self.configuration[both]
        return Pairs(chosen, before[both] == PASS, after[both] == PASS, self.block[chosen])


def pairing_of(before: Tables, after: Tables) -> Pairing:
    """Pair configurations, and their runs by seed.

    Configurations belong together where their scenarios are equal; else, where the system alone is another: environment, task and
    abstract scenario are equal, and the two are the only ones of that content that are left on both sides, or have one name. The
    seed of a run depends on environment, task, run index and the campaign's `execution.seed`, so that runs of one seed meet the
    same noise. Duplicates stand for the configuration that was run.
    """
    matches, ambiguous = _matches(before, after)
    oracles = tuple(name for name in after.oracles if name in before.oracles)
    sides = [_Runs(tables, oracles) for tables in (before, after)]
    rows: list[tuple[int, int, int, int, int]] = []
    lonely = [0, 0]
    for k, match in enumerate(matches):
        then, now = sides[0].seeds.get(match.before, {}), sides[1].seeds.get(match.after, {})
        common = [seed for seed in then if seed in now]
        lonely[0] += len(then) - len(common)
        lonely[1] += len(now) - len(common)
        for seed in common:
            at, place = sides[0].place(match.before, then[seed]), sides[1].place(match.after, now[seed])
            if at is not None and place is not None:
                rows.append((k, then[seed], now[seed], at, place))
    table = np.array(rows, dtype=np.int64).reshape(-1, 5)
    return Pairing(
        matches=tuple(matches),
        only_before=_others(before, {match.before for match in matches}),
        only_after=_others(after, {match.after for match in matches} | {*ambiguous}),
        ambiguous=tuple(ambiguous),
        oracles=oracles,
        lonely_before=lonely[0],
        lonely_after=lonely[1],
        block=np.array([after.blocks[match.after] for match in matches], dtype=np.int64),
        configuration=table[:, 0],
        run_before=table[:, 1],
        run_after=table[:, 2],
        said_before=sides[0].said[table[:, 3]],
        said_after=sides[1].said[table[:, 4]],
    )


def _others(tables: Tables, names: set[str]) -> tuple[str, ...]:
    found = tables.configurations
    return tuple(found.names[k] for k in found.distinct.tolist() if found.names[k] not in names)


class _Runs:
    """The runs of one campaign, by configuration and seed."""

    def __init__(self, tables: Tables, oracles: Sequence[str]) -> None:
        self.seeds: dict[str, dict[str, int]] = {}
        columns = (
            texts(tables.runs["configuration"]),
            texts(tables.runs["seed"]),
            integers(tables.runs["run_index"]).tolist(),
        )
        for name, seed, run_index in zip(*columns, strict=True):
            self.seeds.setdefault(name, {})[seed] = run_index
        verdicts = tables.verdicts
        self._numbers = {name: k for k, name in enumerate(verdicts.names)}
        self._keys = verdicts.configuration * _RUNS + verdicts.run_index
        self.said = verdicts.judgements[:, [verdicts.oracles.index(name) for name in oracles]]

    def place(self, name: str, run_index: int) -> int | None:
        """Row of a run in `said`; None where no oracle said anything."""
        key = self._numbers[name] * _RUNS + run_index
        at = int(np.searchsorted(self._keys, key))
        return at if at < len(self._keys) and self._keys[at] == key else None


def _matches(before: Tables, after: Tables) -> tuple[list[Match], list[str]]:
    then, now = _distinct(before), _distinct(after)
    by_digest = {row.digest: row.name for row in then}
    found: dict[str, Match] = {}
    for row in now:
        if row.digest in by_digest:
            found[row.name] = Match(by_digest[row.digest], row.name, "equal")
    taken = {match.before for match in found.values()}
    left_then, left_now = (
        _grouped([row for row in then if row.name not in taken]),
        _grouped([r for r in now if r.name not in found]),
    )
    ambiguous = []
    for content, rows in left_now.items():
        candidates = left_then.get(content, [])
        named = {row.name for row in candidates} & {row.name for row in rows}
        for row in rows:
            if row.name in named:
                found[row.name] = Match(row.name, row.name, "other system")
        rest, others = ([row for row in side if row.name not in named] for side in (rows, candidates))
        if len(rest) == len(others) == 1:
            found[rest[0].name] = Match(others[0].name, rest[0].name, "other system")
        elif others:
            ambiguous += [row.name for row in rest]
    return [found[row.name] for row in now if row.name in found], ambiguous


@dataclass(frozen=True, slots=True)
class _Row:
    name: str
    digest: str
    content: str


def _distinct(tables: Tables) -> list[_Row]:
    found = tables.configurations
    digests, abstracts = texts(found.table["scenario_digest"]), texts(found.table["abstract"])
    return [_Row(found.names[k], digests[k], _test(abstracts[k], found.contents[k])) for k in found.distinct.tolist()]


def _test(abstract: str, content: Mapping[str, object]) -> str:
    """What is tested: a scenario without its system, be that a robot's parameters or programs."""
    return json.dumps([abstract, content.get("environment"), content.get("task")], sort_keys=True)


def _grouped(rows: Sequence[_Row]) -> dict[str, list[_Row]]:
    groups: dict[str, list[_Row]] = {}
    for row in rows:
        groups.setdefault(row.content, []).append(row)
    return groups


def _together(said: NDArray[np.int8]) -> NDArray[np.int8]:
    """(P,) as `run_judgement` has it."""
    passed = ((said == PASS) | (said == ABSENT)).all(axis=1) & (said == PASS).any(axis=1)
    return np.where((said == FAIL).any(axis=1), FAIL, np.where(passed, PASS, NOT_JUDGED)).astype(np.int8)
