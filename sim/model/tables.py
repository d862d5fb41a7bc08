"""Tables: CSV and Parquet as named columns."""

import io
from collections.abc import Mapping
from typing import Any, Final, TypeAlias

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv
import pyarrow.parquet
from numpy.typing import NDArray

Columns: TypeAlias = Mapping[str, NDArray[Any]]
"""Name to (N,) float64, int64, bool or str, all of one length."""

MAX_UNPACKED_BYTES: Final = 512 * 2**20


class TableFault(ValueError):
    """A file that is no table; says why in one line."""


def read_table(name: str, content: bytes) -> tuple[Columns, tuple[str, ...]]:
    """The columns of a file called `name`, and what is to be said of them.

    A value that is not there is NaN in a column of numbers or truth values, which then is float64, and empty in a column
    of text. Moments are seconds since 1970, times of day seconds since midnight. Columns of anything else, such as
    lists, are left out with a note.

    Raises:
        TableFault: it can't be read.
    """
    try:
        table = _parquet(content) if name.lower().endswith(".parquet") else _csv(content)
        return _columns(table)
    except (pa.ArrowException, UnicodeDecodeError, OSError) as error:
        raise TableFault(f"not a table: {_one_line(error)}") from None


def _csv(content: bytes) -> Any:
    # One block: a column's type follows from all of its values, not from those of the first mebibyte.
    reading = pyarrow.csv.ReadOptions(use_threads=False, block_size=len(content) + 1)
    return pyarrow.csv.read_csv(io.BytesIO(content), reading)


def _parquet(content: bytes) -> Any:
    file = pyarrow.parquet.ParquetFile(io.BytesIO(content))
    groups = range(file.metadata.num_row_groups)
    unpacked = sum(file.metadata.row_group(i).total_byte_size for i in groups)
    if unpacked > MAX_UNPACKED_BYTES:
        raise TableFault(f"not read: {unpacked} bytes when unpacked, more than {MAX_UNPACKED_BYTES}")
    return file.read()


def _columns(table: Any) -> tuple[Columns, tuple[str, ...]]:
    columns: dict[str, NDArray[Any]] = {}
    notes = []
    for name, column in zip(table.column_names, table.columns, strict=True):
        if name in columns:
            notes.append(f"a second column {name!r} is left out")
            continue
        values = _values(column)
        if values is None:
            notes.append(f"column {name!r} is left out: no numbers, truth values or text but {column.type}")
        else:
            columns[name] = values
    return columns, tuple(notes)


def _values(column: Any) -> NDArray[Any] | None:
    kind = column.type
    if pa.types.is_dictionary(kind):
        column, kind = column.cast(kind.value_type), kind.value_type
    if pa.types.is_string(kind) or pa.types.is_large_string(kind):
        return np.array(pc.fill_null(column, "").to_pylist(), dtype=np.str_)
    if pa.types.is_timestamp(kind) or pa.types.is_date(kind):
        return _numbers(column.cast(pa.timestamp("us", getattr(kind, "tz", None)), safe=False).cast(pa.int64()), 1e-6)
    if pa.types.is_time(kind) or pa.types.is_duration(kind):
        unit = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}[kind.unit]
        return _numbers(column.cast(pa.int32() if kind.bit_width == 32 else pa.int64()), unit)
    if pa.types.is_boolean(kind):
        if column.null_count:
            return _numbers(column.cast(pa.uint8()))
        return _array(column.cast(pa.uint8())).astype(np.bool_)
    if pa.types.is_integer(kind) and not column.null_count:
        try:
            return _array(column.cast(pa.int64()))
        except pa.ArrowInvalid:  # beyond 2**63
            return _numbers(column)
    if pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_decimal(kind) or pa.types.is_null(kind):
        return _numbers(column)
    return None


def _numbers(column: Any, factor: float = 1.0) -> NDArray[np.float64]:
    values: NDArray[np.float64] = _array(pc.fill_null(column.cast(pa.float64(), safe=False), float("nan")))
    return values * factor


def _array(column: Any) -> NDArray[Any]:
    """A column without nulls; pyarrow's `to_numpy` would import pandas, which takes 0.35 s."""
    chunks = column.combine_chunks()
    if isinstance(chunks, pa.ChunkedArray):  # which it stays where there is no row
        chunks = pa.concat_arrays(chunks.chunks) if chunks.num_chunks else pa.array([], column.type)
    return np.array(np.from_dlpack(chunks))


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())[:300]
