"""Recordings of runs, raw and deterministic; and their logs, of the host and outside every digest."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from vastflow.sim.model.digest import FileContent, Value, digest, file_digest
from vastflow.sim.model.faults import ScenarioError
from vastflow.sim.model.obstacle import Model, Obstacle
from vastflow.sim.model.pose import Pose
from vastflow.sim.model.shape import Box, Disc

Columns: TypeAlias = Mapping[str, NDArray[Any]]
"""Name to (N,) float64, int64, bool or str, all of one length."""


@dataclass(frozen=True, slots=True)
class LeftOut:
    """A file that was not recorded, with the reason in words."""

    path: str
    size_bytes: int
    why: str


@dataclass(frozen=True)
class Outputs:
    """Files that a run wrote.

    Attributes:
        tables: Path without its suffix to columns.
        files: Path to content of other files and unreadable tables.
        left_out: Files that were too large, and links that leave the folder.
        notes: Problems with tables and files, one line each.
    """

    tables: Mapping[str, Columns] = field(default_factory=dict, repr=False)
    files: Mapping[str, bytes] = field(default_factory=dict, repr=False)
    left_out: tuple[LeftOut, ...] = ()
    notes: tuple[str, ...] = ()


Outcome: TypeAlias = Literal["succeeded", "aborted", "timed_out", "failed"]
"""End of a run's scenario: passed; failed by an aborted navigation action; not ended in time; failed otherwise."""


@dataclass(frozen=True, slots=True)
class Event:
    """An event: a contact, a recovery, a goal reached or missed.

    Attributes:
        kind: `contact`, `recovery`, `goal_reached`, `goal_missed`, `plan_failed`, `control_failed`, `stopped_by_monitor`;
            `stood_still` (`vastflow.sim.loop.standstill`); of an obstacle `spawned`, `deleted`, and `obstacle_moved`.
        x_m, y_m: True position of the robot's or the obstacle's center.
        what: The partner of a contact, the recovery's name, the number of a goal, the code of a failure, the obstacle, the cause of
            a standstill.
        value: Closing speed of a contact (m/s), yaw of an obstacle (rad); otherwise 0.
    """

    t_s: float
    kind: str
    x_m: float
    y_m: float
    what: str
    value: float = 0.0


@dataclass(frozen=True, slots=True)
class Entity:
    """Shape of an obstacle that a scenario put into the world; events have its places."""

    name: str
    shape: Model
    length_m: float
    width_m: float

    def at(self, pose: Pose) -> Obstacle:
        """Return the obstacle at a pose."""
        is_disc = self.shape == "cylinder"
        return Obstacle(self.name, Disc(self.length_m / 2) if is_disc else Box(self.length_m, self.width_m), pose)


@dataclass(frozen=True, slots=True)
class Run:
    """A row per run: the end of its mission. It holds nothing of the host.

    Attributes:
        seed: Entropy of the run in hexadecimal, see `vastflow.sim.kernels.streams.run_entropy`.
        outcome: End of the scenario; a contact does not end it.
        error_code: Nav2's code of the last failure, 0 for a success.
        reason: Failure and contacts in words; empty for a success without contacts.
        simulated_s: Simulated time from the start of the run to the scenario's end.
        distance_m: Length of the true path.
        missed_goals: Skipped goals of a waypoint mission.
        entities: Obstacles that the scenario itself put into the world, in order.
        estimated_by: Where the pose is from if it is the robot's own estimate, because nothing measured the true one; else empty.
    """

    run_index: int
    seed: str
    outcome: Outcome
    error_code: int
    reason: str
    simulated_s: float
    distance_m: float
    recoveries: int
    missed_goals: int
    events: tuple[Event, ...] = ()
    entities: tuple[Entity, ...] = ()
    estimated_by: str = ""


@dataclass(frozen=True)
class Recording:
    """Recording of one run.

    Attributes:
        columns: Name to (N,) int32, aligned over simulation time: `t_ms`, true pose `x_mm y_mm yaw_mrad`,
            the robot's own estimate `estimated_x_mm estimated_y_mm estimated_yaw_mrad`, true motion
            `speed_mmps yaw_rate_mradps`, command `command_speed_mmps command_yaw_rate_mradps`,
            `localized` (1 where AMCL published an update since the previous row). Fixed point is small and equal on all
            hosts of one numeric class.
        behaviors: Status changes of the scenario's behaviors, see `vastflow.sim.scenario.tree.tree.StatusChange`.
        outputs: Files that the run's programs wrote; they need not be reproducible.
    """

    run: Run
    columns: Mapping[str, NDArray[np.int32]] = field(repr=False)
    behaviors: Columns = field(default_factory=dict, repr=False)
    outputs: Outputs = field(default_factory=Outputs, repr=False)

    @cached_property
    def digest(self) -> str:
        """Digest of the run's row, the columns and the behaviors."""
        columns = {name: column.astype("<i4").tobytes().hex() for name, column in self.columns.items()}
        behaviors = {name: column.tolist() for name, column in self.behaviors.items()}
        return digest(run_row(self.run), columns, behaviors)


def recording_value(value: Value, base: Path) -> FileContent:
    """Return the recording at a path as a configuration's value, or raise `ScenarioError`."""
    path = base / str(value)
    try:
        return FileContent(str(path), file_digest(path))
    except (OSError, ValueError) as error:
        raise ScenarioError(f"expected a recording of `vastflow import` ({error}), got {value!r}") from None


def run_row(run: Run) -> dict[str, Any]:
    """Return `run` as plain JSON values."""
    events, entities = ([asdict(each) for each in part] for part in (run.events, run.entities))
    row = {**asdict(run), "events": events, "entities": entities}
    if not run.estimated_by:  # as in rows of earlier versions
        del row["estimated_by"]
    return row


def run_of(row: Mapping[str, Any]) -> Run:
    """Read a run that `run_row` wrote."""
    events = tuple(Event(**event) for event in row["events"])
    return Run(**{**row, "events": events, "entities": tuple(Entity(**entity) for entity in row.get("entities", ()))})


def si(fixed_point: NDArray[np.int32]) -> NDArray[np.float64]:
    """Convert a column of thousandths (mm, ms, mrad and per second) to SI units."""
    return fixed_point.astype(np.float64) * 1e-3


@dataclass(frozen=True, slots=True)
class Use:
    """Resource usage of a run's processes at a moment."""

    t_s: float  # Host time since the first sample.
    cpu_s: float  # CPU time of all processes seen so far.
    rss_bytes: int  # Resident memory of live processes; shared pages count for each.
    processes: int  # Number of live processes.


@dataclass(frozen=True, slots=True)
class LogText:
    """Output of one command."""

    label: str  # Name in the scenario, or `pre_command`, `post_command`; may be empty.
    command: tuple[str, ...]
    text: str = field(repr=False)
    cut: bool  # True if there was more.


@dataclass(frozen=True, slots=True)
class RunLog:
    """Log of a run.

    Attributes:
        started_s: Start in seconds since 1970 (UTC).
        wall_s, cpu_s: Time of this process, or of the run's own processes if it had any.
        max_rss_bytes: Peak memory of the same.
        lines: Log of the scenario, each line with its simulated time.
        texts: Output of each program.
        resources: Samples of the run's processes, once a second of host time.
        notes: Outputs that were left out, and how `post_command` ended.
        health: What the host and nodes did to the time of a run that nodes drove; empty for others.
    """

    started_s: float
    wall_s: float
    cpu_s: float
    max_rss_bytes: int
    lines: tuple[str, ...] = ()
    texts: tuple[LogText, ...] = ()
    resources: tuple[Use, ...] = ()
    notes: tuple[str, ...] = ()
    health: Mapping[str, float] = field(default_factory=dict)


def run_log_row(log: RunLog) -> dict[str, Any]:
    """Return `log` as plain JSON values."""
    return asdict(log)


def run_log_of(row: Mapping[str, Any]) -> RunLog:
    """Read a log that `run_log_row` wrote; raises `KeyError` or `TypeError` for other rows."""
    texts = tuple(LogText(**{**text, "command": tuple(text["command"])}) for text in row["texts"])
    resources = tuple(Use(**use) for use in row["resources"])
    numbers = (row["started_s"], row["wall_s"], row["cpu_s"], row["max_rss_bytes"])
    return RunLog(*numbers, tuple(row["lines"]), texts, resources, tuple(row["notes"]), row.get("health", {}))
