"""Pairing of the runs of two campaigns."""

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from vastflow.oracles.results.schema import read_columns
from vastflow.oracles.results.tables import NOT_JUDGED, PASS, Tables, together
from vastflow.oracles.statistics.comparison import Pairs

if TYPE_CHECKING:
    import pandas as pd

How: TypeAlias = Literal["equal", "other system"]


@dataclass(frozen=True, slots=True)
class Match:
    """A configuration of each campaign, equal or with another system."""

    before: str
    after: str
    how: How


@dataclass(frozen=True, eq=False)
class Pairing:
    """The runs that two campaigns have in common.

    Attributes:
        matches: Paired configurations, in the order of the later campaign.
        only_before, only_after: Names of configurations without a counterpart.
        ambiguous: Names in the later campaign of configurations with several possible counterparts.
        oracles: Oracles of both campaigns, which judge the pairs.
        lonely_before, lonely_after: Runs of paired configurations whose seed the other campaign lacks.
        other_seeds: Number of lonely runs up to the other's last run of the configuration: it has their numbers, with other seeds.
        block: (M,) unit of each match, see `Units`.
        configuration: (P,) index into `matches`.
        seed: (P,) equal numbers for pairs of one seed.
        run_before, run_after: (P,) run index.
        row_before, row_after: (P,) row in each campaign's table of verdicts.
        said_before, said_after: (P, oracles) codes of judgments.
    """

    matches: tuple[Match, ...]
    only_before: tuple[str, ...]
    only_after: tuple[str, ...]
    ambiguous: tuple[str, ...]
    oracles: tuple[str, ...]
    lonely_before: int
    lonely_after: int
    other_seeds: int
    block: NDArray[np.int64] = field(repr=False)
    configuration: NDArray[np.int64] = field(repr=False)
    seed: NDArray[np.int64] = field(repr=False)
    run_before: NDArray[np.int64] = field(repr=False)
    run_after: NDArray[np.int64] = field(repr=False)
    row_before: NDArray[np.int64] = field(repr=False)
    row_after: NDArray[np.int64] = field(repr=False)
    said_before: NDArray[np.int8] = field(repr=False)
    said_after: NDArray[np.int8] = field(repr=False)

    def judged(self, oracle: str | None) -> tuple[NDArray[np.int8], NDArray[np.int8]]:
        """Judgments (P,) before and after, by one oracle or by all of them together."""
        if oracle is None:
            return together(self.said_before), together(self.said_after)
        k = self.oracles.index(oracle)
        return self.said_before[:, k], self.said_after[:, k]

    @property
    def unpaired(self) -> str:
        """Words for configurations and runs without a counterpart; may be empty."""
        found = (
            (len(self.only_before), "configuration", "only in A"),
            (len(self.only_after), "configuration", "only in B"),
            (len(self.ambiguous), "configuration", "in B with several counterparts in A"),
            (self.lonely_before, "run", "of A with a seed that B has not"),
            (self.lonely_after, "run", "of B with a seed that A has not"),
        )
        return _counted(found)

    @property
    def refused(self) -> str:
        """Words for what is unpaired and could hide a loss, with its remedy; may be empty."""
        found = (
            (len(self.only_before), "configuration", "only in A (run a baseline with B's configurations)"),
            (len(self.ambiguous), "configuration", "in B with several counterparts in A (keep their names)"),
            (self.other_seeds, "run", "with other seeds (give both campaigns one `execution.seed`)"),
        )
        return _counted(found)

    def no_longer_judged(self, oracle: str | None = None) -> int:
        before, after = self.judged(oracle)
        return int(((before < NOT_JUDGED) & (after >= NOT_JUDGED)).sum())

    def pairs(self, oracle: str | None = None) -> Pairs:
        before, after = self.judged(oracle)
        both = (before < NOT_JUDGED) & (after < NOT_JUDGED)
        chosen = self.configuration[both]
        return Pairs(chosen, before[both] == PASS, after[both] == PASS, self.block[chosen], self.seed[both])


def pairing_of(before: Tables, after: Tables) -> Pairing:
    """Pair configurations, and their runs by seed.

    Configurations match if their scenarios are equal, or equal without their systems and of one name, or the only ones left with that
    content. Runs of one seed meet the same noise, since it depends on environment, task, run index and `execution.seed`.
    """
    matches, ambiguous = _matches(before, after)
    oracles = tuple(name for name in after.oracles if name in before.oracles)
    then, now = _runs(before, [match.before for match in matches]), _runs(after, [match.after for match in matches])
    said_before, said_after = (
        tables.verdicts.judgments[:, [tables.oracles.index(name) for name in oracles]] for tables in (before, after)
    )
    common = then.merge(now, on=["match", "seed"], suffixes=("_before", "_after"))
    sides = ((then, now, common["run_index_before"]), (now, then, common["run_index_after"]))
    paired = common.dropna(subset=["row_before", "row_after"]).sort_values("match", kind="stable")
    row_before, row_after = (paired[name].to_numpy(np.int64) for name in ("row_before", "row_after"))
    return Pairing(
        matches=tuple(matches),
        only_before=_others(before, {match.before for match in matches}),
        only_after=_others(after, {match.after for match in matches} | {*ambiguous}),
        ambiguous=tuple(ambiguous),
        oracles=oracles,
        lonely_before=len(then) - len(common),
        lonely_after=len(now) - len(common),
        other_seeds=sum(_other_seeds(side, other, common.assign(run_index=index)) for side, other, index in sides),
        block=np.array([after.blocks[match.after] for match in matches], dtype=np.int64),
        configuration=paired["match"].to_numpy(np.int64),
        seed=np.unique(paired["seed"].to_numpy(str), return_inverse=True)[1],
        run_before=paired["run_index_before"].to_numpy(np.int64),
        run_after=paired["run_index_after"].to_numpy(np.int64),
        row_before=row_before,
        row_after=row_after,
        said_before=said_before[row_before],
        said_after=said_after[row_after],
    )


def _counted(found: Iterable[tuple[int, str, str]]) -> str:
    return ", ".join(f"{n:,} {noun}{'' if n == 1 else 's'} {where}" for n, noun, where in found if n)


def _other_seeds(side: "pd.DataFrame", other: "pd.DataFrame", common: "pd.DataFrame") -> int:
    keys = ["match", "run_index"]
    lonely = side[~side.set_index(keys).index.isin(common.set_index(keys).index)]
    return int((lonely["run_index"] <= lonely["match"].map(other.groupby("match")["run_index"].max())).sum())


def _others(tables: Tables, names: set[str]) -> tuple[str, ...]:
    found = tables.configurations
    return tuple(found.names[k] for k in found.distinct.tolist() if found.names[k] not in names)


def _runs(tables: Tables, matched: Sequence[str]) -> "pd.DataFrame":
    """Runs of matched configurations: `match`, `seed`, `run_index`, and `row` of their verdicts or NaN."""
    import pandas as pd  # takes a third of a second

    verdicts, keys = tables.verdicts, ["configuration", "run_index"]
    runs = read_columns(tables.directory / "runs.parquet", "configuration").select([*keys, "seed"]).to_pandas()
    runs = runs.drop_duplicates(["configuration", "seed"], keep="last")
    judged = pd.DataFrame(
        {
            keys[0]: np.array(verdicts.names, dtype=object)[verdicts.configuration],
            keys[1]: verdicts.run_index,
            "row": range(len(verdicts)),
        }
    )
    known = pd.DataFrame({keys[0]: matched, "match": range(len(matched))})
    return runs.merge(known, on=keys[0]).merge(judged, how="left", on=keys)


def _matches(before: Tables, after: Tables) -> tuple[list[Match], list[str]]:
    (digests_then, left_then), (digests_now, left_now) = _distinct(before), _distinct(after)
    names = {digest: name for name, digest in digests_then.items()}
    found = {name: Match(names[digest], name, "equal") for name, digest in digests_now.items() if digest in names}
    taken = {match.before for match in found.values()}
    ambiguous = []
    for content, all_now in left_now.items():
        now = [name for name in all_now if name not in found]
        then = [name for name in left_then.get(content, ()) if name not in taken]
        found |= {name: Match(name, name, "other system") for name in now if name in then}
        rest, others = [name for name in now if name not in then], [name for name in then if name not in now]
        if len(rest) == len(others) == 1:
            found[rest[0]] = Match(others[0], rest[0], "other system")
        elif others:
            ambiguous += rest
    return [found[name] for name in digests_now if name in found], ambiguous


def _distinct(tables: Tables) -> tuple[dict[str, str], dict[str, list[str]]]:
    """Names of configurations to digests, and names by content: the scenario without the system."""
    found = tables.configurations
    known, abstracts = (found.table[column].to_pylist() for column in ("scenario_digest", "abstract"))
    digests, by_content = {}, dict[str, list[str]]()
    for k in found.distinct.tolist():
        digests[found.names[k]], content = known[k], found.contents[k]
        tested = json.dumps([abstracts[k], content.get("environment"), content.get("task")], sort_keys=True)
        by_content.setdefault(tested, []).append(found.names[k])
    return digests, by_content
