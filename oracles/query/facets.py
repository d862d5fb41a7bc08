"""Views of selected runs: rates, facets, pages of configurations, points, and reasons."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final, Literal, TypeAlias

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import scipy.special  # noqa: F401 - which intervals import when they are first asked for, while somebody waits
from numpy.typing import NDArray

from vastflow.oracles.evidence.headline import Headline
from vastflow.oracles.query.selection import (
    Between,
    Bools,
    Column,
    Condition,
    Filter,
    Runs,
    RunTable,
    ValuesOf,
    is_place,
    mask_of,
    number_text,
)
from vastflow.oracles.results.factors import MOST_LEVELS
from vastflow.oracles.results.tables import FAIL, NOT_JUDGED, PASS
from vastflow.oracles.statistics.intervals import Counts
from vastflow.oracles.statistics.looks import mean_rate

Kind: TypeAlias = Literal["values", "numbers", "constant", "places"]

BINS: Final = 24
MOST_VALUES: Final = 12
"""Values of a text that a facet lists; the most frequent of the selection."""
MOST_REASONS: Final = 12
_VERDICTS: Final = 3
_NO_FACETS: Final = ("configuration", "run_index")
_AXES: Final = ("factor", "path", "metric")
_SAMPLE: Final = 1000
_DIGITS: Final = 12
"""Significant digits of a mean, which hide its rounding."""


@dataclass(frozen=True, eq=False)
class Facet:
    """A column cut into bins or values, so that counting one is a single pass.

    Attributes:
        edges: (BINS + 1,) of `numbers`; empty otherwise.
        values: Texts of `values` and the one of `constant`, None for a missing value.
        cells: (R,) index of the bin or value; missing numbers are in the bin after the last.
    """

    column: Column
    kind: Kind
    edges: NDArray[np.float64] = field(repr=False)
    values: tuple[str | None, ...] = field(repr=False)
    cells: NDArray[np.int32] = field(repr=False)

    @property
    def size(self) -> int:
        """Number of cells."""
        return len(self.values) or BINS + 1


def facet_of(column: Column) -> Facet:
    """Return the facet of a column: few distinct numbers are values, more of them bins."""
    if column.levels is not None:
        used = np.unique(np.where(column.values < 0, len(column.levels), column.values))  # missing ones come last
        names: list[str | None] = [*column.levels, None]
        names = [names[k] for k in used.tolist()]
        if any(name is not None and is_place(name) for name in names[:2]) and len(used) > 1:
            return Facet(column, "places", np.zeros(0), (), np.zeros(0, dtype=np.int32))
        return _of_values(column, names, np.searchsorted(used, column.values % (len(column.levels) + 1)))
    missing = ~np.isfinite(column.values)
    finite = column.values[~missing]
    # Sorting all of a hundred thousand numbers takes long, and a few of them mostly tell.
    if len(np.unique(finite[:: max(len(finite) // _SAMPLE, 1)])) <= MOST_LEVELS:
        known = np.unique(finite)
        if len(known) <= MOST_LEVELS:
            cells = np.where(missing, len(known), np.searchsorted(known, column.values))
            return _of_values(column, [*map(number_text, known.tolist()), *([None] if missing.any() else [])], cells)
    low, high = float(finite.min()), float(finite.max())
    scaled = np.where(missing, low, column.values) - low
    cells = np.clip((scaled * (BINS / (high - low))).astype(np.int64), 0, BINS - 1)
    return Facet(
        column, "numbers", np.linspace(low, high, BINS + 1), (), np.where(missing, BINS, cells).astype(np.int32)
    )


def _of_values(column: Column, names: Sequence[str | None], cells: NDArray[Any]) -> Facet:
    kind: Kind = "values" if len(names) > 1 else "constant"
    return Facet(column, kind, np.zeros(0), tuple(names), cells.astype(np.int32))


class Chosen:
    """Some runs of a table, counted.

    Attributes:
        runs, verdict, configuration: (n,) index, verdict, and configuration of each run.
        counts: (configurations, 3) runs of each verdict.
        weight: (n,) of each run in the rate of its configuration; 0 if it was not judged.
    """

    def __init__(self, table: RunTable, mask: Bools) -> None:
        self.runs = np.flatnonzero(mask)
        self.verdict, self.configuration = table.verdict[self.runs], table.configuration[self.runs]
        self.counts = _counts(self.configuration, self.verdict, len(table.configurations))
        self.weight = table.weight[self.runs] * (self.verdict != NOT_JUDGED)

    def of(self, facet: Facet) -> NDArray[np.int64]:
        """Return the runs (cells, 3) of each cell and verdict."""
        return _counts(facet.cells[self.runs], self.verdict, facet.size)

    def rates(self, cells: NDArray[Any], size: int) -> NDArray[np.float64]:
        """Return the mean in each cell of the rates that configurations have there, NaN without judged runs."""
        n = len(self.counts)
        pairs, at = np.unique(cells.astype(np.int64) * n + self.configuration, return_inverse=True)
        judged, passed = np.bincount(at, self.weight), np.bincount(at, self.weight * (self.verdict == PASS))
        of, rates = pairs[judged > 0] // n, passed[judged > 0] / judged[judged > 0]
        with np.errstate(invalid="ignore"):
            found: NDArray[np.float64] = np.bincount(of, rates, size) / np.bincount(of, minlength=size)
        return found


class Facets:
    """Facets of a table's columns."""

    def __init__(self, table: RunTable) -> None:
        self.table = table
        self.facets = {name: facet_of(each) for name, each in table.columns.items() if name not in _NO_FACETS}

    def json(self, chosen: Filter) -> dict[str, Any]:
        """Return the counts of each facet among the runs that pass the conditions on the other columns."""
        whole = Chosen(self.table, mask_of(self.table, chosen))
        shown = []
        for name, facet in self.facets.items():
            if facet.kind in ("values", "numbers"):
                runs, condition = whole, chosen.get(name)
                if condition is not None:
                    others = {column: each for column, each in chosen.items() if column != name}
                    runs = Chosen(self.table, mask_of(self.table, others))
                shown.append(_facet_json(facet, runs, condition))
        constant = [(name, facet) for name, facet in self.facets.items() if facet.kind == "constant"]
        return {
            "facets": shown,
            "constant": [{"name": name, "value": next(iter(facet.values), None)} for name, facet in constant],
            "places": [name for name, facet in self.facets.items() if facet.kind == "places"],
        }

    def varying(self, group: str | None = None) -> list[str]:
        """Return the names of columns that vary and are no places, of one group or of all."""
        kinds = ("values", "numbers")
        return [n for n, each in self.facets.items() if each.kind in kinds and group in (None, each.column.group)]


def _facet_json(facet: Facet, chosen: Chosen, condition: Condition | None) -> dict[str, Any]:
    counts, column = chosen.of(facet), facet.column
    told = {"name": column.name, "group": column.group, "unit": column.unit, "kind": facet.kind}
    if facet.kind == "numbers":
        ends = {"low": float(facet.edges[0]), "high": float(facet.edges[-1])}
        return {**told, **ends, "counts": counts[:BINS].tolist(), "missing": int(counts[BINS].sum())}
    order = np.arange(facet.size)
    if len(order) > MOST_VALUES:
        order = np.sort(np.argsort(-counts.sum(axis=1), kind="stable")[:MOST_VALUES])
        asked = condition.values if isinstance(condition, ValuesOf) else ()
        order = np.union1d(order, [k for k, value in enumerate(facet.values) if value in asked]).astype(np.int64)
    rates = [None if math.isnan(rate) else rate for rate in chosen.rates(facet.cells[chosen.runs], facet.size).tolist()]
    shown = [{"value": facet.values[k], **_counts_json(counts[k]), "rate": rates[k]} for k in order.tolist()]
    return {**told, "numbers": column.levels is None, "values": shown, "left_out": facet.size - len(order)}


def _counts(cells: NDArray[Any], verdict: NDArray[np.int8], n: int) -> NDArray[np.int64]:
    return np.bincount(cells * _VERDICTS + verdict, minlength=n * _VERDICTS).reshape(n, _VERDICTS)


def _counts_json(counts: NDArray[np.int64]) -> dict[str, Any]:
    return dict(zip(("passed", "failed", "not_judged"), counts.tolist(), strict=True))


def rate_json(counts: Counts, runs: Runs) -> dict[str, Any]:
    """Return a configuration's rate and its interval; None where nothing was judged, and no interval where a search chose it."""
    ends = counts.interval
    known = counts.judged and runs != "searched"
    return {"rate": counts.rate, "interval": [ends.low, ends.high] if known else None}


def summary_json(table: RunTable, mask: Bools, *, by_result: bool = False) -> dict[str, Any]:
    """Return counts and headline of the selected runs.

    There is no interval where runs were chosen `by_result`, ended by a rule, or were searched for.
    """
    chosen = Chosen(table, mask)
    counts = chosen.counts.sum(axis=0)
    judged = chosen.counts[:, PASS] + chosen.counts[:, FAIL]
    of, passed = np.flatnonzero(judged), chosen.rates(chosen.configuration, len(judged))
    rate, these = mean_rate(passed[of], judged[of]) or (None, None)
    left_out = int((chosen.counts.any(axis=1) & (judged == 0)).sum())
    told = Headline(rate, None if by_result or table.runs != "fixed" else these, None, len(of), left_out)
    if table.runs == "searched":
        told = replace(told, finding=f"{counts[PASS]:,} of {judged.sum():,} judged runs passed")
    return {
        **_counts_json(counts),
        "headline": told.text,
        "rate": told.rate,
        "interval": [told.these.low, told.these.high] if told.these else None,
        "runs": len(chosen.runs),
        "all_runs": len(table),
        "configurations": int(chosen.counts.any(axis=1).sum()),
        "all_configurations": len(np.unique(table.configuration)),
    }


def rows_json(
    table: RunTable,
    mask: Bools,
    shown: Sequence[str],
    sort: str,
    *,
    descending: bool,
    start: int,
    count: int,
    by_result: bool = False,
) -> dict[str, Any]:
    """Return a page of the selected configurations, sorted by a column of the page or any column of the table.

    A number of a configuration is the mean of its selected runs, a text that of the first. Configurations without a value come last.
    Runs that were chosen `by_result` have no interval.

    Raises:
        BadFilter: a column that there is not.
    """
    chosen = Chosen(table, mask)
    here = np.flatnonzero(chosen.counts.any(axis=1))
    counts = chosen.counts[here]
    with np.errstate(invalid="ignore"):
        rates = pa.array(counts[:, PASS] / (counts[:, PASS] + counts[:, FAIL]), from_pandas=True)
    own = {"rate": rates, "runs": counts.sum(axis=1), "failed": counts[:, FAIL], "not_judged": counts[:, NOT_JUDGED]}
    own["configuration"] = here
    names = list(dict.fromkeys([*shown, *([] if sort in own else [sort])]))
    found = {name: _of_configurations(table.column(name), chosen, here) for name in names}
    keys = pa.table({"key": {**found, **own}[sort], "place": here})
    by = [("key", "descending" if descending else "ascending"), ("place", "ascending")]
    page = pc.sort_indices(keys, by)[start : start + count]
    values = pa.table(found).take(page).to_pylist() if found else [{}] * len(page)
    rows = [
        {
            "configuration": table.configurations[here[k]],
            **_counts_json(counts[k]),
            **rate_json(Counts(*counts[k].tolist()), "searched" if by_result else table.runs),
            "values": [*map(_rounded, each.values())],
        }
        for k, each in zip(page.to_pylist(), values, strict=True)
    ]
    columns = [{"name": n, "unit": table.columns[n].unit, "text": table.columns[n].levels is not None} for n in names]
    return {"columns": columns, "rows": rows, "total": len(here), "start": start}


def _of_configurations(column: Column, chosen: "Chosen", here: NDArray[np.int64]) -> pa.Array:
    """Return the mean, or the first text, of the selected runs of each configuration (m,), null without one."""
    values = column.values[chosen.runs]
    if column.levels is not None:
        first = values[np.searchsorted(chosen.configuration, here)]
        return pa.array([*column.levels, None], pa.string()).take(
            pa.array(np.where(first < 0, len(column.levels), first))
        )
    known = np.isfinite(values)
    of, n = chosen.configuration[known], len(chosen.counts)
    with np.errstate(invalid="ignore"):
        means = np.bincount(of, values[known], n)[here] / np.bincount(of, minlength=n)[here]
    return pa.array(means, from_pandas=True)


def _rounded(value: float | str | None) -> float | str | None:
    return float(f"{value:.{_DIGITS}g}") if isinstance(value, float) else value


def points(
    table: RunTable, mask: Bools, names: Sequence[str], most: int
) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Return at most `most` selected runs, evenly chosen, in columns: a description and arrays.

    The arrays are `column0` … (n,), texts as indices into `levels`, NaN where missing; and `configuration`, `run`, and `verdict` (n,).

    Raises:
        BadFilter: a column that there is not.
    """
    columns = [table.column(name) for name in names]
    runs = np.flatnonzero(mask)
    total = len(runs)
    if total > most:
        runs = runs[np.linspace(0, total - 1, most).astype(np.int64)]
    shown: list[dict[str, Any]] = []
    arrays: dict[str, NDArray[Any]] = {}
    for k, column in enumerate(columns):
        values, levels = column.values[runs], None
        if column.levels is not None:
            used = np.unique(values[values >= 0])
            levels = [column.levels[each] for each in used.tolist()]
            values = np.where(values < 0, np.nan, np.searchsorted(used, values))
        shown.append({"name": column.name, "unit": column.unit, "levels": levels})
        arrays[f"column{k}"] = values.astype(np.float32)
    configurations, own = run_arrays(table, runs)
    return {"columns": shown, "total": total, "shown": len(runs), "configurations": configurations}, {**arrays, **own}


def run_arrays(table: RunTable, runs: NDArray[np.int64]) -> tuple[list[str], dict[str, NDArray[Any]]]:
    """Return names of configurations, and of each run (n,) the index of its name, its run index, and its verdict."""
    of, place = np.unique(table.configuration[runs], return_inverse=True)
    arrays: dict[str, NDArray[Any]] = {
        "configuration": place.astype(np.int32),
        "run": table.run_index[runs].astype(np.int32),
        "verdict": table.verdict[runs].astype(np.uint8),
    }
    return [table.configurations[k] for k in of.tolist()], arrays


def varying_of(table: RunTable, mask: Bools, names: Sequence[str]) -> tuple[list[str], list[str]]:
    """Part columns into those with several values among the selected runs, and those with one."""
    several: list[str] = []
    one: list[str] = []
    for name in names:
        values = table.columns[name].values[mask]
        known = values[~np.isnan(values)] if table.columns[name].levels is None else values
        (several if len(known) and (known != known[0]).any() else one).append(name)
    return several, one


def reasons_json(table: RunTable, mask: Bools) -> dict[str, Any]:
    """Return the causes and reasons of the selected failed runs, the most frequent first, each with an example."""
    runs = np.flatnonzero(mask & (table.verdict == FAIL))
    return {"failed": len(runs), **{name: _most_frequent(table, name, runs) for name in ("cause", "reason")}}


def _most_frequent(table: RunTable, name: str, runs: NDArray[np.int64]) -> dict[str, Any]:
    column = table.columns.get(name)
    if column is None or column.levels is None:  # of an earlier version
        return {"rows": [], "left_out": 0}
    of = {"value": column.values[runs], "configuration": table.configuration[runs], "run": table.run_index[runs]}
    told = [("run", "count"), ("configuration", "count_distinct"), ("configuration", "first"), ("run", "first")]
    found = pa.table(of).group_by("value", use_threads=False).aggregate(told).sort_by([("run_count", "descending")])
    rows = [
        {
            "value": column.levels[value] if value >= 0 else None,
            "runs": times,
            "configurations": configurations,
            "configuration": table.configurations[first],
            "run": run,
        }
        for value, times, configurations, first, run in zip(
            *(found[name].to_pylist() for name in ("value", *map("_".join, told))), strict=True
        )
    ]
    return {"rows": rows[:MOST_REASONS], "left_out": len(rows[MOST_REASONS:])}


def axes_of(facets: Facets, chosen: Filter) -> list[str]:
    """Return the columns of parallel coordinates: those of the filter's ranges first, then factors and metrics."""
    asked = [each.column for each in chosen.values() if isinstance(each, Between)]
    return list(dict.fromkeys([*asked, *(name for group in _AXES for name in facets.varying(group))]))


def column_list(facets: Facets) -> list[Mapping[str, Any]]:
    """Return the columns that axes can have, by group."""
    columns = facets.table.columns
    return [{"name": n, "group": columns[n].group, "unit": columns[n].unit} for n in facets.varying()]
