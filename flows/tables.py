"""The campaign directory's tables: their columns, and rows written as parquet."""

import io
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import pyarrow as pa
import pyarrow.json
import pyarrow.parquet as pq

from vastflow.oracles.verdict import Verdict
from vastflow.producers.configuration import Configuration, ExcludedInstance, RejectedInstance
from vastflow.sim.digest import FileContent, Value

Row = Mapping[str, Any]

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
        "metrics": json_text(metrics),
    }


def write_table(path: Path, schema: pa.Schema, rows: Sequence[Row]) -> None:
    """Write `rows` as parquet with the columns of `schema`; a key a row lacks is null.

    The rows go through pyarrow's JSON reader, because building arrays from Python lists imports pandas (0.4 s).
    """
    if not rows:
        table = pa.Table.from_batches([], schema)
    else:
        content = "\n".join(json.dumps(row, allow_nan=False) for row in rows).encode()
        table = pyarrow.json.read_json(
            io.BytesIO(content),
            read_options=pyarrow.json.ReadOptions(use_threads=False, block_size=len(content) + 1),
            parse_options=pyarrow.json.ParseOptions(explicit_schema=schema, unexpected_field_behavior="error"),
        )
    pq.write_table(table, path, compression="zstd")


def json_text(value: Value) -> str:
    """`value` as JSON, keys in order as they are; a file is `{"file": digest}`, a number that is none is null."""
    return json.dumps(plain(value), ensure_ascii=False, separators=(",", ":"), allow_nan=False)


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
