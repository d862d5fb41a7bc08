"""The schema of a campaign directory's tables: written from rows and columns, read as columns.

Readers raise `Unreadable` for a file that is missing or damaged.

Whatever of pyarrow takes or gives a numpy array or a Python scalar (`to_numpy`, `pa.array`, `fill_null`) imports pandas, which
costs 0.4 s where only a terminal wants a number; so buffers are handed over as they are.
"""

import itertools
import json
import math
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final, Self

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from numpy.typing import NDArray

from vastflow.oracles.results.former import FORMER
from vastflow.oracles.results.unusable import DAMAGE
from vastflow.sim.model.archive import columns_of
from vastflow.sim.model.digest import FileContent, Value
from vastflow.sim.model.files import Missing, Unreadable
from vastflow.sim.model.parquet import open_table, rows_with

BEHAVIORS_FILE: Final = "behaviors.parquet"
CONFIGURATION: Final = "configuration"
Row = Mapping[str, Any]
Columns = Mapping[str, Sequence[Any]]
"""Name to the values of rows, as many in each."""

_ROWS_A_GROUP: Final = 8192
_PLAIN_TEXT: Final = json.JSONEncoder(ensure_ascii=False, separators=(",", ":"), allow_nan=False).encode

_TEXT, _NUMBER, _COUNT = pa.string(), pa.float64(), pa.int32()
_REQUESTED: Final = ("name", "family", "scenario_digest", "checked_digest", "duplicate_of", "environment", "abstract")
CONFIGURATIONS: Final = pa.schema(
    {
        **dict.fromkeys(_REQUESTED, _TEXT),
        "timeout_s": _NUMBER,
        **dict.fromkeys(("scenario", "factors", "provenance", "steps"), _TEXT),
    }
)
REJECTIONS: Final = pa.schema(dict.fromkeys(("family", "parent", "producer", "reason", "requested", "inputs"), _TEXT))
EXCLUSIONS: Final = pa.schema(dict.fromkeys(("family", "name", "constraint", "values"), _TEXT))
_RUN: Final = {"configuration": _TEXT, "family": _TEXT, "run_index": _COUNT}
RUNS: Final = pa.schema(
    {
        **_RUN,
        "seed": _TEXT,
        "outcome": _TEXT,
        "error_code": _COUNT,
        "reason": _TEXT,
        "simulated_s": _NUMBER,
        "distance_m": _NUMBER,
        **dict.fromkeys(("recoveries", "missed_goals", "contacts"), _COUNT),
        "stood_still": _TEXT,
    }
)
JUDGED_RUNS: Final = RUNS.append(pa.field("cause", _TEXT))
"""Columns of `runs.parquet`: records of each run, and the cause of its failure."""
METRICS: Final = "metrics"
_TEXTS: Final = frozenset({"configuration", "family", "judgment", "name", "oracle", "producer", "reason"})
"""Columns of names and words, in whatever table they are."""
VERDICTS: Final = pa.schema({**_RUN, **dict.fromkeys(("oracle", "judgment", "reason", METRICS), _TEXT)})


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
    """Build a table from columns of rows."""
    whole: dict[str, list[Any]] = {name: [] for name in schema.names}
    for part in parts:
        for name, values in whole.items():
            values += part[name]
    return pa.Table.from_arrays([column_array(whole[each.name], each.type) for each in schema], schema=schema)


def write_table(path: Path, schema: pa.Schema, rows: Iterable[Row]) -> None:
    """Write `rows` as parquet, see `TableWriter`; missing values are null."""
    waiting = iter(rows)
    with TableWriter(path, schema) as writer:
        while some := list(itertools.islice(waiting, _ROWS_A_GROUP)):
            if unexpected := {name for row in some for name in row}.difference(schema.names):
                raise ValueError(f"unexpected field {min(unexpected)!r}. Expected one of {', '.join(schema.names)}")
            writer.add(column_table(schema, [{name: [row.get(name) for row in some] for name in schema.names}]))


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


def read_columns(file: Path, *texts: str, without: Container[str] = ()) -> pa.Table:
    """A parquet file without some of its columns, its columns `texts` dictionary-encoded."""
    with _reading(file.name):
        try:
            rows = _opened(file, texts)
        except KeyError:  # of the former version
            former = {now: name for name, now in FORMER.items()}
            rows = _opened(file, [former.get(name, name) for name in texts])
        columns = [name for name in rows.schema_arrow.names if name not in without]
        return renamed(rows.read(columns=columns).unify_dictionaries())


def text_batches(file: Path, column: str, rows: int) -> Iterator[pa.Array]:
    """A column of texts, a bounded number of rows at a time."""
    with _reading(file.name):
        for batch in _opened(file).iter_batches(rows, columns=[column]):
            yield batch[0]


def table_rows(file: Path, *columns: str) -> list[dict[str, Any]]:
    """The rows of a parquet file, with all columns or its columns among `columns`."""
    with _reading(file.name):
        rows: list[dict[str, Any]] = renamed(_opened(file).read(columns=list(columns) or None)).to_pylist()
    return rows


def renamed(table: pa.Table) -> pa.Table:
    """A table with the present names of its columns, see `FORMER`."""
    return table.rename_columns([FORMER.get(name, name) for name in table.column_names])


def rows_of(file: Path, column: str, value: str) -> pa.Table:
    """The rows of a parquet file with a value in a column of texts."""
    with _reading(file.name):
        _check_texts((found := rows_with(file, column, value)).schema)
    return renamed(found)


def table_of(content: bytes, name: str) -> pa.Table:
    """Read the parquet content of a file called `name`."""
    with _reading(name):
        return _opened(content).read()


def behaviors_of(directory: Path, configuration: str) -> dict[str, NDArray[Any]]:
    """Columns of the behaviors of a configuration's runs, `run_index` among them; empty where no run was recorded."""
    file = directory / BEHAVIORS_FILE
    if not file.is_file():
        return {}
    rows = rows_of(file, CONFIGURATION, configuration)
    return columns_of(rows.drop_columns([CONFIGURATION])) if len(rows) else {}


def _opened(source: Path | bytes, texts: Sequence[str] = ()) -> Any:
    found = open_table(source, texts)
    _check_texts(found.schema_arrow)
    return found


def _check_texts(schema: pa.Schema) -> None:
    for each in schema:
        kind = each.type.value_type if pa.types.is_dictionary(each.type) else each.type
        if FORMER.get(each.name, each.name) in _TEXTS and not (
            pa.types.is_string(kind) or pa.types.is_large_string(kind)
        ):
            raise ValueError(f"column {each.name}: expected text, got {each.type}")


@contextmanager
def _reading(name: str) -> Iterator[None]:
    """Report pyarrow's errors about a damaged file as `Unreadable`."""
    try:
        yield
    except FileNotFoundError:
        raise Missing(f"{name}: no such file", "a whole campaign directory") from None
    except (pa.ArrowException, *DAMAGE) as error:
        what = f"{name}: can't be read: {' '.join(str(error).split()) or type(error).__name__}"
        raise Unreadable(what, "expected a table as it was written") from None


def floats(column: Any) -> NDArray[np.float64]:
    """A column of numbers (N,), NaN for null."""
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


def _whole(column: Any) -> Any:
    return column.combine_chunks() if isinstance(column, pa.ChunkedArray) else column


def _buffer(array: Any, dtype: Any) -> NDArray[Any]:
    if not len(array):
        return np.zeros(0, dtype)
    return np.frombuffer(array.buffers()[1], dtype)[array.offset : array.offset + len(array)].copy()
