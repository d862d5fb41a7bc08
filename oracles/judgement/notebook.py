"""Notebooks as oracles: a Jupyter notebook turns tables of runs into verdicts."""

import contextlib
import io
import math
import traceback
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Final, get_args

import numpy as np
import pyarrow as pa
from pydantic import create_model

from vastflow.oracles.judgement.notebook_file import CodeCell, literals, read_cells
from vastflow.oracles.judgement.oracle_base import Oracle, Parameters
from vastflow.oracles.judgement.verdict import Judgement, Verdict
from vastflow.oracles.observation.situation import Situation
from vastflow.oracles.observation.trace import Reference, Trace
from vastflow.sim.plug_ins.effects import plug_in_code
from vastflow.sim.plug_ins.loading import empty_module, frozen_builtins
from vastflow.sim.plug_ins.neighbors import PlugInError
from vastflow.sim.plug_ins.snapshot import Snapshot

SIGNALS: Final = (
    *("t_s", "x_m", "y_m", "yaw_rad", "estimated_x_m", "estimated_y_m", "estimated_yaw_rad"),
    *("speed_mps", "yaw_rate_radps"),
    *("localized", "localization_error_m", "stopped", "wall_clearance_m", "deviation_m"),
    *("static_clearance_m", "appearing_clearance_m"),
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
    """The tables of `traces`, in their order."""
    names = list(dict.fromkeys([*SIGNALS, *(name for trace in traces for name in trace.columns)]))
    index = np.repeat([trace.run.run_index for trace in traces], [len(trace) for trace in traces]).astype(np.int32)
    columns = {name: pa.chunked_array([_signal(trace, name) for trace in traces], pa.float64()) for name in names}
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


def _signal(trace: Trace, name: str) -> pa.Array:
    column = trace.columns.get(name)
    return pa.nulls(len(trace), pa.float64()) if column is None else pa.array(column, pa.float64())


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


METRICS: Final = "metrics"
VERDICTS: Final = "verdicts"
_OWN: Final = ("run_index", "judgement", "reason")


class NotebookOracle(Oracle[Parameters]):
    """The judgement of a notebook.

    Its code cells run in order in a namespace of their own, without a kernel or IPython. Cells tagged `skip-execution` are left out; after a
    cell tagged `parameters`, whose literals are defaults, the values of the campaign file are set. The notebook is given `traces`, `runs` and
    `situation` (see `RunTables`), and leaves `metrics`, name to unit as a literal, and `verdicts`: a table or list of rows with
    `run_index`, `judgement`, `reason` unless it is a pass, and the metrics. A verdict must follow from its run alone.
    """

    cells: ClassVar[Sequence[CodeCell]]
    snapshot: ClassVar[Snapshot]

    def judge(self, trace: Trace, situation: Situation) -> Verdict:
        return self.judge_all([trace], situation)[0]

    def judge_all(self, traces: Sequence[Trace], situation: Situation) -> list[Verdict]:
        """Return the notebook's verdicts; a run without one is not judged.

        Raises:
            PlugInError: a cell failed, or left no valid verdicts.
        """
        left = self._executed(run_tables(traces, situation))
        if VERDICTS not in left:
            raise PlugInError(f"{self.name}: no variable {VERDICTS!r}", "a table or list of rows, one for each run")
        said: dict[int, Mapping[str, Any]] = {}
        for row in _rows(left[VERDICTS]):
            said[self._checked(row, said, traces)] = row
        return [self._said(trace, said.get(trace.run.run_index)) for trace in traces]

    def _executed(self, tables: RunTables) -> dict[str, Any]:
        namespace: dict[str, Any] = {
            "__name__": "__notebook__",
            "__builtins__": frozen_builtins(self.snapshot),
            "traces": tables.traces,
            "runs": tables.runs,
            "situation": tables.situation,
        }
        with contextlib.chdir(self.snapshot.file.parent):  # as Jupyter does: a notebook names files relative to its own
            self._run(namespace)
        return namespace

    def _run(self, namespace: dict[str, Any]) -> None:
        for cell in self.cells:
            try:
                with contextlib.redirect_stdout(io.StringIO()), plug_in_code():
                    exec(compile(cell.code, f"{self.name} cell {cell.number}", "exec"), namespace)  # noqa: S102 - as a plug-in is
            except Exception as error:
                frames = traceback.extract_tb(error.__traceback__)
                lines = [frame.lineno for frame in frames if frame.filename.startswith(self.name)]
                where = f"{self.name}: cell {cell.number}" + (f", line {lines[-1]}" if lines else "")
                raise PlugInError(
                    f"{where}: {type(error).__name__}: {error}", "a cell that accepts any runs"
                ) from error
            if cell.has_parameters:
                namespace.update(self.parameters.model_dump())

    def _checked(self, row: Mapping[str, Any], said: Mapping[int, Any], traces: Sequence[Trace]) -> int:
        indices = [trace.run.run_index for trace in traces]
        index, judgement = row.get("run_index"), row.get("judgement")
        place = f"{self.name}: verdict {len(said) + 1}: "
        if index not in indices:
            raise PlugInError(f"{place}expected one of the runs {indices}, got run_index {index!r}", "")
        if index in said:
            raise PlugInError(f"{place}duplicate verdict on run {index}", "one for each run")
        if judgement not in (known := get_args(Judgement)):
            raise PlugInError(f"{place}expected one of {', '.join(map(repr, known))}, got judgement {judgement!r}", "")
        if judgement != "pass" and not row.get("reason"):
            raise PlugInError(f"{place}{judgement!r} without a reason", "a sentence with numbers in `reason`")
        if unknown := sorted(set(row) - {*_OWN, *self.metrics}):
            raise PlugInError(f"{place}unknown metric {unknown[0]!r}", f"name it with its unit in {METRICS!r}")
        return int(index)

    def _said(self, trace: Trace, row: Mapping[str, Any] | None) -> Verdict:
        if row is None:
            return self.not_judged(trace, "the notebook has no verdict on this run")
        values = {name: _number(row.get(name)) for name in self.metrics}
        reason = "" if row["judgement"] == "pass" else str(row["reason"])
        return self._verdict(trace, row["judgement"], reason, values)

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[Any, ...]]:
        return _frozen_notebook, (self.snapshot, self.name, self.parameters.model_dump(), self.base)


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
        fields: dict[str, Any] = {name: (_type_of(value), value) for name, value in defaults}
        name = module.__name__
        parameters = create_model("NotebookParameters", __base__=Parameters, __module__=name, **fields)
        content = {"Parameters": parameters, "metrics": metrics, "cells": cells, "snapshot": snapshot}
        content |= {"__module__": name, "__doc__": None}
        module.__dict__.setdefault("Notebook", type("Notebook", (NotebookOracle,), content))
    oracle: type[NotebookOracle] = module.__dict__["Notebook"]
    return oracle


def _frozen_notebook(snapshot: Snapshot, name: str, parameters: Mapping[str, Any], base: Path) -> NotebookOracle:
    """The oracle in another process, from the same copy of the notebook."""
    found = notebook_oracle(snapshot)
    return found(found.Parameters.model_validate(parameters), name, base)


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


def _type_of(value: object) -> Any:
    return type(value) if isinstance(value, bool | int | float | str) else Any


def _rows(table: Any) -> Iterable[Mapping[str, Any]]:
    """Rows of a pyarrow, polars or pandas table, or of a list."""
    if hasattr(table, "to_dict"):
        return list(table.to_dict("records"))
    rows = getattr(table, "to_pylist", None) or getattr(table, "to_dicts", None)
    return list(rows() if rows else table)


def _number(value: Any) -> float | None:
    """A metric; NaN, a missing value of a table, as None."""
    return None if value is None or math.isnan(value) else float(value)
