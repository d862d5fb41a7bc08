"""The tables of a campaign's runs, written part by part, so that few runs are in memory at a time."""

import hashlib
import json
from collections.abc import Container, Sequence
from contextlib import ExitStack
from functools import cached_property
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Final, Self

import pyarrow as pa
import pyarrow.parquet as pq

from vastflow.flows.results.summary import OutcomeTally
from vastflow.flows.results.tables import TablePart, configuration_row, exclusion_row, rejection_row
from vastflow.oracles.evidence.rates import pooled
from vastflow.oracles.results.behaviors import BEHAVIORS_FILE
from vastflow.oracles.results.schema import (
    CONFIGURATIONS,
    EXCLUSIONS,
    JUDGED_RUNS,
    REJECTIONS,
    VERDICTS,
    TableWriter,
    write_table,
)
from vastflow.producers.instantiation.instantiate import Instantiation
from vastflow.producers.model.configuration import Configuration
from vastflow.sim.model.files import read_json

LOGS_FILE: Final = "logs/runs.jsonl"
"""A line for each block of runs: `configuration`, where and with what they were executed, and `runs`."""

_BEHAVIORS_A_GROUP: Final = 1 << 16


class CampaignTables:
    """Writes `runs.parquet`, `verdicts.parquet` and `behaviors.parquet` into a campaign directory, and counts.

    Args:
        oracles: Names of the oracles, in order.
    """

    def __init__(self, place: Path, oracles: Sequence[str]) -> None:
        self._oracles = oracles
        self._tallies: list[OutcomeTally] = []
        self._open = ExitStack()
        self._run_rows = self._open.enter_context(TableWriter(place / "runs.parquet", JUDGED_RUNS))
        self._verdict_rows = self._open.enter_context(TableWriter(place / "verdicts.parquet", VERDICTS))
        self._behaviors = self._open.enter_context(_BehaviorWriter(place / BEHAVIORS_FILE))

    @property
    def tally(self) -> OutcomeTally:
        """Of the runs that were added."""
        return OutcomeTally(
            pooled(each.counts for each in self._tallies),
            {oracle: pooled(each.by_oracle[oracle] for each in self._tallies) for oracle in self._oracles},
            sum(each.stood_still for each in self._tallies),
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._open.__exit__(kind, error, traceback)

    def add(self, configurations: Sequence[Configuration], part: TablePart) -> None:
        """Write the rows of some configurations; to be called in their order."""
        self._run_rows.add(part.run_rows(configurations))
        self._verdict_rows.add(part.verdict_rows(configurations))
        if (behaviors := part.behavior_rows(configurations)) is not None:
            self._behaviors.add(behaviors)
        self._tallies.append(part.tally)


class RunLogs:
    """Writes the run logs of a campaign directory."""

    def __init__(self, place: Path) -> None:
        self._place = place
        self._file: IO[bytes] | None = None

    def add(self, configuration: str, logs: Sequence[bytes], known: Container[str] = ()) -> set[str]:
        """Write the logs of a configuration's blocks; what is none, for nothing vouches for them, is left out.

        Args:
            known: Digests of logs that were read whole before, which takes most of the time.

        Returns:
            Digests of the logs that were written.
        """
        sound = set()
        for log in logs:
            hashed = hashlib.sha256(log).hexdigest()
            if hashed not in known and not _is_log(log):
                continue
            sound.add(hashed)
            block = b"".join(line.strip() for line in log.splitlines())  # JSON has no line break within a text
            line = b'{"configuration": %b, %b\n' % (json.dumps(configuration).encode(), block[1:])
            if self._file is None:
                (self._place / LOGS_FILE).parent.mkdir(exist_ok=True)
                self._file = open(self._place / LOGS_FILE, "wb")  # noqa: SIM115 - closed by `close`
            self._file.write(line)
        return sound

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
    """Reads `logs/runs.jsonl`, or a file for each configuration as earlier versions wrote them.

    Reading raises `OSError` or `ValueError` where the file is damaged.
    """

    def __init__(self, directory: Path) -> None:
        self._directory = directory

    def of(self, configuration: str) -> list[dict[str, Any]]:
        """The log of each of a configuration's runs, in order, with the block's host and versions; empty without any."""
        own = self._directory / "logs" / f"{configuration}.json"
        if own.is_file():
            rows: list[dict[str, Any]] = read_json(own)
            return rows
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
