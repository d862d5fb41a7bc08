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
