"""Frames of a stored run: everything that its page shows at once, from the recording and without an execution."""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any, Final, TypeAlias

import numpy as np
import pyarrow.compute as pc
from numpy.typing import NDArray
from pydantic import TypeAdapter

from vastflow.oracles.judgment.verdict import Metric, run_judgment
from vastflow.oracles.observation.obstacle_tracks import ObstacleTrack, obstacle_tracks_of
from vastflow.oracles.observation.situation import situation_of
from vastflow.oracles.observation.trace import NOWHERE_MM, Reference, signals_of, trace_of
from vastflow.oracles.query.scene import known_cells, known_extent_m, zones_of
from vastflow.oracles.results.executed import KeptFiles, configuration_row, recordings_of, scenario_of_row
from vastflow.oracles.results.schema import VERDICTS, rows_of
from vastflow.oracles.results.unusable import UnusableDirectory, reading
from vastflow.sim.loop.event_words import event_words
from vastflow.sim.model.blocks import read_block
from vastflow.sim.model.pose import Pose
from vastflow.sim.model.rates import TICK_S
from vastflow.sim.model.recording import Columns, Event, Recording
from vastflow.sim.model.scenario import Scenario
from vastflow.sim.system.system import system_of
from vastflow.sim.world.environment import world_of
from vastflow.sim.world.occupancy import OccupancyMap

POSES: Final = ("t_ms", "x_mm", "y_mm", "yaw_mrad", "estimated_x_mm", "estimated_y_mm", "estimated_yaw_mrad")
_CLEARANCES: Final = {"wall": "walls", "static": "obstacles", "appearing": "appearing obstacles", "moving": "movers"}
SIGNALS: Final[Sequence[tuple[str, str, Mapping[str, str]]]] = (
    ("Speed", "m/s", {"speed_mmps": "true", "sent_speed_mmps": "commanded"}),
    ("Distance to the goal", "m", {"goal_distance_mm": ""}),
    ("Localization error", "m", {"localization_error_mm": ""}),
    ("Clearance of the center", "m", {f"{to}_clearance_mm": words for to, words in _CLEARANCES.items()}),
    ("Off the reference path", "m", {"deviation_mm": ""}),
    ("Yaw rate", "rad/s", {"yaw_rate_mradps": "true", "sent_yaw_rate_mradps": "commanded"}),
)
"""Title, unit, and lines of the plots beside the map; the lines are columns of thousandths."""

_METRICS: Final = TypeAdapter(dict[str, Metric])
NO_POINTS: Final = np.empty((0, 2))
FREE, WALL, UNKNOWN = 0, 1, 2
"""Cells of maps in a reply; those of masks are 0 to 100."""


@dataclass(frozen=True, eq=False)
class StoredRun:
    """A run as its campaign directory has it.

    Attributes:
        configuration: The executed one; a duplicate's original.
        recording: None where the run was not recorded.
        reference_xy_m: Points (N, 2) of the reference path; none where the run has no such path.
        derived: Stored columns of the trace.
        verdicts: Rows of `verdicts.parquet`, one for each oracle.
    """

    configuration: str
    run_index: int
    scenario: Scenario
    recording: Recording | None = field(repr=False)
    reference_xy_m: NDArray[np.float64] = field(repr=False)
    derived: Mapping[str, NDArray[np.int32]] = field(repr=False)
    verdicts: Sequence[Mapping[str, Any]] = field(repr=False)

    @cached_property
    def columns(self) -> Mapping[str, NDArray[np.int32]]:
        """Recorded and derived columns that mean something, and the distance to the goal."""
        stored = {**(self.recording.columns if self.recording is not None else {}), **self.derived}
        if self.recording is not None and self.recording.columns and (goals := situation_of(self.scenario).goals):
            stored["goal_distance_mm"] = _goal_distance_mm(self.recording, goals)
        return {name: each for name, each in stored.items() if name != "deviation_mm" or len(self.reference_xy_m)}


def stored_run(directory: Path, configuration: str, run_index: int) -> StoredRun:
    """Read a run from a campaign directory.

    Raises:
        UnusableDirectory: an unknown configuration or run; a missing or damaged file.
    """
    with reading(directory.name):
        row = configuration_row(directory, configuration)
        name = row["duplicate_of"] or configuration
        of_all = rows_of(directory / "verdicts.parquet", "configuration", name).select(VERDICTS.names)
        if not (verdicts := of_all.filter(pc.field("run_index") == run_index).to_pylist()):
            numbers = f"0 to {pc.max(of_all['run_index'])}" if len(of_all) else "of which it has none"
            raise UnusableDirectory(
                f"{directory.name}: {name}: expected the number of a run, {numbers}, got {run_index}"
            )
        for verdict in verdicts:
            _check_metrics(verdict["metrics"])
        scenario = scenario_of_row(row, KeptFiles(directory))
        return StoredRun(name, run_index, scenario, *_recorded(directory, name, run_index), verdicts)


_Recorded: TypeAlias = tuple[Recording | None, NDArray[np.float64], Mapping[str, NDArray[np.int32]]]


def _check_metrics(text: str) -> None:
    try:
        _METRICS.validate_json(text)
    except ValueError:
        raise ValueError(f"verdicts.parquet: metrics: expected values with units by name, got {text[:60]!r}") from None


def _recorded(directory: Path, name: str, run_index: int) -> _Recorded:
    recording, traces = recordings_of(directory, name).get(run_index), directory / "traces" / f"{name}.parquet"
    for row, derived in read_block(traces) if recording and traces.is_file() else ():
        if recording and row["run_index"] == run_index:
            reference = trace_of(recording, row, derived).reference
            return recording, reference.points_xy_m if isinstance(reference, Reference) else NO_POINTS, derived
    return recording, NO_POINTS, {}


def facts_of(run: StoredRun, asked: str) -> dict[str, Any]:
    """Return what a page tells of a run beside its map, such as verdicts and events.

    Args:
        asked: The configuration in the address, of which the executed one may be the original.
    """
    facts: dict[str, Any] = {
        "configuration": asked,
        "executed": run.configuration,
        "run": run.run_index,
        "judgment": run_judgment([verdict["judgment"] for verdict in run.verdicts]),
        "verdicts": [{**verdict, "metrics": json.loads(verdict["metrics"])} for verdict in run.verdicts],
        "sentence": "",
        "tick_s": TICK_S,
    }
    if run.recording is None:
        facts |= {"outcome": "", "simulated_s": 0.0, "events": [], "behaviors": []}
        return {**facts, "sentence": "This run was not recorded. The verdicts say why."}
    told = run.recording.run
    facts |= {
        **{name: getattr(told, name) for name in ("outcome", "reason", "simulated_s", "distance_m", "recoveries")},
        "events": [*event_rows(told.events)],
        "behaviors": [*scenario_spans(run.recording.behaviors, told.simulated_s)],
    }
    if not run.recording.columns:
        where = f"What its programs wrote is in outputs/{run.configuration}.zip of the campaign directory."
        facts["sentence"] = f"This scenario has no robot, so there is no map to show. {where}"
    return facts


def frames_of(run: StoredRun, asked: str) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Return the facts of a run, see `facts_of`, and arrays of what its map and its signals show.

    Raises:
        ValueError: a scenario or a map that can't be read.
    """
    facts = facts_of(run, asked)
    if run.recording is None or facts["sentence"]:
        return facts, {}
    situation, robot = situation_of(run.scenario), system_of(run.scenario.system, is_drawn=True).robot
    grids = [*_grids(run.scenario)]
    signals = signals_of(run.recording.columns)
    facts |= {
        "robot": {"radius_m": robot.radius_m, "vertices": robot.vertices},
        "goals": [(goal.x_m, goal.y_m) for goal in situation.goals],
        "obstacles": [_track_row(track) for track in obstacle_tracks_of(situation, run.recording.run, signals)],
        "activities": [*_standing(run.columns)],
        "nowhere": NOWHERE_MM,
        "grids": [{**place, "cells": f"grid {k}"} for k, (place, _) in enumerate(grids)],
    }
    shown = dict.fromkeys([*POSES, *(column for _, _, lines in SIGNALS for column in lines if column in run.columns)])
    arrays = {name: run.columns[name] for name in shown}
    cells = {f"grid {k}": each for k, (_, each) in enumerate(grids)}
    return facts, {**arrays, **cells, "reference": run.reference_xy_m.astype(np.float32)}


def plots_of(runs: Sequence[StoredRun]) -> Iterator[Mapping[str, Any]]:
    """Yield the plot of each signal that runs have: key, title, unit, least and greatest value, lines."""
    for title, unit, words in SIGNALS:
        lines, known = [], [np.zeros(1, dtype=np.int32)]
        for side, run in enumerate(runs):
            for n, name in enumerate(words):
                if (values := run.columns.get(name)) is not None:
                    known.append(values[values != NOWHERE_MM])
                    path = _path(run.columns["t_ms"], values)
                    lines.append({"side": side, "n": n, "words": words[name], "column": name, "d": path})
        every = np.concatenate(known) * 1e-3
        low, high = float(every.min()), float(every.max())
        if lines:
            ends = {"low": low, "high": high if high > low else low + 1.0}
            yield {"key": next(iter(words)), "title": title, "unit": unit, **ends, "lines": lines}


def _goal_distance_mm(recording: Recording, goals: Sequence[Pose]) -> NDArray[np.int32]:
    """Return the distance (N,) from the robot's center to the next open goal, or to the last one."""
    over_ms = [1000 * event.t_s for event in recording.run.events if event.kind in ("goal_reached", "goal_missed")]
    now = np.minimum(np.searchsorted(over_ms, recording.columns["t_ms"] - 0.5), len(goals) - 1)
    x_m, y_m = np.array([(goal.x_m, goal.y_m) for goal in goals])[now].T
    away_mm = np.hypot(recording.columns["x_mm"] - 1000 * x_m, recording.columns["y_mm"] - 1000 * y_m)
    return np.asarray(np.rint(away_mm), dtype=np.int32)


def _path(t_ms: NDArray[np.int32], values: NDArray[np.int32]) -> str:
    """Return a line as SVG has it, in seconds and units of the signal downwards, with gaps."""
    known = values != NOWHERE_MM
    pens = np.where(known & ~np.r_[False, known[:-1]], "M", "L")
    places = np.column_stack([t_ms, -values])[known] * 1e-3
    return "".join(f"{pen}{t_s:g} {y:g}" for pen, (t_s, y) in zip(pens[known].tolist(), places.tolist(), strict=True))


def event_rows(events: Iterable[Event]) -> Iterator[dict[str, Any]]:
    """Yield time, kind, place, and words of events, without minor ones."""
    for event in events:
        if (text := event_words(event)) is not None:
            yield {"t_s": event.t_s, "kind": event.kind, "x_m": event.x_m, "y_m": event.y_m, "text": text}


def scenario_spans(behaviors: Columns, end_s: float) -> Iterator[dict[str, Any]]:
    """Yield name, start, end, last status, and row of each time that an action of the scenario ran.

    Args:
        behaviors: Status changes of the scenario's tree, see `Recording`; without its compositions, which have children.
        end_s: Time of the run's end, until which an action without a last status ran.
    """
    if not behaviors:
        return
    parents = set(behaviors["parent"].tolist())
    running: dict[int, dict[str, Any]] = {}
    for t_s, node, name, status, message in zip(
        *(behaviors[column].tolist() for column in ("t_s", "behavior", "name", "status", "message")), strict=True
    ):
        if node in parents:
            continue
        if (span := running.pop(node, None)) is not None:
            yield {**span, "end_s": t_s, "status": status, "message": message or span["message"]}
        if status == "RUNNING":
            # The first row where no other action runs.
            lane = min({*range(len(running) + 1)} - {each["lane"] for each in running.values()})
            running[node] = {"name": name, "start_s": t_s, "message": message, "lane": lane}
    for span in running.values():
        yield {**span, "end_s": end_s, "status": "RUNNING"}


def _standing(columns: Mapping[str, NDArray[np.int32]]) -> Iterator[tuple[float, float, str]]:
    """Yield start, end, and activity as far as a recording tells it: whether the robot drives or stands."""
    if "stopped" in columns:
        stands, t_s = columns["stopped"] != 0, (columns["t_ms"] * 1e-3).tolist()
        for first, end in pairwise([0, *(np.flatnonzero(np.diff(stands)) + 1).tolist(), len(t_s) - 1]):
            yield t_s[first], t_s[end], "standing" if stands[first] else "driving"


def _track_row(track: ObstacleTrack) -> dict[str, Any]:
    """Name, shape, size, and places: since when (s), x, y (null while absent), and yaw."""
    obstacle = track.obstacle
    places = zip((track.since_ms * 1e-3).tolist(), *track.xy_m.T.tolist(), track.yaw_rad.tolist(), strict=True)
    size = {"length_m": obstacle.length_m, "width_m": obstacle.width_m}
    return {"name": obstacle.name, "shape": obstacle.model, **size, "places": [*places]}


def _grids(scenario: Scenario) -> Iterator[tuple[dict[str, Any], NDArray[np.uint8]]]:
    """Yield the map, the world where it differs, and masks of costmap filters: place and cells of each."""
    world = world_of(scenario.environment)
    if world is None:
        raise TypeError("the scenario of a robot has no world")
    found = [("map", world.ground, _cells_of(world.ground))]
    if world.walls is not world.ground:
        found.append(("world", world.walls, _cells_of(world.walls)))
    zones = zones_of([scenario])
    for kind, masks in (("keepout", zones.keepout), ("speed", zones.speed)):
        found += [(kind, mask, np.maximum(mask.cells, 0).astype(np.uint8)) for mask in masks]
    for kind, grid, cells in found:
        rows, columns = known_cells(grid)
        ((x_m, y_m),) = grid.corners_of(np.array([(rows.start, columns.start)])).tolist()
        place = {"x_m": x_m, "y_m": y_m, "yaw_rad": grid.yaw_rad, "resolution_m": grid.resolution_m}
        yield {"kind": kind, **place, "extent": known_extent_m(grid, 0.0)}, cells[rows, columns]


def _cells_of(occupancy: OccupancyMap) -> NDArray[np.uint8]:
    kinds: NDArray[np.uint8] = np.select([occupancy.occupied, occupancy.cells < 0], [WALL, UNKNOWN], FREE).astype(
        np.uint8
    )
    return kinds
