"""Stored artifacts of one configuration: blocks of its runs, verdicts, logs, and faults."""

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Final

from vastflow.oracles.judgement.verdict import Verdict, read_verdicts
from vastflow.oracles.observation.trace import levelled
from vastflow.sim.model.blocks import read_block, read_rows, write_block
from vastflow.tasks.engine.engine import RunFault
from vastflow.tasks.engine.work import BEHAVIORS, OUTPUTS, RECORDINGS, RUN_LOG, TRACES, VERDICTS
from vastflow.tasks.store.artifact import Stored
from vastflow.tasks.store.store import Store

FAULT: Final = "fault"
"""What the reason of a verdict that is missing begins with."""


class StoredResult:
    """Stored artifacts of a configuration, read on demand.

    Reading raises `vastflow.tasks.store.store.Lost` where something is damaged.

    Args:
        stored: Its blocks.
        runs: Runs that are wanted.
    """

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
        contents = (self._store.load(each.verdicts, VERDICTS) for each in self._stored if each.verdicts)
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
