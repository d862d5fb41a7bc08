"""Walks: the trajectories of recorded runs, read from a campaign directory a configuration at a time."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vastflow.oracles.obstacle_tracks import spawned_by
from vastflow.sim.model.blocks import read_columns, read_rows
from vastflow.sim.model.obstacle import Obstacle
from vastflow.sim.model.recording import run_of, si

_STEP_M: Final = 0.05


@dataclass(frozen=True, eq=False)
class Walks:
    """True positions of a configuration's runs.

    Attributes:
        run_index: (R,) of the runs that have at least one row, ascending.
        starts: (R + 1,) where each run's rows begin, and the end of the last.
        xy_m: (N, 2) in the map frame.
        spawned: What the scenario itself put into the world in any run, where it put it.
    """

    run_index: NDArray[np.int64]
    starts: NDArray[np.int64]
    xy_m: NDArray[np.float64] = field(repr=False)
    spawned: tuple[Obstacle, ...] = ()

    @property
    def ends_xy_m(self) -> NDArray[np.float64]:
        """(R, 2) where each run ended."""
        return np.asarray(self.xy_m[self.starts[1:] - 1])

    def line(self, run: int) -> NDArray[np.float64]:
        """The path (M, 2) of the run at an index, a point every 5 cm and the last."""
        xy_m = self.xy_m[self.starts[run] : self.starts[run + 1]]
        along_m = np.r_[0.0, np.cumsum(np.hypot(*np.diff(xy_m, axis=0).T))]
        keep = np.r_[True, np.diff(np.floor(along_m / _STEP_M)) > 0]
        keep[-1] = True
        return np.asarray(xy_m[keep])


def read_walks(directory: Path, configuration: str) -> Walks | None:
    """The walks of a configuration of the campaign directory `directory`; None where nothing was recorded."""
    file = directory / "recordings" / f"{configuration}.parquet"
    if not file.is_file():  # every run of it was broken
        return None
    index, columns = read_columns(file, ("x_mm", "y_mm"))
    if not len(index):
        return None
    starts = np.r_[0, np.flatnonzero(np.diff(index)) + 1, len(index)]
    xy_m = np.column_stack((si(columns["x_mm"]), si(columns["y_mm"])))
    spawned = tuple(obstacle for row in read_rows(file) if row["entities"] for obstacle in spawned_by(run_of(row)))
    return Walks(index[starts[:-1]].astype(np.int64), starts, xy_m, spawned)


def read_estimate(directory: Path, configuration: str, run_index: int) -> NDArray[np.float64]:
    """Where the robot took itself to be (N, 2) in a recorded run, in the map frame."""
    file = directory / "recordings" / f"{configuration}.parquet"
    index, columns = read_columns(file, ("estimated_x_mm", "estimated_y_mm"))
    return np.column_stack([si(column[index == run_index]) for column in columns.values()])
