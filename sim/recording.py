"""Recordings: what happened in a run, raw and deterministic."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from functools import cached_property
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from vastflow.sim.digest import digest

Outcome: TypeAlias = Literal["succeeded", "aborted", "timed_out"]


@dataclass(frozen=True, slots=True)
class Event:
    """Something that happened at a moment: a contact, a recovery, a goal reached or missed.

    Attributes:
        kind: `contact`, `recovery`, `goal_reached`, `goal_missed`, `plan_failed`, `control_failed`, `stopped_by_monitor`;
            of an obstacle `spawned`, and `obstacle_moved` at each row at which it stands elsewhere than before.
        x_m, y_m: True position of the robot's centre; of the obstacle's where the event is one of an obstacle.
        what: The partner of a contact, the recovery's name, the number of a goal, the code of a failure, the obstacle.
        value: Closing speed of a contact (m/s), yaw of an obstacle (rad); 0 where there is nothing to measure.
    """

    t_s: float
    kind: str
    x_m: float
    y_m: float
    what: str
    value: float = 0.0


@dataclass(frozen=True, slots=True)
class Run:
    """One row per run: how the mission ended. Nothing of the host is in it.

    Attributes:
        seed: Entropy of the run in hexadecimal, see `vastflow.sim.streams.run_entropy`.
        outcome: How the mission ended; a contact does not end it.
        error_code: Nav2's code of the last failure, 0 for a success.
        reason: In words, with the contacts there were; empty for a success without any.
        simulated_s: Simulated time from the start of the run to the mission's end.
        distance_m: True way driven.
        missed_goals: Goals of a waypoint mission that were given up.
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


@dataclass(frozen=True)
class Recording:
    """What happened in one run.

    Attributes:
        run: The run's row.
        columns: Name to (N,) int32, aligned over simulation time: `t_ms`, true pose `x_mm y_mm yaw_mrad`,
            the robot's own estimate `estimated_x_mm estimated_y_mm estimated_yaw_mrad`, true motion
            `speed_mmps yaw_rate_mradps`, command `command_speed_mmps command_yaw_rate_mradps`,
            `localized` (1 where AMCL published an update since the row before). Fixed point, so that
            a recording is small and the same on every host of one numeric class.
    """

    run: Run
    columns: Mapping[str, NDArray[np.int32]] = field(repr=False)

    @cached_property
    def digest(self) -> str:
        """Digest of the run's row and of every column."""
        columns = {name: column.astype("<i4").tobytes().hex() for name, column in self.columns.items()}
        return digest(run_row(self.run), columns)


def run_row(run: Run) -> dict[str, Any]:
    """`run` as plain JSON values."""
    return {**asdict(run), "events": [asdict(event) for event in run.events]}


def run_of(row: Mapping[str, Any]) -> Run:
    """The run that `run_row` wrote."""
    return Run(**{**row, "events": tuple(Event(**event) for event in row["events"])})


def si(fixed_point: NDArray[np.int32]) -> NDArray[np.float64]:
    """A column of thousandths (mm, ms, mrad and per second) in SI units."""
    return fixed_point.astype(np.float64) * 1e-3
