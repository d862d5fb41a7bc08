"""One run of a campaign as a test case and as files of its own."""

import csv
import io
import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import PurePosixPath
from typing import Any, Final

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv

from vastflow.flows.export.junit import Case, Flaw, Suite, suite_report
from vastflow.flows.results.found import FAULT
from vastflow.oracles.judgement.verdict import run_judgement
from vastflow.oracles.observation.trace import signal_name
from vastflow.sim.model.blocks import Columns as Recorded
from vastflow.sim.model.runlog import RunLog, Use
from vastflow.sim.model.tables import Columns
from vastflow.sim.run import PERIOD_S

BRIEFLY: Final = ("simulated_time_s", "wall_time_s", "outcome")
"""Properties that a case keeps in a report of many."""

STATUS_NUMBERS: Final = {"INVALID": 1, "RUNNING": 2, "SUCCESS": 3, "FAILURE": 4}
"""Of a behavior, as ROS messages have them."""


@dataclass(frozen=True)
class ExportedRun:
    """A run with all that a campaign directory has of it.

    Attributes:
        verdicts: Its rows of `verdicts.parquet`.
        row: Its row of `runs.parquet`; None where it was not recorded.
        log: Its run log, None where there is none.
        host: Where it ran and with what, as the log's file has it.
        recorded: Columns of its recording, in thousandths; empty without a robot.
        behaviors: Its `behaviors` table, may be empty.
        scenario, scenario_file: Name of the scenario, and of the file that it stands in.
    """

    campaign: str
    configuration: str
    run_index: int
    verdicts: Sequence[Mapping[str, Any]]
    row: Mapping[str, Any] | None
    log: RunLog | None
    host: Mapping[str, Any] = field(default_factory=dict)
    recorded: Recorded = field(default_factory=dict, repr=False)
    behaviors: Columns = field(default_factory=dict, repr=False)
    scenario: str = ""
    scenario_file: str = ""


def case_of(run: ExportedRun) -> Case:
    """The run as a test case: what all oracles together say, and in its properties what each of them does."""
    return Case(
        name=f"{run.configuration}/{run.run_index}",
        classname=f"{run.campaign}.{run.configuration}",
        time_s=run.log.wall_s if run.log else 0.0,
        started_s=run.log.started_s if run.log else None,
        properties=dict(_properties(run)),
        flaw=_flaw(run),
    )


def brief(case: Case) -> Case:
    """The case as a report of many has it: without the numbers, which would make hundreds of megabytes of it."""
    return replace(case, properties={name: case.properties[name] for name in BRIEFLY if name in case.properties})


def files_of(run: ExportedRun, case: Case) -> Iterator[tuple[str, bytes]]:
    """Path below the run's folder, and content, of each file but the outputs of its programs."""
    yield "test.xml", suite_report(Suite(run.configuration, [case]))
    if run.recorded:
        yield "recording.csv", recording_csv(run.recorded)
        if all(f"{begin}{name}" in run.recorded for begin in FRAMES.values() for name in _POSE):
            yield "poses.csv", poses_csv(run.recorded)
    if run.behaviors:
        yield "behaviors.csv", _csv(_BEHAVIOR_COLUMNS, _behavior_rows(run.behaviors))
        yield "behaviors.jsonl", _behavior_lines(run)
    if run.log is not None:
        yield "resources.csv", _csv(("t_s", "cpu_s", "rss_bytes", "processes"), _resources(run.log))
        for name, text in _logs(run.log):
            yield f"logs/{name}", text.encode(errors="replace")
        yield "logs/host.json", f"{json.dumps(run.host, indent=1)}\n".encode()


def recording_csv(recorded: Recorded) -> bytes:
    """The columns of a recording in SI units, one row a sample."""
    columns = {signal_name(name): _si(name, column) for name, column in recorded.items()}
    return table_csv(pa.table(columns))


FRAMES: Final = {"base_link": "estimated_", "turtlebot4_base_link_gt": ""}
"""Frame, as RoboVAST's recordings call it, to how the columns of its pose begin: where the robot believes to be, and where it is."""


def poses_csv(recorded: Recorded) -> bytes:
    """The robot's poses on the map, a row for each frame and sample: s, m, rad."""
    pose = ("position.x", "position.y", "position.z", "orientation.roll", "orientation.pitch", "orientation.yaw")
    rows = [
        (frame, t_s, x_m, y_m, 0.0, 0.0, 0.0, yaw_rad)
        for frame, begin in FRAMES.items()
        for t_s, x_m, y_m, yaw_rad in zip(
            *(_si(name, recorded[name]).tolist() for name in ("t_ms", *(f"{begin}{each}" for each in _POSE))),
            strict=True,
        )
    ]
    return _csv(("frame", "timestamp", *pose), sorted(rows, key=lambda row: row[1]))


_POSE: Final = ("x_mm", "y_mm", "yaw_mrad")


def table_csv(table: pa.Table) -> bytes:
    """`table` as CSV; a number that is none is an empty field."""
    out = io.BytesIO()
    out.write(_csv(table.column_names, ()))
    for k, name in enumerate(table.column_names):
        column = table.column(k)
        if pa.types.is_floating(column.type):  # few readers take `nan` for missing
            table = table.set_column(k, name, pc.if_else(pc.is_nan(column), None, column))
    if table.num_columns:
        pyarrow.csv.write_csv(table, out, pyarrow.csv.WriteOptions(include_header=False))
    return out.getvalue()


def _properties(run: ExportedRun) -> Iterator[tuple[str, str]]:
    row = run.row or {}
    if run.row is not None:
        yield "simulated_time_s", str(row["simulated_s"])
    if run.log is not None:
        yield "wall_time_s", str(round(run.log.wall_s, 6))
        yield "cpu_time_s", str(round(run.log.cpu_s, 6))
        yield "max_rss_bytes", str(run.log.max_rss_bytes)
        yield "host", str(run.host["host"]["name"])
    for name in (
        *("outcome", "reason", "cause", "seed"),
        *("distance_m", "recoveries", "missed_goals", "contacts", "stood_still"),
    ):
        if row.get(name) not in (None, ""):
            yield name, str(row[name])
    for verdict in run.verdicts:
        yield verdict["oracle"], verdict["judgement"]
        for metric, measured in verdict["metrics"].items():
            if measured["value"] is not None:
                unit = "" if measured["unit"] == "1" else f" ({measured['unit']})"
                yield f"{verdict['oracle']}: {metric}{unit}", str(measured["value"])


def _flaw(run: ExportedRun) -> Flaw | None:
    judgement = run_judgement(verdict["judgement"] for verdict in run.verdicts)
    if judgement == "pass":
        return None
    against = [verdict for verdict in run.verdicts if verdict["judgement"] == judgement]
    message = "; ".join(f"{verdict['oracle']}: {verdict['reason']}" for verdict in against)
    text = "\n".join([*map(_told, run.verdicts), *_ended_as(run)])
    if judgement == "fail":
        return Flaw("failure", message, text)
    if not against or any(verdict["reason"].startswith(FAULT) for verdict in against):
        return Flaw("error", message or f"{FAULT}: there is no verdict", text)
    return Flaw("skipped", f"not judged by {message}", text)


def _told(verdict: Mapping[str, Any]) -> str:
    why = f": {verdict['reason']}" if verdict["reason"] else ""
    return f"{verdict['oracle']}: {verdict['judgement']}{why}"


def _ended_as(run: ExportedRun) -> Iterator[str]:
    """The scenario's tree as it was in the end, a line for each node."""
    depth: dict[int, int] = {-1: -1}
    last: dict[int, Mapping[str, Any]] = {}
    for row in _rows(run.behaviors):
        depth.setdefault(row["behavior"], depth.get(row["parent"], -1) + 1)
        last[row["behavior"]] = row
    if last:
        yield ""
    for node, end in sorted(last.items()):
        message = f": {end['message']}" if end["message"] else ""
        yield f"{end['status']:8}{'  ' * depth[node]}{end['name']} ({run.scenario_file}:{end['line']}:{end['column']}){message}"


_BEHAVIOR_COLUMNS: Final = (
    *("timestamp", "behavior_name", "behavior_id", "status", "status_name", "class_name"),
    *("parent_id", "child_index", "message", "line", "column"),
)


def _behavior_rows(behaviors: Columns) -> Iterator[Sequence[Any]]:
    for row in _rows(behaviors):
        yield (
            *(row["t_s"], row["name"], row["behavior"], STATUS_NUMBERS.get(row["status"], 0), row["status"]),
            *(row["class_name"], row["parent"], row["child_index"], row["message"], row["line"], row["column"]),
        )


def _behavior_lines(run: ExportedRun) -> bytes:
    header = {
        "format": "behaviors",
        "version": 1,
        "scenario": run.scenario,
        "tick_period": PERIOD_S,
        "clock": "simulated",
    }
    lines: list[Mapping[str, Any]] = [header]
    lines += [
        {
            "timestamp": row["t_s"],
            "behavior_id": row["behavior"],
            "parent_id": None if row["parent"] < 0 else row["parent"],
            "child_index": row["child_index"],
            "behavior_name": row["name"],
            "class_name": row["class_name"],
            "status": row["status"],
            "feedback_message": row["message"],
            "osc_file": run.scenario_file,
            "osc_line": row["line"],
            "osc_column": row["column"],
        }
        for row in _rows(run.behaviors)
    ]
    return "".join(f"{json.dumps(line, ensure_ascii=False)}\n" for line in lines).encode(errors="replace")


def _resources(log: RunLog) -> Iterator[Sequence[Any]]:
    """The series of the run's programs, else one row for the worker that simulated it."""
    for use in log.resources or [Use(log.wall_s, log.cpu_s, log.max_rss_bytes, 1)]:
        yield round(use.t_s, 3), round(use.cpu_s, 3), use.rss_bytes, use.processes


def _logs(log: RunLog) -> Iterator[tuple[str, str]]:
    """Name and text of each log file."""
    for name, lines in (("scenario.log", log.lines), ("notes.log", log.notes)):
        if lines:
            yield name, "".join(f"{line}\n" for line in lines)
    for number, said in enumerate(log.texts):
        called = said.label or PurePosixPath(next(iter(said.command), "")).name
        end = "\n[cut here]\n" if said.cut else ""
        yield f"{number}-{_file_name(called)}.log", f"$ {' '.join(said.command)}\n{said.text}{end}"


def _file_name(called: str) -> str:
    return re.sub(r"[^A-Za-z0-9._-]+", "-", called)[:60].strip("-.") or "program"


def _rows(columns: Columns) -> Iterator[dict[str, Any]]:
    for values in zip(*(column.tolist() for column in columns.values()), strict=True):
        yield dict(zip(columns, values, strict=True))


def _csv(names: Iterable[str], rows: Iterable[Sequence[Any]]) -> bytes:
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(names)
    writer.writerows(rows)
    return out.getvalue().encode(errors="replace")


def _si(name: str, column: Any) -> Any:
    """A recorded column in SI units; divided, which gives the decimal that was recorded and no 0.30000000000000004."""
    if signal_name(name) == name:
        return column
    return column / (1e6 if name.endswith("2") else 1e3)
