"""The tables of a campaign's runs, written part by part, so that few runs are in memory at a time."""

import json
from collections import Counter
from collections.abc import Sequence
from contextlib import ExitStack
from functools import cached_property
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Final, Self

import pyarrow as pa
import pyarrow.parquet as pq

from vastflow.flows.results.found import StoredResult, complete
from vastflow.flows.results.summary import OutcomeTally
from vastflow.flows.results.tables import configuration_row, exclusion_row, rejection_row, run_columns, verdict_columns
from vastflow.oracles.evidence.rates import Counts
from vastflow.oracles.judgement.verdict import Judgement, Verdict, run_judgement
from vastflow.oracles.results.behaviors import BEHAVIORS_FILE, CONFIGURATION
from vastflow.oracles.results.schema import (
    CONFIGURATIONS,
    EXCLUSIONS,
    JUDGED_RUNS,
    REJECTIONS,
    VERDICTS,
    Columns,
    TableWriter,
    column_table,
    texts,
    write_table,
)
from vastflow.producers.instantiation.instantiate import Instantiation
from vastflow.producers.model.configuration import Configuration
from vastflow.sim.model.archive import behaviors_below, read_behaviors
from vastflow.sim.model.blocks import read_rows

LOGS_FILE: Final = "logs/runs.jsonl"
"""A line for each block of runs: `configuration`, where and with what they were executed, and `runs`."""

_BEHAVIORS_A_GROUP: Final = 1 << 16
_CONFIGURATIONS_AT_A_TIME: Final = 64


class CampaignTables:
    """Writes `runs.parquet`, `verdicts.parquet` and `behaviors.parquet` into a campaign directory, and counts.

    Args:
        oracles: Names of the oracles, in order.
    """

    def __init__(self, place: Path, oracles: Sequence[str]) -> None:
        self._oracles = oracles
        self._together: Counter[Judgement] = Counter()
        self._by_oracle: dict[str, Counter[Judgement]] = {oracle: Counter() for oracle in oracles}
        self._stood_still = 0
        self._runs: list[Columns] = []
        self._verdicts: list[Columns] = []
        self._open = ExitStack()
        self._run_rows = self._open.enter_context(TableWriter(place / "runs.parquet", JUDGED_RUNS))
        self._verdict_rows = self._open.enter_context(TableWriter(place / "verdicts.parquet", VERDICTS))
        self._behaviors = self._open.enter_context(_BehaviorWriter(place / BEHAVIORS_FILE))

    @property
    def tally(self) -> OutcomeTally:
        """Outcomes of the added runs."""
        by_oracle = {oracle: _counts(counter) for oracle, counter in self._by_oracle.items()}
        return OutcomeTally(_counts(self._together), by_oracle, self._stood_still)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if kind is None:
            self._flush()
        self._open.__exit__(kind, error, traceback)

    def add(self, configuration: Configuration, found: StoredResult, runs: int) -> None:
        """Add the results of a configuration's first `runs` runs; call in order of configurations."""
        rows = {row["run_index"]: row for block in found.recordings for row in read_rows(block)}
        wanted = [rows[index] for index in sorted(rows) if index < runs]
        causes = found.causes
        columns = {**run_columns(configuration, wanted), "cause": [causes.get(row["run_index"]) for row in wanted]}
        self._stood_still += sum(cause is not None for cause in columns["stood_still"])
        verdicts = complete(found, runs, self._oracles)
        self._count(verdicts)
        self._runs.append(columns)
        self._verdicts.append(verdict_columns(configuration, verdicts))
        if len(self._runs) == _CONFIGURATIONS_AT_A_TIME:
            self._flush()
        blocks = found.behaviors
        behaviors = read_behaviors(blocks[0]) if found.exact and blocks else behaviors_below(blocks, runs)
        if behaviors is not None:
            names = texts([configuration.name] * behaviors.num_rows)
            self._behaviors.add(behaviors.add_column(0, CONFIGURATION, names))

    def _flush(self) -> None:
        self._run_rows.add(column_table(JUDGED_RUNS, self._runs))
        self._verdict_rows.add(column_table(VERDICTS, self._verdicts))
        self._runs, self._verdicts = [], []

    def _count(self, verdicts: Sequence[Verdict]) -> None:
        """Count verdicts on every run, those on one run after another."""
        oracles = len(self._oracles)
        for verdict in verdicts:
            self._by_oracle[verdict.oracle][verdict.judgement] += 1
        for first in range(0, len(verdicts), oracles):
            self._together[run_judgement(each.judgement for each in verdicts[first : first + oracles])] += 1


def _counts(counter: Counter[Judgement]) -> Counts:
    return Counts(counter["pass"], counter["fail"], counter["not judged"])


class RunLogs:
    """Writes the run logs of a campaign directory."""

    def __init__(self, place: Path) -> None:
        self._place = place
        self._file: IO[bytes] | None = None

    def add(self, configuration: str, logs: Sequence[bytes]) -> None:
        """Write the logs of a configuration's blocks; leave out damaged ones, which no digest covers."""
        for log in filter(_is_log, logs):
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

    def add(self, rows: pa.Table) -> None:
        """Add the behaviors of some configurations."""
        self._tables.append(rows)
        self._rows += rows.num_rows
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


class KeptLogs:
    """Reads `logs/runs.jsonl`.

    Reading raises `OSError` or `ValueError` where the file is damaged.
    """

    def __init__(self, directory: Path) -> None:
        self._directory = directory

    def of(self, configuration: str) -> list[dict[str, Any]]:
        """The log of each of a configuration's runs, in order, with the block's host and versions; empty without any."""
        found: dict[int, dict[str, Any]] = {}
        for line in self._lines.get(configuration, ()):
            block = json.loads(line)
            where = {key: value for key, value in block.items() if key not in ("configuration", "runs")}
            found |= {row["run_index"]: {**row, **where} for row in block["runs"]}
        return [found[run_index] for run_index in sorted(found)]

    @cached_property
    def _lines(self) -> dict[str, list[bytes]]:
        """Configuration to the lines of its blocks."""
        found: dict[str, list[bytes]] = {}
        file = self._directory / LOGS_FILE
        if file.is_file():
            for line in file.read_bytes().splitlines():
                found.setdefault(json.loads(line)["configuration"], []).append(line)
        return found
