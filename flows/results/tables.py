"""The campaign directory's tables: their columns, and rows written as parquet."""

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, Self

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from vastflow.oracles.verdict import Verdict
from vastflow.producers.configuration import Configuration, ExcludedInstance, RejectedInstance
from vastflow.sim.digest import FileContent, Value

Row = Mapping[str, Any]

_ROWS_A_GROUP: Final = 8192
_PLAIN_TEXT: Final = json.JSONEncoder(ensure_ascii=False, separators=(",", ":"), allow_nan=False).encode

CONFIGURATIONS: Final = pa.schema(
    {
        "name": pa.string(),
        "family": pa.string(),
        "scenario_digest": pa.string(),
        "duplicate_of": pa.string(),
        "environment": pa.string(),
        "abstract": pa.string(),
        "timeout_s": pa.float64(),
        "scenario": pa.string(),
        "factors": pa.string(),
        "provenance": pa.string(),
        "steps": pa.string(),
    }
)
REJECTIONS: Final = pa.schema(
    {name: pa.string() for name in ("family", "parent", "producer", "reason", "requested", "inputs")}
)
EXCLUSIONS: Final = pa.schema({name: pa.string() for name in ("family", "name", "constraint", "values")})
RUNS: Final = pa.schema(
    {
        "configuration": pa.string(),
        "family": pa.string(),
        "run_index": pa.int32(),
        "seed": pa.string(),
        "outcome": pa.string(),
        "error_code": pa.int32(),
        "reason": pa.string(),
        "simulated_s": pa.float64(),
        "distance_m": pa.float64(),
        "recoveries": pa.int32(),
        "missed_goals": pa.int32(),
        "contacts": pa.int32(),
    }
)
VERDICTS: Final = pa.schema(
    {
        "configuration": pa.string(),
        "family": pa.string(),
        "run_index": pa.int32(),
        "oracle": pa.string(),
        "judgement": pa.string(),
        "reason": pa.string(),
        "metrics": pa.string(),
    }
)


def configuration_row(configuration: Configuration) -> Row:
    """A row of `configurations.parquet`."""
    scenario = configuration.scenario
    content: dict[str, Value] = {
        "environment": scenario.environment,
        "task": scenario.task,
        "system": scenario.system,
    }
    if scenario.programs is not None:
        content["programs"] = scenario.programs.content
    return {
        "name": configuration.name,
        "family": configuration.family,
        "scenario_digest": scenario.digest,
        "duplicate_of": configuration.duplicate_of,
        "environment": environment_digest(configuration),
        "abstract": scenario.abstract if isinstance(scenario.abstract, str) else json_text(scenario.abstract),
        "timeout_s": scenario.timeout_s,
        "scenario": json_text(content),
        "factors": json_text(configuration.factors),
        "provenance": json_text(configuration.provenance),
        "steps": json_text(
            [{"producer": step.producer, "keys": step.keys, "choice": step.choice} for step in configuration.steps]
        ),
    }


def environment_digest(configuration: Configuration) -> str | None:
    """Digest of the configuration's map, None for a scenario without one."""
    map_file = configuration.scenario.environment.get("map_file")
    return map_file.digest if isinstance(map_file, FileContent) else None


def rejection_row(rejected: RejectedInstance) -> Row:
    """A row of `rejections.parquet`."""
    return {
        "family": rejected.family,
        "parent": rejected.parent,
        "producer": rejected.producer,
        "reason": rejected.reason,
        "requested": json_text(rejected.requested),
        "inputs": json_text(rejected.inputs),
    }


def exclusion_row(excluded: ExcludedInstance) -> Row:
    """A row of `exclusions.parquet`."""
    return {
        "family": excluded.family,
        "name": excluded.name,
        "constraint": excluded.constraint,
        "values": json_text(excluded.values),
    }


def run_table_row(configuration: Configuration, run: Row) -> Row:
    """A row of `runs.parquet`, from a run's row in a block."""
    copied = {name: run[name] for name in RUNS.names if name in run}
    contacts = sum(event["kind"] == "contact" for event in run["events"])
    return {"configuration": configuration.name, "family": configuration.family, **copied, "contacts": contacts}


def verdict_row(configuration: Configuration, verdict: Verdict) -> Row:
    """A row of `verdicts.parquet`."""
    metrics = {name: {"value": metric.value, "unit": metric.unit} for name, metric in verdict.metrics.items()}
    return {
        "configuration": configuration.name,
        "family": configuration.family,
        "run_index": verdict.run_index,
        "oracle": verdict.oracle,
        "judgement": verdict.judgement,
        "reason": verdict.reason,
        "metrics": _PLAIN_TEXT(metrics) if _finite(verdict) else json_text(metrics),
    }


def _finite(verdict: Verdict) -> bool:
    return all(metric.value is None or math.isfinite(metric.value) for metric in verdict.metrics.values())


class TableWriter:
    """Writes rows as parquet with the columns of `schema`, some thousand at a time; a key a row lacks is null."""

    def __init__(self, path: Path, schema: pa.Schema) -> None:
        self._schema = schema
        self._rows: list[Row] = []
        self._writer = pq.ParquetWriter(path, schema, compression="zstd")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is None and self._rows:
            self._write(self._rows)
        self._writer.close()

    def add(self, rows: Iterable[Row]) -> None:
        """Add rows; how they come together is not in the file."""
        self._rows += rows
        while len(self._rows) >= _ROWS_A_GROUP:
            self._write(self._rows[:_ROWS_A_GROUP])
            del self._rows[:_ROWS_A_GROUP]

    def _write(self, rows: Sequence[Row]) -> None:
        if unexpected := {name for row in rows for name in row}.difference(self._schema.names):
            raise ValueError(f"unexpected field {min(unexpected)!r}; one of {', '.join(self._schema.names)}")
        columns = [_column([row.get(field.name) for row in rows], field.type) for field in self._schema]
        self._writer.write_table(pa.Table.from_arrays(columns, schema=self._schema))


def _column(values: Sequence[Any], kind: pa.DataType) -> pa.Array:
    """Texts or numbers, None for null, as an array. Built by hand, because `pyarrow.array` imports pandas (0.4 s)."""
    if pa.types.is_string(kind):
        builder = pa.lib.StringBuilder()
        builder.append_values(values)
        return builder.finish()
    there = np.array([value is not None for value in values], dtype=np.bool_)
    numbers = np.array([0 if value is None else value for value in values], dtype=kind.to_pandas_dtype())
    bits = np.packbits(there, bitorder="little").tobytes()
    return pa.Array.from_buffers(kind, len(values), [pa.py_buffer(bits), pa.py_buffer(numbers)])


def write_table(path: Path, schema: pa.Schema, rows: Iterable[Row]) -> None:
    """Write `rows` as parquet, see `TableWriter`."""
    with TableWriter(path, schema) as writer:
        for row in rows:
            writer.add([row])


def json_text(value: Value) -> str:
    """`value` as JSON, keys in order as they are; a file is `{"file": digest}`, a number that is none is null."""
    return _PLAIN_TEXT(plain(value))


def plain(value: Value) -> Any:
    """`value` as `json.dumps` takes it, see `json_text`."""
    if isinstance(value, FileContent):
        return {"file": value.digest}
    if isinstance(value, Mapping):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
