"""Columns of parquet tables as numpy arrays.

Whatever of pyarrow takes or gives a numpy array or a Python scalar (`to_numpy`, `pa.array`, `fill_null`) imports pandas, which
costs 0.4 s where only a terminal wants a number; so buffers are handed over as they are.
"""

import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.json
import pyarrow.parquet as pq
from numpy.typing import NDArray

from vastflow.sim.model.files import Missing, Unreadable


def read_columns(file: Path, *texts: str) -> pa.Table:
    """A parquet file, its columns `texts` dictionary-encoded.

    Raises:
        Unreadable: it is missing or damaged.
    """
    with _reading(file.name):
        table = pq.ParquetFile(file, read_dictionary=list(texts)).read()  # pq.read_table imports 0.1 s more
        return table.unify_dictionaries().combine_chunks()


def table_rows(file: Path, *columns: str) -> list[dict[str, Any]]:
    """The rows of a parquet file, of all columns or those of `columns` that it has.

    Raises:
        Unreadable: it is missing or damaged.
    """
    with _reading(file.name):
        rows: list[dict[str, Any]] = pq.ParquetFile(file).read(columns=list(columns) or None).to_pylist()
    return rows


def table_of(content: bytes, name: str) -> pa.Table:
    """Read the parquet content of a file called `name`.

    Raises:
        Unreadable: it is damaged.
    """
    with _reading(name):
        return pq.ParquetFile(io.BytesIO(content)).read()


class RowGroups:
    """A parquet file, read a row group at a time.

    Raises (every method, too):
        Unreadable: it is missing or damaged.
    """

    def __init__(self, file: Path) -> None:
        self._name = file.name
        with _reading(file.name):
            self._file = pq.ParquetFile(file)

    def __len__(self) -> int:
        return int(self._file.num_row_groups)

    def read(self, group: int, *columns: str) -> pa.Table:
        """A row group, all columns of it or those of `columns`."""
        with _reading(self._name):
            return self._file.read_row_group(group, columns=list(columns) or None)


@contextmanager
def _reading(name: str) -> Iterator[None]:
    """Report pyarrow's errors about a damaged file as `Unreadable`."""
    try:
        yield
    except FileNotFoundError:
        raise Missing(f"{name}: no such file", "a whole campaign directory") from None
    except (pa.ArrowException, OSError, ValueError, LookupError, TypeError, ArithmeticError) as error:
        what = f"{name}: can't be read: {' '.join(str(error).split())}"
        raise Unreadable(what, "a table as it was written") from None


def floats(column: Any) -> NDArray[np.float64]:
    """A column of numbers (N,), NaN where there is none."""
    whole = _whole(pc.cast(column, pa.float64()))
    values: NDArray[np.float64] = _buffer(whole, np.float64)
    if whole.null_count:
        values[_buffer(pc.cast(pc.is_null(whole), pa.uint8()), np.uint8) == 1] = np.nan
    return values


def integers(column: Any) -> NDArray[np.int64]:
    """A column of whole numbers (N,) without nulls."""
    return _buffer(_whole(pc.cast(column, pa.int64())), np.int64)


def codes(column: Any) -> tuple[NDArray[np.int64], list[str]]:
    """A column of texts as indices (N,) into its distinct texts, and these. Nothing (null) is the empty text."""
    whole = _whole(pc.dictionary_encode(pc.cast(column, pa.string()), null_encoding="encode"))
    return integers(whole.indices), [text or "" for text in whole.dictionary.to_pylist()]


def texts(column: Any) -> list[Any]:
    """A column of texts as a list, None for null."""
    found: list[Any] = column.to_pylist()
    return found


def taken(column: Any, rows: NDArray[np.bool_]) -> Any:
    """The entries of a column where `rows` (N,) is True."""
    indices = np.flatnonzero(rows)
    return column.take(pa.Array.from_buffers(pa.int64(), len(indices), [None, pa.py_buffer(indices)]))


def parsed(column: Any) -> pa.Table:
    """A column of JSON objects as a table, a row each, a column a key; without any key no columns.

    Raises:
        ValueError: what is no JSON object.
    """
    lines = texts(column)
    if all(line == "{}" for line in lines):  # of which pyarrow makes no rows
        return pa.table({})
    content = "\n".join(lines).encode()
    options = pyarrow.json.ReadOptions(use_threads=False, block_size=len(content) + 1)
    return pyarrow.json.read_json(io.BytesIO(content), read_options=options)


def _whole(column: Any) -> Any:
    return column.combine_chunks() if isinstance(column, pa.ChunkedArray) else column


def _buffer(array: Any, dtype: Any) -> NDArray[Any]:
    if not len(array):
        return np.zeros(0, dtype)
    return np.frombuffer(array.buffers()[1], dtype)[array.offset : array.offset + len(array)].copy()
