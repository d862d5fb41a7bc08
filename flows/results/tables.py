"""Rows of the campaign directory's tables: of configurations, of runs, and of verdicts."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from operator import itemgetter
from typing import Any, Final

import pyarrow as pa

from vastflow.flows.results.found import Found, complete
from vastflow.flows.results.summary import OutcomeTally
from vastflow.oracles.evidence.rates import Counts
from vastflow.oracles.judgement.verdict import Judgement, Verdict, metrics_text, run_judgement
from vastflow.oracles.results.behaviors import CONFIGURATION
from vastflow.oracles.results.schema import JUDGED_RUNS, RUNS, VERDICTS, Columns, Row, column_array, json_text, texts
from vastflow.producers.model.configuration import Configuration, ExcludedInstance, RejectedInstance
from vastflow.sim.loop.standstill import STOOD_STILL
from vastflow.sim.model.archive import behaviors_below, read_behaviors
from vastflow.sim.model.blocks import read_rows
from vastflow.sim.model.digest import FileContent, Value
from vastflow.sim.reading.checked import checked_digest


def configuration_row(configuration: Configuration) -> Row:
    """A row of `configurations.parquet`."""
    scenario = configuration.scenario
    content: dict[str, Value] = {
        "environment": scenario.environment,
        "task": scenario.task,
        "system": scenario.system,
    }
    if scenario.programs is not None:
        content["programs"] = scenario.programs.content
    return {
        "name": configuration.name,
        "family": configuration.family,
        "scenario_digest": scenario.digest,
        "checked_digest": checked_digest(scenario),
        "duplicate_of": configuration.duplicate_of,
        "environment": environment_digest(configuration),
        "abstract": scenario.abstract if isinstance(scenario.abstract, str) else json_text(scenario.abstract),
        "timeout_s": scenario.timeout_s,
        "scenario": json_text(content),
        "factors": json_text(configuration.factors),
        "provenance": json_text(configuration.provenance),
        "steps": json_text(
            [{"producer": step.producer, "keys": step.keys, "choice": step.choice} for step in configuration.steps]
        ),
    }


def environment_digest(configuration: Configuration) -> str | None:
    """Digest of the configuration's map, None for a scenario without one."""
    map_file = configuration.scenario.environment.get("map_file")
    return map_file.digest if isinstance(map_file, FileContent) else None


def rejection_row(rejected: RejectedInstance) -> Row:
    """A row of `rejections.parquet`."""
    return {
        "family": rejected.family,
        "parent": rejected.parent,
        "producer": rejected.producer,
        "reason": rejected.reason,
        "requested": json_text(rejected.requested),
        "inputs": json_text(rejected.inputs),
    }


def exclusion_row(excluded: ExcludedInstance) -> Row:
    """A row of `exclusions.parquet`."""
    return {
        "family": excluded.family,
        "name": excluded.name,
        "constraint": excluded.constraint,
        "values": json_text(excluded.values),
    }


def run_columns(configuration: Configuration, runs: Sequence[Row]) -> Columns:
    """Columns of `runs.parquet`, from rows of a configuration's runs in a block."""
    copied = zip(*map(_COPIED_OF, runs), strict=True) if runs else ((),) * len(_COPIED)
    return {
        "configuration": [configuration.name] * len(runs),
        "family": [configuration.family] * len(runs),
        **dict(zip(_COPIED, copied, strict=True)),
        "contacts": [sum(event["kind"] == "contact" for event in run["events"]) for run in runs],
        "stood_still": [
            next((event["what"] for event in run["events"] if event["kind"] == STOOD_STILL), None) for run in runs
        ],
    }


_COPIED: Final = tuple(
    name for name in RUNS.names if name not in ("configuration", "family", "contacts", "stood_still")
)
_COPIED_OF: Final = itemgetter(*_COPIED)


def verdict_columns(configuration: Configuration, verdicts: Sequence[Verdict]) -> Columns:
    """Columns of `verdicts.parquet`."""
    return {
        "configuration": [configuration.name] * len(verdicts),
        "family": [configuration.family] * len(verdicts),
        "run_index": [verdict.run_index for verdict in verdicts],
        "oracle": [verdict.oracle for verdict in verdicts],
        "judgement": [verdict.judgement for verdict in verdicts],
        "reason": [verdict.reason for verdict in verdicts],
        "metrics": [metrics_text(verdict.metrics) for verdict in verdicts],
    }


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
