"""A closed loop that is watched, and its recording."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from vastflow.sim.loop.closed_loop import ClosedLoop
from vastflow.sim.loop.standstill import STANDSTILL_M, standstill, told
from vastflow.sim.model.pose import GridFrame
from vastflow.sim.model.recording import Columns, Entity, Event, Outcome, Recording, Run
from vastflow.sim.nav2.navigator import state
from vastflow.sim.nav2.navigator.state import Stack, columns_of

Watch: TypeAlias = Callable[[Stack, int], None]


@dataclass(frozen=True, slots=True)
class Ending:
    """The end of a run; see `vastflow.sim.model.recording.Run`."""

    outcome: Outcome
    reason: str = ""
    error_code: int = 0


class Watched:
    """A closed loop that is watched after some of its ticks.

    Args:
        watch, watch_ticks: See `vastflow.sim.run.run`.
    """

    def __init__(self, loop: ClosedLoop, watch: Watch | None, watch_ticks: Sequence[int]) -> None:
        self._loop = loop
        self._watch = watch
        self._ticks = iter(watch_ticks if watch else ())
        self._next = next(self._ticks, math.inf)

    def advance(self, until_tick: int) -> None:
        """Advance as the loop does: to a tick, or until the mission's state changes."""
        loop, status = self._loop, self._loop.status
        while self._watch and self._next < until_tick:
            loop.advance(int(self._next) + 1)
            if loop.tick > self._next:
                self._watch(loop.stack, int(self._next))
                self._next = next(self._ticks, math.inf)
            if loop.status != status:
                return
        loop.advance(until_tick)


def recording_of(
    loop: ClosedLoop,
    entropy: Sequence[int],
    ending: Ending,
    behaviors: Columns | None = None,
) -> Recording:
    """Return the recording of a loop at the run's end; for `behaviors` see `Recording`."""
    loop.conclude()
    stack = loop.stack
    m = stack.m[0]
    columns = {name: stack.rows[: int(m["rows"]), k].copy() for k, name in enumerate(columns_of(stack.robot))}
    columns |= loop.movers.columns_at(columns["t_ms"])
    events = [*(_event(row, loop.frame) for row in m["event_rows"][: int(m["events"])]), *loop.events]
    reasons = [ending.reason] if ending.reason else []
    if loop.sent_s is not None and float(m["distance"]) < STANDSTILL_M and ending.outcome != "succeeded":
        events.append(standstill(columns, events, loop.sent_s))
        reasons.append(told(events[-1]))
    if contacts := [event for event in loop.events if event.kind == "contact"]:
        first = f"with {contacts[0].what} at {contacts[0].t_s:.1f} s"
        reasons.append(f"a contact {first}" if len(contacts) == 1 else f"{len(contacts)} contacts, the first {first}")
    return Recording(
        Run(
            run_index=entropy[-1],
            seed=seed_text(entropy),
            outcome=ending.outcome,
            error_code=ending.error_code,
            reason="; ".join(reasons),
            simulated_s=round(loop.now_s, 3),
            distance_m=round(float(m["distance"]), 3),
            recoveries=int(m["recoveries"]),
            missed_goals=int(m["missed"]),
            events=tuple(sorted(events, key=lambda event: event.t_s)),
            entities=tuple(Entity(o.name, o.model, o.length_m, o.width_m) for o in loop.spawned),
        ),
        columns,
        behaviors or {},
    )


def recording_without_world(ended_s: float, entropy: Sequence[int], ending: Ending, behaviors: Columns) -> Recording:
    end = ending.outcome, 0, ending.reason, round(ended_s, 3)
    return Recording(
        Run(entropy[-1], seed_text(entropy), *end, distance_m=0.0, recoveries=0, missed_goals=0), {}, behaviors
    )


def seed_text(entropy: Sequence[int]) -> str:
    """Return the entropy of a run as its row has it."""
    return ":".join(f"{part:x}" for part in entropy)


def _event(row: NDArray[np.float64], frame: GridFrame) -> Event:
    t_s, kind, x_m, y_m, what, value = row.tolist()
    x_m, y_m = frame.to_map(x_m, y_m)
    detail = state.RECOVERIES[int(what)] if int(kind) == state.EVENT_RECOVERY else str(int(what))
    return Event(round(t_s, 3), state.EVENT_KINDS[int(kind)], round(x_m, 3), round(y_m, 3), detail, value)
