"""Scenes: walks, failures, and zones of one environment, to be drawn."""

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vastflow.oracles.judgment.registry import SUCCESS
from vastflow.oracles.observation.obstacle_tracks import spawned_by
from vastflow.oracles.observation.situation import situation_of
from vastflow.oracles.results.executed import KeptFiles, kept_map, scenario_of_row
from vastflow.oracles.results.tables import CODES, FAIL, NOT_JUDGED, Tables
from vastflow.oracles.statistics.failure_map import FailureGrid, FailureMap, empty_map, failure_map, grid_over
from vastflow.oracles.statistics.intervals import Counts
from vastflow.sim.model.blocks import read_columns, read_rows
from vastflow.sim.model.digest import FileContent
from vastflow.sim.model.obstacle import Obstacle
from vastflow.sim.model.recording import run_of, si
from vastflow.sim.model.scenario import Scenario
from vastflow.sim.system.keys import MASK_KEYS
from vastflow.sim.system.system import system_of
from vastflow.sim.world.occupancy import OccupancyMap
from vastflow.sim.world.world import read_grid


@dataclass(frozen=True, eq=False, slots=True)
class Zones:
    """Distinct masks of the enabled filters of some scenarios."""

    keepout: tuple[OccupancyMap, ...] = field(default=(), repr=False)
    speed: tuple[OccupancyMap, ...] = field(default=(), repr=False)


NO_ZONES: Final = Zones()


def zones_of(scenarios: Iterable[Scenario]) -> Zones:
    """The masks of the enabled filters.

    Raises:
        ValueError: a filter without a mask, or a mask that cannot be read.
    """
    keepout: dict[str, FileContent] = {}
    speed: dict[str, FileContent] = {}
    for scenario in scenarios:
        if scenario.system.keys().isdisjoint(MASK_KEYS):
            continue
        masks = system_of(scenario.system, is_drawn=True).masks
        for mask, found in ((masks.keepout, keepout), (masks.speed, speed)):
            if mask is not None:
                found[mask.digest] = mask
    return Zones(*(tuple(read_grid(mask) for mask in found.values()) for found in (keepout, speed)))


_STEP_M: Final = 0.05


@dataclass(frozen=True, eq=False)
class Walks:
    """True positions of a configuration's runs.

    Attributes:
        run_index: (R,) of the runs with rows, ascending.
        starts: (R + 1,) index of each run's first row, and N.
        xy_m: (N, 2) in the map frame.
        spawned: Obstacles that the scenario spawned in any run.
    """

    run_index: NDArray[np.int64]
    starts: NDArray[np.int64]
    xy_m: NDArray[np.float64] = field(repr=False)
    spawned: tuple[Obstacle, ...] = ()

    @property
    def ends_xy_m(self) -> NDArray[np.float64]:
        return np.asarray(self.xy_m[self.starts[1:] - 1])

    def line(self, run: int) -> NDArray[np.float64]:
        """The path (M, 2) of the run at an index, a point every 5 cm and the last."""
        xy_m = self.xy_m[self.starts[run] : self.starts[run + 1]]
        along_m = np.r_[0.0, np.cumsum(np.hypot(*np.diff(xy_m, axis=0).T))]
        keep = np.r_[True, np.diff(np.floor(along_m / _STEP_M)) > 0]
        keep[-1] = True
        return np.asarray(xy_m[keep])


def read_walks(directory: Path, configuration: str) -> Walks | None:
    """The walks of a configuration of the campaign directory `directory`; None without a robot, or where nothing was recorded."""
    file = directory / "recordings" / f"{configuration}.parquet"
    if not file.is_file():  # every run of it was broken
        return None
    try:
        index, columns = read_columns(file, ("x_mm", "y_mm"))
    except KeyError:  # programs alone
        return None
    if not len(index):
        return None
    starts = np.r_[0, np.flatnonzero(np.diff(index)) + 1, len(index)]
    xy_m = np.column_stack((si(columns["x_mm"]), si(columns["y_mm"])))
    spawned = tuple(obstacle for row in read_rows(file) if row["entities"] for obstacle in spawned_by(run_of(row)))
    return Walks(index[starts[:-1]].astype(np.int64), starts, xy_m, spawned)


def read_estimate(directory: Path, configuration: str, run_index: int) -> NDArray[np.float64]:
    """Estimated positions (N, 2) of a recorded run, in the map frame."""
    file = directory / "recordings" / f"{configuration}.parquet"
    index, columns = read_columns(file, ("estimated_x_mm", "estimated_y_mm"))
    return np.column_stack([si(column[index == run_index]) for column in columns.values()])


def read_mover_paths(
    directory: Path, configuration: str, run_index: int, movers: Iterable[str]
) -> list[NDArray[np.float64]]:
    """Positions (N, 2) of each mover in a recorded run, in the map frame; none where they were not recorded."""
    names = [f"mover_{axis}_mm/{mover}" for mover in movers for axis in "xy"]
    try:
        index, columns = read_columns(directory / "recordings" / f"{configuration}.parquet", names)
    except KeyError:  # of a real robot
        return []
    along = [si(columns[name][index == run_index]) for name in names]
    return [np.column_stack(pair) for pair in zip(along[::2], along[1::2], strict=True)]


MAX_LINES: Final = 1000
"""Trajectories drawn per judgment and environment, as in the paper."""
MAX_SCENES: Final = 12
"""Most environments drawn; those with most failures."""
CELL_M: Final = 0.25
_POSITIONS: Final = 300_000


@dataclass(frozen=True, eq=False)
class Scene:
    """One environment and everything that happened in it.

    Attributes:
        environment: Digest of the map.
        lines: At most `MAX_LINES` true trajectories (N, 2) of each judgment, evenly chosen.
        starts_xy_m, goals_xy_m, obstacles: Distinct ones of all configurations, spawned obstacles included.
        failed_xy_m: (F, 2) final positions of recorded failed runs.
        missed: (F,) whether the mission failed, and not only another oracle.
        failures: Failed runs over visits in cells of `CELL_M`.
    """

    environment: str
    occupancy: OccupancyMap
    runs: Counts
    lines: Mapping[int, Sequence[NDArray[np.float64]]] = field(repr=False)
    starts_xy_m: NDArray[np.float64]
    goals_xy_m: NDArray[np.float64]
    obstacles: Sequence[Obstacle] = field(repr=False)
    failed_xy_m: NDArray[np.float64] = field(repr=False)
    missed: NDArray[np.bool_] = field(repr=False)
    failures: FailureMap = field(repr=False)
    zones: Zones = NO_ZONES


def environment_counts(tables: Tables) -> dict[str, Counts]:
    """The runs in each environment, in the order of the configurations."""
    found = tables.configurations
    counts = tables.verdicts.counts(None)
    sums: dict[str, NDArray[np.int64]] = {}
    for k in found.distinct:
        if environment := found.environments[k]:
            sums[environment] = sums.get(environment, 0) + counts[k]
    return {environment: Counts(*map(int, total)) for environment, total in sums.items()}


def scenes_of(tables: Tables) -> list[Scene]:
    """The scene of each environment that was run in, in the order of the configurations, at most `MAX_SCENES`."""
    counts = environment_counts(tables)
    drawn = {*sorted(counts, key=lambda environment: -counts[environment].failed)[:MAX_SCENES]}
    files = KeptFiles(tables.directory)
    return [_scene(tables, environment, runs, files) for environment, runs in counts.items() if environment in drawn]


def known_extent_m(occupancy: OccupancyMap, margin_m: float) -> tuple[float, float, float, float]:
    """x0, x1, y0, y1 of the known part of the map, with a margin."""
    rows, columns = known_cells(occupancy)
    ends = [(r, c) for r in (rows.start, rows.stop) for c in (columns.start, columns.stop)]
    corners = occupancy.corners_of(np.array(ends))
    (x0, y0), (x1, y1) = corners.min(axis=0).tolist(), corners.max(axis=0).tolist()
    return x0 - margin_m, x1 + margin_m, y0 - margin_m, y1 + margin_m


def known_cells(occupancy: OccupancyMap) -> tuple[slice, slice]:
    """Rows and columns of the known part of the map; all if it is empty."""
    known = occupancy.cells >= 0
    found = [np.flatnonzero(known.any(axis=axis)) for axis in (1, 0)]
    ends = [(at[0], at[-1] + 1) if at.size else (0, n) for at, n in zip(found, known.shape, strict=True)]
    rows, columns = (slice(int(first), int(stop)) for first, stop in ends)
    return rows, columns


def _scene(tables: Tables, environment: str, runs: Counts, files: KeptFiles) -> Scene:
    found, verdicts = tables.configurations, tables.verdicts
    indices = np.array([k for k in found.distinct if found.environments[k] == environment], dtype=np.int64)
    scenarios = [scenario_of_row(found.row(int(k)), files) for k in indices]
    situations = []
    for scenario in scenarios:
        with suppress(ValueError):  # one that could not run
            situations.append(situation_of(scenario))
    occupancy = kept_map(tables.directory, environment)
    x0, x1, y0, y1 = known_extent_m(occupancy, CELL_M)
    failures = empty_map(grid_over(x0, y0, x1, y1, CELL_M))
    waiting: list[tuple[Walks, NDArray[np.int8]]] = []
    lines: dict[int, list[NDArray[np.float64]]] = {code: [] for code in CODES.values()}
    spawned: list[Obstacle] = []
    failed_xy_m, missed = [np.zeros((0, 2))], [np.zeros(0, dtype=np.bool_)]
    chosen = _chosen(tables, indices)
    for k in indices:
        walks = read_walks(tables.directory, found.names[k])
        if walks is None:
            continue
        own = verdicts.rows_of(k)
        rows = own.start + np.searchsorted(verdicts.run_index[own], walks.run_index)
        judged = verdicts.together[rows]
        failed = rows[judged == FAIL]
        failed_xy_m.append(walks.ends_xy_m[judged == FAIL])
        missed.append(verdicts.of(SUCCESS)[failed] == FAIL if SUCCESS in tables.oracles else failed < 0)
        for run in np.flatnonzero(chosen[rows]):
            lines[int(judged[run])].append(walks.line(int(run)))
        spawned += walks.spawned
        waiting.append((walks, judged))
        if sum(len(walks.xy_m) for walks, _ in waiting) > _POSITIONS:
            failures, waiting = failures + _visited(failures.grid, waiting), []
    return Scene(
        environment,
        occupancy,
        runs,
        lines,
        _distinct([(s.start.x_m, s.start.y_m) for s in situations if s.start is not None]),
        _distinct([(goal.x_m, goal.y_m) for s in situations for goal in s.goals]),
        distinct_obstacles([*(o for s in situations for o in s.obstacles), *spawned]),
        np.concatenate(failed_xy_m),
        np.concatenate(missed),
        failures + _visited(failures.grid, waiting),
        zones_of(scenarios),
    )


def _visited(grid: FailureGrid, configurations: Sequence[tuple[Walks, NDArray[np.int8]]]) -> FailureMap:
    if not configurations:
        return empty_map(grid)
    xy_m = np.concatenate([walks.xy_m for walks, _ in configurations])
    lengths = np.concatenate([np.diff(walks.starts) for walks, _ in configurations])
    judged = np.concatenate([said for _, said in configurations])
    of = np.repeat(np.arange(len(configurations)), [len(said) for _, said in configurations])
    known = judged != NOT_JUDGED
    starts = np.r_[0, np.cumsum(lengths[known])]
    return failure_map(grid, xy_m[np.repeat(known, lengths)], starts, judged[known] == FAIL, of[known])


def _chosen(tables: Tables, indices: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Whether each run (R,) is drawn, evenly spread over configurations."""
    verdicts = tables.verdicts
    here = np.isin(verdicts.configuration, indices)
    chosen = np.zeros(len(verdicts), dtype=np.bool_)
    for code in CODES.values():
        alike = np.flatnonzero(here & (verdicts.together == code))
        chosen[alike[np.unique(np.linspace(0, len(alike) - 1, min(len(alike), MAX_LINES)).astype(np.int64))]] = True
    return chosen


def _distinct(points: list[tuple[float, float]]) -> NDArray[np.float64]:
    return np.array(list(dict.fromkeys(points)), dtype=np.float64).reshape(-1, 2)


def distinct_obstacles(obstacles: Sequence[Obstacle]) -> list[Obstacle]:
    """`obstacles` without repetitions of pose and shape."""
    return list({(o.pose, o.shape): o for o in obstacles}.values())
