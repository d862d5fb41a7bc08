"""The tables of a campaign's runs, written as configurations come in, so that few runs are in memory at a time."""

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import IO, Final, Self

import pyarrow as pa
import pyarrow.parquet as pq

from vastflow.flows.request.members import Runs, runs_of
from vastflow.flows.results.found import Found, complete
from vastflow.flows.results.summary import OutcomeTally
from vastflow.flows.results.tables import (
    CONFIGURATIONS,
    EXCLUSIONS,
    JUDGED_RUNS,
    REJECTIONS,
    VERDICTS,
    TableWriter,
    configuration_row,
    exclusion_row,
    rejection_row,
    run_columns,
    verdict_columns,
    write_table,
)
from vastflow.oracles.directory.behaviors import BEHAVIORS_FILE, CONFIGURATION
from vastflow.oracles.evidence.rates import Counts
from vastflow.oracles.verdict import Judgement, Verdict, run_judgement
from vastflow.producers.configuration import Configuration
from vastflow.producers.instantiate import Instantiation
from vastflow.sim.recordings.behavior_block import behaviors_below, read_behaviors
from vastflow.sim.recordings.blocks import read_rows

LOGS_FILE: Final = "logs/runs.jsonl"
"""A line for each block of runs: `configuration`, where and with what they were executed, and `runs`."""

_BEHAVIORS_A_GROUP: Final = 1 << 16


class CampaignTables:
    """Writes `runs.parquet`, `verdicts.parquet`, `behaviors.parquet` and the run logs into a campaign directory, and counts.

    Args:
        runs: Of each configuration.
        oracles: Names of the oracles, in order.
    """

    def __init__(self, place: Path, runs: Runs, oracles: Sequence[str]) -> None:
        self._runs = runs
        self._oracles = oracles
        self._together: Counter[Judgement] = Counter()
        self._stood_still = 0
        self._by_oracle: dict[str, Counter[Judgement]] = {oracle: Counter() for oracle in oracles}
        self._open = ExitStack()
        self._run_rows = self._open.enter_context(TableWriter(place / "runs.parquet", JUDGED_RUNS))
        self._verdict_rows = self._open.enter_context(TableWriter(place / "verdicts.parquet", VERDICTS))
        self._behaviors = self._open.enter_context(_BehaviorWriter(place / BEHAVIORS_FILE))
        self._logs = RunLogs(place)

    @property
    def tally(self) -> OutcomeTally:
        """Of the runs that were added."""
        by_oracle = {oracle: _counts(counter) for oracle, counter in self._by_oracle.items()}
        return OutcomeTally(_counts(self._together), by_oracle, self._stood_still)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._logs.close()
        self._open.__exit__(kind, error, traceback)

    def add(self, configuration: Configuration, found: Found) -> None:
        """Write what was found of a configuration; to be called in their order."""
        runs = runs_of(self._runs, configuration.name)
        rows = {row["run_index"]: row for block in found.recordings for row in read_rows(block)}
        wanted = [rows[index] for index in sorted(rows) if index < runs]
        columns = run_columns(configuration, wanted)
        causes = found.causes
        self._run_rows.add_columns({**columns, "cause": [causes.get(row["run_index"]) for row in wanted]})
        self._stood_still += sum(cause is not None for cause in columns["stood_still"])
        verdicts = complete(found, runs, self._oracles)
        self._verdict_rows.add_columns(verdict_columns(configuration, verdicts))
        self._count(verdicts)
        self._behaviors.add(configuration.name, found, runs)
        self._logs.add(configuration.name, found.logs)

    def _count(self, verdicts: Sequence[Verdict]) -> None:
        """Count verdicts on every run, those on one run after another."""
        oracles = len(self._oracles)
        for verdict in verdicts:
            self._by_oracle[verdict.oracle][verdict.judgement] += 1
        for first in range(0, len(verdicts), oracles):
            self._together[run_judgement(each.judgement for each in verdicts[first : first + oracles])] += 1


class RunLogs:
    """Writes the run logs of a campaign directory."""

    def __init__(self, place: Path) -> None:
        self._place = place
        self._file: IO[bytes] | None = None

    def add(self, configuration: str, logs: Sequence[bytes]) -> None:
        """Write the logs of a configuration's blocks; what is none, for nothing vouches for them, is left out."""
        for log in logs:
            if not _is_log(log):
                continue
            block = b"".join(line.strip() for line in log.splitlines())  # JSON has no line break within a text
            line = b'{"configuration": %b, %b\n' % (json.dumps(configuration).encode(), block[1:])
            if self._file is None:
                (self._place / LOGS_FILE).parent.mkdir(exist_ok=True)
                self._file = open(self._place / LOGS_FILE, "wb")  # noqa: SIM115 - closed by `close`
            self._file.write(line)

    def close(self) -> None:
        """Write what is left."""
        if self._file is not None:
            self._file.close()


def _is_log(log: bytes) -> bool:
    try:
        found = json.loads(log)
    except ValueError:
        return False
    return isinstance(found, dict) and isinstance(found.get("runs"), list)


class _BehaviorWriter:
    """Writes the behaviors of all configurations under each other, with a column for the configuration before the others."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._tables: list[pa.Table] = []
        self._rows = 0
        self._writer: pq.ParquetWriter | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._flush()
        if self._writer is not None:
            self._writer.close()

    def add(self, configuration: str, found: Found, runs: int) -> None:
        """Add the behaviors of one configuration's wanted runs."""
        blocks = found.behaviors
        table = read_behaviors(blocks[0]) if found.exact and blocks else behaviors_below(blocks, runs)
        if table is None:
            return
        names = pa.repeat(pa.scalar(configuration), table.num_rows)
        self._tables.append(table.add_column(0, CONFIGURATION, names))
        self._rows += table.num_rows
        if self._rows >= _BEHAVIORS_A_GROUP:
            self._flush()

    def _flush(self) -> None:
        if not self._tables:
            return
        whole = pa.concat_tables(self._tables).combine_chunks()
        self._tables, self._rows = [], 0
        if self._writer is None:
            self._writer = pq.ParquetWriter(self._path, whole.schema, compression="zstd")
        self._writer.write_table(whole.cast(self._writer.schema), row_group_size=whole.num_rows or None)


def write_instantiation(place: Path, instantiation: Instantiation) -> None:
    """Write `configurations.parquet`, `rejections.parquet` and `exclusions.parquet`."""
    write_table(place / "configurations.parquet", CONFIGURATIONS, map(configuration_row, instantiation.configurations))
    write_table(place / "rejections.parquet", REJECTIONS, map(rejection_row, instantiation.rejections))
    write_table(place / "exclusions.parquet", EXCLUSIONS, map(exclusion_row, instantiation.excluded))


def _counts(counter: Mapping[Judgement, int]) -> Counts:
    return Counts(counter.get("pass", 0), counter.get("fail", 0), counter.get("not judged", 0))
