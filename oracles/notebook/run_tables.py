"""Run tables: the traces of several runs as two tables, for notebooks and for whoever likes tables."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import pyarrow as pa

from vastflow.oracles.situation import Situation
from vastflow.oracles.trace import Reference, Trace

SIGNALS: Final = (
    *(
        "t_s",
        "x_m",
        "y_m",
        "yaw_rad",
        "estimated_x_m",
        "estimated_y_m",
        "estimated_yaw_rad",
        "speed_mps",
        "yaw_rate_radps",
    ),
    *("localized", "localization_error_m", "stopped", "wall_clearance_m", "deviation_m"),
    *("static_clearance_m", "appearing_clearance_m"),
)


@dataclass(frozen=True, slots=True)
class RunTables:
    """Runs of one configuration.

    Attributes:
        traces: A row for each row of each run: `run_index` and the signals of `vastflow.oracles.trace.Trace`, float64 in SI units; null
            where a run does not have a signal. `SIGNALS` are there even where no run has them.
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
