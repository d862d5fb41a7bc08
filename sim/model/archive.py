"""Tables of a block of runs beside its aligned columns, and what its programs wrote, in one file each.

Behaviors are a stream of Arrow's, compressed as a whole. A campaign reads one of these small files for each of its configurations, and
one in parquet's format takes five times as long and twice the room.
"""

import io
import zipfile
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from vastflow.sim.model.recording import Outputs
from vastflow.sim.model.tables import Columns

_LONG_AGO: Final = (1980, 1, 1, 0, 0, 0)


def write_table(columns: Columns) -> bytes:
    """A table as one parquet file; equal columns give equal bytes."""
    out = io.BytesIO()
    pq.write_table(arrow_table(columns), out)
    return out.getvalue()


def read_table(content: bytes) -> dict[str, NDArray[Any]]:
    """What `write_table` wrote."""
    return columns_of(pq.read_table(io.BytesIO(content)))


def arrow_table(columns: Columns) -> pa.Table:
    """A table as pyarrow has it."""
    return pa.table({name: pa.array(values.tolist(), _type(values)) for name, values in columns.items()})


def columns_of(table: pa.Table) -> dict[str, NDArray[Any]]:
    """The columns of what `arrow_table` made; of another table, those of numbers, truth values and texts."""
    return {
        name: np.array(table.column(name).to_pylist(), _DTYPES[str(table.column(name).type)])
        for name in table.column_names
    }


def write_outputs(outputs: Mapping[int, Outputs]) -> bytes:
    """The outputs of runs, by run index, as one archive; equal outputs give equal bytes."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for run_index, each in sorted(outputs.items()):
            tables = {f"{run_index}/tables/{name}.parquet": write_table(each.tables[name]) for name in each.tables}
            files = {f"{run_index}/files/{name}": content for name, content in each.files.items()}
            for name, content in sorted({**tables, **files}.items()):
                archive.writestr(zipfile.ZipInfo(name, _LONG_AGO), content, zipfile.ZIP_DEFLATED)
    return out.getvalue()


def read_outputs(content: bytes) -> dict[int, Outputs]:
    """What `write_outputs` wrote."""
    tables: dict[int, dict[str, Columns]] = {}
    files: dict[int, dict[str, bytes]] = {}
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        for entry in archive.namelist():
            number, kind, name = entry.split("/", 2)
            run_index = int(number)
            if kind == "tables":
                tables.setdefault(run_index, {})[name.removesuffix(".parquet")] = read_table(archive.read(entry))
            else:
                files.setdefault(run_index, {})[name] = archive.read(entry)
    return {run: Outputs(tables.get(run, {}), files.get(run, {})) for run in sorted({*tables, *files})}


def one_archive(blocks: Sequence[bytes], runs: int) -> bytes:
    """Outputs of several blocks of runs together, as far as they are of runs below `runs`; empty without any."""
    found = {run: outputs for block in blocks for run, outputs in read_outputs(block).items() if run < runs}
    return write_outputs(found) if found else b""


def table(types: Mapping[str, type], rows: Sequence[Sequence[Any]]) -> dict[str, NDArray[Any]]:
    """Columns of the given names and types (float, int, bool, str) from rows."""
    columns = zip(*rows, strict=True) if rows else ([] for _ in types)
    return {
        name: np.array(column, dtype=object if kind is str else kind)
        for (name, kind), column in zip(types.items(), columns, strict=True)
    }


def _type(values: NDArray[Any]) -> Any:
    return {"f": pa.float64(), "i": pa.int64(), "u": pa.int64(), "b": pa.bool_()}.get(values.dtype.kind, pa.string())


_DTYPES: Final[Mapping[str, Any]] = {"double": np.float64, "int64": np.int64, "bool": np.bool_, "string": object}


RUN_INDEX = "run_index"


def write_behaviors(runs: Mapping[int, Columns]) -> bytes:
    """Tables of equal columns, by run index, as one file; equal tables give equal bytes."""
    table = arrow_table(_stacked(runs))
    stream = pa.BufferOutputStream()
    with pa.ipc.new_stream(stream, table.schema) as writer:
        writer.write_table(table)
    content = stream.getvalue()
    packed: bytes = pa.Codec("zstd").compress(content, asbytes=True)
    return b"%d %b" % (content.size, packed)


def read_behaviors(block: bytes) -> pa.Table:
    """What `write_behaviors` wrote.

    Raises:
        ValueError: it is damaged.
    """
    size, _, content = block.partition(b" ")
    if not size.isdigit():
        raise ValueError("no behaviors as vastflow writes them")
    return pa.ipc.open_stream(pa.Codec("zstd").decompress(content, decompressed_size=int(size))).read_all()


def behaviors_below(blocks: Sequence[bytes], runs: int) -> pa.Table | None:
    """The behaviors of all runs below `runs`, run by run, each once: campaigns may have cut the same runs differently.

    None where no block has any of them.
    """
    parts = []
    seen: set[int] = set()
    for table in map(read_behaviors, blocks):
        index = _index(table)
        parts.append(table.take(_numbers(np.flatnonzero((index < runs) & ~np.isin(index, sorted(seen))))))
        seen.update(index.tolist())
    if not any(part.num_rows for part in parts):
        return None
    whole = pa.concat_tables(parts).combine_chunks()
    return whole.take(_numbers(np.argsort(_index(whole), kind="stable")))


def _stacked(runs: Mapping[int, Columns]) -> Columns:
    names = list(next(iter(runs.values()), {}))
    lengths = [len(next(iter(table.values()), ())) for table in runs.values()]
    index = np.repeat(np.array(list(runs), dtype=np.int64), lengths)
    return {RUN_INDEX: index, **{name: np.concatenate([table[name] for table in runs.values()]) for name in names}}


def _index(table: pa.Table) -> NDArray[np.int64]:
    """The runs of rows; pyarrow's `to_numpy` would import pandas."""
    return np.array(np.from_dlpack(table.column(RUN_INDEX).combine_chunks()), dtype=np.int64)


def _numbers(rows: NDArray[np.int64]) -> pa.Array:
    """Numbers of rows; `pyarrow.array` would import pandas."""
    numbers = np.ascontiguousarray(rows, dtype=np.int64)
    return pa.Array.from_buffers(pa.int64(), len(numbers), [None, pa.py_buffer(numbers)])
