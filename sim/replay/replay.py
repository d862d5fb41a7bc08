"""Replays: a recorded run executed again and observed."""

import itertools
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from vastflow.sim.model.digest import digest
from vastflow.sim.model.rates import TICK_S
from vastflow.sim.model.recording import Recording, run_row
from vastflow.sim.model.scenario import Scenario
from vastflow.sim.nav2.navigator.state import Stack
from vastflow.sim.replay.snapshot import Box, Moment, TickSnapshot, moment_of, snapshot_of
from vastflow.sim.run import run


@dataclass(frozen=True, eq=False, slots=True)
class Replay:
    """A run, executed again.

    Attributes:
        moments: One of each tick.
        snapshots: Those of the requested ticks up to the run's end.
    """

    recording: Recording
    moments: Sequence[Moment] = field(repr=False)
    snapshots: Sequence[TickSnapshot] = field(repr=False)


@dataclass(frozen=True, slots=True)
class Difference:
    """First difference of two recordings of a run.

    Attributes:
        what: Name of the column, or of a value of the run's row.
        row, t_s: Row of the columns and its time; None for a value of the run's row.
        recorded, executed: Values; None where there is none.
    """

    what: str
    row: int | None
    t_s: float | None
    recorded: Any
    executed: Any

    def __str__(self) -> str:
        time = "" if self.t_s is None else f" ({self.t_s:.2f} s)"
        where = f"{self.what} of the run" if self.row is None else f"row {self.row}{time}, {self.what}"
        return f"{where}: recorded {_said(self.recorded)}, executed {_said(self.executed)}"


def replay(scenario: Scenario, run_index: int, seed: int, looks: Mapping[int, Box]) -> Replay:
    """Execute a run as `vastflow.sim.run.run` does, byte for byte, and observe it.

    Args:
        seed: The campaign's `execution.seed`.
        looks: Tick to the part of the map whose costs its snapshot has.
    """
    moments: list[Moment] = []
    snapshots: list[TickSnapshot] = []

    def watch(stack: Stack, tick: int) -> None:
        moments.append(moment_of(stack, tick))
        if tick in looks:
            snapshots.append(snapshot_of(stack, moments[-1], looks[tick]))

    recording = run(scenario, run_index, seed, watch=watch, watch_ticks=range(round(scenario.timeout_s / TICK_S)))
    return Replay(recording, moments, snapshots)


def first_difference(recorded: Recording, executed: Recording) -> Difference | None:
    """Return the first different column of the earliest row, else value of the run's row; None if equal."""
    if recorded.digest == executed.digest:
        return None
    found = [
        d
        for name in dict.fromkeys([*recorded.columns, *executed.columns])
        if (d := _column_difference(name, recorded, executed))
    ]
    if found:
        return min(found, key=lambda d: d.row or 0)
    ours, theirs = run_row(executed.run), run_row(recorded.run)
    for key in ours:
        if digest(ours[key]) != digest(theirs[key]):
            return Difference(key, None, None, theirs[key], ours[key])
    changes = [
        list(zip(*(column.tolist() for column in r.behaviors.values()), strict=True)) for r in (recorded, executed)
    ]
    for pair in itertools.zip_longest(*changes):
        if pair[0] != pair[1]:
            return Difference("behaviors", None, None, *pair)
    return Difference("behaviors", None, None, tuple(recorded.behaviors), tuple(executed.behaviors))


def _column_difference(name: str, recorded: Recording, executed: Recording) -> Difference | None:
    """Return the first row in which a column differs or is missing."""
    a, b = (np.asarray(r.columns.get(name, np.empty(0)), dtype=np.int64) for r in (recorded, executed))
    common = min(len(a), len(b))
    unequal = np.flatnonzero(a[:common] != b[:common])
    if not unequal.size and len(a) == len(b):
        return None
    row = int(unequal[0]) if unequal.size else common
    longer = recorded if len(a) > row else executed
    t_s = float(longer.columns["t_ms"][row]) * 1e-3 if "t_ms" in longer.columns else None
    return Difference(name, row, t_s, *(int(c[row]) if row < len(c) else None for c in (a, b)))


def _said(value: Any) -> str:
    return "nothing" if value is None else textwrap.shorten(str(value), 100, placeholder=" …")
