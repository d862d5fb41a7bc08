"""Recorded paths of a campaign, read in the background, and what selected runs show on a map."""

import io
import os
import threading
import time
from base64 import b64encode
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vastflow.oracles.query.facets import run_arrays
from vastflow.oracles.query.selection import Bools, RunTable
from vastflow.oracles.results.executed import kept_map
from vastflow.oracles.results.tables import FAIL, NOT_JUDGED
from vastflow.oracles.results.unusable import DAMAGE
from vastflow.oracles.statistics.failure_map import LAST_M, MINIMUM_VISITS, FailureGrid, grid_over
from vastflow.sim.model.blocks import read_columns
from vastflow.sim.model.files import is_file, is_inside
from vastflow.sim.model.recording import si
from vastflow.sim.world.occupancy import OccupancyMap

LAYERS: Final = ("paths", "ends", "rate")

STEP_M: Final = 0.25
"""Distance between the points of a path that are kept."""
MOST_PATHS: Final = 2000
MOST_ENDS: Final = 4000
CELL_M: Final = 0.25


@dataclass(frozen=True, eq=False)
class Paths:
    """Paths of recorded runs, one after another.

    Attributes:
        row: (K,) index of the run in the table.
        starts: (K + 1,) index of each run's first point, and N.
        xy_m: (N, 2) float32, a point every `STEP_M` and the last.
        cell_starts: (K + 1,) index of each run's first cell, and M.
        cells: (M,) each cell of the grid that a run visits, once.
        ended: (M,) whether the cell is on the last half meter of the path.
    """

    row: NDArray[np.int64] = field(repr=False)
    starts: NDArray[np.int64] = field(repr=False)
    xy_m: NDArray[np.float32] = field(repr=False)
    cell_starts: NDArray[np.int64] = field(repr=False)
    cells: NDArray[np.integer[Any]] = field(repr=False)
    ended: Bools = field(repr=False)


def paths_of(row: NDArray[np.int64], starts: NDArray[np.int64], xy_m: NDArray[np.float64], grid: FailureGrid) -> Paths:
    """Thin the paths of runs, none of which is empty.

    Args:
        row: (K,) index of each run in the table.
        starts: (K + 1,) index of each run's first position, and P.
        xy_m: (P, 2) recorded positions.
    """
    lengths = np.diff(starts)
    run = np.repeat(np.arange(len(row)), lengths)
    steps_m = np.zeros(len(xy_m))
    steps_m[1:] = np.hypot(*np.diff(xy_m, axis=0).T)
    steps_m[starts[:-1]] = 0.0
    along_m = np.cumsum(steps_m)
    along_m -= along_m[starts[:-1]][run]
    keep = np.ones(len(xy_m), dtype=np.bool_)
    keep[1:] = np.diff(np.floor(along_m / STEP_M)) != 0
    keep[starts[:-1]] = keep[starts[1:] - 1] = True
    cell, cells = grid.cells(xy_m), grid.shape[0] * grid.shape[1]
    key, inside = run * cells + cell, cell >= 0
    visited = np.unique(key[inside])
    last = np.unique(key[inside & (along_m[starts[1:] - 1][run] - along_m <= LAST_M)])
    return Paths(
        row,
        np.r_[0, np.cumsum(np.bincount(run[keep], minlength=len(row)))],
        xy_m[keep].astype(np.float32),
        np.r_[0, np.cumsum(np.bincount(visited // cells, minlength=len(row)))],
        (visited % cells).astype(np.min_scalar_type(cells)),
        np.isin(visited, last),
    )


def join_paths(parts: Sequence[Paths]) -> Paths:
    """Return the paths of several configurations as one."""

    def stacked(name: str) -> NDArray[Any]:
        each = [getattr(part, name) for part in parts]
        if not name.endswith("starts"):
            return np.concatenate(each)
        return np.asarray(np.r_[0, np.cumsum(np.concatenate([np.diff(starts) for starts in each]))])

    return Paths(*(stacked(each.name) for each in fields(Paths)))


@dataclass(frozen=True, eq=False)
class Floor:
    """A map, its known part, and the grid over it.

    Attributes:
        known: Rows and columns of the known part.
    """

    occupancy: OccupancyMap
    known: tuple[slice, slice]
    grid: FailureGrid

    @cached_property
    def json(self) -> Mapping[str, Any]:
        """The picture and where it lies: its lowest corner before it is turned about the map's origin, and its size."""
        from PIL import Image

        (rows, columns), cell_m = self.known, self.occupancy.resolution_m
        x_m, y_m = self.occupancy.origin_xy_m
        # Walls are gray, unknown cells faint, and free ones clear, for any background.
        cells, out = self.occupancy.cells[self.known][::-1], io.BytesIO()
        opacity = np.select([cells == 0, cells < 0], [0, 40], 210).astype(np.uint8)
        Image.fromarray(np.dstack([np.full_like(opacity, 128), opacity]), "LA").save(out, "PNG", compress_level=1)
        return {
            "x": x_m + columns.start * cell_m,
            "y": y_m + rows.start * cell_m,
            "width": (columns.stop - columns.start) * cell_m,
            "height": (rows.stop - rows.start) * cell_m,
            "origin": [x_m, y_m],
            "yaw": self.occupancy.yaw_rad,
            "extent": list(self.grid.extent_m),
            "picture": f"data:image/png;base64,{b64encode(out.getvalue()).decode()}",
        }


def floor_of(directory: Path, environment: str) -> Floor:
    """Read the map of an environment.

    Raises:
        ValueError: the map is missing or damaged.
    """
    from vastflow.oracles.query.scene import known_cells, known_extent_m

    if Path(environment).name != environment:
        raise ValueError(f"expected the digest of a map, got {environment!r}")
    occupancy = kept_map(directory, environment)
    x0, x1, y0, y1 = known_extent_m(occupancy, CELL_M)
    return Floor(occupancy, known_cells(occupancy), grid_over(x0, y0, x1, y1, CELL_M))


def stored_file(directory: Path, folder: str, configuration: str) -> Path | None:
    """Return a configuration's file in a folder; None without one, or where its name or a link leads out."""
    file = directory / folder / f"{configuration}.parquet"
    inside = file.parent == directory / folder and is_inside(file, os.path.realpath(directory))
    return file if inside and is_file(file) else None


def read_paths(directory: Path, table: RunTable, configuration: int, grid: FailureGrid) -> Paths | None:
    """Read the paths of a configuration; None where nothing was recorded.

    Raises:
        OSError, ValueError: a damaged recording.
    """
    file = stored_file(directory, "recordings", table.configurations[configuration])
    if file is None:
        return None
    index, columns = read_columns(file, ("x_mm", "y_mm"))
    rows = table.rows_of(configuration)
    own = table.run_index[rows.start : rows.stop]
    keep = np.isin(index, own)  # a run that was recorded and is not in the table is of no use here
    index = index[keep]
    if not len(index):
        return None
    starts = np.r_[0, np.flatnonzero(np.diff(index)) + 1, len(index)]
    xy_m = np.column_stack([si(columns[name][keep]) for name in ("x_mm", "y_mm")])
    return paths_of(rows.start + np.searchsorted(own, index[starts[:-1]]), starts, xy_m, grid)


class Reading(threading.Thread):
    """The paths of an environment, read in the background.

    Attributes:
        configurations: Configurations of the environment, shuffled, so that a part of them shows the whole.
        paths: Paths read so far; None before the first ones.
        problem: Why nothing can be read; empty where it can.
        done, damaged: Numbers of configurations.
    """

    def __init__(self, directory: Path, table: RunTable, environment: str, configurations: NDArray[np.int64]) -> None:
        super().__init__(daemon=True)
        self.configurations: list[int] = np.random.default_rng(0).permutation(configurations).tolist()
        self.floor: Floor | None = None
        self.paths: Paths | None = None
        self.problem, self.done, self.damaged = "", 0, 0
        self._directory, self._table, self._environment = directory, table, environment

    def run(self) -> None:
        """Read the map, and then recording after recording."""
        try:
            self.floor = floor_of(self._directory, self._environment)
        except DAMAGE as error:
            self.problem = " ".join(str(error).split()) or type(error).__name__
            return
        parts: list[Paths] = []
        shown_s = time.monotonic()
        for done, k in enumerate(self.configurations, start=1):
            try:
                found = read_paths(self._directory, self._table, k, self.floor.grid)
                parts += [] if found is None else [found]
            except DAMAGE:
                self.damaged += 1
            if parts and (time.monotonic() > shown_s + _SHOWN_S or done == len(self.configurations)):
                self.paths = join_paths([*([self.paths] if self.paths else []), *parts])
                parts, shown_s = [], time.monotonic()
            self.done = done  # after its paths are there


_SHOWN_S: Final = 0.2
"""Time between two moments at which what was read is shown."""


def layer(
    paths: Paths, table: RunTable, mask: Bools, grid: FailureGrid, shown: str
) -> tuple[Mapping[str, Any], Mapping[str, NDArray[Any]]]:
    """Return a layer of the map: a description and arrays.

    `paths` of few runs are lines: `xy` (N, 2) and `starts` (K + 1,). `ends` of few runs are points: `xy` (K, 2). Both have `configuration`,
    `run`, and `verdict` (K,). Else it is a grid: `runs` and `failed` runs in each cell, row by row. In a grid of `rate` a run failed where
    its path ends.
    """
    chosen = np.flatnonzero(mask[paths.row])
    total = len(chosen)
    cells = {"origin": list(grid.origin_xy_m), "cell": grid.cell_m, "rows": grid.shape[0], "columns": grid.shape[1]}
    header = {"layer": shown, "runs": total, "minimum": MINIMUM_VISITS, "grid": cells}
    if shown == "rate" or total > (MOST_PATHS if shown == "paths" else MOST_ENDS):
        return {**header, "form": "grid"}, _grid(paths, table, mask, grid, shown)
    names, own = run_arrays(table, paths.row[chosen])
    told = {**header, "form": "runs", "configurations": names}
    if shown == "ends":
        return told, {"xy": paths.xy_m[paths.starts[chosen + 1] - 1], **own}
    lengths = np.diff(paths.starts)[chosen]
    starts = np.r_[0, np.cumsum(lengths)]
    at = np.repeat(paths.starts[chosen] - starts[:-1], lengths) + np.arange(starts[-1])
    return told, {"xy": paths.xy_m[at], "starts": starts.astype(np.int32), **own}


def _grid(paths: Paths, table: RunTable, mask: Bools, grid: FailureGrid, shown: str) -> dict[str, NDArray[Any]]:
    verdict, chosen = table.verdict[paths.row], mask[paths.row]
    if shown == "rate":
        chosen = chosen & (verdict != NOT_JUDGED)
    failed, cells = chosen & (verdict == FAIL), grid.shape[0] * grid.shape[1]
    if shown == "ends":
        at = grid.cells(paths.xy_m[paths.starts[1:] - 1].astype(np.float64))
        here = [at[some & (at >= 0)] for some in (chosen, failed)]
    else:
        lengths = np.diff(paths.cell_starts)
        lost = np.repeat(failed, lengths)
        here = [paths.cells[np.repeat(chosen, lengths)], paths.cells[lost & paths.ended if shown == "rate" else lost]]
    came, fell = (np.bincount(each, minlength=cells).astype(np.uint32) for each in here)
    return {"runs": came, "failed": fell}
