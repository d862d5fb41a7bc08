"""Parts of tables that are kept in the store: after an edit only those are made anew that have a configuration it reaches."""

import logging
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final

import pyarrow as pa

from vastflow.flows.results.report_key import written_by
from vastflow.flows.results.summary import OutcomeTally
from vastflow.flows.results.table_part import TablePart
from vastflow.oracles.evidence.rates import Counts
from vastflow.producers.model.configuration import Configuration
from vastflow.sim.model.digest import Value, digest
from vastflow.tasks.keys import Keys
from vastflow.tasks.shards import chunks
from vastflow.tasks.source import SourceTree
from vastflow.tasks.store import Lost, Store, StoreError

LOGGER: Final = logging.getLogger("vastflow.results")

PART_SOURCE: Final = "vastflow.flows.results.table_part"
"""What makes a part, with all that it imports."""

LEAST: Final = 8
"""Configurations of a part that is kept: fewer are made as soon as found."""

_MOST_PARTS: Final = 64
_PACKAGES: Final = ("vastflow.flows.request", "vastflow.flows.results")
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
