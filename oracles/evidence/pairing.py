"""Pairing: which runs of two campaigns belong together."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from vastflow.oracles.results.column import texts
from vastflow.oracles.results.tables import Tables
from vastflow.oracles.results.verdict_table import ABSENT, FAIL, NOT_JUDGED, PASS
from vastflow.oracles.statistics.comparison import Pairs

if TYPE_CHECKING:
    import pandas as pd

How: TypeAlias = Literal["equal", "other system"]


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
    then, now = (
        _runs(before, [match.before for match in matches]),
        _runs(after, [match.after for match in matches]),
    )
    common = then.merge(now, on=["match", "seed"], suffixes=("_before", "_after"))
    paired = common.dropna(subset=["row_before", "row_after"]).sort_values("match", kind="stable")
    return Pairing(
        matches=tuple(matches),
        only_before=_others(before, {match.before for match in matches}),
        only_after=_others(after, {match.after for match in matches} | {*ambiguous}),
        ambiguous=tuple(ambiguous),
        oracles=oracles,
        lonely_before=len(then) - len(common),
        lonely_after=len(now) - len(common),
        block=np.array([after.blocks[match.after] for match in matches], dtype=np.int64),
        configuration=paired["match"].to_numpy(np.int64),
        run_before=paired["run_index_before"].to_numpy(np.int64),
        run_after=paired["run_index_after"].to_numpy(np.int64),
        said_before=_said(before, oracles)[paired["row_before"].to_numpy(np.int64)],
        said_after=_said(after, oracles)[paired["row_after"].to_numpy(np.int64)],
    )


def _others(tables: Tables, names: set[str]) -> tuple[str, ...]:
    found = tables.configurations
    return tuple(found.names[k] for k in found.distinct.tolist() if found.names[k] not in names)


def _runs(tables: Tables, matched: Sequence[str]) -> "pd.DataFrame":
    """The runs of matched configurations: `match`, `seed`, `run_index`, and the `row` of their verdicts, NaN where there are none."""
    import pandas as pd  # takes a third of a second

    verdicts, keys = tables.verdicts, ["configuration", "run_index"]
    runs = tables.runs.select([*keys, "seed"]).to_pandas().drop_duplicates(["configuration", "seed"], keep="last")
    judged = pd.DataFrame(
        {
            keys[0]: np.array(verdicts.names, dtype=object)[verdicts.configuration],
            keys[1]: verdicts.run_index,
            "row": range(len(verdicts)),
        }
    )
    known = pd.DataFrame({keys[0]: matched, "match": range(len(matched))})
    return runs.merge(known, on=keys[0]).merge(judged, how="left", on=keys)


def _said(tables: Tables, oracles: Sequence[str]) -> NDArray[np.int8]:
    """(R, oracles) codes of judgements."""
    return tables.verdicts.judgements[:, [tables.oracles.index(name) for name in oracles]]


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
