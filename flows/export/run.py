"""One run of a campaign as a test case and as files of its own."""

import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import PurePosixPath
from typing import Any, Final

import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv

from vastflow.flows.export.junit import Case, Flaw, FlawKind, Suite, suite_report
from vastflow.flows.results.rows import FAULT
from vastflow.oracles.judgment.verdict import run_judgment
from vastflow.oracles.observation.trace import signal_name
from vastflow.oracles.replay.recorded import RecordedRun
from vastflow.sim.model.blocks import Columns as Recorded
from vastflow.sim.model.recording import Columns, RunLog, Use
from vastflow.sim.run import PERIOD_S
from vastflow.sim.scenario.tree.world import WORLD

STATUS_NUMBERS: Final = {"INVALID": 1, "RUNNING": 2, "SUCCESS": 3, "FAILURE": 4}
"""Numbers of ROS messages for the status of a behavior."""

FRAMES: Final = {"base_link": "estimated_", "turtlebot4_base_link_gt": ""}
"""Frames of RoboVAST's recordings to the prefix of their columns: the robot's estimate of its pose, and its true pose."""
_POSE: Final = {"x_mm": "position.x", "y_mm": "position.y", "yaw_mrad": "orientation.yaw"}
_POSES: Final = (
    *("frame", "timestamp", "position.x", "position.y", "position.z"),
    *("orientation.roll", "orientation.pitch", "orientation.yaw"),
)

_TREE: Final = ("t_s", "behavior", "parent", "child_index", "name", "class_name", "status", "message")
_LINE_KEYS: Final = (
    *("timestamp", "behavior_id", "parent_id", "child_index", "behavior_name", "class_name", "status"),
    *("feedback_message", "osc_file", "osc_line", "osc_column"),
)
_LINE: Final = dict(zip((*_TREE, "file", "line", "column"), _LINE_KEYS, strict=True))
"""Our columns to the keys of a line of `behaviors.jsonl`."""
_CSV: Final = ("t_s", "name", "behavior", "number", "status", "class_name")
_RENAMED: Final = {**{name: _LINE[name] for name in _CSV if name in _LINE}, "number": "status", "status": "status_name"}
_ACTIONS: Final = {name.rpartition(".")[2]: name for name in WORLD}
"""Names of actions to what RoboVAST calls them: after their actor."""


@dataclass(frozen=True)
class ExportedRun:
    """The data of one run in a campaign directory.

    Attributes:
        verdicts, row: Its rows of `verdicts.parquet` and of `runs.parquet`, the latter None without a recording.
        log, host: Its run log, if any, with host and versions.
        recorded: Columns of its recording, in thousandths; empty without a robot.
        behaviors: Its `behaviors` table, may be empty.
        outputs: Files that its programs wrote, by their places; tables are CSV, or Parquet if the run has another file of that name.
        read: Reads all that an execution of the run needs; None where there is no recording.
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
    outputs: Mapping[str, bytes] = field(default_factory=dict, repr=False)
    read: Callable[[], RecordedRun] | None = field(default=None, repr=False)


def case_of(run: ExportedRun) -> Case:
    """Return the run as a test case, judged by all oracles together, with their verdicts as properties."""
    return Case(
        name=f"{run.configuration}/{run.run_index}",
        classname=f"{run.campaign}.{run.configuration}",
        time_s=run.log.wall_s if run.log else 0.0,
        started_s=run.log.started_s if run.log else None,
        properties=dict(_properties(run)),
        flaw=_flaw(run),
    )


def files_of(run: ExportedRun, case: Case) -> Iterator[tuple[str, bytes]]:
    """Yield path below the run's folder and content of each file except its programs' outputs."""
    yield "test.xml", suite_report(Suite(run.configuration, [case]))
    if run.recorded:
        signals = {signal_name(name): _si(name, column) for name, column in run.recorded.items()}
        yield "recording.csv", table_csv(pa.table(signals))
        if all(f"{prefix}{name}" in run.recorded for prefix in FRAMES.values() for name in _POSE):
            yield "poses.csv", poses_csv(run.recorded)
    if run.behaviors:
        rows = pd.DataFrame(run.behaviors)
        yield "behaviors.csv", behaviors_csv(rows)
        yield "behaviors.jsonl", _behavior_lines(run, rows)
    if run.log is not None:
        # of the run's programs, else of the worker that simulated it
        series = run.log.resources or [Use(run.log.wall_s, run.log.cpu_s, run.log.max_rss_bytes, 1)]
        uses = [(round(use.t_s, 3), round(use.cpu_s, 3), use.rss_bytes, use.processes) for use in series]
        yield "resources.csv", _csv(pd.DataFrame(uses, columns=["t_s", "cpu_s", "rss_bytes", "processes"]))
        for name, text in _logs(run.log):
            yield f"logs/{name}", text.encode(errors="replace")
        yield "logs/host.json", f"{json.dumps(run.host, indent=1)}\n".encode()


def behaviors_csv(rows: pd.DataFrame) -> bytes:
    """Return status changes of behaviors as CSV in RoboVAST's columns, numbered from 1 in the order in which they appear."""
    numbers = {behavior: k for k, behavior in enumerate(dict.fromkeys(rows["behavior"]), 1)}
    told = rows.assign(
        number=[STATUS_NUMBERS.get(status, 0) for status in rows["status"]],
        behavior=[numbers[behavior] for behavior in rows["behavior"]],
        name=[_ACTIONS.get(name, name) for name in rows["name"]],
    )
    return _csv(told[list(_CSV)].rename(columns=_RENAMED))


def poses_csv(recorded: Recorded) -> bytes:
    """Return the robot's poses on the map as CSV, a row for each frame and sample: s, m, rad."""
    t_s = _si("t_ms", recorded["t_ms"])
    frames = []
    for frame, prefix in FRAMES.items():
        pose = {said: _si(name, recorded[f"{prefix}{name}"]) for name, said in _POSE.items()}
        frames.append(pd.DataFrame({**dict.fromkeys(_POSES, 0.0), "frame": frame, "timestamp": t_s, **pose}))
    return _csv(pd.concat(frames).sort_values("timestamp", kind="stable"))


def table_csv(table: pa.Table) -> bytes:
    """Return `table` as CSV with an empty field for NaN, which few readers take for missing."""
    for k, name in enumerate(table.column_names):
        column = table.column(k)
        if pa.types.is_floating(column.type):
            table = table.set_column(k, name, pc.if_else(pc.is_nan(column), None, column))
    header, rows = _csv(pd.DataFrame(columns=table.column_names)), pa.BufferOutputStream()
    if table.num_columns:
        pyarrow.csv.write_csv(table, rows, pyarrow.csv.WriteOptions(include_header=False))
    content: bytes = rows.getvalue().to_pybytes()
    return header + content


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
        yield verdict["oracle"], verdict["judgment"]
        for metric, measured in verdict["metrics"].items():
            if measured["value"] is not None:
                unit = "" if measured["unit"] == "1" else f" ({measured['unit']})"
                yield f"{verdict['oracle']}: {metric}{unit}", str(measured["value"])


def flaw_of(verdicts: Sequence[Mapping[str, Any]]) -> FlawKind | None:
    """Return what keeps a run with these verdicts from passing, None if nothing does."""
    judgment = run_judgment(verdict["judgment"] for verdict in verdicts)
    if judgment != "not judged":
        return None if judgment == "pass" else "failure"
    reasons = [verdict["reason"] for verdict in verdicts if verdict["judgment"] == judgment]
    return "error" if not reasons or any(reason.startswith(FAULT) for reason in reasons) else "skipped"


def _flaw(run: ExportedRun) -> Flaw | None:
    kind = flaw_of(run.verdicts)
    if kind is None:
        return None
    judgment = run_judgment(verdict["judgment"] for verdict in run.verdicts)
    against = [verdict for verdict in run.verdicts if verdict["judgment"] == judgment]
    message = "; ".join(f"{verdict['oracle']}: {verdict['reason']}" for verdict in against)
    told = [[each["oracle"], each["judgment"], *filter(None, [each["reason"]])] for each in run.verdicts]
    text = "\n".join([*map(": ".join, told), *_final_tree(run)])
    if kind == "skipped":
        message = f"not judged by {message}"
    return Flaw(kind, message or f"{FAULT}: there is no verdict", text)


def _final_tree(run: ExportedRun) -> Iterator[str]:
    depth: dict[int, int] = {-1: -1}
    last: dict[int, Mapping[str, Any]] = {}
    for row in pd.DataFrame(run.behaviors).to_dict("records"):
        depth.setdefault(row["behavior"], depth.get(row["parent"], -1) + 1)
        last[row["behavior"]] = row
    if last:
        yield ""
    for node, end in sorted(last.items()):
        message = f": {end['message']}" if end["message"] else ""
        yield f"{end['status']:8}{'  ' * depth[node]}{end['name']} ({run.scenario_file}:{end['line']}:{end['column']}){message}"


def _behavior_lines(run: ExportedRun, rows: pd.DataFrame) -> bytes:
    shared = {"format": "behaviors", "version": 1, "scenario": run.scenario}
    lines = [{**shared, "tick_period": PERIOD_S, "clock": "simulated"}]
    for row in rows.assign(file=run.scenario_file)[list(_LINE)].rename(columns=_LINE).to_dict("records"):
        lines.append({**row, "parent_id": None if row["parent_id"] < 0 else row["parent_id"]})
    return "".join(f"{json.dumps(line, ensure_ascii=False)}\n" for line in lines).encode(errors="replace")


def _logs(log: RunLog) -> Iterator[tuple[str, str]]:
    for name, lines in (("scenario.log", log.lines), ("notes.log", log.notes)):
        if lines:
            yield name, "".join(f"{line}\n" for line in lines)
    for number, said in enumerate(log.texts):
        called = said.label or PurePosixPath(next(iter(said.command), "")).name
        name = re.sub(r"[^A-Za-z0-9._-]+", "-", called)[:60].strip("-.") or "program"
        end = "\n[cut here]\n" if said.cut else ""
        yield f"{number}-{name}.log", f"$ {' '.join(said.command)}\n{said.text}{end}"


def _csv(rows: pd.DataFrame) -> bytes:
    text: str = rows.to_csv(index=False, lineterminator="\n")
    return text.encode(errors="replace")


def _si(name: str, column: Any) -> Any:
    """Return a recorded column in SI units; division gives the recorded decimal and no 0.30000000000000004."""
    if signal_name(name) == name:
        return column
    return column / (1e6 if name.endswith("2") else 1e3)
