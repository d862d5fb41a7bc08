"""The tables of a campaign directory: rows of configurations, runs, and verdicts, and the files that hold them."""

from collections import Counter
from collections.abc import Iterable, Mapping
from contextlib import ExitStack, suppress
from functools import cached_property
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Final, Self

import pyarrow as pa
import pyarrow.parquet as pq

from vastflow.flows.results.rows import Rows
from vastflow.oracles.evidence.headline import percent_text
from vastflow.oracles.judgment.verdict import Judgment
from vastflow.oracles.page.words import plural
from vastflow.oracles.results.schema import (
    BEHAVIORS_FILE,
    CONFIGURATIONS,
    EXCLUSIONS,
    JUDGED_RUNS,
    REJECTIONS,
    VERDICTS,
    Row,
    TableWriter,
    json_text,
    write_table,
)
from vastflow.oracles.statistics.intervals import Counts
from vastflow.producers.instantiation.instantiate import Instantiation
from vastflow.producers.model.configuration import Configuration, ExcludedInstance, RejectedInstance
from vastflow.sim.model.digest import Value
from vastflow.sim.model.files import Missing, json_value, open_file
from vastflow.sim.model.nodes import HOST_LATE, Nodes
from vastflow.sim.reading.checked import checked_digest
from vastflow.sim.world.environment import ground_file
from vastflow.tasks.engine.engine import RunFault

LOGS_FILE: Final = "logs/runs.jsonl"
"""A line for each block of runs: `configuration`, where and with what they were executed, and `runs`."""

_BEHAVIORS_A_GROUP: Final = 1 << 16


def configuration_row(configuration: Configuration) -> Row:
    """A row of `configurations.parquet`."""
    scenario = configuration.scenario
    content: dict[str, Value] = {part: getattr(scenario, part) for part in ("environment", "task", "system")}
    if scenario.programs is not None:
        content["programs"] = scenario.programs.content
    ground = ground_file(scenario.environment)
    return {
        "name": configuration.name,
        "family": configuration.family,
        "scenario_digest": scenario.digest,
        "checked_digest": checked_digest(scenario),
        "duplicate_of": configuration.duplicate_of,
        "environment": None if ground is None else ground.digest,
        "abstract": scenario.abstract if isinstance(scenario.abstract, str) else json_text(scenario.abstract),
        "timeout_s": scenario.timeout_s,
        "scenario": json_text(content),
        "factors": json_text(configuration.factors),
        "provenance": json_text(configuration.provenance),
        "steps": json_text(
            [
                {"producer": step.producer, "keys": step.keys, "choice": step.choice, "inputs": step.inputs}
                for step in configuration.steps
            ]
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


class RunTables:
    """Writes `runs.parquet`, `verdicts.parquet`, `behaviors.parquet`, and the run logs part by part, and counts.

    Attributes:
        stood_still: Number of failed runs whose robot was sent and never moved.
        faults: Faults of the added configurations.
    """

    def __init__(self, place: Path) -> None:
        self.stood_still = 0
        self.faults: list[RunFault] = []
        self._place = place
        self._counted: Counter[tuple[str | None, Judgment]] = Counter()
        self._behaviors: list[pa.Table] = []
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
            self._flush_behaviors()
        self._open.__exit__(kind, error, traceback)

    def counts(self, oracle: str | None = None) -> Counts:
        """Count the added runs by what one oracle says, or all together."""
        return Counts(*(self._counted[oracle, judgment] for judgment in ("pass", "fail", "not judged")))

    def add(self, rows: Rows) -> None:
        """Add the rows of a part; call in order of configurations."""
        self._run_rows.add(rows.runs)
        self._verdict_rows.add(rows.verdicts)
        self._counted.update(rows.counted)
        self.stood_still += rows.stood_still
        self.faults += rows.faults
        if rows.behaviors is not None:
            self._behaviors.append(rows.behaviors)
            if sum(each.num_rows for each in self._behaviors) >= _BEHAVIORS_A_GROUP:
                self._flush_behaviors()
        if rows.logs:
            if self._logs is None:
                (self._place / LOGS_FILE).parent.mkdir(exist_ok=True)
                self._logs = self._open.enter_context(open(self._place / LOGS_FILE, "wb"))  # noqa: SIM115
            self._logs.write(rows.logs)

    def _flush_behaviors(self) -> None:
        if not self._behaviors:
            return
        whole = pa.concat_tables(self._behaviors).combine_chunks()
        self._behaviors = []
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
            block = json_value(line)
            where = {key: value for key, value in block.items() if key not in ("configuration", "runs")}
            found |= {row["run_index"]: {**row, **where} for row in block["runs"]}
        return [found[run_index] for run_index in sorted(found)]

    @cached_property
    def _lines(self) -> dict[str, list[bytes]]:
        found: dict[str, list[bytes]] = {}
        with suppress(Missing), open_file(self._directory / LOGS_FILE) as lines:
            for line in lines:
                found.setdefault(json_value(line)["configuration"], []).append(line)
        return found


def health_text(logs: KeptLogs, runs: Mapping[str, int], nodes: Nodes, faults: Iterable[RunFault]) -> str:
    """Return how well the host kept pace with a campaign's runs, by their logs and faults.

    Args:
        runs: Number of runs by configuration; others in the logs don't count.
    """
    rows = [row for name, number in runs.items() for row in logs.of(name) if row["run_index"] < number]
    kept = [health for row in rows if (health := row.get("health"))]
    said = f"{plural(len(kept), 'run')} paced at {nodes.real_time_factor:g} times real time"
    if kept:
        ticks, late, missed = (sum(each[name] for each in kept) for name in ("ticks", "late_ticks", "missed"))
        said += f": {percent_text(late / max(ticks, 1))} of ticks late, threads waited {max(each['waited'] for each in kept):.0%} of the time "
        said += f"for a CPU at most, {plural(missed, 'control loop')} missed by the nodes' own words"
    lost = len({(each.configuration, each.run_index) for each in faults if each.error.startswith(HOST_LATE)})
    return f"{said}; {plural(lost, 'run')} not judged, as the host was late" if lost else said
