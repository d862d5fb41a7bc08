"""Verdicts: what `judge` gives. Keys are in memory, the rest is in the store."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import pyarrow as pa

from vastflow.flows.results.found import StoredResult, complete
from vastflow.flows.results.tables import verdict_columns
from vastflow.flows.stages.configurations import Configurations, faults_text
from vastflow.flows.stages.traces import Traces
from vastflow.flows.terminal.words import count_text
from vastflow.oracles.evidence.rates import Counts, counts_of
from vastflow.oracles.judgement.verdict import Verdict, run_judgement
from vastflow.oracles.results.schema import VERDICTS as COLUMNS
from vastflow.oracles.results.schema import column_table
from vastflow.tasks.engine.engine import RunFault
from vastflow.tasks.keys.keys import Keys
from vastflow.tasks.store.artifact import Stored

METRICS: Final = pa.schema(
    {
        "configuration": pa.string(),
        "family": pa.string(),
        "run_index": pa.int32(),
        "oracle": pa.string(),
        "metric": pa.string(),
        "value": pa.float64(),
        "unit": pa.string(),
    }
)


@dataclass(frozen=True, repr=False)
class Verdicts:
    """The verdicts on a campaign's runs.

    Attributes:
        traces: What was judged.
        oracles: Names of the oracles, `success` first.
        keys: Of the code that judged, and of the oracles with their parameters.
        blocks: Name of a configuration that is no duplicate to what is in the store of it.
        faults: Why runs are not judged, those of recordings and traces included.
    """

    traces: Traces
    oracles: tuple[str, ...]
    keys: Keys = field(repr=False)
    blocks: Mapping[str, tuple[Stored, ...]] = field(repr=False)
    faults: tuple[RunFault, ...] = ()

    @property
    def configurations(self) -> Configurations:
        """The executed configurations."""
        return self.traces.configurations

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the configurations, duplicates included."""
        return self.configurations.names

    def __repr__(self) -> str:
        size = f"{count_text(len(self.blocks), 'configuration')} × {count_text(self.traces.recordings.runs, 'run')}"
        said = f"judged by {', '.join(self.oracles)}"
        return f"<{self.configurations.opened.name}: {size}, {said}{faults_text(self.faults)}>"

    def of(self, name: str) -> list[Verdict]:
        """A verdict for each run that was asked for and each oracle: run by run, oracles in their order.

        What a fault kept from being judged is `not judged`, with the fault as its reason.

        Raises:
            UserError: there is none of this name.
            Lost: something is no longer in the store or damaged; `judge` computes it again.
        """
        own = self.configurations.executed_as(name).name
        faults = [fault for fault in self.faults if fault.configuration in ("", own)]
        runs = self.traces.recordings.runs
        found = StoredResult(self.configurations.opened.store, self.blocks[own], runs, faults)
        return complete(found, runs, self.oracles)

    def counts(self, oracle: str | None = None) -> dict[str, Counts]:
        """Configuration that is no duplicate to how often its runs passed and failed, with rate and interval.

        Args:
            oracle: One of `oracles`; None for what all of them together say of a run.

        Raises:
            ValueError: no such oracle judged.
            Lost: as `of`.
        """
        if oracle is not None and oracle not in self.oracles:
            raise ValueError(f"no oracle {oracle!r}; those that judged: {', '.join(self.oracles)}")
        counts = {}
        for name in self.blocks:
            said: dict[int, list[Verdict]] = {}
            for verdict in self.of(name):
                if oracle in (None, verdict.oracle):
                    said.setdefault(verdict.run_index, []).append(verdict)
            counts[name] = counts_of(run_judgement(each.judgement for each in run) for run in said.values())
        return counts

    def table(self) -> pa.Table:
        """A row for each run and oracle, as `verdicts.parquet` of a campaign directory.

        Raises:
            Lost: as `of`.
        """
        return column_table(
            COLUMNS, (verdict_columns(self.configurations[name], self.of(name)) for name in self.blocks)
        )

    def metrics(self) -> pa.Table:
        """A row for each run, oracle and metric; a value that could not be had is null.

        Raises:
            Lost: as `of`.
        """
        rows = [
            {
                "configuration": name,
                "family": self.configurations[name].family,
                "run_index": verdict.run_index,
                "oracle": verdict.oracle,
                "metric": key,
                "value": metric.value,
                "unit": metric.unit,
            }
            for name in self.blocks
            for verdict in self.of(name)
            for key, metric in verdict.metrics.items()
        ]
        return pa.Table.from_pylist(rows, schema=METRICS)
