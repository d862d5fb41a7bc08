"""Layers of a run: what only its execution knows, at ten moments a second or fewer."""

import gzip
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vastflow.deployments.explorer.packed import packed
from vastflow.oracles.replay.bands import bands
from vastflow.oracles.replay.recorded import RecordedRun, recorded_run
from vastflow.oracles.results.unusable import UnusableDirectory, reading
from vastflow.sim.model.pose import Pose
from vastflow.sim.model.rates import TICK_S
from vastflow.sim.model.recording import Recording
from vastflow.sim.nav2.navigator.state import Stack
from vastflow.sim.reading.checked import checked_of
from vastflow.sim.replay import Box, Moment, Patch, first_difference, moment_of, snapshot_of
from vastflow.sim.run import run
from vastflow.sim.scenario.programs.actions import PROCESSES

EVERY_TICKS: Final = 2
"""Ticks between two moments: 10 Hz, the lidar's rate."""
MOST_MOMENTS: Final = 3000
"""Moments of a run; one of more than five minutes has fewer a second."""
REACH_M: Final = 5.0
"""Half the edge of the part of the global costmap that is shown around the robot."""
STEP_M: Final = 2.0
"""Steps in which this part follows the robot, so that successive moments share it."""
LARGEST: Final = 32767
"""Of a coordinate in units."""


def compressed_layers(directory: Path, configuration: str, run_index: int) -> bytes:
    """Return the packed layers of a recorded run, compressed by gzip.

    Raises:
        UnusableDirectory: the run can't be executed again, or only with its programs.
    """
    with reading(directory.name):
        return gzip.compress(layers_of(recorded_run(directory, configuration, run_index)), 1)


def layers_of(recorded: RecordedRun) -> bytes:
    """Execute a recorded run once more, and return its packed layers.

    Raises:
        UnusableDirectory: the run can't be executed again, or only with its programs.
    """
    if not recorded.recording.columns:
        raise UnusableDirectory("The scenario has no robot, so there are no layers.")
    try:
        checked = checked_of(recorded.scenario)
        if checked.programs or checked.actions & PROCESSES.keys():
            raise UnusableDirectory(
                "The run's programs would be started again; `vastflow replay` does this when asked to."
            )
        watched = Watched(round(recorded.scenario.timeout_s / TICK_S), recorded.recording.run.simulated_s)
        arguments = recorded.scenario, recorded.recording.run.run_index, recorded.seed
        executed = run(*arguments, watch=watched, watch_ticks=range(watched.ticks))
    except UnusableDirectory:
        raise
    except ValueError as error:  # a scenario of another version
        raise UnusableDirectory(f"This version of vastflow can't execute the run: {error}") from None
    return packed(*watched.layers(_sentence(recorded, executed)))


def _sentence(recorded: RecordedRun, executed: Recording) -> str:
    """Return how the executed run differs from the recorded one; empty where it does not."""
    if (difference := first_difference(recorded.recording, executed)) is None:
        return ""
    from vastflow.flows.results.provenance import origin_differences  # rarely needed, and imported in half a second
    from vastflow.tasks.keys.keys import EXECUTE_SOURCE, numeric_class
    from vastflow.tasks.keys.source import installed_tree

    why = origin_differences(recorded.metadata, numeric_class(), installed_tree().digest(*EXECUTE_SOURCE))
    because = f" ({'; '.join(why)})" if why else ""
    return f"The layers are not those of the recorded run, which the execution differs from: {difference}{because}."


class Watched:
    """The watch of an execution: it copies what the layers show.

    Args:
        ticks: Most ticks of the run.
        expected_s: Simulated time that the run will probably take.
    """

    def __init__(self, ticks: int, expected_s: float) -> None:
        self.ticks = ticks
        self.every = max(EVERY_TICKS, -(-round(expected_s / TICK_S) // MOST_MOMENTS))
        self._moments: list[Moment] = []
        self._plans, self._scans = Points(), Points()
        self._horizons, self._particles = Points(), Points()
        self._global, self._local = Costs(), Costs()

    def __call__(self, stack: Stack, tick: int) -> None:
        """Look at the stack after a tick."""
        moment = moment_of(stack, tick)
        self._moments.append(moment)
        if tick % self.every:
            return
        snapshot = snapshot_of(stack, moment, _around(moment.true), overview=False)
        self._plans.add(snapshot.plan_xy_m)
        self._scans.add(snapshot.scan_xy_m)
        self._horizons.add(snapshot.intended_xy_m)
        self._particles.add(snapshot.particles[:, :2])
        self._global.add(snapshot.global_costs)
        self._local.add(snapshot.local_costs)

    def layers(self, sentence: str) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """Return header and arrays of a reply."""
        every_s = self.every * TICK_S
        points = {"plan": self._plans, "scan": self._scans, "horizon": self._horizons, "particles": self._particles}
        costs = {"global": self._global, "local": self._local}
        placed = {name: each.packed() for name, each in points.items()}
        header = {
            "sentence": sentence,
            "note": f"The layers have a moment every {every_s:g} s, and the global costmap {2 * REACH_M:g} m round the robot.",
            "every_s": every_s,
            "activities": [(a * TICK_S, (z + 1) * TICK_S, kind) for a, z, kind in bands(self._moments)],
            "units": {name: unit for name, (unit, _, _) in placed.items()},
        }
        arrays: dict[str, NDArray[Any]] = {}
        for name, (_, xy, spans) in placed.items():
            arrays |= {f"{name} points": xy, f"{name} spans": spans}
        for name, each in costs.items():
            arrays |= {f"{name} cells": each.cells, f"{name} spans": each.spans, f"{name} places": each.places}
        return header, arrays


def _around(pose: Pose) -> Box:
    x, y = (STEP_M * round(at / STEP_M) for at in (pose.x_m, pose.y_m))
    return Box(x - REACH_M, y - REACH_M, x + REACH_M, y + REACH_M)


class Unit(NamedTuple):
    """Points are at `x_m + size_m * i`, likewise for y, for whole numbers i."""

    x_m: float
    y_m: float
    size_m: float


class Points:
    """Sets of points over moments; one that is the end of the set before is not stored again."""

    def __init__(self) -> None:
        self._parts: list[NDArray[np.float64]] = []
        self._spans: list[tuple[int, int]] = []
        self._n = 0

    def add(self, xy_m: NDArray[np.float64]) -> None:
        """Add the set (N, 2) of the next moment."""
        last, n = self._parts[-1] if self._parts else xy_m[:0], len(xy_m)
        if n == 0 or n > len(last) or not np.array_equal(last[len(last) - n :], xy_m):
            self._parts.append(xy_m)
            self._n += n
        self._spans.append((self._n - n, self._n))

    def packed(self) -> tuple[Unit, NDArray[np.int16], NDArray[np.uint32]]:
        """Return all points (N, 2) in units, and the spans (M, 2) of moments.

        A unit is a millimeter, or more where points are farther apart. A span is the first of a moment's points, and their end.
        """
        xy_m = np.concatenate([np.empty((0, 2)), *self._parts])
        low, high = (xy_m.min(axis=0), xy_m.max(axis=0)) if len(xy_m) else (np.zeros(2), np.zeros(2))
        middle, size_m = (low + high) / 2, max(0.001, float((high - low).max()) / 2 / LARGEST)
        units = np.rint((xy_m - middle) / size_m).astype(np.int16)
        x_m, y_m = middle.tolist()
        return Unit(x_m, y_m, size_m), units, np.array(self._spans, dtype=np.uint32).reshape(-1, 2)


class Costs:
    """Parts of a costmap over moments; one that equals the one before is not stored again."""

    def __init__(self) -> None:
        self._parts: list[NDArray[np.uint8]] = []
        self._spans: list[tuple[int, int, int]] = []
        self._places: list[tuple[float, float, float, float]] = []
        self._n = 0

    def add(self, patch: Patch | None) -> None:
        """Add the part of the next moment; None is an empty one."""
        costs = np.empty((0, 0), dtype=np.uint8) if patch is None else patch.costs
        corner, resolution_m = (Pose(0.0, 0.0), 0.0) if patch is None else (patch.corner, patch.resolution_m)
        if not (self._parts and np.array_equal(self._parts[-1], costs)):
            self._parts.append(costs)
            self._n += costs.size
        self._spans.append((self._n - costs.size, *costs.shape))
        self._places.append((corner.x_m, corner.y_m, corner.yaw_rad, resolution_m))

    @property
    def cells(self) -> NDArray[np.uint8]:
        """All costs (N,), row by row."""
        return np.concatenate([np.empty(0, dtype=np.uint8), *(part.ravel() for part in self._parts)])

    @property
    def spans(self) -> NDArray[np.uint32]:
        """First cell, rows, and columns (M, 3) of each moment's part."""
        return np.array(self._spans, dtype=np.uint32).reshape(-1, 3)

    @property
    def places(self) -> NDArray[np.float32]:
        """Pose x, y, yaw of the lower left corner, and resolution (M, 4)."""
        return np.array(self._places, dtype=np.float32).reshape(-1, 4)
