"""The schema of a campaign directory's tables: their columns, and rows written as parquet."""

import itertools
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, Self

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from vastflow.sim.model.digest import FileContent, Value

Row = Mapping[str, Any]
Columns = Mapping[str, Sequence[Any]]
"""Name to the values of rows, as many in each."""

_ROWS_A_GROUP: Final = 8192
_PLAIN_TEXT: Final = json.JSONEncoder(ensure_ascii=False, separators=(",", ":"), allow_nan=False).encode

CONFIGURATIONS: Final = pa.schema(
    {
        "name": pa.string(),
        "family": pa.string(),
        "scenario_digest": pa.string(),
        "checked_digest": pa.string(),
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
        "stood_still": pa.string(),
    }
)
JUDGED_RUNS: Final = RUNS.append(pa.field("cause", pa.string()))
"""Of `runs.parquet`: what was recorded of each run, and why it failed where it did."""
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


class TableWriter:
    """Writer of parquet with the columns of `schema`, in row groups of one size."""

    def __init__(self, path: Path, schema: pa.Schema) -> None:
        self._waiting: list[pa.Table] = []
        self._rows = 0
        self._writer = pq.ParquetWriter(path, schema, compression="zstd")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is None and self._rows:
            self._write(self._rows)
        self._writer.close()

    def add(self, rows: pa.Table) -> None:
        """Add rows of the schema."""
        self._waiting.append(rows)
        self._rows += rows.num_rows
        while self._rows >= _ROWS_A_GROUP:
            self._write(_ROWS_A_GROUP)

    def _write(self, rows: int) -> None:
        waiting = pa.concat_tables(self._waiting)
        self._writer.write_table(waiting.slice(0, rows).combine_chunks())
        self._waiting = [waiting.slice(rows)]
        self._rows -= rows


def column_array(values: Sequence[Any], kind: pa.DataType) -> pa.Array:
    """Texts or numbers, None for null, as an array. Built by hand, because `pyarrow.array` imports pandas (0.4 s)."""
    if pa.types.is_string(kind):
        try:
            return texts(values)
        except UnicodeEncodeError:  # a plug-in's words, say, with a file's name that is no text
            return texts([text and text.encode("utf-8", "backslashreplace").decode() for text in values])
    there = np.array([value is not None for value in values], dtype=np.bool_)
    numbers = np.array([0 if value is None else value for value in values], dtype=kind.to_pandas_dtype())
    bits = np.packbits(there, bitorder="little").tobytes()
    return pa.Array.from_buffers(kind, len(values), [pa.py_buffer(bits), pa.py_buffer(numbers)])


def texts(values: Sequence[str | None]) -> pa.Array:
    """Texts that UTF-8 has, None for null, as an array."""
    builder = pa.lib.StringBuilder()
    builder.append_values(values)
    return builder.finish()


def column_table(schema: pa.Schema, parts: Iterable[Columns]) -> pa.Table:
    """Rows that stand in columns, under each other, as a table."""
    whole: dict[str, list[Any]] = {name: [] for name in schema.names}
    for part in parts:
        for name, values in whole.items():
            values += part[name]
    return pa.Table.from_arrays([column_array(whole[each.name], each.type) for each in schema], schema=schema)


def write_table(path: Path, schema: pa.Schema, rows: Iterable[Row]) -> None:
    """Write `rows` as parquet, see `TableWriter`; what a row lacks is null."""
    waiting = iter(rows)
    with TableWriter(path, schema) as writer:
        while some := list(itertools.islice(waiting, _ROWS_A_GROUP)):
            writer.add(_table_of(schema, some))


def _table_of(schema: pa.Schema, rows: Sequence[Row]) -> pa.Table:
    if unexpected := {name for row in rows for name in row}.difference(schema.names):
        raise ValueError(f"unexpected field {min(unexpected)!r}; one of {', '.join(schema.names)}")
    arrays = [column_array([row.get(each.name) for row in rows], each.type) for each in schema]
    return pa.Table.from_arrays(arrays, schema=schema)


def json_text(value: Value) -> str:
    """Write `value` as JSON: a file is `{"file": digest}`, a number that is not finite null."""
    return _PLAIN_TEXT(plain(value))


def plain(value: Value) -> Any:
    """`value` as `json.dumps` takes it, see `json_text`."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if value is None or isinstance(value, str | int):  # most are, and the others take long to tell
        return value
    if isinstance(value, FileContent):
        return {"file": value.digest}
    if isinstance(value, Mapping):
        return {key: plain(item) for key, item in value.items()}
    return [plain(item) for item in value]
