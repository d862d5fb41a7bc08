"""Notebooks as oracles: a Jupyter notebook turns tables of runs into verdicts."""

import ast
import contextlib
import io
import math
import traceback
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Final, Literal, get_args

import numpy as np
import pyarrow as pa
from pydantic import BaseModel, ValidationError, create_model

from vastflow.oracles.judgment.oracle import Oracle, Parameters
from vastflow.oracles.judgment.verdict import FORMER, Judgment, Verdict, warn_of_former
from vastflow.oracles.observation.situation import Situation
from vastflow.oracles.observation.trace import CLEARANCES, Reference, Trace
from vastflow.sim.model.files import Unreadable, read_json
from vastflow.sim.plug_ins.effects import plug_in_code
from vastflow.sim.plug_ins.loading import empty_module, frozen_builtins
from vastflow.sim.plug_ins.neighbors import PlugInError
from vastflow.sim.plug_ins.snapshot import Snapshot

SKIPPED: Final = "skip-execution"
"""Tag of cells that are not executed, as in nbclient."""
PARAMETERS: Final = "parameters"
"""Tag of the cell with defaults of parameters, as in papermill."""
METRICS: Final = "metrics"
VERDICTS: Final = "verdicts"


class _Metadata(BaseModel):
    tags: list[str] = []


class _Cell(BaseModel):
    cell_type: str
    source: str | list[str]
    metadata: _Metadata = _Metadata()


class _Notebook(BaseModel):
    nbformat: Literal[4]
    cells: list[_Cell]


@dataclass(frozen=True, slots=True)
class CodeCell:
    """A code cell; `number` counts all cells from 1."""

    number: int
    code: str
    has_parameters: bool


def read_cells(file: Path) -> tuple[CodeCell, ...]:
    """The code cells of a notebook that are executed.

    Raises:
        PlugInError: no notebook of format 4, or a cell that is not Python.
    """
    cells = tuple(_cells(file))
    for cell in cells:
        try:
            compile(cell.code, file.name, "exec")
        except SyntaxError as error:
            lines, number = cell.code.splitlines(), error.lineno or 0
            text = lines[number - 1].strip() if 0 < number <= len(lines) else error.msg
            where = f"{file.name}: cell {cell.number}" + (f", line {number}" if number else "")
            tagged = f"tag cells with IPython commands {SKIPPED!r}"
            raise PlugInError(f"{where}: expected Python, got {text!r}", tagged) from None
        except (ValueError, RecursionError, MemoryError) as error:  # a NUL, half a character; too deep for Python
            raise PlugInError(f"{file.name}: cell {cell.number}: {error}") from None
    return cells


def notebook_code(file: Path) -> str:
    """The executed cells as one Python text, from which all judgments follow.

    Raises:
        PlugInError: no notebook of format 4.
    """
    return "".join(f"{cell.code}\n" + "parameters = ...\n" * cell.has_parameters for cell in _cells(file))


def literals(cell: CodeCell, file: Path, only: str | None = None) -> Mapping[str, Any]:
    """Name to value of the literals that a cell assigns.

    Args:
        only: The one wanted name; other statements are free then.

    Raises:
        PlugInError: a statement that does not assign a literal to a name.
    """
    found: dict[str, Any] = {}
    for statement in ast.parse(cell.code).body:
        name, value = _assigned(statement)
        if only is not None and name != only:
            continue
        try:
            if name is None or value is None:
                raise ValueError
            found[name] = ast.literal_eval(value)
        except (ValueError, TypeError, RecursionError, MemoryError):  # TypeError: a list as a key
            where = f"{file.name}: cell {cell.number}, line {statement.lineno}"
            raise PlugInError(f"{where}: expected name = literal, got {ast.unparse(statement)!r}", "") from None
    return found


def _assigned(statement: ast.stmt) -> tuple[str | None, ast.expr | None]:
    match statement:
        case (
            ast.Assign(targets=[ast.Name(id=name)], value=value) | ast.AnnAssign(target=ast.Name(id=name), value=value)
        ):
            return name, value
    return None, None


def _cells(file: Path) -> list[CodeCell]:
    try:
        notebook = _Notebook.model_validate(read_json(file, "a notebook"))
    except Unreadable as error:
        raise PlugInError(error.problem, error.expected) from None
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"])) or "content"
        got = str(first["input"])[:60]
        raise PlugInError(f"{file.name}: {where}: expected a notebook of format 4, got {got}", "") from None
    return [
        CodeCell(number, "".join(cell.source), PARAMETERS in cell.metadata.tags)
        for number, cell in enumerate(notebook.cells, 1)
        if cell.cell_type == "code" and SKIPPED not in cell.metadata.tags
    ]


SIGNALS: Final = (
    *("t_s", "x_m", "y_m", "yaw_rad", "estimated_x_m", "estimated_y_m", "estimated_yaw_rad"),
    *("speed_mps", "yaw_rate_radps"),
    *("localized", "localization_error_m", "stopped", "wall_clearance_m", "deviation_m"),
    *CLEARANCES,
)


@dataclass(frozen=True, slots=True)
class RunTables:
    """Runs of one configuration.

    Attributes:
        traces: Rows of all runs: `run_index` and the signals of `Trace`, null for missing ones. `SIGNALS` are always there.
        runs: A row for each run: `run_index outcome reason simulated_s distance_m recoveries missed_goals contacts
            reference_length_m` (null without a reference) and `events`, a list of structs.
    """

    traces: pa.Table
    runs: pa.Table
    situation: Situation


def run_tables(traces: Sequence[Trace], situation: Situation) -> RunTables:
    names = list(dict.fromkeys([*SIGNALS, *(name for trace in traces for name in trace.columns)]))
    index = np.repeat([trace.run.run_index for trace in traces], [len(trace) for trace in traces]).astype(np.int32)
    signals = {name: [trace.columns.get(name, [None] * len(trace)) for trace in traces] for name in names}
    columns = {
        name: pa.chunked_array([pa.array(each, pa.float64()) for each in found], pa.float64())
        for name, found in signals.items()
    }
    rows = [
        {
            **{name: getattr(trace.run, name) for name in _RUN.names if hasattr(trace.run, name) and name != "events"},
            "contacts": len(trace.events("contact")),
            "reference_length_m": trace.reference.length_m if isinstance(trace.reference, Reference) else None,
            "events": [{name: getattr(event, name) for name in _EVENT.names} for event in trace.run.events],
        }
        for trace in traces
    ]
    return RunTables(pa.table({"run_index": index, **columns}), pa.Table.from_pylist(rows, _RUN), situation)


_EVENT = pa.struct(
    [
        *[("t_s", pa.float64()), ("kind", pa.string()), ("x_m", pa.float64()), ("y_m", pa.float64())],
        *[("what", pa.string()), ("value", pa.float64())],
    ]
)
_RUN = pa.schema(
    [
        *[("run_index", pa.int32()), ("outcome", pa.string()), ("reason", pa.string())],
        *[("simulated_s", pa.float64()), ("distance_m", pa.float64())],
        *[("recoveries", pa.int32()), ("missed_goals", pa.int32()), ("contacts", pa.int32())],
        *[("reference_length_m", pa.float64()), ("events", pa.list_(_EVENT))],
    ]
)
_OWN: Final = ("run_index", "judgment", "reason")


class NotebookOracle(Oracle[Parameters]):
    """The judgment of a notebook.

    Its code cells run in order in a namespace of their own, without a kernel or IPython. Cells tagged `skip-execution` are left out; after a
    cell tagged `parameters`, whose literals are defaults, the values of the campaign file are set. The notebook is given `traces`, `runs` and
    `situation` (see `RunTables`), and leaves `metrics`, name to unit as a literal, and `verdicts`: a table or list of rows with
    `run_index`, `judgment`, `reason` unless it is a pass, and the metrics. A verdict must follow from its run alone.
    """

    cells: ClassVar[Sequence[CodeCell]]
    snapshot: ClassVar[Snapshot]

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[Any, ...]]:
        return _restored, (self.snapshot, self.name, self.parameters.model_dump(), self.base)

    def judge(self, trace: Trace, situation: Situation) -> Verdict:
        return self.judge_all([trace], situation)[0]

    def judge_all(self, traces: Sequence[Trace], situation: Situation) -> list[Verdict]:
        """Return the notebook's verdicts; a run without one is not judged.

        Raises:
            PlugInError: a cell failed, or left no valid verdicts.
        """
        left = self._executed(run_tables(traces, situation))
        if VERDICTS not in left:
            raise PlugInError(
                f"{self.name} sets no {VERDICTS!r}", "it must be a table or list of rows, one for each run"
            )
        said: dict[int, Mapping[str, Any]] = {}
        rows = list(_rows(left[VERDICTS]))
        if any(FORMER in row for row in rows):
            warn_of_former(self.name)
            rows = [{"judgment" if name == FORMER else name: value for name, value in row.items()} for row in rows]
        for row in rows:
            said[self._checked(row, said, traces)] = row
        return [self._said(trace, said.get(trace.run.run_index)) for trace in traces]

    def _executed(self, tables: RunTables) -> dict[str, Any]:
        namespace: dict[str, Any] = {"__name__": "__notebook__", "__builtins__": frozen_builtins(self.snapshot)}
        namespace |= {"traces": tables.traces, "runs": tables.runs, "situation": tables.situation}
        for cell in self.cells:
            try:
                # As in Jupyter, a notebook names files relative to its own.
                with (
                    contextlib.chdir(self.snapshot.file.parent),
                    contextlib.redirect_stdout(io.StringIO()),
                    plug_in_code(),
                ):
                    exec(compile(cell.code, f"{self.name} cell {cell.number}", "exec"), namespace)  # noqa: S102 - as a plug-in is
            except Exception as error:
                frames = traceback.extract_tb(error.__traceback__)
                lines = [frame.lineno for frame in frames if frame.filename.startswith(self.name)]
                where = f"{self.name}: cell {cell.number}" + (f", line {lines[-1]}" if lines else "")
                what = f"{where}: {type(error).__name__}: {error}"
                raise PlugInError(what, "the cell must accept any runs") from error
            if cell.has_parameters:
                namespace |= self.parameters.model_dump()
        return namespace

    def _checked(self, row: Mapping[str, Any], said: Mapping[int, Any], traces: Sequence[Trace]) -> int:
        indices = [trace.run.run_index for trace in traces]
        index, judgment = row.get("run_index"), row.get("judgment")
        place = f"{self.name}: verdict {len(said) + 1}: "
        if index not in indices:
            raise PlugInError(f"{place}expected one of the runs {indices}, got run_index {index!r}", "")
        if index in said:
            raise PlugInError(f"{place}duplicate verdict on run {index}", "expected one for each run")
        if judgment not in (known := get_args(Judgment)):
            raise PlugInError(f"{place}expected one of {', '.join(map(repr, known))}, got judgment {judgment!r}", "")
        if judgment != "pass" and not row.get("reason"):
            raise PlugInError(f"{place}{judgment!r} without a reason", "write a sentence with numbers into `reason`")
        if unknown := sorted(set(row) - {*_OWN, *self.metrics}):
            raise PlugInError(f"{place}unknown metric {unknown[0]!r}", f"name it with its unit in {METRICS!r}")
        return int(index)

    def _said(self, trace: Trace, row: Mapping[str, Any] | None) -> Verdict:
        if row is None:
            return self.not_judged(trace, "the notebook has no verdict on this run")
        # NaN is a missing value of a table.
        values = {
            name: None if (value := row.get(name)) is None or math.isnan(value) else float(value)
            for name in self.metrics
        }
        reason = "" if row["judgment"] == "pass" else str(row["reason"])
        return self._verdict(trace, row["judgment"], reason, values)


def _restored(snapshot: Snapshot, name: str, parameters: Mapping[str, Any], base: Path) -> NotebookOracle:
    found = notebook_oracle(snapshot)
    return found(found.Parameters.model_validate(parameters), name, base)


def notebook_oracle(snapshot: Snapshot) -> type[NotebookOracle]:
    """The oracle class of a notebook, in a module of its own.

    Raises:
        PlugInError: it cannot be read, or is not Python.
    """
    module = empty_module(snapshot)
    if "Notebook" not in module.__dict__:
        file = snapshot.file
        cells = read_cells(file)
        metrics = _metrics(cells, file)
        defaults = [item for cell in cells if cell.has_parameters for item in literals(cell, file).items()]
        fields: dict[str, Any] = {
            name: (type(value) if isinstance(value, bool | int | float | str) else Any, value)
            for name, value in defaults
        }
        name = module.__name__
        parameters = create_model("NotebookParameters", __base__=Parameters, __module__=name, **fields)
        content = {"Parameters": parameters, "metrics": metrics, "cells": cells, "snapshot": snapshot}
        content |= {"__module__": name, "__doc__": None}
        module.__dict__.setdefault("Notebook", type("Notebook", (NotebookOracle,), content))
    oracle: type[NotebookOracle] = module.__dict__["Notebook"]
    return oracle


def _metrics(cells: Iterable[CodeCell], file: Path) -> dict[str, str]:
    for cell in cells:
        found = literals(cell, file, only=METRICS).get(METRICS)
        if found is not None:
            if not isinstance(found, dict) or not all(isinstance(part, str) for item in found.items() for part in item):
                raise PlugInError(
                    f"{file.name}: cell {cell.number}: expected names and units, got {METRICS} = {found!r}", ""
                )
            return found
    return {}


def _rows(table: Any) -> Iterable[Mapping[str, Any]]:
    if hasattr(table, "to_dict"):
        return list(table.to_dict("records"))
    rows = getattr(table, "to_pylist", None) or getattr(table, "to_dicts", None)
    return list(rows() if rows else table)
