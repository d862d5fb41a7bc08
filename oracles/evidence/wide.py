"""The wide table: one row a run, with factors, outcome, and verdicts in columns."""

import json
from collections.abc import Container, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from vastflow.oracles.evidence.evidence import run_weights
from vastflow.oracles.evidence.findings import looks_of
from vastflow.oracles.evidence.varied import path_property_rows, varied_rows
from vastflow.oracles.results.executed import environment_names
from vastflow.oracles.results.schema import codes, floats, integers
from vastflow.oracles.results.tables import FAIL, PASS, Tables, VerdictTable, run_keys

WIDE_FILE: Final = "runs_wide.parquet"
_ROWS: Final = 1 << 17
_TEXTS: Final = ("outcome", "reason", "cause", "stood_still")
_NUMBERS: Final = ("simulated_s", "distance_m", "recoveries", "missed_goals", "contacts")


def wide_table(tables: Tables) -> pd.DataFrame:
    """One row for each run, judged or not, in the order of configurations.

    `passed` is the joint judgment and `passed.<oracle>` that of one oracle: true, false, or missing where unjudged. Metrics are
    `<oracle>.<metric> (<unit>)`. Where runs ended by a rule, `weight` is that of each run in its configuration's unbiased rate; of a search,
    `purpose` parts the runs that confirm the best point from those that found it. Factors have the names of the campaign file, with `factor.` before names that are taken; those
    that are not all numbers are text.
    """
    verdicts = tables.verdicts
    columns: dict[str, Any] = {
        "configuration": pd.Categorical.from_codes(verdicts.configuration, pd.Index(verdicts.names, dtype="string")),
        "family": _by_configuration(tables.configurations.families, verdicts.configuration),
        "run_index": verdicts.run_index,
        **_of_runs(tables),
    }
    if (looks := looks_of(tables.metadata)) is not None:
        columns["weight"] = run_weights(looks, verdicts)
    if searched := tables.metadata.get("search"):
        columns["purpose"] = _purposes(searched, verdicts)
    for oracle in (None, *tables.oracles):
        said = verdicts.of(oracle)
        judged = (said == PASS) | (said == FAIL)
        columns[f"passed.{oracle}" if oracle else "passed"] = pd.arrays.BooleanArray(said == PASS, ~judged)
    for oracle in tables.oracles:
        for name, metric in verdicts.metrics(oracle).items():
            unit = f" ({metric.unit})" if metric.unit not in ("", "1") else ""
            columns[_free(f"{oracle}.{name}{unit}", "metric", columns)] = metric.values
    return pd.DataFrame({**columns, **_factors(tables, columns)})


def write_wide(directory: Path, found: pd.DataFrame) -> None:
    """Write a wide table in parts, as a copy of a million rows in pyarrow's form takes 100 MB."""
    schema = pa.Schema.from_pandas(found, preserve_index=False)
    with pq.ParquetWriter(directory / WIDE_FILE, schema, compression="zstd") as writer:
        for start in range(0, len(found), _ROWS):
            rows = found.iloc[start : start + _ROWS]
            writer.write_table(pa.Table.from_pandas(rows, schema, preserve_index=False))


def _of_runs(tables: Tables) -> dict[str, Any]:
    """Columns of `runs.parquet` in the order of the verdicts: by codes, as texts of a million runs take a gigabyte."""
    runs, verdicts = tables.runs, tables.verdicts
    known = [name for name in (*_TEXTS, *_NUMBERS) if name in runs.column_names] if len(runs) else []
    code, names = codes(runs["configuration"])
    places = pd.Index(verdicts.names).get_indexer(names)
    keys, first = np.unique(run_keys(places[code], integers(runs["run_index"])), return_index=True)
    at = pd.Index(keys).get_indexer(run_keys(verdicts.configuration, verdicts.run_index))
    columns: dict[str, Any] = {}
    for name in known:
        if name in _NUMBERS:
            columns[name] = np.where(at < 0, np.nan, floats(runs[name])[first[at]])
            continue
        code, texts = codes(runs[name])
        said = pd.Categorical.from_codes(np.where(at < 0, -1, code[first[at]]), _texts(texts))
        columns[name] = said.set_categories(_texts(sorted({*said.remove_unused_categories().categories} - {""})))
    return columns


def _purposes(searched: Mapping[str, Any], verdicts: VerdictTable) -> pd.Categorical:
    """`confirmation` of the best point's fresh runs, whose indices the search never used; else `search`."""
    fresh = np.zeros(len(verdicts), dtype=np.int8)
    if searched["best"] is not None and searched["confirmation"] is not None:
        best = verdicts.rows_of(verdicts.names.index(searched["best"]["configuration"]))
        fresh[best] = verdicts.run_index[best] >= searched["best"]["runs"]
    return pd.Categorical.from_codes(fresh, _texts(("search", "confirmation")))


def _factors(tables: Tables, others: Iterable[str]) -> dict[str, Any]:
    found = tables.configurations
    maps = environment_names(tables.directory, found.environments)
    varied = varied_rows(found, range(len(found)), maps)
    rows = [{**seen, **row} for row, seen in zip(varied, path_property_rows(found, range(len(found))), strict=True)]
    taken = dict.fromkeys(others)
    names = dict.fromkeys(name for row in rows for name in row)
    of_run = tables.verdicts.configuration
    columns: dict[str, Any] = {}
    for name in names:
        values = [row.get(name) for row in rows]
        shown = _free(name, "factor", {**taken, **columns})
        if all(value is None or (isinstance(value, int | float) and not isinstance(value, bool)) for value in values):
            columns[shown] = np.array([np.nan if value is None else float(value) for value in values])[of_run]
        else:
            columns[shown] = _by_configuration(values, of_run)
    return columns


def _free(name: str, kind: str, taken: Container[str]) -> str:
    """`name`, prefixed by `kind` until it is free."""
    while name in taken:
        name = f"{kind}.{name}"
    return name


def _by_configuration(values: Sequence[Any], of_run: NDArray[np.int64]) -> pd.Categorical:
    texts = [value if isinstance(value, str) else None if value is None else json.dumps(value) for value in values]
    return pd.Categorical(texts, _texts(dict.fromkeys(text for text in texts if text is not None)))[of_run]


def _texts(texts: Iterable[str]) -> pd.Index:
    return pd.Index(texts, dtype="string")
