"""A scenario played to its end: its tree, the closed loop and its programs in turn, on one clock."""

import math
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Final

from vastflow.sim.behavior.tree import ScenarioTree
from vastflow.sim.loop.closed_loop import ClosedLoop
from vastflow.sim.nav.rates import TICK_S
from vastflow.sim.nav.state import Stack
from vastflow.sim.process.run import ProcessRun

PERIOD_S: Final = 0.1
"""Between two ticks of a scenario's tree."""

TICKS: Final = round(PERIOD_S / TICK_S)
"""Ticks of the closed loop between two of the tree's."""

Watch = Callable[[Stack, int], None]


def play(
    tree: ScenarioTree,
    timeout_s: float,
    loop: ClosedLoop | None,
    programs: ProcessRun | None,
    watch: Watch | None = None,
    watch_ticks: Sequence[int] = (),
) -> None:
    """Run a scenario to its end, or to the end of its time.

    The tree is ticked ten times a simulated second, but for ticks that can change nothing: those are passed over until
    the robot's mission ends or something in the tree is due. While a program runs no tick is passed over, and each lasts its
    0.1 s of host time, or until the program ends: a program's time can't be simulated.

    Args:
        loop: The robot in its world; None for a scenario without.
        programs: What the scenario starts programs in, if it does.
        watch, watch_ticks: See `vastflow.sim.run.run`.
    """
    world = _World(loop, watch, watch_ticks) if loop else None
    last = math.floor(timeout_s / PERIOD_S + 1e-9)
    number = 0
    began_s = time.monotonic()
    while not tree.ended and number < last:
        waiting = programs is not None and programs.waiting
        due = number + 1 if waiting else min(tree.next_tick(), last)
        number = world.advance(int(due)) if world else int(due)
        if programs is not None and waiting:
            programs.wait(max(0.0, began_s + PERIOD_S - time.monotonic()))
        began_s = time.monotonic()
        tree.tick(number)


class _World:
    """The closed loop, advanced by the tree's ticks, with a look after some of its own."""

    def __init__(self, loop: ClosedLoop, watch: Watch | None, watch_ticks: Sequence[int]) -> None:
        self._loop = loop
        self._watch = watch
        self._ticks: Iterator[int] = iter(watch_ticks)
        self._next = next(self._ticks, None) if watch else None

    def advance(self, number: int) -> int:
        """Go on until tick `number` of the tree, or the first one after the mission's end; which it is."""
        self._advance(number * TICKS)
        reached = -(-self._loop.tick // TICKS)
        self._advance(reached * TICKS)
        return reached

    def _advance(self, until_tick: int) -> None:
        status = self._loop.status
        while self._watch is not None and self._next is not None and self._next < until_tick:
            self._loop.advance(self._next + 1)
            if self._loop.tick > self._next:
                self._watch(self._loop.stack, self._next)
                self._next = next(self._ticks, None)
            if self._loop.status != status:
                return
        self._loop.advance(until_tick)
