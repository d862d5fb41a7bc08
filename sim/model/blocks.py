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

from vastflow.sim.model.recording import Recording, run_of, run_row

Columns = Mapping[str, NDArray[np.int32]]
Block = bytes | Path
"""Content of a block, or its file."""

RUN_INDEX: Final = "run_index"
_ROWS_KEY: Final = b"vastflow.runs"
_SUFFIXES: Final = ("", ":d1", ":d2")
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
    stored = {RUN_INDEX: index, **dict(_stored(name, [run[name] for run in columns]) for name in names)}
    encodings = {name: "BYTE_STREAM_SPLIT" if _order(name) else "PLAIN" for name in stored}
    table = pa.table(stored)
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
    file = _opened(block)
    rows = _unpacked(file.metadata.metadata[_ROWS_KEY])
    index, values = _columns(file, file.schema_arrow.names)
    starts, ends = (np.searchsorted(index, [row[RUN_INDEX] for row in rows], side=side) for side in ("left", "right"))
    return [
        (row, {name: column[start:end] for name, column in values.items()})
        for row, start, end in zip(rows, starts, ends, strict=True)
    ]


def read_rows(block: Block) -> list[dict[str, Any]]:
    """Read the rows of a block's runs without a column."""
    return _unpacked(_opened(block).metadata.metadata[_ROWS_KEY])


def read_columns(block: Block, names: Iterable[str]) -> tuple[NDArray[np.int32], dict[str, NDArray[np.int32]]]:
    """Read some columns over all runs: run index (N,), and name to (N,); raises `KeyError` for an unknown name."""
    file = _opened(block)
    there = {_name(stored): stored for stored in file.schema_arrow.names}
    return _columns(file, [there[name] for name in names])


def write_recordings(recordings: Sequence[Recording]) -> bytes:
    """Write recordings of runs in increasing order as one block."""
    return write_block([run_row(r.run) for r in recordings], [r.columns for r in recordings])


def read_recordings(block: Block) -> list[Recording]:
    """Read the recordings of a block."""
    return [Recording(run_of(row), columns) for row, columns in read_block(block)]


def _opened(block: Block) -> Any:
    # pq.read_table would import 0.1 s more.
    return pq.ParquetFile(io.BytesIO(block) if isinstance(block, bytes) else block)


def _columns(file: Any, stored: Sequence[str]) -> tuple[NDArray[np.int32], dict[str, NDArray[np.int32]]]:
    table = file.read(columns=[RUN_INDEX, *stored])
    found = {_name(name): _restored(_int32(table.column(name)), _order(name)) for name in stored if name != RUN_INDEX}
    return _int32(table.column(RUN_INDEX)), found


def _stored(name: str, runs: Sequence[NDArray[np.int32]]) -> tuple[str, NDArray[np.int32]]:
    """Return a column's name and values in the form that zstd compresses best."""
    values = np.concatenate(runs)
    forms = [values, *(_zigzag(_differences(values, order)) for order in (1, 2))]
    codec = pa.Codec("zstd", compression_level=1)
    lengths = [
        len(codec.compress(form.tobytes() if order == 0 else _split(form), asbytes=True))
        for order, form in enumerate(forms)
    ]
    order = lengths.index(min(lengths))
    return (name if order == 0 and not _order(name) else f"{name}:d{order}"), forms[order]


def _order(stored: str) -> int:
    return max(_SUFFIXES.index(suffix) for suffix in _SUFFIXES if stored.endswith(suffix))


def _name(stored: str) -> str:
    return stored[: -len(":d0")] if stored.endswith((":d0", *_SUFFIXES[1:])) else stored


def _differences(values: NDArray[np.int32], order: int) -> NDArray[np.int32]:
    for _ in range(order):
        values = np.concatenate((values[:1], values[1:] - values[:-1]))
    return values


def _zigzag(values: NDArray[np.int32]) -> NDArray[np.int32]:
    return (values << 1) ^ (values >> 31)


def _restored(codes: NDArray[np.int32], order: int) -> NDArray[np.int32]:
    if order:
        unsigned = codes.view(np.uint32)
        codes = (unsigned >> 1).view(np.int32) ^ -(codes & 1)
    for _ in range(order):
        codes = np.cumsum(codes, dtype=np.int32)
    return codes


def _split(values: NDArray[np.int32]) -> bytes:
    """Return all first bytes, then all second ones, as Parquet's BYTE_STREAM_SPLIT does."""
    return values.view(np.uint8).reshape(-1, 4).T.tobytes()


def _packed(rows: Sequence[Mapping[str, Any]]) -> bytes:
    text = json.dumps(rows, separators=(",", ":"), sort_keys=True).encode()
    # Parquet's metadata is text: not every tool reads bytes there.
    return b"%d " % len(text) + base64.b85encode(
        pa.Codec("zstd", compression_level=_LEVEL).compress(text, asbytes=True)
    )


def _unpacked(packed: bytes) -> list[dict[str, Any]]:
    length, _, text = packed.partition(b" ")
    if not length.isdigit():
        raise ValueError("a block that another version of vastflow wrote; run the campaign again")
    rows: list[dict[str, Any]] = json.loads(
        pa.Codec("zstd").decompress(base64.b85decode(text), decompressed_size=int(length), asbytes=True)
    )
    return rows


def _int32(column: Any) -> NDArray[np.int32]:
    """Copy a column to an array; pyarrow's `to_numpy` would import pandas, which costs a worker 0.35 s."""
    return np.array(np.from_dlpack(column.combine_chunks()), dtype=np.int32)
