"""Blocks: aligned columns of consecutive runs in one parquet file, each run's row in the file's metadata.

Recordings and traces are both kept so. The bytes depend on the content and the pyarrow version alone.
"""

import io
import json
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from vastflow.sim.recording import Recording, run_of, run_row

Columns = Mapping[str, NDArray[np.int32]]
ROWS_KEY: Final = b"vastflow.runs"


def write_block(rows: Sequence[Mapping[str, Any]], columns: Sequence[Columns]) -> bytes:
    """One parquet file of several runs.

    Args:
        rows: A JSON-ready mapping per run, with `run_index`.
        columns: Per run, name to (N,) int32; all runs have the same names.
    """
    names = list(columns[0]) if columns else []
    for run in columns:
        if list(run) != names:
            raise ValueError(f"runs of one block have the same columns, got {names} and {list(run)}")
    lengths = [len(next(iter(run.values()))) if run else 0 for run in columns]
    index = np.repeat(np.array([row["run_index"] for row in rows], dtype=np.int32), lengths)
    table = pa.table({"run_index": index, **{name: np.concatenate([run[name] for run in columns]) for name in names}})
    out = io.BytesIO()
    with pq.ParquetWriter(
        out,
        table.schema,
        compression="zstd",
        use_dictionary=False,
        column_encoding={name: "DELTA_BINARY_PACKED" for name in table.column_names},
        store_schema=False,  # which would repeat the rows in base64, and without which a table's metadata is dropped
    ) as writer:
        writer.write_table(table)
        writer.add_key_value_metadata({ROWS_KEY: json.dumps(rows, separators=(",", ":"), sort_keys=True).encode()})
    return out.getvalue()


def read_block(content: bytes) -> list[tuple[dict[str, Any], dict[str, NDArray[np.int32]]]]:
    """What `write_block` wrote: each run's row and columns, in order."""
    table = pq.read_table(io.BytesIO(content))
    rows: list[dict[str, Any]] = json.loads(table.schema.metadata[ROWS_KEY])
    values = {name: _int32(table.column(name)) for name in table.column_names}
    index = values.pop("run_index")
    names = list(values)
    ends = np.searchsorted(index, [row["run_index"] for row in rows], side="right")
    starts = np.searchsorted(index, [row["run_index"] for row in rows], side="left")
    return [
        (row, {name: values[name][start:end] for name in names})
        for row, start, end in zip(rows, starts, ends, strict=True)
    ]


def write_recordings(recordings: Sequence[Recording]) -> bytes:
    """Recordings of runs in increasing order as one block."""
    return write_block([run_row(r.run) for r in recordings], [r.columns for r in recordings])


def read_recordings(content: bytes) -> list[Recording]:
    """The recordings of a block."""
    return [Recording(run_of(row), columns) for row, columns in read_block(content)]


def _int32(column: Any) -> NDArray[np.int32]:
    """A column as an array of its own; pyarrow's `to_numpy` would import pandas, which costs a worker 0.35 s."""
    return np.array(np.from_dlpack(column.combine_chunks()), dtype=np.int32)
