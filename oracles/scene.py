"""Scenes: what happened in one environment, ready to be drawn."""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import pyarrow.parquet as pq
from numpy.typing import NDArray

from vastflow.oracles.executed import KeptFiles, executed_scenario
from vastflow.oracles.oracle import SUCCESS
from vastflow.oracles.rates import Counts, counts_of
from vastflow.oracles.situation import Situation, situation_of
from vastflow.oracles.tables import RunKey, Tables
from vastflow.oracles.verdict import Judgement
from vastflow.oracles.whereabouts import spawned_by
from vastflow.sim.blocks import ROWS_KEY
from vastflow.sim.maps import OccupancyMap, load_map
from vastflow.sim.obstacle import Obstacle
from vastflow.sim.recording import run_of, si

MAX_TRAJECTORIES: Final = 500
"""Trajectories drawn per judgement and environment; more hide each other (the paper draws 1,000)."""
_STEP_M: Final = 0.05


@dataclass(frozen=True, eq=False)
class Trajectory:
    """The true way of one run, (N, 2) in the map frame, a point every 5 cm."""

    judgement: Judgement
    xy_m: NDArray[np.float64] = field(repr=False)


@dataclass(frozen=True, slots=True)
class FinalPosition:
    """Where a failed run ended; `mission_failed` is False where another oracle failed it."""

    x_m: float
    y_m: float
    mission_failed: bool


@dataclass(frozen=True, eq=False)
class Scene:
    """One environment and everything that happened in it.

    Attributes:
        environment: Digest of the map.
        runs: All runs here, drawn or not.
        trajectories: At most `MAX_TRAJECTORIES` of each judgement, evenly chosen.
        starts_xy_m, goals_xy_m: (n, 2), without repetitions.
        obstacles: Those of all configurations and those that their scenarios spawned, without repetitions.
        failed: Of every failed run that has a recording.
    """

    environment: str
    occupancy: OccupancyMap
    runs: Counts
    trajectories: Sequence[Trajectory] = field(repr=False)
    starts_xy_m: NDArray[np.float64]
    goals_xy_m: NDArray[np.float64]
    obstacles: Sequence[Obstacle]
    failed: Sequence[FinalPosition] = field(repr=False)


def scenes_of(tables: Tables) -> list[Scene]:
    """The scene of each environment that was run in, in the order of the configurations."""
    members: dict[str, list[dict[str, Any]]] = {}
    for row in tables.configurations:
        if row["environment"] is not None and row["duplicate_of"] is None:
            members.setdefault(row["environment"], []).append(row)
    files = KeptFiles(tables.directory)
    return [_scene(tables, environment, rows, files) for environment, rows in members.items()]


def _scene(tables: Tables, environment: str, rows: Sequence[Mapping[str, Any]], files: KeptFiles) -> Scene:
    names = {row["name"] for row in rows}
    runs = {key: judgement for key, judgement in tables.judgements.items() if key[0] in names}
    chosen, missed = _chosen(runs), _missed(tables)
    situations = [_situation(row, files) for row in rows]
    trajectories: list[Trajectory] = []
    failed: list[FinalPosition] = []
    for key, xy_m in _recorded(tables, {*chosen, *(key for key, judgement in runs.items() if judgement == "fail")}):
        if key in chosen:
            trajectories.append(Trajectory(runs[key], _thinned(xy_m)))
        if runs[key] == "fail":
            failed.append(FinalPosition(float(xy_m[-1, 0]), float(xy_m[-1, 1]), key in missed))
    return Scene(
        environment,
        load_map(tables.directory / "environments" / environment / "map.yaml"),
        counts_of(runs.values()),
        trajectories,
        _distinct([(s.start.x_m, s.start.y_m) for s in situations if s.start is not None]),
        _distinct([(goal.x_m, goal.y_m) for s in situations for goal in s.goals]),
        _distinct_obstacles([*(o for s in situations for o in s.obstacles), *_spawned_in(tables, sorted(names))]),
        failed,
    )


def _situation(row: Mapping[str, Any], files: KeptFiles) -> Situation:
    return situation_of(executed_scenario(row["abstract"], 0.0, row["scenario"], files))


def _distinct(points: list[tuple[float, float]]) -> NDArray[np.float64]:
    return np.array(list(dict.fromkeys(points)), dtype=np.float64).reshape(-1, 2)


def _distinct_obstacles(obstacles: Sequence[Obstacle]) -> list[Obstacle]:
    return list({(o.pose, o.length_m, o.width_m, o.shape): o for o in obstacles}.values())


def _spawned_in(tables: Tables, configurations: Sequence[str]) -> Iterator[Obstacle]:
    """What the scenarios themselves put into the world in any run, where they put it."""
    for configuration in configurations:
        file = tables.directory / "recordings" / f"{configuration}.parquet"
        if file.is_file():
            for row in json.loads(pq.read_schema(file).metadata[ROWS_KEY]):
                yield from spawned_by(run_of(row))


def _chosen(runs: Mapping[RunKey, Judgement]) -> set[RunKey]:
    """The runs to draw, evenly spread over the configurations."""
    chosen: set[RunKey] = set()
    for wanted in ("pass", "not judged", "fail"):
        keys = [key for key, judgement in runs.items() if judgement == wanted]
        step = max(1, -(-len(keys) // MAX_TRAJECTORIES))
        chosen.update(keys[::step])
    return chosen


def _missed(tables: Tables) -> set[RunKey]:
    """Runs whose mission failed."""
    return {
        (row["configuration"], row["run_index"])
        for row in tables.verdicts
        if row["oracle"] == SUCCESS and row["judgement"] == "fail"
    }


def _recorded(tables: Tables, wanted: set[RunKey]) -> Iterator[tuple[RunKey, NDArray[np.float64]]]:
    """True positions (N >= 1, 2) of the wanted runs that have a recording, in order."""
    indices: dict[str, list[int]] = {}
    for configuration, run_index in sorted(wanted):
        indices.setdefault(configuration, []).append(run_index)
    for configuration, run_indices in indices.items():
        file = tables.directory / "recordings" / f"{configuration}.parquet"
        if not file.is_file():  # every run of it was broken by a fault of ours
            continue
        table = pq.ParquetFile(file).read(columns=["run_index", "x_mm", "y_mm"])
        # By DLPack, because pyarrow's own to_numpy imports pandas (0.35 s).
        index, x_mm, y_mm = (np.asarray(np.from_dlpack(c.combine_chunks()), dtype=np.int32) for c in table.columns)
        xy_m = np.column_stack((si(x_mm), si(y_mm)))
        for run_index in run_indices:
            start, end = np.searchsorted(index, [run_index, run_index + 1])
            if end > start:
                yield (configuration, run_index), xy_m[start:end]


def _thinned(xy_m: NDArray[np.float64]) -> NDArray[np.float64]:
    along_m = np.r_[0.0, np.cumsum(np.hypot(*np.diff(xy_m, axis=0).T))]
    keep = np.r_[True, np.diff(np.floor(along_m / _STEP_M)) > 0]
    keep[-1] = True
    return xy_m[keep]
