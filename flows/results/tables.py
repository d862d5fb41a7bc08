"""The tables of a campaign directory: rows of configurations, runs, and verdicts, and the files that hold them."""

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from functools import cached_property
from operator import itemgetter
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Final, Self

import pyarrow as pa
import pyarrow.parquet as pq

from vastflow.oracles.judgement.verdict import Judgement, Verdict, metrics_text, read_verdicts, run_judgement
from vastflow.oracles.observation.trace import levelled
from vastflow.oracles.results.schema import (
    BEHAVIORS_FILE,
    CONFIGURATION,
    CONFIGURATIONS,
    EXCLUSIONS,
    JUDGED_RUNS,
    REJECTIONS,
    RUNS,
    VERDICTS,
    Columns,
    Row,
    TableWriter,
    column_table,
    json_text,
    texts,
    write_table,
)
from vastflow.oracles.statistics.intervals import Counts
from vastflow.producers.instantiation.instantiate import Instantiation
from vastflow.producers.model.configuration import Configuration, ExcludedInstance, RejectedInstance
from vastflow.sim.loop.standstill import STOOD_STILL
from vastflow.sim.model.archive import behaviors_below, read_behaviors
from vastflow.sim.model.blocks import read_block, read_rows, write_block
from vastflow.sim.model.digest import FileContent, Value
from vastflow.sim.reading.checked import checked_digest
from vastflow.tasks.engine.engine import RunFault
from vastflow.tasks.engine.work import BEHAVIORS, OUTPUTS, RECORDINGS, RUN_LOG, TRACES
from vastflow.tasks.engine.work import VERDICTS as VERDICTS_FILE
from vastflow.tasks.store.artifact import Stored
from vastflow.tasks.store.store import Store

FAULT: Final = "fault"
"""Prefix of the reason of a missing verdict."""

LOGS_FILE: Final = "logs/runs.jsonl"
"""A line for each block of runs: `configuration`, where and with what they were executed, and `runs`."""

_BEHAVIORS_A_GROUP: Final = 1 << 16
_CONFIGURATIONS_AT_A_TIME: Final = 64
_COPIED: Final = [name for name in RUNS.names if name not in ("configuration", "family", "contacts", "stood_still")]
_COPIED_OF: Final = itemgetter(*_COPIED)


class StoredResult:
    """Stored artifacts of a configuration, read on demand; reading raises `Lost` where something is damaged."""

    def __init__(self, store: Store, stored: Sequence[Stored], runs: int, faults: Sequence[RunFault]) -> None:
        self.faults = faults
        self.exact = len(stored) == 1 and stored[0].block.stop <= runs
        self._store = store
        self._stored = stored

    @cached_property
    def recordings(self) -> Sequence[bytes]:
        """Blocks of recordings."""
        return [self._store.load(each.recordings, RECORDINGS) for each in self._stored]

    @property
    def traces(self) -> Sequence[bytes]:
        """Blocks of traces."""
        return [self._store.load(each.trace, TRACES) for each in self._stored if each.trace]

    @property
    def verdicts(self) -> Sequence[Verdict]:
        """Verdicts on any runs, in any order."""
        contents = (self._store.load(each.verdicts, VERDICTS_FILE) for each in self._stored if each.verdicts)
        return [verdict for content in contents for verdict in read_verdicts(content)]

    @property
    def causes(self) -> Mapping[int, str]:
        """Run index to the cause of its failure, see `vastflow.oracles.judgement.cause`."""
        judged = (each.verdicts for each in self._stored if each.verdicts)
        return {int(run): str(cause) for verdicts in judged for run, cause in verdicts.info["causes"]}

    @property
    def behaviors(self) -> Sequence[bytes]:
        """Blocks of the scenarios' behaviors, as `vastflow.sim.model.archive` writes them."""
        return [self._store.load(each.recordings, BEHAVIORS) for each in self._stored]

    @property
    def outputs(self) -> Sequence[bytes]:
        """Blocks of the programs' outputs, as `vastflow.sim.model.archive` writes them."""
        having = (each.recordings for each in self._stored if OUTPUTS in each.recordings.files)
        return [self._store.load(recordings, OUTPUTS) for recordings in having]

    @property
    def logs(self) -> Sequence[bytes]:
        """Run logs, as `vastflow.tasks.engine.work` writes them."""
        found = (self._store.beside(each.recordings.key, RUN_LOG) for each in self._stored)
        return [log for log in found if log]


def one_block(blocks: Sequence[bytes], runs: int) -> bytes:
    """All runs below `runs` as one block in order: the same bytes however they were blocked; empty without any."""
    if len(blocks) == 1 and all(row["run_index"] < runs for row in read_rows(blocks[0])):
        return blocks[0]
    found = {row["run_index"]: (row, columns) for block in blocks for row, columns in read_block(block)}
    wanted = [found[index] for index in sorted(found) if index < runs]
    return write_block([row for row, _ in wanted], levelled([columns for _, columns in wanted])) if wanted else b""


def complete(result: StoredResult, runs: int, oracles: Sequence[str]) -> list[Verdict]:
    """Return a verdict for each run and oracle; missing ones are `not judged`, with the fault as reason."""
    said = {(verdict.run_index, verdict.oracle): verdict for verdict in result.verdicts}

    def reason(run: int) -> str:
        fault = next((each for each in result.faults if each.run_index in (None, run)), None)
        return f"{FAULT}: there is no verdict" if fault is None else f"{FAULT} in {fault.stage}: {fault.error}"

    return [
        said.get((run, oracle)) or Verdict(oracle, run, "not judged", reason(run))
        for run in range(runs)
        for oracle in oracles
    ]


def configuration_row(configuration: Configuration) -> Row:
    """A row of `configurations.parquet`."""
    scenario = configuration.scenario
    content: dict[str, Value] = {part: getattr(scenario, part) for part in ("environment", "task", "system")}
    if scenario.programs is not None:
        content["programs"] = scenario.programs.content
    map_file = scenario.environment.get("map_file")
    return {
        "name": configuration.name,
        "family": configuration.family,
        "scenario_digest": scenario.digest,
        "checked_digest": checked_digest(scenario),
        "duplicate_of": configuration.duplicate_of,
        "environment": map_file.digest if isinstance(map_file, FileContent) else None,
        "abstract": scenario.abstract if isinstance(scenario.abstract, str) else json_text(scenario.abstract),
        "timeout_s": scenario.timeout_s,
        "scenario": json_text(content),
        "factors": json_text(configuration.factors),
        "provenance": json_text(configuration.provenance),
        "steps": json_text(
            [{"producer": step.producer, "keys": step.keys, "choice": step.choice} for step in configuration.steps]
        ),
    }


def write_instantiation(place: Path, instantiation: Instantiation) -> None:
    """Write `configurations.parquet`, `rejections.parquet` and `exclusions.parquet`."""
    write_table(place / "configurations.parquet", CONFIGURATIONS, map(configuration_row, instantiation.configurations))
    for name, schema, instances in (
        ("rejections", REJECTIONS, instantiation.rejections),
        ("exclusions", EXCLUSIONS, instantiation.excluded),
    ):
        write_table(place / f"{name}.parquet", schema, (instance_row(each, schema) for each in instances))


def instance_row(instance: RejectedInstance | ExcludedInstance, schema: pa.Schema) -> Row:
    """A row of `rejections.parquet` or `exclusions.parquet`: texts, and everything else as JSON."""
    values = {name: getattr(instance, name) for name in schema.names}
    return {name: value if isinstance(value, str) else json_text(value) for name, value in values.items()}


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


def verdict_columns(configuration: Configuration, verdicts: Sequence[Verdict]) -> Columns:
    """Columns of `verdicts.parquet`."""
    return {
        "configuration": [configuration.name] * len(verdicts),
        "family": [configuration.family] * len(verdicts),
        **{name: [getattr(each, name) for each in verdicts] for name in ("run_index", "oracle", "judgement", "reason")},
        "metrics": [metrics_text(verdict.metrics) for verdict in verdicts],
    }


class RunTables:
    """Writes `runs.parquet`, `verdicts.parquet`, `behaviors.parquet`, and the run logs part by part, and counts.

    Few runs are in memory at a time.

    Attributes:
        stood_still: Number of failed runs whose robot was sent and never moved.
        faults: Of the added configurations.
    """

    def __init__(self, place: Path, oracles: Sequence[str]) -> None:
        self.stood_still = 0
        self.faults: list[RunFault] = []
        self._place = place
        self._oracles = oracles
        self._counted: Counter[tuple[str | None, Judgement]] = Counter()
        self._runs: list[Columns] = []
        self._verdicts: list[Columns] = []
        self._behaviors: list[pa.Table] = []
        self._waiting = 0
        self._open = ExitStack()
        self._run_rows = self._open.enter_context(TableWriter(place / "runs.parquet", JUDGED_RUNS))
        self._verdict_rows = self._open.enter_context(TableWriter(place / "verdicts.parquet", VERDICTS))
        self._behavior_rows: pq.ParquetWriter | None = None
        self._logs: IO[bytes] | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if kind is None:
            self._flush()
            self._flush_behaviors()
        self._open.__exit__(kind, error, traceback)

    def counts(self, oracle: str | None = None) -> Counts:
        """Count the added runs by what one oracle says, or all together."""
        return Counts(*(self._counted[oracle, judgement] for judgement in ("pass", "fail", "not judged")))

    def add(self, configuration: Configuration, found: StoredResult, runs: int) -> None:
        """Add the results of a configuration's first `runs` runs; call in order of configurations."""
        rows = {row["run_index"]: row for block in found.recordings for row in read_rows(block)}
        wanted = [rows[index] for index in sorted(rows) if index < runs]
        causes = found.causes
        columns = {**run_columns(configuration, wanted), "cause": [causes.get(row["run_index"]) for row in wanted]}
        self.stood_still += sum(cause is not None for cause in columns["stood_still"])
        verdicts = complete(found, runs, self._oracles)  # run by run
        self._counted.update((verdict.oracle, verdict.judgement) for verdict in verdicts)
        oracles = len(self._oracles)
        for first in range(0, len(verdicts), oracles):
            together = run_judgement(each.judgement for each in verdicts[first : first + oracles])
            self._counted[None, together] += 1
        self._runs.append(columns)
        self._verdicts.append(verdict_columns(configuration, verdicts))
        if len(self._runs) == _CONFIGURATIONS_AT_A_TIME:
            self._flush()
        blocks = found.behaviors
        behaviors = read_behaviors(blocks[0]) if found.exact and blocks else behaviors_below(blocks, runs)
        if behaviors is not None:
            names = texts([configuration.name] * behaviors.num_rows)
            self._behaviors.append(behaviors.add_column(0, CONFIGURATION, names))
            self._waiting += behaviors.num_rows
            if self._waiting >= _BEHAVIORS_A_GROUP:
                self._flush_behaviors()
        self._add_logs(configuration.name, found.logs)
        self.faults += found.faults

    def _add_logs(self, configuration: str, logs: Sequence[bytes]) -> None:
        """Write the logs of a configuration's blocks; leave out damaged ones, which no digest covers."""
        for log in logs:
            try:
                if not isinstance(json.loads(log)["runs"], list):
                    continue
            except (ValueError, LookupError, TypeError):
                continue
            if self._logs is None:
                (self._place / LOGS_FILE).parent.mkdir(exist_ok=True)
                self._logs = self._open.enter_context(open(self._place / LOGS_FILE, "wb"))  # noqa: SIM115
            block = b"".join(line.strip() for line in log.splitlines())  # JSON has no line break within a text
            self._logs.write(b'{"configuration": %b, %b\n' % (json.dumps(configuration).encode(), block[1:]))

    def _flush(self) -> None:
        self._run_rows.add(column_table(JUDGED_RUNS, self._runs))
        self._verdict_rows.add(column_table(VERDICTS, self._verdicts))
        self._runs, self._verdicts = [], []

    def _flush_behaviors(self) -> None:
        if not self._behaviors:
            return
        whole = pa.concat_tables(self._behaviors).combine_chunks()
        self._behaviors, self._waiting = [], 0
        if self._behavior_rows is None:
            writer = pq.ParquetWriter(self._place / BEHAVIORS_FILE, whole.schema, compression="zstd")
            self._behavior_rows = self._open.enter_context(writer)
        self._behavior_rows.write_table(whole.cast(self._behavior_rows.schema), row_group_size=whole.num_rows or None)


class KeptLogs:
    """Reads `logs/runs.jsonl`; reading raises `OSError` or `ValueError` where the file is damaged."""

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
        found: dict[str, list[bytes]] = {}
        file = self._directory / LOGS_FILE
        if file.is_file():
            for line in file.read_bytes().splitlines():
                found.setdefault(json.loads(line)["configuration"], []).append(line)
        return found
