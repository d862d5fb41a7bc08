"""The report and the tables in the store: their keys, and what an edited campaign need not make again."""

import hashlib
import importlib.metadata
import inspect
import json
import logging
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import pyarrow as pa

from vastflow.flows.request.asked import SEARCH, SEQUENTIAL
from vastflow.flows.request.configurations import Runs
from vastflow.flows.results.campaign_tables import LOGS_FILE
from vastflow.flows.results.directory import WRITER
from vastflow.flows.results.summary import OutcomeTally
from vastflow.flows.results.tables import TablePart
from vastflow.oracles.evidence.rates import Counts
from vastflow.oracles.judgement.oracle import Oracle
from vastflow.oracles.page.work_section import with_work
from vastflow.producers.instantiation.instantiate import Instantiation
from vastflow.producers.model.configuration import Configuration
from vastflow.sim.model.digest import FileContent, Value, digest
from vastflow.tasks.engine.shards import chunks
from vastflow.tasks.keys.keys import Keys
from vastflow.tasks.keys.source import SourceTree, folders_of
from vastflow.tasks.store.artifact import inside
from vastflow.tasks.store.source_files import SourceFiles
from vastflow.tasks.store.store import Lost, Store, StoreError

REPORT_SOURCE: Final = ("vastflow.flows.results.results", "vastflow.oracles.page.report")
"""What writes a campaign directory, and what makes a report of it."""

_PACKAGES: Final = ("vastflow.flows.request", "vastflow.flows.results")
"""What of the flows they import."""
_DATA: Final = "vastflow.oracles"
_PAGE: Final = (".css", ".j2", ".js")
"""Package with the report's template, and how the names of its files end."""
REPORT_LIBRARIES: Final = ("jinja2", "markupsafe", "matplotlib")


def written_by() -> tuple[Path, ...]:
    """Folders with the code and the templates that make tables and reports."""
    return tuple(folders_of((*_PACKAGES, _DATA)).values())


def report_key(
    keys: Keys,
    tree: SourceTree,
    campaign: bytes,
    metadata: Mapping[str, Any],
    instantiation: Instantiation,
    contents: Iterable[Sequence[Any]],
    runs: Runs,
    oracles: Sequence[Oracle[Any]],
) -> str:
    """Key under which the store has the report of a campaign without faults.

    Args:
        campaign: The campaign file.
        metadata: What `metadata.json` says; of it what is the same for every call with these results.
        contents: Of each configuration that is no duplicate, in order: the keys of its verdicts, which follow from its scenario,
            its recordings and the oracles' code and parameters, and what is in them.
        runs: Of each configuration; `metadata` has the rule, where they ended by one.
        oracles: Those that judged, in order. The report has their docstrings, which are in no digest of their code.
    """
    hashed = hashlib.sha256()
    same = {name: metadata[name] for name in ("name", "vastflow", "versions", "notes", "robots")}
    same["selection"] = [metadata.get("asked", {}).get("only"), instantiation.sampled_from]
    if SEQUENTIAL in metadata:
        same[SEQUENTIAL] = metadata[SEQUENTIAL]
    if SEARCH in metadata:
        same[SEARCH] = metadata[SEARCH]
    libraries = {name: importlib.metadata.version(name) for name in REPORT_LIBRARIES}
    said = [[oracle.name, inspect.getdoc(type(oracle))] for oracle in oracles]
    for part in (
        [same, libraries, hashlib.sha256(campaign).hexdigest(), runs, said],
        *(
            (c.name, c.family, c.scenario.digest, c.duplicate_of, c.factors, c.provenance)
            for c in instantiation.configurations
        ),
        *([(s.producer, s.keys, s.choice) for s in c.steps] for c in instantiation.configurations),
        *((r.family, r.parent, r.producer, r.reason, r.requested, r.inputs) for r in instantiation.rejections),
        *((e.family, e.name, e.constraint, e.values) for e in instantiation.excluded),
        instantiation.coverage,
        *contents,
    ):
        hashed.update(_text(part).encode() + b"\n")
    source = [tree.with_packages(*_PACKAGES).digest(*REPORT_SOURCE), tree.data_digest(_DATA, _PAGE)]
    return keys.report(source, hashed.hexdigest())


def _plain(value: object) -> Any:
    if isinstance(value, FileContent):
        return {"file": value.digest}
    if isinstance(value, Mapping):
        return dict(value)
    if isinstance(value, Sequence):
        return list(value)
    raise TypeError(f"{type(value).__name__} is no value of a configuration")


_text: Final = json.JSONEncoder(separators=(",", ":"), default=_plain).encode


LOGGER: Final = logging.getLogger("vastflow.results")

PART_SOURCE: Final = "vastflow.flows.results.tables"
"""What makes a part, with all that it imports."""

LEAST: Final = 8
"""Configurations of a part that is kept: fewer are made as soon as found."""

_MOST_PARTS: Final = 64
_PART: Final = "part"
_RUNS: Final = "runs.arrow"
_VERDICTS: Final = "verdicts.arrow"
_BEHAVIORS: Final = "behaviors.arrow"
_LOGS: Final = "logs"


def parts_of(configurations: Sequence[Configuration]) -> list[Sequence[Configuration]]:
    """Configurations that are no duplicates, cut at places that their content chooses: an edit changes one part, or two."""
    cuts = chunks([each.scenario.digest for each in configurations], _MOST_PARTS)
    return [configurations[cut.start : cut.stop] for cut in cuts]


def part_source(tree: SourceTree) -> str:
    """Digest of the code that makes parts, and of the libraries that it uses."""
    return tree.with_packages(*_PACKAGES).digest(PART_SOURCE)


@dataclass(frozen=True, slots=True)
class KeptParts:
    """Where the store has the parts of a campaign's tables, or would have them.

    Attributes:
        source: See `part_source`.
        contents: Of each configuration the keys of its verdicts, which follow from its scenario, its recordings and the oracles'
            code and parameters, and what is in them.
    """

    store: Store
    keys: Keys
    source: str
    contents: Mapping[str, Sequence[str]]

    def key(self, configurations: Sequence[Configuration], runs: Sequence[int], oracles: Sequence[str]) -> str:
        """Key of the part of some configurations.

        Args:
            runs: Of each.
            oracles: Their names, in order.
        """
        of_each: Value = [
            [wanted, *self.contents[each.name]] for each, wanted in zip(configurations, runs, strict=True)
        ]
        return self.keys.report([_PART, self.source], digest(list(oracles), of_each))

    def restore(self, key: str) -> tuple[TablePart, frozenset[str]] | None:
        """The part under a key, and the digests of its run logs as they were; None where there is none that can be read."""
        artifact = self.store.find(key)
        if artifact is None:
            return None
        try:
            tables = {name: _table(self.store.load(artifact, name)) for name in artifact.files}
            part = TablePart(
                tables[_RUNS],
                tables[_VERDICTS],
                tables.get(_BEHAVIORS),
                [(runs, verdicts, behaviors) for runs, verdicts, behaviors in artifact.info["lengths"]],
                _tally(artifact.info),
            )
            return part, frozenset(artifact.info.get(_LOGS, ()))
        except Lost:  # it is gone now, and made again
            return None

    def keep(self, key: str, part: TablePart, logs: Collection[str]) -> None:
        """Keep a part. A store that does not take it costs the next call time, no more.

        Args:
            logs: Digests of its run logs, which were read whole.
        """
        tables = {_RUNS: part.runs, _VERDICTS: part.verdicts, _BEHAVIORS: part.behaviors}
        files = {name: _content(table) for name, table in tables.items() if table is not None}
        info = {"lengths": [list(each) for each in part.lengths], _LOGS: sorted(logs), **asdict(part.tally)}
        try:
            if self.keys.sources is not None:
                self.keys.sources.check_since_start(written_by())
            self.store.put(key, files, info)
        except StoreError as error:
            LOGGER.warning("rows of tables are not kept for the next time: %s", error)


def _tally(info: Mapping[str, Any]) -> OutcomeTally:
    by_oracle = {name: Counts(**each) for name, each in info["by_oracle"].items()}
    return OutcomeTally(Counts(**info["counts"]), by_oracle, info["stood_still"])


def _content(table: pa.Table) -> bytes:
    stream = pa.BufferOutputStream()
    with pa.ipc.new_stream(stream, table.schema, options=pa.ipc.IpcWriteOptions(compression="zstd")) as writer:
        writer.write_table(table)
    content: bytes = stream.getvalue().to_pybytes()
    return content


def _table(content: bytes) -> pa.Table:
    return pa.ipc.open_stream(content).read_all()


REPORT: Final = "report.html"

_RUN_LOGS: Final = "runs.jsonl"
_OTHERS: Final = frozenset(
    {
        *("metadata.json", "campaign.vast", WRITER),
        *("inputs", "environments", "recordings", "traces", "outputs", "logs"),
    }
)
"""What of a campaign directory is a call's own, or a configuration's."""


@dataclass(frozen=True, slots=True)
class Restored:
    """What a kept report says of its campaign, and what it could not give back.

    Attributes:
        logs: Whether the run logs came with it.
    """

    tally: OutcomeTally
    logs: bool


@dataclass(frozen=True, slots=True)
class KeptReport:
    """The place of a campaign's report in the store.

    Attributes:
        key: See `vastflow.flows.results.cached_report.report_key`.
        sources: The source files of which its source digest is.
        parts: Where parts of its tables are; None where none is kept.
    """

    store: Store
    key: str
    sources: SourceFiles | None = None
    parts: KeptParts | None = None

    def restore(self, place: Path) -> Restored | None:
        """Write everything into a campaign directory, the facts of an earlier call in the report; None if it is not kept."""
        artifact = self.store.find(self.key)
        if artifact is None:
            return None
        said = artifact.info
        try:
            contents = {str(file): self.store.load(artifact, name) for name, file in said["places"].items()}
            by_oracle = {name: Counts(**each) for name, each in said["by_oracle"].items()}
            tally = OutcomeTally(Counts(**said["counts"]), by_oracle, said["stood_still"])
        except Lost:  # it is gone now, and made again
            return None
        if not _OTHERS.isdisjoint(Path(file.casefold()).parts[0] for file in contents):
            self.store.discard(self.key, "it has files that no report has")
            return None
        for name, content in contents.items():
            file = inside(place, name)
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(content)
        logs = self.store.beside(self.key, _RUN_LOGS)
        if logs is not None:
            (place / LOGS_FILE).parent.mkdir(exist_ok=True)
            (place / LOGS_FILE).write_bytes(logs)
        return Restored(tally, logs is not None)

    def keep(self, place: Path, tally: OutcomeTally, parts: Sequence[str]) -> None:
        """Keep what was written into a campaign directory. A store that does not take it costs the next call time, no more.

        Args:
            parts: Keys of the parts of its tables.
        """
        files = sorted(file for entry in place.iterdir() if entry.name not in _OTHERS for file in _files(entry))
        places = {file.relative_to(place).as_posix().replace("/", "-"): file for file in files}
        info: dict[str, Any] = {
            "places": {name: file.relative_to(place).as_posix() for name, file in places.items()},
            "parts": list(parts),
            **asdict(tally),
        }
        logs = place / LOGS_FILE
        sidecar = {_RUN_LOGS: logs.read_bytes()} if logs.is_file() else {}
        try:
            if self.sources is not None:
                self.sources.check_since_start(written_by())
            self.store.put(self.key, {name: file.read_bytes() for name, file in places.items()}, info, sidecar)
        except StoreError as error:
            LOGGER.warning("the report is not kept for the next time: %s", error)


def renew_work(place: Path, metadata: Mapping[str, Any]) -> None:
    """Let a report that was kept say the facts of this call.

    Args:
        metadata: `metadata.json` as it is by now.
    """
    report = place / REPORT
    if report.is_file():
        report.write_text(with_work(report.read_text(encoding="utf-8"), metadata), encoding="utf-8")


def _files(entry: Path) -> Iterable[Path]:
    return (file for file in entry.rglob("*") if file.is_file()) if entry.is_dir() else (entry,)
