"""Recordings: what `execute` gives, and what `observe` takes. Keys and digests are in memory, the rest is in the store."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import pyarrow as pa

from vastflow.flows.results.found import StoredResult
from vastflow.flows.results.tables import run_columns
from vastflow.flows.stages.configurations import Configurations, faults_text
from vastflow.flows.terminal.words import count_text
from vastflow.oracles.results.schema import RUNS, column_table
from vastflow.sim.model.blocks import read_rows
from vastflow.tasks.engine.engine import RunFault
from vastflow.tasks.keys.keys import Keys
from vastflow.tasks.store.artifact import Stored

if TYPE_CHECKING:
    from vastflow.sim.model.recording import Recording


@dataclass(frozen=True, repr=False)
class Recordings:
    """The recordings of a campaign's runs.

    Attributes:
        configurations: Those that were executed.
        runs: Asked for of each: run indices 0 to runs - 1.
        keys: Of the code that executed them.
        blocks: Name of a configuration that is no duplicate to what is in the store of it.
        faults: Why runs are missing.
    """

    configurations: Configurations
    runs: int
    keys: Keys = field(repr=False)
    blocks: Mapping[str, tuple[Stored, ...]] = field(repr=False)
    faults: tuple[RunFault, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the configurations, duplicates included."""
        return self.configurations.names

    def __repr__(self) -> str:
        recorded = sum(
            len({run for each in blocks for run in range(each.block.start, min(each.block.stop, self.runs))})
            for blocks in self.blocks.values()
        )
        size = f"{count_text(len(self.blocks), 'configuration')} × {count_text(self.runs, 'run')}"
        return f"<{self.configurations.opened.name}: {size}, {recorded} recorded{faults_text(self.faults)}>"

    def of(self, name: str) -> "list[Recording]":
        """The recordings of a configuration's runs in order, read from the store.

        Raises:
            UserError: there is none of this name.
            Lost: something is no longer in the store or damaged; `execute` computes it again.
        """
        from vastflow.sim.model.archive import columns_of, read_behaviors, read_outputs
        from vastflow.sim.model.blocks import read_recordings
        from vastflow.sim.model.recording import Outputs

        stored = self.stored(self.configurations.executed_as(name).name)
        written = {index: each for block in stored.outputs for index, each in read_outputs(block).items()}
        found = {}
        for block, behavior in zip(stored.recordings, stored.behaviors, strict=True):
            behaviors = columns_of(read_behaviors(behavior))
            for recording in read_recordings(block):
                index = recording.run.run_index
                own = {key: column[behaviors["run_index"] == index] for key, column in behaviors.items()}
                del own["run_index"]
                found[index] = replace(recording, behaviors=own, outputs=written.get(index, Outputs()))
        return [found[index] for index in sorted(found) if index < self.runs]

    def table(self) -> pa.Table:
        """Return a row for each recorded run, as in `runs.parquet` but without causes.

        Raises:
            Lost: as `of`.
        """
        return column_table(RUNS, (run_columns(self.configurations[name], self._rows(name)) for name in self.blocks))

    def stored(self, name: str) -> StoredResult:
        """Return the stored artifacts of a distinct configuration."""
        return StoredResult(self.configurations.opened.store, self.blocks[name], self.runs, self.faults)

    def _rows(self, name: str) -> list[dict[str, Any]]:
        """Rows of a configuration's wanted runs, in order."""
        found = {row["run_index"]: row for block in self.stored(name).recordings for row in read_rows(block)}
        return [found[index] for index in sorted(found) if index < self.runs]
