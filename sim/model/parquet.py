"""Parquet files that others write, opened within limits."""

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any, BinaryIO, Final

import pyarrow.parquet as pq

from vastflow.sim.model.faults import Got
from vastflow.sim.model.files import Unreadable, open_file

MOST_CELLS: Final = 400_000_000
"""Values of a table, of which a file of a few bytes may have any number that are alike."""
MOST_UNPACKED_BYTES: Final = 4 * 2**30


def open_table(source: Path | bytes, read_dictionary: Sequence[str] = ()) -> Any:
    """Open a Parquet file, or its content, as `pyarrow.parquet.ParquetFile`.

    `pyarrow.parquet.read_table` would import 0.1 s more.

    Raises:
        Missing, Unreadable: see `vastflow.sim.model.files.open_file`; or too many values.
        pyarrow.ArrowException, OSError: damaged.
    """
    if isinstance(source, bytes):
        return _within_limits(pq.ParquetFile(io.BytesIO(source), read_dictionary=list(read_dictionary)))
    with open_file(source, "a Parquet file") as file:
        return _within_limits(pq.ParquetFile(_place(file), read_dictionary=list(read_dictionary)))


def rows_with(source: Path, column: str, value: str) -> Any:
    """Read the rows with a value in a column, from row groups that may have it; raises as `open_table`."""
    with open_file(source, "a Parquet file") as file:
        _within_limits(pq.ParquetFile(_place(file)))
        return pq.read_table(_place(file), filters=[(column, "==", value)])


def _place(file: BinaryIO) -> str:
    """Return the path of an open file, which pyarrow opens again, as it reads faster than from Python's."""
    return f"/dev/fd/{file.fileno()}"


def _within_limits(file: Any) -> Any:
    groups = [file.metadata.row_group(k) for k in range(file.metadata.num_row_groups)]
    cells = sum(max(group.num_rows, group.column(k).num_values) for group in groups for k in range(group.num_columns))
    unpacked = sum(group.total_byte_size for group in groups)
    for found, most, what in ((cells, MOST_CELLS, "values"), (unpacked, MOST_UNPACKED_BYTES, "bytes when unpacked")):
        if not 0 <= found <= most:
            raise Unreadable(Got(f"{found:,} {what}"), f"at most {most:,}")
    return file
