"""Pace: how many runs by the host's clock this machine executes at a time, by a probe."""

import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import Final

from vastflow.sim.model.scenario import Scenario
from vastflow.tasks.engine import work
from vastflow.tasks.engine.executor import Priority, WorkerDied
from vastflow.tasks.engine.pool import Pool, cores

PACED_SHARE: Final = 0.75
"""Share of the cores that paced runs may take together; their peaks need the rest."""
PROBE_S: Final = 10.0
"""Host time of a probe from its first tick on."""


class Pace:
    """Bounds the workers of a pool before its first paced run.

    Args:
        notice: Is given the bound, a line for the user.
    """

    def __init__(self, pool: Pool, notice: Callable[[str], None]) -> None:
        self._pool, self._notice = pool, notice
        self._is_known = False

    def keep(self, scenario: Scenario, seed: int) -> None:
        """Bound the pool's workers by a probe, once, if runs of the scenario are paced."""
        nodes = scenario.programs and scenario.programs.nodes
        if self._is_known or not nodes or nodes.time != "paced" or self._pool.workers == 1:
            return
        self._is_known = True
        with suppress(WorkerDied):
            taken = self._pool.submit(work.answered, probe, scenario, seed, priority=Priority.EVALUATE).result()
            if isinstance(taken, float):  # else the runs will say what is wrong
                fitting = int(PACED_SHARE * cores() / taken)
                self._pool.bound(max(fitting, 1))
                self._notice(_said(self._pool.workers, taken, bool(fitting)))


def _said(workers: int, taken: float, fits: bool) -> str:
    said = f"{workers} worker{'s' * (workers > 1)}, as a paced run takes {taken:.2g} of {cores()} cores"
    return said if fits else f"{said}. Runs may be late, and are not judged then"


def probe(scenario: Scenario, seed: int) -> float:
    """Execute the beginning of a paced run, and return how many cores it takes."""
    from vastflow.sim.run import execute

    programs = scenario.programs
    assert programs is not None and programs.nodes is not None
    nodes = replace(programs.nodes, most_late=1.0, most_waiting=1.0)
    timeout_s = min(PROBE_S * nodes.real_time_factor, scenario.timeout_s)
    before_s = time.process_time()
    log = execute(replace(scenario, timeout_s=timeout_s, programs=replace(programs, nodes=nodes)), 0, seed).log
    return (log.cpu_s + time.process_time() - before_s) / log.wall_s
