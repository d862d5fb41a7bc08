"""What is kept of a run beside its aligned columns: tables with rows of their own, and what its programs wrote."""

import io
import zipfile
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from vastflow.sim.process.outputs import Outputs
from vastflow.sim.process.tables import Columns

_LONG_AGO: Final = (1980, 1, 1, 0, 0, 0)


def write_table(columns: Columns) -> bytes:
    """A table as one parquet file; equal columns give equal bytes."""
    out = io.BytesIO()
    pq.write_table(pa.table({name: pa.array(values.tolist(), _type(values)) for name, values in columns.items()}), out)
    return out.getvalue()


def read_table(content: bytes) -> dict[str, NDArray[Any]]:
    """What `write_table` wrote."""
    table = pq.read_table(io.BytesIO(content))
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


def stacked(tables: Mapping[int, Columns]) -> dict[str, NDArray[Any]]:
    """Tables of equal columns, one of each run, under each other behind a column `run_index`."""
    names = list(next(iter(tables.values()), {}))
    lengths = [len(next(iter(table.values()), ())) for table in tables.values()]
    index = np.repeat(np.array(list(tables), dtype=np.int64), lengths)
    return {"run_index": index, **{name: np.concatenate([table[name] for table in tables.values()]) for name in names}}


def one_table(blocks: Sequence[bytes], runs: int) -> bytes:
    """Tables of several blocks of runs under each other, as far as they are of runs below `runs`; empty without any.

    The same bytes however the runs were blocked.
    """
    if len(blocks) == 1 and _all_below(blocks[0], runs):
        return blocks[0]
    parts = [read_table(block) for block in blocks]
    if not parts:
        return b""
    whole = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    order = np.argsort(whole["run_index"], kind="stable")
    wanted = order[whole["run_index"][order] < runs]
    return write_table({name: column[wanted] for name, column in whole.items()})


def _all_below(block: bytes, runs: int) -> bool:
    """Whether a table is of runs below `runs` alone, by its statistics."""
    metadata = pq.read_metadata(io.BytesIO(block))
    groups = [metadata.row_group(k).column(0).statistics for k in range(metadata.num_row_groups)]
    return all(group is not None and group.max is not None and group.max < runs for group in groups)


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
