"""Recordings: what happened in a run, raw and deterministic."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from functools import cached_property
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from vastflow.sim.model.digest import digest
from vastflow.sim.model.obstacle import Shape

Columns: TypeAlias = Mapping[str, NDArray[Any]]
"""Name to (N,) float64, int64, bool or str, all of one length."""


@dataclass(frozen=True, slots=True)
class LeftOut:
    """A file that is named only.

    Attributes:
        why: In words.
    """

    path: str
    size_bytes: int
    why: str


@dataclass(frozen=True)
class Outputs:
    """What a run wrote.

    Attributes:
        tables: Name, which is the path without its suffix, to columns.
        files: Path to content of what is no table, or could not be read as one.
        left_out: What was too large, or a link that leaves the folder.
        notes: What was wrong with a table or a file, one line each.
    """

    tables: Mapping[str, Columns] = field(default_factory=dict, repr=False)
    files: Mapping[str, bytes] = field(default_factory=dict, repr=False)
    left_out: tuple[LeftOut, ...] = ()
    notes: tuple[str, ...] = ()


Outcome: TypeAlias = Literal["succeeded", "aborted", "timed_out", "failed"]
"""How a run's scenario ended: passed; failed by a navigation action that Nav2 gave up; not ended in time; failed otherwise."""


@dataclass(frozen=True, slots=True)
class Event:
    """Something that happened at a moment: a contact, a recovery, a goal reached or missed.

    Attributes:
        kind: `contact`, `recovery`, `goal_reached`, `goal_missed`, `plan_failed`, `control_failed`, `stopped_by_monitor`;
            `stood_still` where the robot was sent and never moved (`vastflow.sim.loop.standstill`);
            of an obstacle `spawned`, `deleted`, and `obstacle_moved` at each row at which it stands elsewhere than before.
        x_m, y_m: True position of the robot's center; of the obstacle's where the event is one of an obstacle.
        what: The partner of a contact, the recovery's name, the number of a goal, the code of a failure, the obstacle, the cause of
            a standstill.
        value: Closing speed of a contact (m/s), yaw of an obstacle (rad); 0 where there is nothing to measure.
    """

    t_s: float
    kind: str
    x_m: float
    y_m: float
    what: str
    value: float = 0.0


@dataclass(frozen=True, slots=True)
class Entity:
    """Something that a scenario put into the world: its shape; where it stood and when is among the events.

    Attributes:
        length_m, width_m: As `vastflow.sim.model.obstacle.Obstacle` has them.
    """

    name: str
    shape: Shape
    length_m: float
    width_m: float


@dataclass(frozen=True, slots=True)
class Run:
    """One row per run: how the mission ended. Nothing of the host is in it.

    Attributes:
        seed: Entropy of the run in hexadecimal, see `vastflow.sim.kernels.streams.run_entropy`.
        outcome: How the scenario ended; a contact does not end it.
        error_code: Nav2's code of the last failure, 0 for a success.
        reason: In words, with the contacts there were; empty for a success without any.
        simulated_s: Simulated time from the start of the run to the scenario's end.
        distance_m: True path driven.
        missed_goals: Goals of a waypoint mission that were given up.
        entities: What the scenario itself put into the world, in order.
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
        behaviors: Status changes of the scenario's behaviors, see `vastflow.sim.run.BEHAVIORS`.
        outputs: What the run's programs wrote. They promise no equal bytes.
    """

    run: Run
    columns: Mapping[str, NDArray[np.int32]] = field(repr=False)
    behaviors: Columns = field(default_factory=dict, repr=False)
    outputs: Outputs = field(default_factory=Outputs, repr=False)

    @cached_property
    def digest(self) -> str:
        """Digest of the run's row, of every column and of the behaviors."""
        columns = {name: column.astype("<i4").tobytes().hex() for name, column in self.columns.items()}
        behaviors = {name: column.tolist() for name, column in self.behaviors.items()}
        return digest(run_row(self.run), columns, behaviors)


def run_row(run: Run) -> dict[str, Any]:
    """`run` as plain JSON values."""
    events, entities = ([asdict(each) for each in part] for part in (run.events, run.entities))
    return {**asdict(run), "events": events, "entities": entities}


def run_of(row: Mapping[str, Any]) -> Run:
    """The run that `run_row` wrote."""
    events = tuple(Event(**event) for event in row["events"])
    return Run(**{**row, "events": events, "entities": tuple(Entity(**entity) for entity in row.get("entities", ()))})


def si(fixed_point: NDArray[np.int32]) -> NDArray[np.float64]:
    """A column of thousandths (mm, ms, mrad and per second) in SI units."""
    return fixed_point.astype(np.float64) * 1e-3
