"""A part of a campaign's tables: the rows of configurations next to each other, which are the same in each campaign that has them.

The configurations' names are not in it: a value more in a campaign file renames what comes after it, and changes no row.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import pyarrow as pa

from vastflow.flows.results.found import Found, complete
from vastflow.flows.results.summary import OutcomeTally
from vastflow.flows.results.tables import (
    JUDGED_RUNS,
    VERDICTS,
    column_array,
    run_columns,
    texts,
    verdict_columns,
)
from vastflow.oracles.directory.behaviors import CONFIGURATION
from vastflow.oracles.evidence.rates import Counts
from vastflow.oracles.verdict import Judgement, Verdict, run_judgement
from vastflow.producers.model.configuration import Configuration
from vastflow.sim.model.archive import behaviors_below, read_behaviors
from vastflow.sim.model.blocks import read_rows

_NAMES: Final = ("configuration", "family")


@dataclass(frozen=True, eq=False)
class TablePart:
    """Rows of some configurations, in their order.

    Attributes:
        runs, verdicts: As in the campaign's tables, less what the configurations are called.
        behaviors: None where no run has any.
        lengths: Of each configuration the number of its rows in these three.
    """

    runs: pa.Table
    verdicts: pa.Table
    behaviors: pa.Table | None
    lengths: Sequence[tuple[int, int, int]]
    tally: OutcomeTally

    def run_rows(self, configurations: Sequence[Configuration]) -> pa.Table:
        """Rows of `runs.parquet`, for configurations that are called so."""
        return _named(self.runs, JUDGED_RUNS, configurations, [length for length, _, _ in self.lengths])

    def verdict_rows(self, configurations: Sequence[Configuration]) -> pa.Table:
        """Rows of `verdicts.parquet`."""
        return _named(self.verdicts, VERDICTS, configurations, [length for _, length, _ in self.lengths])

    def behavior_rows(self, configurations: Sequence[Configuration]) -> pa.Table | None:
        """Rows of `behaviors.parquet`, if there are any."""
        if self.behaviors is None:
            return None
        names = _repeated([each.name for each in configurations], [length for _, _, length in self.lengths])
        return self.behaviors.add_column(0, CONFIGURATION, texts(names))


class PartRows:
    """Rows that become a part once all its configurations were added, so that few recordings are in memory at a time.

    Args:
        oracles: Their names, in order.
    """

    def __init__(self, oracles: Sequence[str]) -> None:
        self._oracles = oracles
        self._runs = _without_names(JUDGED_RUNS)
        self._verdicts = _without_names(VERDICTS)
        self._behaviors: list[pa.Table] = []
        self._lengths: list[tuple[int, int, int]] = []
        self._together: Counter[Judgement] = Counter()
        self._by_oracle: dict[str, Counter[Judgement]] = {oracle: Counter() for oracle in oracles}
        self._stood_still = 0

    def add(self, configuration: Configuration, found: Found, runs: int) -> None:
        """Add what was found of a configuration's first `runs` runs."""
        rows = {row["run_index"]: row for block in found.recordings for row in read_rows(block)}
        wanted = [rows[index] for index in sorted(rows) if index < runs]
        causes = found.causes
        columns = {**run_columns(configuration, wanted), "cause": [causes.get(row["run_index"]) for row in wanted]}
        for name, values in self._runs.items():
            values += columns[name]
        self._stood_still += sum(cause is not None for cause in columns["stood_still"])
        verdicts = complete(found, runs, self._oracles)
        said = verdict_columns(configuration, verdicts)
        for name, values in self._verdicts.items():
            values += said[name]
        self._count(verdicts)
        self._lengths.append((len(wanted), len(verdicts), self._add_behaviors(found, runs)))

    def part(self) -> TablePart:
        """All that was added."""
        behaviors = pa.concat_tables(self._behaviors).combine_chunks() if self._behaviors else None
        by_oracle = {oracle: _counts(counter) for oracle, counter in self._by_oracle.items()}
        tally = OutcomeTally(_counts(self._together), by_oracle, self._stood_still)
        return TablePart(
            _table(JUDGED_RUNS, self._runs), _table(VERDICTS, self._verdicts), behaviors, self._lengths, tally
        )

    def _count(self, verdicts: Sequence[Verdict]) -> None:
        """Count verdicts on every run, those on one run after another."""
        oracles = len(self._oracles)
        for verdict in verdicts:
            self._by_oracle[verdict.oracle][verdict.judgement] += 1
        for first in range(0, len(verdicts), oracles):
            self._together[run_judgement(each.judgement for each in verdicts[first : first + oracles])] += 1

    def _add_behaviors(self, found: Found, runs: int) -> int:
        blocks = found.behaviors
        table = read_behaviors(blocks[0]) if found.exact and blocks else behaviors_below(blocks, runs)
        if table is None:
            return 0
        self._behaviors.append(table)
        return int(table.num_rows)


def _without_names(schema: pa.Schema) -> dict[str, list[Any]]:
    return {name: [] for name in schema.names if name not in _NAMES}


def _table(schema: pa.Schema, columns: Mapping[str, Sequence[Any]]) -> pa.Table:
    kinds = pa.schema([schema.field(name) for name in columns])
    return pa.Table.from_arrays([column_array(columns[each.name], each.type) for each in kinds], schema=kinds)


def _named(
    rows: pa.Table, schema: pa.Schema, configurations: Sequence[Configuration], lengths: Sequence[int]
) -> pa.Table:
    names = _repeated([each.name for each in configurations], lengths)
    families = _repeated([each.family for each in configurations], lengths)
    columns = dict(zip(_NAMES, (texts(names), texts(families)), strict=True))
    return pa.Table.from_arrays(
        [columns[name] if name in columns else rows[name] for name in schema.names], schema=schema
    )


def _repeated(values: Sequence[str], lengths: Sequence[int]) -> list[str]:
    return [value for value, length in zip(values, lengths, strict=True) for _ in range(length)]


def _counts(counter: Mapping[Judgement, int]) -> Counts:
    return Counts(counter.get("pass", 0), counter.get("fail", 0), counter.get("not judged", 0))
