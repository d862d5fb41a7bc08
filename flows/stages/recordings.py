"""Recordings: what `execute` gives, and what `observe` takes. Keys and digests are in memory, the rest is in the store."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import pyarrow as pa

from vastflow.flows.results.tables import run_columns
from vastflow.flows.stages.configurations import Configurations, faults_text
from vastflow.flows.terminal.words import count_text
from vastflow.oracles.results.schema import RUNS, column_table
from vastflow.sim.model.blocks import read_rows
from vastflow.tasks.engine.engine import RunFault
from vastflow.tasks.engine.work import BEHAVIORS, OUTPUTS, RECORDINGS
from vastflow.tasks.keys.keys import Keys
from vastflow.tasks.store.artifact import Block
from vastflow.tasks.store.store import Lost, Store

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
    blocks: Mapping[str, tuple[Block, ...]] = field(repr=False)
    faults: tuple[RunFault, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the configurations, duplicates included."""
        return self.configurations.names

    def __repr__(self) -> str:
        recorded = sum(
            len({run for block in blocks for run in range(block.start, min(block.stop, self.runs))})
            for blocks in self.blocks.values()
        )
        size = f"{count_text(len(self.blocks), 'configuration')} × {count_text(self.runs, 'run')}"
        return f"<{self.configurations.opened.name}: {size}, {recorded} recorded{faults_text(self.faults)}>"

    def of(self, name: str) -> "list[Recording]":
        """The recordings of a configuration's runs in order, read from the store.

        Raises:
            UnknownConfiguration: there is none of this name.
            Lost: something is no longer in the store or damaged; `execute` computes it again.
        """
        from vastflow.sim.model.archive import columns_of, read_behaviors, read_outputs
        from vastflow.sim.model.blocks import read_recordings
        from vastflow.sim.model.recording import Outputs

        store = self.configurations.opened.store
        found = {}
        for block in self.blocks[self.configurations.executed_as(name).name]:
            behaviors = columns_of(read_behaviors(store.read(block.key, BEHAVIORS)))
            written = read_outputs(outputs) if (outputs := outputs_of(store, block)) else {}
            for recording in read_recordings(store.read(block.key, RECORDINGS)):
                index = recording.run.run_index
                own = {key: column[behaviors["run_index"] == index] for key, column in behaviors.items()}
                del own["run_index"]
                found[index] = replace(recording, behaviors=own, outputs=written.get(index, Outputs()))
        return [found[index] for index in sorted(found) if index < self.runs]

    def table(self) -> pa.Table:
        """A row for each run that was recorded, as `runs.parquet` of a campaign directory but for causes; reads every block's rows.

        Raises:
            Lost: as `of`.
        """
        return column_table(RUNS, (run_columns(self.configurations[name], self._rows(name)) for name in self.blocks))

    def _rows(self, name: str) -> list[dict[str, Any]]:
        """Rows of a configuration's wanted runs, in order."""
        store = self.configurations.opened.store
        blocks = (store.read(block.key, RECORDINGS) for block in self.blocks[name])
        found = {row["run_index"]: row for block in blocks for row in read_rows(block)}
        return [found[index] for index in sorted(found) if index < self.runs]


def outputs_of(store: Store, block: Block) -> bytes | None:
    """What the programs of a block's runs wrote, as `vastflow.sim.model.archive` has it; None where they wrote nothing.

    Raises:
        Lost: the block is no longer in the store, or damaged.
    """
    artifact = store.find(block.key)
    if artifact is None:
        raise Lost(f"{block.key} is not in the store")
    return store.load(artifact, OUTPUTS) if OUTPUTS in artifact.files else None
