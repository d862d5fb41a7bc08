"""Tables of a block of runs that are not aligned with ticks: behaviors, and output of programs.

Behaviors are a compressed Arrow stream: a campaign reads one such small file for each configuration, and Parquet takes five times as
long and twice the room.
"""

import io
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from typing import IO, Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv
import pyarrow.parquet as pq
from numpy.typing import NDArray

from vastflow.sim.model.blocks import RUN_INDEX, array_of
from vastflow.sim.model.faults import Got
from vastflow.sim.model.files import Unreadable
from vastflow.sim.model.parquet import open_table
from vastflow.sim.model.recording import Columns, Outputs

MAX_UNPACKED_BYTES: Final = 512 * 2**20
MOST_OUTPUTS_BYTES: Final = 4 * 2**30
"""Size limit of all outputs of a configuration, unpacked; those of a run have at most 320 MiB."""
_LONG_AGO: Final = (1980, 1, 1, 0, 0, 0)
_DTYPES: Final[Mapping[str, Any]] = {"double": np.float64, "int64": np.int64, "bool": np.bool_, "string": object}


def columns_of(table: pa.Table) -> dict[str, NDArray[Any]]:
    """Return the columns of a table that this module wrote."""
    return {
        name: np.array(table.column(name).to_pylist(), _DTYPES[str(table.column(name).type)])
        for name in table.column_names
    }


def write_outputs(outputs: Mapping[int, Outputs]) -> bytes:
    """Write the outputs of runs, by run index, as one archive; equal outputs give equal bytes."""

    def parquet(columns: Columns) -> bytes:
        table = io.BytesIO()
        pq.write_table(_arrow_table(columns), table)
        return table.getvalue()

    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for run_index, each in sorted(outputs.items()):
            tables = {f"{run_index}/tables/{name}.parquet": parquet(table) for name, table in each.tables.items()}
            files = {f"{run_index}/files/{name}": content for name, content in each.files.items()}
            for name, content in sorted({**tables, **files}.items()):
                archive.writestr(zipfile.ZipInfo(name, _LONG_AGO), content, zipfile.ZIP_DEFLATED)
    return out.getvalue()


def unpacked(file: IO[bytes]) -> Iterator[tuple[tuple[int, str, str], bytes]]:
    """Yield run index, `tables` or `files`, and name of each entry of an archive of outputs, with its content.

    Raises:
        ValueError, BadZipFile: damaged, or larger than outputs are.
    """
    with zipfile.ZipFile(file) as archive:
        for place, entry in members_of(archive).items():
            yield place, archive.read(entry)


def members_of(archive: zipfile.ZipFile) -> dict[tuple[int, str, str], zipfile.ZipInfo]:
    """Return the entries of an archive of outputs by run index, `tables` or `files`, and name; raises as `unpacked` does."""
    entries = {entry.filename: entry for entry in archive.infolist()}
    if (found := sum(entry.file_size for entry in entries.values())) > MOST_OUTPUTS_BYTES:
        raise Unreadable(Got(f"{found:,} bytes of outputs when unpacked"), f"at most {MOST_OUTPUTS_BYTES:,}")
    places = ((name.split("/", 2), entry) for name, entry in entries.items())
    return {(int(run_index), kind, path): entry for (run_index, kind, path), entry in places}


def read_outputs(content: bytes) -> dict[int, Outputs]:
    """Read outputs that `write_outputs` wrote; raises as `unpacked` does."""
    tables: dict[int, dict[str, Columns]] = {}
    files: dict[int, dict[str, bytes]] = {}
    for (run_index, kind, name), written in unpacked(io.BytesIO(content)):
        if kind == "tables":
            tables.setdefault(run_index, {})[name.removesuffix(".parquet")] = columns_of(open_table(written).read())
        else:
            files.setdefault(run_index, {})[name] = written
    return {run: Outputs(tables.get(run, {}), files.get(run, {})) for run in sorted({*tables, *files})}


def one_archive(blocks: Sequence[bytes], runs: int) -> bytes:
    """Join the outputs of blocks for runs below `runs`; empty without any."""
    found = {run: outputs for block in blocks for run, outputs in read_outputs(block).items() if run < runs}
    return write_outputs(found) if found else b""


def table(types: Mapping[str, type], rows: Sequence[Sequence[Any]]) -> dict[str, NDArray[Any]]:
    """Return columns of the given names and types (float, int, bool, str) from rows."""
    columns = zip(*rows, strict=True) if rows else ([] for _ in types)
    return {
        name: np.array(column, dtype=object if kind is str else kind)
        for (name, kind), column in zip(types.items(), columns, strict=True)
    }


def _arrow_table(columns: Columns) -> pa.Table:
    kinds = {"f": pa.float64(), "i": pa.int64(), "u": pa.int64(), "b": pa.bool_()}
    return pa.table(
        {name: pa.array(values.tolist(), kinds.get(values.dtype.kind, pa.string())) for name, values in columns.items()}
    )


def write_behaviors(runs: Mapping[int, Columns]) -> bytes:
    """Write tables of equal columns, by run index, as one file; equal tables give equal bytes."""
    names = list(next(iter(runs.values()), {}))
    lengths = [len(next(iter(table.values()), ())) for table in runs.values()]
    index = np.repeat(np.array(list(runs), dtype=np.int64), lengths)
    stacked = {name: np.concatenate([table[name] for table in runs.values()]) for name in names}
    table = _arrow_table({RUN_INDEX: index, **stacked})
    stream = pa.BufferOutputStream()
    with pa.ipc.new_stream(stream, table.schema) as writer:
        writer.write_table(table)
    content = stream.getvalue()
    packed: bytes = pa.Codec("zstd").compress(content, asbytes=True)
    return b"%d %b" % (content.size, packed)


def read_behaviors(block: bytes) -> pa.Table:
    """Read behaviors that `write_behaviors` wrote; raises `ValueError` if they are damaged."""
    size, _, content = block.partition(b" ")
    if not size.isdigit():
        raise ValueError("no behaviors as vastflow writes them")
    return pa.ipc.open_stream(pa.Codec("zstd").decompress(content, decompressed_size=int(size))).read_all()


def behaviors_below(blocks: Sequence[bytes], runs: int) -> pa.Table | None:
    """Join the behaviors of runs below `runs`, run by run, each once; None without any.

    Blocks may overlap: campaigns cut the same runs differently.
    """
    parts = []
    seen: set[int] = set()
    for table in map(read_behaviors, blocks):
        index = array_of(table.column(RUN_INDEX))
        new = np.flatnonzero((index < runs) & ~np.isin(index, sorted(seen)))
        parts.append(table.take(pa.array(new.tolist(), pa.int64())))
        seen.update(index.tolist())
    if not any(part.num_rows for part in parts):
        return None
    whole = pa.concat_tables(parts).combine_chunks()
    order = np.argsort(array_of(whole.column(RUN_INDEX)), kind="stable")
    return whole.take(pa.array(order.tolist(), pa.int64()))


def read_foreign_table(name: str, content: bytes) -> tuple[Columns, tuple[str, ...]]:
    """Read the columns of a CSV or Parquet file, with notes on omitted ones.

    A missing value is NaN in a column of numbers or truth values, which then is float64, and empty in a column of text.
    Moments are seconds since 1970, times of day seconds since midnight.

    Raises:
        ValueError: it can't be read; says why in one line.
    """
    try:
        if name.lower().endswith(".parquet"):
            return _foreign_columns(_parquet(content))
        # One block: a column's type follows from all of its values, not from those of the first mebibyte.
        reading = pyarrow.csv.ReadOptions(use_threads=False, block_size=len(content) + 1)
        return _foreign_columns(pyarrow.csv.read_csv(io.BytesIO(content), reading))
    except (pa.ArrowException, UnicodeDecodeError, OSError) as error:
        raise ValueError(f"not a table: {' '.join(str(error).split())[:300]}") from None


def _parquet(content: bytes) -> Any:
    file = open_table(content)
    groups = range(file.metadata.num_row_groups)
    unpacked = sum(file.metadata.row_group(i).total_byte_size for i in groups)
    if unpacked > MAX_UNPACKED_BYTES:
        raise ValueError(f"not read: {unpacked} bytes when unpacked, more than {MAX_UNPACKED_BYTES}")
    return file.read()


def _foreign_columns(table: Any) -> tuple[Columns, tuple[str, ...]]:
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
        return _floats(column.cast(pa.timestamp("us", getattr(kind, "tz", None)), safe=False).cast(pa.int64()), 1e-6)
    if pa.types.is_time(kind) or pa.types.is_duration(kind):
        unit = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}[kind.unit]
        return _floats(column.cast(pa.int32() if kind.bit_width == 32 else pa.int64()), unit)
    if pa.types.is_boolean(kind):
        if column.null_count:
            return _floats(column.cast(pa.uint8()))
        return array_of(column.cast(pa.uint8())).astype(np.bool_)
    if pa.types.is_integer(kind) and not column.null_count:
        try:
            return array_of(column.cast(pa.int64()))
        except pa.ArrowInvalid:  # beyond 2**63
            return _floats(column)
    if pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_decimal(kind) or pa.types.is_null(kind):
        return _floats(column)
    return None


def _floats(column: Any, factor: float = 1.0) -> NDArray[np.float64]:
    values: NDArray[np.float64] = array_of(pc.fill_null(column.cast(pa.float64(), safe=False), float("nan")))
    return values * factor
