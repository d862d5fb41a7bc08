"""Rows: what the tables of a campaign directory say of consecutive configurations, made from artifacts or kept in the store."""

import io
import json
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from operator import itemgetter
from pathlib import Path
from typing import Final

import pyarrow as pa

from vastflow.flows.results.current_report import source_digest
from vastflow.oracles.judgment.verdict import Judgment, Verdict, metrics_text, read_verdicts, run_judgment
from vastflow.oracles.observation.trace import levelled
from vastflow.oracles.results.schema import (
    CONFIGURATION,
    JUDGED_RUNS,
    RUNS,
    VERDICTS,
    Columns,
    Row,
    column_table,
    texts,
)
from vastflow.producers.model.configuration import Configuration
from vastflow.sim.loop.standstill import STOOD_STILL
from vastflow.sim.model.archive import behaviors_below, read_behaviors
from vastflow.sim.model.blocks import read_block, read_rows, write_block
from vastflow.sim.model.digest import digest
from vastflow.sim.model.files import Unreadable, read_bytes
from vastflow.tasks.engine.engine import RunFault
from vastflow.tasks.engine.work import BEHAVIORS, OUTPUTS, RECORDINGS, RUN_LOG, TRACES
from vastflow.tasks.engine.work import VERDICTS as VERDICTS_FILE
from vastflow.tasks.store.artifact import Artifact, Lost, Stored, entry_of
from vastflow.tasks.store.store import Store

FAULT: Final = "fault"
"""Prefix of the reason of a missing verdict."""
_COPIED: Final = [name for name in RUNS.names if name not in ("configuration", "family", "contacts", "stood_still")]
_COPIED_OF: Final = itemgetter(*_COPIED)


class StoredResult:
    """Stored artifacts of a configuration, read on demand; reading raises `Lost` where something is damaged.

    Args:
        copies: Earlier copies of files in their campaign directory, which are read instead where their content is the same.
    """

    def __init__(
        self,
        store: Store,
        stored: Sequence[Stored],
        runs: int,
        faults: Sequence[RunFault],
        copies: Mapping[str, Path] | None = None,
    ) -> None:
        self.faults = faults
        self.exact = len(stored) == 1 and stored[0].block.stop <= runs
        self._store = store
        self._stored = stored
        self._copies = copies or {}

    def _read(self, artifact: Artifact, name: str) -> bytes:
        if (copy := self._copies.get(name)) is not None:
            with suppress(Unreadable):
                content = read_bytes(copy, most_bytes=artifact.files[name].size)
                if entry_of(content) == artifact.files[name]:
                    return content
        return self._store.load(artifact, name)

    @property
    def identity(self) -> Sequence[str] | None:
        """Keys and content digests behind its rows; None where something is missing or broken."""
        if self.faults or not all(each.verdicts for each in self._stored):
            return None
        pairs = [(each.block, each.verdicts) for each in self._stored if each.verdicts]
        return [f"{block.key} {block.content} {judged.key} {judged.content}" for block, judged in pairs]

    @cached_property
    def recordings(self) -> Sequence[bytes]:
        """Blocks of recordings."""
        return [self._read(each.recordings, RECORDINGS) for each in self._stored]

    @property
    def traces(self) -> Sequence[bytes]:
        """Blocks of traces."""
        return [self._read(each.trace, TRACES) for each in self._stored if each.trace]

    @property
    def verdicts(self) -> Sequence[Verdict]:
        """Verdicts on any runs, in any order."""
        contents = (self._store.load(each.verdicts, VERDICTS_FILE) for each in self._stored if each.verdicts)
        return [verdict for content in contents for verdict in read_verdicts(content)]

    @property
    def causes(self) -> Mapping[int, str]:
        """Run index to the cause of its failure, see `vastflow.oracles.judgment.cause`."""
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
        return [self._read(recordings, OUTPUTS) for recordings in having]

    @property
    def logs(self) -> Sequence[bytes]:
        """Run logs, as `vastflow.tasks.engine.work` writes them."""
        found = (self._store.beside(each.recordings.key, RUN_LOG) for each in self._stored)
        return [log for log in found if log]


def copies_in(directory: Path, configuration: str) -> dict[str, Path]:
    """Return where a campaign directory has copies of files of the store, by their names there."""
    return {
        RECORDINGS: directory / "recordings" / f"{configuration}.parquet",
        TRACES: directory / "traces" / f"{configuration}.parquet",
        OUTPUTS: directory / "outputs" / f"{configuration}.zip",
    }


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
        **{name: [getattr(each, name) for each in verdicts] for name in ("run_index", "oracle", "judgment", "reason")},
        "metrics": [metrics_text(verdict.metrics) for verdict in verdicts],
    }


@dataclass(frozen=True, eq=False)
class Rows:
    """Rows of consecutive configurations, for the tables of a campaign directory.

    Attributes:
        logs: A line for each block of runs, see `vastflow.flows.results.tables.LOGS_FILE`.
        counted: Number of runs by oracle and what it says of them; oracle None is all together.
        stood_still: Number of failed runs whose robot was sent and never moved.
    """

    runs: pa.Table
    verdicts: pa.Table
    behaviors: pa.Table | None
    logs: bytes
    counted: Mapping[tuple[str | None, Judgment], int]
    stood_still: int
    faults: Sequence[RunFault] = ()


def rows_of(
    results: Iterable[tuple[Configuration, StoredResult]], runs: Mapping[str, int], oracles: Sequence[str]
) -> Rows:
    """Make the rows of the first `runs` runs of each configuration; few results are in memory at a time."""
    run_parts, verdict_parts, behaviors = [], [], []
    logs: list[bytes] = []
    counted: Counter[tuple[str | None, Judgment]] = Counter()
    faults: list[RunFault] = []
    stood_still = 0
    for configuration, found in results:
        wanted_runs = runs[configuration.name]
        by_index = {row["run_index"]: row for block in found.recordings for row in read_rows(block)}
        wanted = [by_index[index] for index in sorted(by_index) if index < wanted_runs]
        causes = found.causes
        columns = {**run_columns(configuration, wanted), "cause": [causes.get(row["run_index"]) for row in wanted]}
        stood_still += sum(cause is not None for cause in columns["stood_still"])
        verdicts = complete(found, wanted_runs, oracles)  # run by run
        counted.update((verdict.oracle, verdict.judgment) for verdict in verdicts)
        for first in range(0, len(verdicts), len(oracles)):
            together = run_judgment(each.judgment for each in verdicts[first : first + len(oracles)])
            counted[None, together] += 1
        run_parts.append(columns)
        verdict_parts.append(verdict_columns(configuration, verdicts))
        blocks = found.behaviors
        own = read_behaviors(blocks[0]) if found.exact and blocks else behaviors_below(blocks, wanted_runs)
        if own is not None:
            behaviors.append(own.add_column(0, CONFIGURATION, texts([configuration.name] * own.num_rows)))
        logs += _log_lines(configuration.name, found.logs)
        faults += found.faults
    return Rows(
        column_table(JUDGED_RUNS, run_parts),
        column_table(VERDICTS, verdict_parts),
        pa.concat_tables(behaviors).combine_chunks() if behaviors else None,
        b"".join(logs),
        counted,
        stood_still,
        faults,
    )


def _log_lines(configuration: str, logs: Iterable[bytes]) -> Iterator[bytes]:
    """Yield a line for each block of runs; leave out damaged ones, which no digest covers."""
    for log in logs:
        try:
            if not isinstance(json.loads(log)["runs"], list):
                continue
        except (ValueError, LookupError, TypeError):
            continue
        block = b"".join(line.strip() for line in log.splitlines())  # JSON has no line break within a text
        yield b'{"configuration": %b, %b\n' % (json.dumps(configuration).encode(), block[1:])


_CUT: Final = "08"
"""A part ends with a scenario whose digest is less, one of 32: an edit moves no cut but those beside it."""
_MOST: Final = 64


def parts(configurations: Iterable[Configuration]) -> Iterator[list[Configuration]]:
    """Cut configurations into parts of some 30, whose rows are kept together."""
    part: list[Configuration] = []
    for configuration in configurations:
        part.append(configuration)
        if len(part) == _MOST or configuration.scenario.digest < _CUT:
            yield part
            part = []
    if part:
        yield part


_RUNS: Final = "runs.arrow"
_VERDICTS: Final = "verdicts.arrow"
_LOGS: Final = "logs.jsonl"


class KeptRows:
    """Rows in the store, by all that they follow from.

    Attributes:
        keys: Keys that were asked for, in order; None if a part has none.
    """

    def __init__(self, store: Store, oracles: Sequence[str]) -> None:
        self.keys: list[str] | None = []
        self._store = store
        self._made_by = [source_digest(), pa.__version__, list(oracles)]

    def key(self, part: Iterable[tuple[Configuration, StoredResult, int]]) -> str | None:
        """Key of the rows of a part; None if something of it is missing or broken."""
        content = [[each.name, each.family, runs, found.identity] for each, found, runs in part]
        if any(each[-1] is None for each in content):
            self.keys = None
            return None
        hashed = digest(self._made_by, content)
        key = f"rows/{hashed[:2]}/{hashed}"
        if self.keys is not None:
            self.keys.append(key)
        return key

    def find(self, key: str) -> Rows | None:
        """Return the rows of a key, if they are there undamaged."""
        if (artifact := self._store.find(key)) is None:
            return None
        try:
            files = {name: self._store.load(artifact, name) for name in {_RUNS, _VERDICTS, *artifact.files}}
        except Lost:
            return None
        hashed, _, logs = (self._store.beside(key, _LOGS) or b"").partition(b"\n")
        if entry_of(logs).sha256.encode() != hashed:
            return None
        options = pa.ipc.IpcReadOptions(use_threads=False)  # to wake them takes longer than to read
        tables = {name: pa.ipc.open_stream(content, options=options).read_all() for name, content in files.items()}
        counted = {(oracle, judgment): count for oracle, judgment, count in artifact.info["counted"]}
        stood_still = artifact.info["stood_still"]
        return Rows(tables[_RUNS], tables[_VERDICTS], tables.get(BEHAVIORS), logs, counted, stood_still)

    def put(self, key: str, rows: Rows) -> None:
        """Keep the rows of a part."""
        files = {_RUNS: _stream(rows.runs), _VERDICTS: _stream(rows.verdicts)}
        if rows.behaviors is not None:
            files[BEHAVIORS] = _stream(rows.behaviors)
        counted = [[oracle, judgment, count] for (oracle, judgment), count in rows.counted.items()]
        # Times and hosts of runs follow from no key, so they are beside the artifact, with their own digest.
        logs = entry_of(rows.logs).sha256.encode() + b"\n" + rows.logs
        self._store.put(key, files, {"counted": counted, "stood_still": rows.stood_still}, {_LOGS: logs})


def _stream(table: pa.Table) -> bytes:
    out = io.BytesIO()
    with pa.ipc.new_stream(out, table.schema, options=pa.ipc.IpcWriteOptions(compression="lz4")) as stream:
        stream.write_table(table)
    return out.getvalue()
