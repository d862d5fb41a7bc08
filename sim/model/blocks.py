"""Blocks: aligned columns of consecutive runs in one Parquet file, each run's row in the file's metadata.

Recordings and traces are stored so. The bytes depend on the content and the pyarrow version alone.

A smooth column is stored as its differences: `x_mm:d1` has first, `x_mm:d2` second differences. A difference d >= 0 is written as
2 d and one below 0 as -2 d - 1. Runs follow each other without a break, and arithmetic is modulo 2³², so that nothing is lost.
"""

import base64
import io
import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from vastflow.sim.model.parquet import open_table
from vastflow.sim.model.recording import Recording, run_of, run_row

Columns = Mapping[str, NDArray[np.int32]]
Block = bytes | Path
"""Content of a block, or its file."""

RUN_INDEX: Final = "run_index"
_ROWS_KEY: Final = b"vastflow.runs"
_LEVEL: Final = 9
"""Compression level of zstd: the next saves 1 % of the size in four times the time."""


def write_block(rows: Sequence[Mapping[str, Any]], columns: Sequence[Columns]) -> bytes:
    """Write several runs as one Parquet file.

    Args:
        rows: A JSON-ready mapping per run, with `run_index`.
        columns: Per run, name to (N,) int32; all runs have the same names.
    """
    names = list(columns[0]) if columns else []
    for run in columns:
        if list(run) != names:
            raise ValueError(f"expected the same columns in all runs of a block, got {names} and {list(run)}")
    lengths = [len(next(iter(run.values()))) if run else 0 for run in columns]
    index = np.repeat(np.array([row[RUN_INDEX] for row in rows], dtype=np.int32), lengths)
    stored = dict(_stored(name, np.concatenate([run[name] for run in columns])) for name in names)
    encodings = {name: "BYTE_STREAM_SPLIT" if _parted(name)[1] else "PLAIN" for name in stored}
    table = pa.table({name: _column(values) for name, values in {RUN_INDEX: index, **stored}.items()})
    out = io.BytesIO()
    with pq.ParquetWriter(
        out,
        table.schema,
        compression="zstd",
        compression_level=_LEVEL,
        use_dictionary=False,
        column_encoding={**encodings, RUN_INDEX: "DELTA_BINARY_PACKED"},
        store_schema=False,  # which would repeat the rows in base64, and without which a table's metadata is dropped
        write_statistics=False,  # of differences, of which nobody asks for the least and the greatest
    ) as writer:
        writer.write_table(table)
        writer.add_key_value_metadata({_ROWS_KEY: _packed(rows)})
    return out.getvalue()


def read_block(block: Block) -> list[tuple[dict[str, Any], dict[str, NDArray[np.int32]]]]:
    """Read a block: each run's row and columns, in order."""
    file = open_table(block)
    rows = _unpacked(file.metadata.metadata[_ROWS_KEY])
    index, values = _columns(file, file.schema_arrow.names[1:])
    starts, ends = (np.searchsorted(index, [row[RUN_INDEX] for row in rows], side=side) for side in ("left", "right"))
    return [
        (row, {name: column[start:end] for name, column in values.items()})
        for row, start, end in zip(rows, starts, ends, strict=True)
    ]


def read_rows(block: Block) -> list[dict[str, Any]]:
    """Read the rows of a block's runs without a column."""
    return _unpacked(open_table(block).metadata.metadata[_ROWS_KEY])


def read_columns(block: Block, names: Iterable[str]) -> tuple[NDArray[np.int32], dict[str, NDArray[np.int32]]]:
    """Read some columns over all runs: run index (N,), and name to (N,); raises `KeyError` for an unknown name."""
    file = open_table(block)
    there = {_parted(stored)[0]: stored for stored in file.schema_arrow.names}
    return _columns(file, [there[name] for name in names])


def write_recordings(recordings: Sequence[Recording]) -> bytes:
    """Write recordings of runs in increasing order as one block."""
    return write_block([run_row(r.run) for r in recordings], [r.columns for r in recordings])


def read_recordings(block: Block) -> list[Recording]:
    return [Recording(run_of(row), columns) for row, columns in read_block(block)]


def _column(values: NDArray[np.int32]) -> pa.Array:
    """Return values as pyarrow has them, which would import pandas to look at them."""
    return pa.Array.from_buffers(pa.int32(), len(values), [None, pa.py_buffer(np.ascontiguousarray(values, np.int32))])


def array_of(column: Any) -> NDArray[Any]:
    """Return a column without nulls as an array; pyarrow's `to_numpy` would import pandas, which takes 0.35 s."""
    chunks = column.combine_chunks()
    if isinstance(chunks, pa.ChunkedArray):  # which it stays where there is no row
        chunks = pa.concat_arrays(chunks.chunks) if chunks.num_chunks else pa.array([], column.type)
    return np.array(np.from_dlpack(chunks))


def _columns(file: Any, stored: Sequence[str]) -> tuple[NDArray[np.int32], dict[str, NDArray[np.int32]]]:
    table = file.read(columns=[RUN_INDEX, *stored])
    values = {}
    for each in stored:
        name, order = _parted(each)
        values[name] = array_of(table.column(each))
        if order:
            values[name] = (values[name].view(np.uint32) >> 1).view(np.int32) ^ -(values[name] & 1)
        for _ in range(order):
            values[name] = np.cumsum(values[name], dtype=np.int32)
    return array_of(table.column(RUN_INDEX)), values


def _stored(name: str, values: NDArray[np.int32]) -> tuple[str, NDArray[np.int32]]:
    """Return a column's name and values in the form that zstd compresses best."""
    forms, differences = [values], values
    for _ in range(2):
        differences = np.concatenate((differences[:1], differences[1:] - differences[:-1]))
        forms.append((differences << 1) ^ (differences >> 31))
    codec = pa.Codec("zstd", compression_level=1)
    # Of differences all first bytes come first, then all second ones, as Parquet's BYTE_STREAM_SPLIT has them.
    texts = [values.tobytes(), *(form.view(np.uint8).reshape(-1, 4).T.tobytes() for form in forms[1:])]
    lengths = [len(codec.compress(text, asbytes=True)) for text in texts]
    order = lengths.index(min(lengths))
    return f"{name}:d{order}" if order or _parted(name)[0] != name else name, forms[order]


def _parted(stored: str) -> tuple[str, int]:
    """Return a stored column's name and order of differences; names that end so themselves have `:d0`."""
    return (stored[:-3], int(stored[-1])) if stored.endswith((":d0", ":d1", ":d2")) else (stored, 0)


def _packed(rows: Sequence[Mapping[str, Any]]) -> bytes:
    text = json.dumps(rows, separators=(",", ":"), sort_keys=True).encode()
    # Parquet's metadata is text: not every tool reads bytes there.
    return b"%d " % len(text) + base64.b85encode(
        pa.Codec("zstd", compression_level=_LEVEL).compress(text, asbytes=True)
    )


def _unpacked(packed: bytes) -> list[dict[str, Any]]:
    length, _, text = packed.partition(b" ")
    if not length.isdigit():
        raise ValueError("Another version of vastflow wrote this block. Run the campaign again.")
    rows: list[dict[str, Any]] = json.loads(
        pa.Codec("zstd").decompress(base64.b85decode(text), decompressed_size=int(length), asbytes=True)
    )
    return rows
