"""Values of the stages of the Python API. Keys and digests are in memory, everything else is in the store."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from html import escape
from itertools import groupby
from typing import TYPE_CHECKING, Any, Final, TypeVar

import pyarrow as pa

from vastflow.flows.request.campaign_file import OpenCampaign
from vastflow.flows.results.rows import StoredResult, complete, run_columns, verdict_columns
from vastflow.flows.results.tables import configuration_row
from vastflow.flows.terminal.progress import count_text
from vastflow.oracles.judgment.verdict import Verdict, run_judgment
from vastflow.oracles.results.schema import CONFIGURATIONS, RUNS, VERDICTS, Columns, column_table
from vastflow.oracles.statistics.intervals import Counts, counts_of
from vastflow.producers.instantiation.instantiate import Instantiation
from vastflow.producers.model.configuration import Configuration, ExcludedInstance, RejectedInstance
from vastflow.sim.model.blocks import read_rows
from vastflow.sim.model.faults import UserError, message_of
from vastflow.sim.model.names import did_you_mean
from vastflow.tasks.engine.engine import RunFault
from vastflow.tasks.keys.keys import Keys
from vastflow.tasks.store.artifact import Stored

if TYPE_CHECKING:
    from vastflow.oracles.figures.style import Plot
    from vastflow.oracles.observation.trace import Trace
    from vastflow.sim.model.recording import Recording

T = TypeVar("T")
_SHOWN: Final = 20
"""Configurations in a notebook's table."""


@dataclass(frozen=True, repr=False)
class Configurations:
    """The instantiation of a campaign, in memory as a whole.

    Attributes:
        opened: The campaign and its store.
        faults: Producers that raised: what they would have made is missing.
    """

    opened: OpenCampaign = field(repr=False)
    instantiation: Instantiation = field(repr=False)
    faults: tuple[RunFault, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """All names in order, duplicates of other configurations included."""
        return tuple(self._named)

    @property
    def rejections(self) -> tuple[RejectedInstance, ...]:
        """Instances that can't be built, with the reason."""
        return self.instantiation.rejections

    @property
    def excluded(self) -> tuple[ExcludedInstance, ...]:
        """Instances that constraints exclude."""
        return self.instantiation.excluded

    @property
    def coverage(self) -> Mapping[str, Any]:
        """Coverage of the requested test space, in the form of `coverage.json`."""
        return self.instantiation.coverage

    def __repr__(self) -> str:
        lost = f"{len(self.rejections)} instances rejected, {len(self.excluded)} excluded"
        return f"<{self.opened.name}: {count_text(len(self), 'configuration')}, {lost}{faults_text(self.faults)}>"

    def _repr_html_(self) -> str:
        return _html(self, tuple(self))

    def __len__(self) -> int:
        return len(self._named)

    def __iter__(self) -> Iterator[Configuration]:
        return iter(self.instantiation.configurations)

    def __getitem__(self, name: str) -> Configuration:
        """The configuration called `name`; raises `UserError` for an unknown name, as all methods do."""
        if name not in self._named:
            raise UserError(message_of(f"unknown configuration {name!r}", did_you_mean(name, self._named)))
        return self._named[name]

    def executed_as(self, name: str) -> Configuration:
        """The configuration that owns the runs of `name`: an earlier one of equal content, or itself."""
        found = self[name]
        return found if found.duplicate_of is None else self[found.duplicate_of]

    def table(self) -> pa.Table:
        """A row for each configuration, as `configurations.parquet` of a campaign directory."""
        rows = [configuration_row(configuration) for configuration in self]
        return pa.Table.from_pylist(rows, schema=CONFIGURATIONS)

    @cached_property
    def _named(self) -> Mapping[str, Configuration]:
        return {configuration.name: configuration for configuration in self.instantiation.configurations}


def _html(value: object, shown: Sequence[Configuration]) -> str:
    import pandas as pd  # takes a third of a second

    rows = [
        {
            "configuration": each.name,
            "family": each.family,
            **{key: value for key, value in each.factors.items() if isinstance(value, int | float | str)},
        }
        for each in shown[:_SHOWN]
    ]
    more = f"<p>and {len(shown) - _SHOWN:,} more</p>" if len(shown) > _SHOWN else ""
    return f"<p>{escape(repr(value))}</p>{pd.DataFrame(rows).to_html(index=False, na_rep='')}{more}"


def faults_text(faults: Sequence[RunFault]) -> str:
    """Format a number of faults, such as `, 2 faults`; empty for none."""
    return f", {count_text(len(faults), 'fault')}" if faults else ""


METRICS: Final = pa.schema(
    [*list(VERDICTS)[:4], ("metric", pa.string()), ("value", pa.float64()), ("unit", pa.string())]
)


@dataclass(frozen=True, repr=False)
class StageResult:
    """The result of a stage for a campaign's runs.

    Methods that read the store raise `Lost` where something is no longer there or damaged; this stage and those before
    compute it again.

    Attributes:
        configurations: The executed configurations.
        runs: Runs of each: run indices 0 to runs - 1.
        keys: Keys of the code of this stage and those before.
        blocks: Name of a distinct configuration to its stored blocks.
        faults: Faults of this stage and those before.
        ended: Name of a distinct configuration to its runs, where they ended by the file's rule; then `runs` is their most.
    """

    configurations: Configurations
    runs: int
    keys: Keys = field(repr=False)
    blocks: Mapping[str, tuple[Stored, ...]] = field(repr=False)
    faults: tuple[RunFault, ...] = ()
    ended: Mapping[str, int] = field(default_factory=dict, repr=False)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the configurations, duplicates included."""
        return self.configurations.names

    @property
    def said(self) -> str:
        """The state of the runs, for `repr`."""
        return "not executed"

    def runs_of(self, name: str) -> int:
        """Return the number of runs of a distinct configuration."""
        return self.ended.get(name, self.runs)

    def __repr__(self) -> str:
        most = " at most" * bool(self.ended)
        size = f"{count_text(len(self.blocks), 'configuration')} × {count_text(self.runs, 'run')}{most}"
        return f"<{self.configurations.opened.name}: {size}, {self.said}{faults_text(self.faults)}>"

    def _repr_html_(self) -> str:
        return _html(self, [self.configurations[name] for name in self.blocks])

    def stored(self, name: str, observed: bool = False) -> StoredResult:
        """Return the stored artifacts of a distinct configuration; only observed blocks on request."""
        blocks = [each for each in self.blocks[name] if each.trace or not observed]
        faults = [fault for fault in self.faults if fault.configuration in ("", name)]
        return StoredResult(self.configurations.opened.store, blocks, self.runs_of(name), faults)

    def wanted(self, name: str, found: Mapping[int, T]) -> list[T]:
        """Return found runs of a configuration by index, in order, without unwanted ones."""
        runs = self.runs_of(self.configurations.executed_as(name).name)
        return [found[index] for index in sorted(found) if index < runs]


class Recordings(StageResult):
    """The recordings of a campaign's runs."""

    @property
    def said(self) -> str:
        """The number of recorded runs."""
        spans = [(name, each.block) for name, blocks in self.blocks.items() for each in blocks]
        runs = {(name, run) for name, block in spans for run in range(block.start, min(block.stop, self.runs_of(name)))}
        return f"{len(runs)} recorded"

    def of(self, name: str) -> "list[Recording]":
        """The recordings of a configuration's runs in order, read from the store."""
        from vastflow.sim.model.archive import columns_of, read_behaviors

        stored = self.stored(self.configurations.executed_as(name).name)
        found = {}
        for behavior, recordings in zip(stored.behaviors, _recordings(stored), strict=True):
            behaviors = columns_of(read_behaviors(behavior))
            indices = behaviors.pop("run_index")
            for recording in recordings:
                index = recording.run.run_index
                own = {key: column[indices == index] for key, column in behaviors.items()}
                found[index] = replace(recording, behaviors=own)
        return self.wanted(name, found)

    def plot(self, name: str) -> "Plot":
        """Draw the path of each run of a configuration, on its map if it has one."""
        from vastflow.oracles.figures.maps import lines_plot
        from vastflow.sim.world.environment import world_of

        lines = [
            (f"run {each.run.run_index}: {each.run.outcome}", each.columns["x_mm"] / 1000, each.columns["y_mm"] / 1000)
            for each in self.of(name)
            if "x_mm" in each.columns
        ]
        world = world_of(self.configurations[name].scenario.environment)
        return lines_plot(lines, "x (m)", "y (m)", None if world is None else world.ground)

    def table(self) -> pa.Table:
        """Return a row for each recorded run, as in `runs.parquet` but without causes."""

        def columns(name: str) -> Columns:
            rows = {row["run_index"]: row for block in self.stored(name).recordings for row in read_rows(block)}
            return run_columns(self.configurations[name], self.wanted(name, rows))

        return column_table(RUNS, map(columns, self.blocks))


class Traces(StageResult):
    """The traces of a campaign's runs."""

    said = "observed"

    def of(self, name: str) -> "list[Trace]":
        """The traces of a configuration's runs in order, read from the store."""
        from vastflow.oracles.observation.trace import trace_of
        from vastflow.sim.model.blocks import read_block

        stored = self.stored(self.configurations.executed_as(name).name, observed=True)
        return self.wanted(
            name,
            {
                recording.run.run_index: trace_of(recording, row, columns)
                for block, recordings in zip(stored.traces, _recordings(stored), strict=True)
                for recording, (row, columns) in zip(recordings, read_block(block), strict=True)
            },
        )

    def plot(self, name: str, signal: str = "localization_error_m") -> "Plot":
        """Draw a signal of each run of a configuration over time; raises `UserError` if no run has it."""
        from vastflow.oracles.figures.maps import lines_plot

        traces = self.of(name)
        if signal not in (known := {column for trace in traces for column in trace.columns}):
            raise UserError(message_of(f"unknown signal {signal!r}", did_you_mean(signal, known)))
        lines = [(f"run {each.run.run_index}", each["t_s"], each[signal]) for each in traces if signal in each.columns]
        return lines_plot(lines, "t_s", signal)

    def table(self, name: str) -> pa.Table:
        """The signals of a configuration's runs under each other, in SI units, behind a column `run_index`.

        A signal that some run does not have is null there.
        """
        parts = []
        for trace in self.of(name):
            index = pa.array([trace.run.run_index] * len(trace), pa.int32())
            parts.append(pa.table({"run_index": index, **{key: pa.array(trace[key]) for key in trace.columns}}))
        return pa.concat_tables(parts, promote_options="default") if parts else pa.table({})


def _recordings(stored: StoredResult) -> "Iterator[list[Recording]]":
    from vastflow.sim.model.archive import read_outputs
    from vastflow.sim.model.blocks import read_recordings
    from vastflow.sim.model.recording import Outputs

    written = {index: each for block in stored.outputs for index, each in read_outputs(block).items()}
    for block in stored.recordings:
        yield [replace(each, outputs=written.get(each.run.run_index, Outputs())) for each in read_recordings(block)]


@dataclass(frozen=True, repr=False)
class Verdicts(StageResult):
    """The verdicts on a campaign's runs.

    Attributes:
        oracles: Names of the oracles, `success` first.
    """

    oracles: tuple[str, ...] = ()

    @property
    def said(self) -> str:
        """The oracles that judged."""
        return f"judged by {', '.join(self.oracles)}"

    def of(self, name: str) -> list[Verdict]:
        """The verdicts of the requested runs, by run and then by oracle in campaign order.

        What a fault kept from being judged is `not judged`, with the fault as its reason."""
        owner = self.configurations.executed_as(name).name
        return complete(self.stored(owner), self.runs_of(owner), self.oracles)

    def counts(self, oracle: str | None = None) -> dict[str, Counts]:
        """Configuration that is no duplicate to how often its runs passed and failed, with rate and interval.

        Args:
            oracle: One of `oracles`; None for what all of them together say of a run.

        Raises:
            ValueError: no such oracle judged.
            Lost: as `of`.
        """
        if oracle is not None and oracle not in self.oracles:
            raise ValueError(f"expected an oracle that judged, {', '.join(self.oracles)}, got {oracle!r}")
        counts = {}
        for name in self.blocks:
            said = [each for each in self.of(name) if oracle in (None, each.oracle)]
            runs = groupby(said, lambda verdict: verdict.run_index)
            counts[name] = counts_of(run_judgment(each.judgment for each in run) for _, run in runs)
        return counts

    def table(self) -> pa.Table:
        """A row for each run and oracle, as `verdicts.parquet` of a campaign directory."""
        return column_table(
            VERDICTS, (verdict_columns(self.configurations[name], self.of(name)) for name in self.blocks)
        )

    def metrics(self) -> pa.Table:
        """A row for each run, oracle and metric; a value that could not be had is null."""
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
