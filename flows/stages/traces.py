"""Traces: what `observe` gives, and what `judge` takes. Keys and digests are in memory, the rest is in the store."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import pyarrow as pa

from vastflow.flows.results.found import StoredResult
from vastflow.flows.stages.configurations import Configurations, faults_text
from vastflow.flows.stages.recordings import Recordings
from vastflow.flows.terminal.words import count_text
from vastflow.tasks.engine.engine import RunFault
from vastflow.tasks.keys.keys import Keys
from vastflow.tasks.store.artifact import Stored

if TYPE_CHECKING:
    from vastflow.oracles.observation.trace import Trace


@dataclass(frozen=True, repr=False)
class Traces:
    """The traces of a campaign's runs.

    Attributes:
        recordings: What was observed.
        keys: Of the code that observed them.
        blocks: Name of a configuration that is no duplicate to what is in the store of it.
        faults: Why runs are missing, those of the recordings included.
    """

    recordings: Recordings
    keys: Keys = field(repr=False)
    blocks: Mapping[str, tuple[Stored, ...]] = field(repr=False)
    faults: tuple[RunFault, ...] = ()

    @property
    def configurations(self) -> Configurations:
        """The executed configurations."""
        return self.recordings.configurations

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the configurations, duplicates included."""
        return self.configurations.names

    def __repr__(self) -> str:
        size = f"{count_text(len(self.blocks), 'configuration')} × {count_text(self.recordings.runs, 'run')}"
        return f"<{self.configurations.opened.name}: {size}, observed{faults_text(self.faults)}>"

    def of(self, name: str) -> "list[Trace]":
        """The traces of a configuration's runs in order, read from the store.

        Raises:
            UserError: there is none of this name.
            Lost: something is no longer in the store or damaged; `execute` and `observe` compute it again.
        """
        from vastflow.oracles.observation.trace import trace_of
        from vastflow.sim.model.archive import read_outputs
        from vastflow.sim.model.blocks import read_block, read_recordings
        from vastflow.sim.model.recording import Outputs

        stored = self.stored(self.configurations.executed_as(name).name)
        written = {index: each for block in stored.outputs for index, each in read_outputs(block).items()}
        found = {}
        for block, trace in zip(stored.recordings, stored.traces, strict=True):
            for recording, (row, columns) in zip(read_recordings(block), read_block(trace), strict=True):
                index = recording.run.run_index
                whole = replace(recording, outputs=written.get(index, Outputs()))
                found[index] = trace_of(whole, row, columns)
        return [found[index] for index in sorted(found) if index < self.recordings.runs]

    def stored(self, name: str) -> StoredResult:
        """Return the stored artifacts of a configuration's observed blocks."""
        observed = [each for each in self.blocks[name] if each.trace]
        return StoredResult(self.configurations.opened.store, observed, self.recordings.runs, self.faults)

    def table(self, name: str) -> pa.Table:
        """The signals of a configuration's runs under each other, in SI units, behind a column `run_index`.

        A signal that some run does not have is null there.

        Raises:
            UserError, Lost: as `of`.
        """
        parts = []
        for trace in self.of(name):
            index = pa.array([trace.run.run_index] * len(trace), pa.int32())
            parts.append(pa.table({"run_index": index, **{key: pa.array(trace[key]) for key in trace.columns}}))
        return pa.concat_tables(parts, promote_options="default") if parts else pa.table({})
