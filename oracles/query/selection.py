"""Selections of a campaign's runs: filters as canonical text, and masks of the runs that pass them."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Literal, SupportsIndex, TypeAlias
from urllib.parse import quote, unquote

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from vastflow.oracles.evidence.varied import MEASURED, PATH_PROPERTIES
from vastflow.oracles.results.schema import floats
from vastflow.oracles.results.tables import FAIL, NOT_JUDGED, PASS, run_keys
from vastflow.sim.model.faults import UserError
from vastflow.sim.model.parquet import open_table

Runs: TypeAlias = Literal["fixed", "sequential", "searched"]
"""Origin of a campaign's runs: a requested number, a rule that ended them, or a search that placed them."""
Group: TypeAlias = Literal["run", "verdict", "metric", "factor", "path"]
Bools: TypeAlias = NDArray[np.bool_]

WIDE_FILE: Final = "runs_wide.parquet"
"""See `vastflow.oracles.evidence.wide`, whose import takes a second."""
PASSED: Final = "passed"
WEIGHT: Final = "weight"
RUN_COLUMNS: Final = (
    "family",
    "purpose",
    "outcome",
    "cause",
    "reason",
    "stood_still",
    "simulated_s",
    "distance_m",
    "recoveries",
)
RUN_COUNTS: Final = ("missed_goals", "contacts", "configuration", "run_index")
_ASKED: Final = ("family", "purpose", "configuration", "run_index")
"""Columns of a run that do not come from its execution."""
JUDGED: Final = ("pass", "fail")
"""Levels of a verdict; a run that was not judged has none."""

PATH_COLUMNS: Final = (*MEASURED.values(), *PATH_PROPERTIES.values())
"""Numbers that follow from a drawn path, and that nobody chose."""
_UNITS: Final[Mapping[str, str]] = {"simulated_s": "s", "distance_m": "m"}
_MISSING: Final = "!"
_SAFE: Final = " ()/,"
"""Characters of names that are left readable besides letters, digits, and `-._~`."""


class BadFilter(UserError, ValueError):
    """A filter's text that can't be read, or that names no column of the campaign."""


@dataclass(frozen=True, eq=False)
class Column:
    """One column over the runs, of numbers or of texts.

    Attributes:
        values: (R,) numbers, NaN where missing; or indices into `levels`, -1 where missing.
        levels: Distinct texts; None for numbers.
    """

    name: str
    group: Group
    unit: str
    values: NDArray[Any] = field(repr=False)
    levels: tuple[str, ...] | None = field(default=None, repr=False)

    @property
    def missing(self) -> Bools:
        """(R,) whether a run has no value."""
        return np.asarray(np.isnan(self.values) if self.levels is None else self.values < 0)


@dataclass(frozen=True, eq=False)
class RunTable:
    """The runs of a campaign, in columns by name.

    Attributes:
        verdict: (R,) codes `PASS`, `FAIL`, `NOT_JUDGED` of all oracles together.
        configuration: (R,) index into `configurations`.
        weight: (R,) of the run in its configuration's rate.
    """

    columns: Mapping[str, Column] = field(repr=False)
    verdict: NDArray[np.int8] = field(repr=False)
    configuration: NDArray[np.int64] = field(repr=False)
    configurations: tuple[str, ...] = field(repr=False)
    run_index: NDArray[np.int64] = field(repr=False)
    weight: NDArray[np.float64] = field(repr=False)
    runs: Runs = "fixed"

    def __len__(self) -> int:
        return len(self.verdict)

    def rows_of(self, configuration: int) -> range:
        """Return the runs of a configuration."""
        return range(*np.searchsorted(self.configuration, (configuration, configuration + 1)).tolist())

    def value(self, name: str, run: SupportsIndex) -> float | str | None:
        """Return a run's value in a column; None where it is missing or there is no such column."""
        column = self.columns.get(name)
        if column is None or column.missing[run]:
            return None
        return float(column.values[run]) if column.levels is None else column.levels[column.values[run]]

    def column(self, name: str) -> Column:
        """Return a column by its name.

        Raises:
            BadFilter: the campaign has none of this name.
        """
        if name not in self.columns:
            raise BadFilter(f"expected a column of this campaign, got {name!r}")
        return self.columns[name]


@dataclass(frozen=True, slots=True)
class ValuesOf:
    """Runs that have one of some values in order; None is missing, and numbers have their shortest form."""

    column: str
    values: tuple[str | None, ...]


@dataclass(frozen=True, slots=True)
class Between:
    """Runs whose number is within a range, ends included; None is an open end."""

    column: str
    low: float | None
    high: float | None


@dataclass(frozen=True, slots=True)
class Containing:
    """Runs whose text has a part."""

    column: str
    part: str


Condition: TypeAlias = ValuesOf | Between | Containing
Filter: TypeAlias = Mapping[str, Condition]
"""Conditions that a run has to meet, by their columns, which are in order."""


def format_filter(chosen: Filter) -> str:
    """Return the canonical text: `noise=0.1|0.4;passed=fail;safety.margin (m):..0.2;configuration*office`."""
    return ";".join(map(_condition_text, chosen.values()))


def parse_filter(text: str) -> Filter:
    """Read the text of a filter, its conditions and their values in any order.

    Raises:
        BadFilter: a condition that is none.
    """
    conditions = sorted((_condition(part) for part in text.split(";") if part), key=lambda each: each.column)
    chosen = {each.column: each for each in conditions}
    if len(chosen) < len(conditions):
        raise BadFilter("expected one condition for each column, got two")
    return chosen


def number_text(value: float) -> str:
    """Return the shortest text that is read as the same number."""
    return repr(value + 0.0).removesuffix(".0")


def _condition_text(condition: Condition) -> str:
    name = quote(condition.column, safe=_SAFE)
    if isinstance(condition, Containing):
        return f"{name}*{quote(condition.part, safe=_SAFE)}"
    if isinstance(condition, ValuesOf):
        return f"{name}={'|'.join(_MISSING if v is None else quote(v, safe=_SAFE) for v in condition.values)}"
    low, high = ("" if end is None else number_text(end) for end in (condition.low, condition.high))
    return f"{name}:{low}..{high}"


def _condition(text: str) -> Condition:
    at = next((k for k, character in enumerate(text) if character in "=:*"), None)
    if at is None:
        raise BadFilter(f"expected column=value, column:low..high, or column*part, got {text!r}")
    column, sign, rest = unquote(text[:at]), text[at], text[at + 1 :]
    if sign == "*":
        return Containing(column, unquote(rest))
    if sign == "=":
        values = {None if value == _MISSING else unquote(value) for value in rest.split("|")}
        return ValuesOf(column, tuple(sorted(values, key=lambda value: (value is None, value or ""))))
    ends = rest.split("..")
    try:
        low, high = (float(end) + 0.0 if end else None for end in ends)  # without a negative zero
    except ValueError:
        raise BadFilter(f"{column}: expected low..high, got {rest!r}") from None
    given = [end for end in (low, high) if end is not None]
    if not given or not all(map(math.isfinite, given)):
        raise BadFilter(f"{column}: expected a range with a finite end, got {rest!r}")
    return Between(column, low, high)


def mask_of(table: RunTable, chosen: Filter) -> Bools:
    """Return which runs (R,) pass a filter.

    Raises:
        BadFilter: a column that there is not, or a condition that does not suit its column.
    """
    masks = [_meeting(table, condition) for condition in chosen.values()]
    return np.asarray(np.logical_and.reduce([np.ones(len(table), dtype=np.bool_), *masks]))


def _meeting(table: RunTable, condition: Condition) -> Bools:
    column = table.column(condition.column)
    if isinstance(condition, Between):
        if column.levels is not None:
            raise BadFilter(f"{column.name}: expected values of a text, got a range")
        low, high = (
            end if end is not None else sign for end, sign in ((condition.low, -np.inf), (condition.high, np.inf))
        )
        return np.asarray((column.values >= low) & (column.values <= high))
    if isinstance(condition, Containing):
        if column.levels is None:
            raise BadFilter(f"{column.name}: expected a range of numbers, got a part of a text")
        return _of_levels(column, [condition.part in level for level in column.levels], missing=False)
    missing, given = None in condition.values, {value for value in condition.values if value is not None}
    if column.levels is not None:
        return _of_levels(column, [level in given for level in column.levels], missing=missing)
    try:
        numbers = np.array([float(value) for value in given])
    except ValueError:
        raise BadFilter(f"{column.name}: expected numbers, got {', '.join(sorted(given))}") from None
    return np.asarray(np.isin(column.values, numbers) | (column.missing if missing else False))


def _of_levels(column: Column, chosen: Sequence[bool], *, missing: bool) -> Bools:
    """Return the runs of chosen levels; index -1, of missing values, is the last place."""
    return np.asarray(np.array([*chosen, missing], dtype=np.bool_)[column.values])


def read_run_table(directory: Path, runs: Runs = "fixed") -> RunTable:
    """Read the runs of a campaign directory, see `vastflow.oracles.evidence.wide`.

    Raises:
        OSError, ValueError: their table is missing or damaged, or runs are in disorder.
    """
    try:
        file = open_table(directory / WIDE_FILE)
    except (pa.ArrowException, ValueError) as error:
        raise ValueError(f"{WIDE_FILE}: can't be read: {' '.join(str(error).split())}") from None
    names = file.schema_arrow.names
    if lacking := [name for name in ("configuration", "run_index", PASSED) if name not in names]:
        raise ValueError(f"{WIDE_FILE}: expected a column {lacking[0]!r}, got none")
    oracles = [name.removeprefix(f"{PASSED}.") for name in names if name.startswith(f"{PASSED}.")]
    # One column after another, as all of them at once take twice the memory.
    columns = {name: _column(name, file.read(columns=[name]).unify_dictionaries()[name], oracles) for name in names}
    configuration, joint = columns["configuration"], columns[PASSED].values
    of, run_index = configuration.values.astype(np.int64), columns["run_index"].values
    if len(of) and (of[0] < 0 or not (np.diff(run_keys(of, run_index.astype(np.int64))) > 0).all()):
        raise ValueError(f"{WIDE_FILE}: expected the runs of each configuration one after another, got another order")
    verdict = np.where(joint < 0, NOT_JUDGED, np.where(joint == 0, PASS, FAIL)).astype(np.int8)
    weight = columns.pop(WEIGHT).values if WEIGHT in columns else np.ones(len(of))
    return RunTable(columns, verdict, of, configuration.levels or (), run_index.astype(np.int64), weight, runs)


def _column(name: str, column: Any, oracles: Sequence[str]) -> Column:
    group = _group(name, oracles)
    unit = name[name.rindex(" (") + 2 : -1] if name.endswith(")") and " (" in name else _UNITS.get(name, "")
    if pa.types.is_boolean(column.type):
        passed = floats(pc.cast(column, pa.uint8()))
        return Column(name, group, "", np.where(np.isnan(passed), -1, 1 - passed).astype(np.int8), JUDGED)
    if pa.types.is_dictionary(column.type) or pa.types.is_string(column.type) or pa.types.is_large_string(column.type):
        encoded = pc.dictionary_encode(pc.cast(column, pa.string())).combine_chunks()
        at = floats(encoded.indices)
        return Column(
            name, group, "", np.where(np.isnan(at), -1, at).astype(np.int32), tuple(encoded.dictionary.to_pylist())
        )
    return Column(name, group, unit, floats(column))


def _group(name: str, oracles: Sequence[str]) -> Group:
    if name in RUN_COLUMNS + RUN_COUNTS:
        return "run"
    if name == PASSED or name in [f"{PASSED}.{oracle}" for oracle in oracles]:
        return "verdict"
    if any(name.startswith(f"{oracle}.") for oracle in oracles):
        return "metric"
    return "path" if name in PATH_COLUMNS else "factor"


def is_by_result(table: RunTable, chosen: Filter) -> bool:
    """True if runs were chosen by what came out, so that their rate tells nothing of others."""
    named = (table.column(each.column) for each in chosen.values())
    return any(each.group in ("run", "verdict", "metric") and each.name not in _ASKED for each in named)


def python_of(table: RunTable, chosen: Filter, directory: Path) -> str:
    """Return a pandas program that selects the same runs from the campaign directory's table."""
    parts = [f"({_expression(table.column(each.column), each)})" for each in chosen.values()]
    joined = "\n    & ".join(parts)
    selection = f"runs[\n    {joined}\n]" if parts else "runs"
    file = str(directory / WIDE_FILE)
    return f"import pandas as pd\n\nruns = pd.read_parquet({file!r})\nselection = {selection}\n"


def _expression(column: Column, condition: Condition) -> str:
    name = f"runs[{condition.column!r}]"
    if isinstance(condition, Between):
        ends = (("ge", condition.low), ("le", condition.high))
        return " & ".join(f"{name}.{sign}({end!r})" for sign, end in ends if end is not None)
    if isinstance(condition, Containing):
        return f'{name}.astype("string").str.contains({condition.part!r}, regex=False).fillna(False)'
    given = [value for value in condition.values if value is not None]
    values: list[Any] = given if column.levels is not None else [float(value) for value in given]
    if column.group == "verdict":
        values = [value == JUDGED[0] for value in given if value in JUDGED]
    parts = [f"{name}.isin({values!r})"] if given else []
    return " | ".join(parts + ([f"{name}.isna()"] if None in condition.values else []))


def is_place(level: str) -> bool:
    """True if a text is a JSON object or list, such as a pose, which no one filters by."""
    return level.startswith(('{"', "[")) and level.endswith(("}", "]"))
