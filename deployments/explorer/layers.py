"""Layers of a run: what only its execution knows, at ten moments a second or fewer."""

import gzip
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vastflow.deployments.explorer.packed import packed
from vastflow.flows.results.trust import permitted_contents
from vastflow.oracles.replay.bands import bands
from vastflow.oracles.replay.recorded import RecordedRun, needs_code, recorded_run
from vastflow.oracles.results.unusable import UnusableDirectory, reading
from vastflow.sim.model.pose import Pose
from vastflow.sim.model.rates import TICK_S
from vastflow.sim.model.recording import Recording
from vastflow.sim.plug_ins.loading import code_from
from vastflow.sim.reading.checked import checked_of
from vastflow.sim.replay import Box, Moment, Patch, State, first_difference, moment_of, snapshot_of
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


def compressed_layers(directory: Path, configuration: str, run_index: int, consent: str | None = None) -> bytes:
    """Return the packed layers of a recorded run, compressed by gzip.

    Args:
        consent: See `permitted_contents`.

    Raises:
        UnusableDirectory: the run can't be executed again, or only with its programs.
        NotPermitted: it executes code that the user neither made nor permitted.
    """
    with _executable(directory, configuration, run_index, consent) as recorded:
        return gzip.compress(layers_of(recorded), 1)


def bag_file(directory: Path, configuration: str, run_index: int, consent: str | None = None) -> bytes:
    """Return a recorded run as an MCAP file of ROS 2 messages; arguments and errors as `compressed_layers`.

    Raises:
        UserError: the extra `ros` is not installed.
    """
    from vastflow.flows.export.mcap.bag import NAME
    from vastflow.flows.export.mcap.mcap import bag_of

    with _executable(directory, configuration, run_index, consent) as recorded:
        if not recorded.recording.columns:
            raise UnusableDirectory("The scenario has no robot, so there is nothing to show in Foxglove.")
        return bag_of(recorded)[f"{NAME}.mcap"]


@contextmanager
def _executable(directory: Path, configuration: str, run_index: int, consent: str | None) -> Iterator[RecordedRun]:
    """Yield a recorded run that the body may execute."""
    with reading(directory.name), code_from(()):
        recorded = recorded_run(directory, configuration, run_index)
    contents = permitted_contents(directory, consent or None) if needs_code(recorded) else ()
    with reading(directory.name), code_from(contents):
        yield recorded


def layers_of(recorded: RecordedRun) -> bytes:
    """Execute a recorded run once more, and return its packed layers.

    Raises:
        UnusableDirectory: the run can't be executed again, or only with its programs.
    """
    if not recorded.recording.columns:
        raise UnusableDirectory("The scenario has no robot, so there are no layers.")
    try:
        checked = checked_of(recorded.scenario)
        if checked.programs is not None and checked.programs.nodes is not None:
            raise UnusableDirectory(
                "Nodes of ROS 2 drove the run, so that its scans and costmaps can't be computed again."
            )
        if checked.programs or checked.actions & PROCESSES.keys():
            raise UnusableDirectory("The run's programs would be started again. Use `vastflow replay` for this.")
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

    why = origin_differences(
        recorded.metadata, numeric_class(), installed_tree().digest(*EXECUTE_SOURCE), recorded.scenario.system
    )
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
        self._points = {name: Parts(np.empty((0, 2))) for name in ("plan", "scan", "horizon", "particles")}
        self._costs = {name: Parts(np.empty(0, dtype=np.uint8)) for name in ("global", "local")}
        self._places: dict[str, list[tuple[float, ...]]] = {name: [] for name in self._costs}

    def __call__(self, stack: State, tick: int) -> None:
        """Look at the stack after a tick."""
        moment = moment_of(stack, tick)
        self._moments.append(moment)
        if tick % self.every:
            return
        snapshot = snapshot_of(stack, moment, _around(moment.true), overview=False)
        points = snapshot.plan_xy_m, snapshot.scan_xy_m, snapshot.intended_xy_m, snapshot.particles[:, :2]
        for parts, xy_m in zip(self._points.values(), points, strict=True):
            parts.add(xy_m)
        for name, patch in (("global", snapshot.global_costs), ("local", snapshot.local_costs)):
            if patch is None:
                patch = Patch(np.empty((0, 0), dtype=np.uint8), Pose(0.0, 0.0), 0.0)
            self._costs[name].add(patch.costs.ravel(), *patch.costs.shape)
            corner = patch.corner
            self._places[name].append((corner.x_m, corner.y_m, corner.yaw_rad, patch.resolution_m))

    def layers(self, sentence: str) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """Return header and arrays of a reply.

        A span is the first point of a moment, and their end; or the first cell, and the rows and columns. A place is the pose of the
        lower left corner of cells, and their size. Points are in millimeters.
        """
        every_s = self.every * TICK_S
        arrays = {f"{name} spans": each.spans for name, each in {**self._points, **self._costs}.items()}
        for name, each in self._points.items():
            arrays[f"{name} points"] = np.rint(1000.0 * each.whole).astype(np.int32)
        for name, each in self._costs.items():
            arrays[f"{name} cells"] = each.whole
            arrays[f"{name} places"] = np.array(self._places[name], dtype=np.float32)
        header = {
            "sentence": sentence,
            "note": f"The layers have a moment every {every_s:g} s, and the global costmap {2 * REACH_M:g} m round the robot.",
            "every_s": every_s,
            "activities": [(a * TICK_S, (z + 1) * TICK_S, kind) for a, z, kind in bands(self._moments)],
        }
        return header, arrays


def _around(pose: Pose) -> Box:
    x, y = (STEP_M * round(at / STEP_M) for at in (pose.x_m, pose.y_m))
    return Box(x - REACH_M, y - REACH_M, x + REACH_M, y + REACH_M)


class Parts:
    """Parts of an array over moments; one that is the end of the one before is not stored again."""

    def __init__(self, empty: NDArray[Any]) -> None:
        self._parts = [empty]
        self._spans: list[tuple[int, ...]] = []
        self._n = 0

    def add(self, part: NDArray[Any], *shape: int) -> None:
        """Add the part of the next moment; its span is its first row, and its shape or its end."""
        last, n = self._parts[-1], len(part)
        if n == 0 or n > len(last) or not np.array_equal(last[len(last) - n :], part):
            self._parts.append(part)
            self._n += n
        self._spans.append((self._n - n, *(shape or (self._n,))))

    @property
    def whole(self) -> NDArray[Any]:
        """All parts one after another."""
        return np.concatenate(self._parts)

    @property
    def spans(self) -> NDArray[Any]:
        """The span of each moment's part (M, …)."""
        return np.array(self._spans, dtype=np.uint32)
