"""One row for each run: what varied, what came of it and what was said of it, each in a column of its own."""

import json
from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from vastflow.oracles.evidence.varied import surroundings_rows, varied_rows
from vastflow.oracles.results.column import codes, floats, integers
from vastflow.oracles.results.executed import environment_names
from vastflow.oracles.results.tables import Tables
from vastflow.oracles.results.verdict_table import FAIL, PASS

WIDE_FILE: Final = "runs_wide.parquet"
MISSING: Final = -1
"""Code of a run that has no text."""
_TEXTS: Final = ("outcome", "reason", "cause", "stood_still")
_NUMBERS: Final = ("simulated_s", "distance_m", "recoveries", "missed_goals", "contacts")
_RUNS: Final = 1 << 31


@dataclass(frozen=True, eq=False)
class TextColumn:
    """Texts of runs: (R,) indices into `known`, `MISSING` where there is none."""

    codes: NDArray[np.int32] = field(repr=False)
    known: tuple[str, ...]


WideColumn = TextColumn | NDArray[Any]
"""Texts, numbers (NaN where there is none), or what is true (1), false (0) or missing (-1)."""


@dataclass(frozen=True, eq=False)
class WideTable:
    """One row for each run that was judged or should have been, in the order of configurations.

    Attributes:
        columns: Name to column. Factors have the names of the campaign file; one that is named like another column has `factor.` before it.
        truths: Names of the columns that are true, false or missing.
    """

    columns: Mapping[str, WideColumn] = field(repr=False)
    truths: frozenset[str]


def wide_table(tables: Tables) -> WideTable:
    """Join the tables of a campaign directory; what was not judged is missing, never false."""
    verdicts = tables.verdicts
    columns: dict[str, WideColumn] = {
        "configuration": TextColumn(verdicts.configuration.astype(np.int32), verdicts.names),
        "family": _by_configuration(tables.configurations.families, verdicts.configuration),
        "run_index": verdicts.run_index,
        **_of_runs(tables),
    }
    said = {"passed": verdicts.together}
    said |= {f"passed.{oracle}": verdicts.of(oracle) for oracle in tables.oracles}
    truths = {
        name: np.where(code == PASS, 1, np.where(code == FAIL, 0, MISSING)).astype(np.int8)
        for name, code in said.items()
    }
    columns |= truths
    for oracle in tables.oracles:
        for name, metric in verdicts.metrics(oracle).items():
            unit = f" ({metric.unit})" if metric.unit not in ("", "1") else ""
            columns[_free(f"{oracle}.{name}{unit}", "metric", columns)] = metric.values
    return WideTable({**columns, **_factors(tables, columns)}, frozenset(truths))


def write_wide(directory: Path, found: WideTable) -> None:
    """Write `runs_wide.parquet`: its columns as they are, texts encoded as dictionaries, what is missing as null."""
    arrays = {name: _array(column, name in found.truths) for name, column in found.columns.items()}
    table = pa.Table.from_arrays(list(arrays.values()), list(arrays))
    table = table.replace_schema_metadata({"pandas": json.dumps(_for_pandas(found.truths))})
    pq.write_table(table, directory / WIDE_FILE, compression="zstd")


def _for_pandas(truths: Iterable[str]) -> dict[str, Any]:
    """What pandas is to know: of its columns of objects, which others may be missing in, it would take no mean."""
    columns = [
        {"name": name, "field_name": name, "pandas_type": "bool", "numpy_type": "boolean", "metadata": None}
        for name in sorted(truths)
    ]
    return {"index_columns": [], "column_indexes": [], "columns": columns}


def _array(column: WideColumn, is_truth: bool) -> pa.Array:
    """Made of buffers, for what takes numpy arrays imports pandas."""
    if isinstance(column, TextColumn):
        indices = _buffered(pa.int32(), column.codes, column.codes != MISSING)
        known = pa.lib.StringBuilder()
        known.append_values(list(column.known))
        return pa.DictionaryArray.from_arrays(indices, known.finish())
    if is_truth:
        return _buffered(pa.bool_(), np.packbits(column == 1, bitorder="little"), column != MISSING)
    if column.dtype == np.float64:
        return _buffered(pa.float64(), column, np.isfinite(column))
    return _buffered(pa.int64(), column, np.ones(len(column), dtype=np.bool_))


def _buffered(kind: pa.DataType, values: NDArray[Any], there: NDArray[np.bool_]) -> pa.Array:
    bits = np.packbits(there, bitorder="little")
    return pa.Array.from_buffers(kind, len(there), [pa.py_buffer(bits), pa.py_buffer(np.ascontiguousarray(values))])


def _of_runs(tables: Tables) -> dict[str, WideColumn]:
    """The columns of `runs.parquet`; a run that was not recorded has none of their values."""
    runs, verdicts = tables.runs, tables.verdicts
    places = {name: k for k, name in enumerate(verdicts.names)}
    found, known = codes(runs["configuration"])
    place = np.array([places[name] for name in known], dtype=np.int64)
    keys = (place[found] if len(place) else found) * _RUNS + integers(runs["run_index"])
    order = np.argsort(keys)
    wanted = verdicts.configuration * _RUNS + verdicts.run_index
    at = np.searchsorted(keys[order], wanted)
    there = np.zeros(len(wanted), dtype=np.bool_)
    inside = at < len(keys)
    there[inside] = keys[order][at[inside]] == wanted[inside]
    row = order[np.minimum(at, max(len(keys) - 1, 0))] if len(keys) else np.zeros(len(wanted), dtype=np.int64)
    columns: dict[str, WideColumn] = {}
    for name in _TEXTS:
        if name in runs.column_names and len(keys):
            indices, texts = codes(runs[name])
            empty = np.array([not text for text in texts], dtype=np.bool_)
            of_row = np.where(there & ~empty[indices[row]], indices[row], MISSING)
            columns[name] = TextColumn(of_row.astype(np.int32), tuple(text or "" for text in texts))
    for name in _NUMBERS:
        if name in runs.column_names and len(keys):
            columns[name] = np.where(there, floats(runs[name])[row], np.nan)
    return columns


def _factors(tables: Tables, others: Iterable[str]) -> dict[str, WideColumn]:
    found = tables.configurations
    maps = environment_names(tables.directory, dict.fromkeys(filter(None, found.environments)))
    varied = varied_rows(found, range(len(found)), maps)
    rows = [{**seen, **row} for row, seen in zip(varied, surroundings_rows(found, range(len(found))), strict=True)]
    taken = dict.fromkeys(others)
    names = dict.fromkeys(name for row in rows for name in row)
    of_run = tables.verdicts.configuration
    columns: dict[str, WideColumn] = {}
    for name in names:
        values = [row.get(name) for row in rows]
        shown = _free(name, "factor", {**taken, **columns})
        if all(value is None or (isinstance(value, int | float) and not isinstance(value, bool)) for value in values):
            columns[shown] = np.array([np.nan if value is None else float(value) for value in values])[of_run]
        else:
            columns[shown] = _by_configuration(values, of_run)
    return columns


def _free(name: str, kind: str, taken: Container[str]) -> str:
    """`name`, with its `kind` before it as often as another column is called so."""
    while name in taken:
        name = f"{kind}.{name}"
    return name


def _by_configuration(values: Sequence[Any], of_run: NDArray[np.int64]) -> TextColumn:
    texts = [value if isinstance(value, str) else None if value is None else json.dumps(value) for value in values]
    known = tuple(dict.fromkeys(text for text in texts if text is not None))
    places = {text: k for k, text in enumerate(known)}
    of = np.array([MISSING if text is None else places[text] for text in texts], dtype=np.int32)
    return TextColumn(of[of_run], known)
