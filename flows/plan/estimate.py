"""Estimates of computation time."""

import itertools
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final

from vastflow.producers.model.configuration import Configuration
from vastflow.producers.places.stops import PATH_LENGTH_KEY
from vastflow.sim.reading.script import script_of

MEAN_SPEED_MPS: Final = 0.3
"""Along the path, with stops and recoveries: 120 runs of some 6 m in `campaigns/quickstart` are about 40 minutes."""
TIMES_REAL_TIME: Final = 200.0
"""Of one core. `vastflow dev bench sim` measures it; less than it printed on a shared core of 2026, for runs are judged too."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """Simulated time of all runs, and what it takes on so many cores.

    Attributes:
        timeout_s: Simulated time that no run exceeds.
    """

    simulated_s: float
    timeout_s: float
    cores: int

    @property
    def wall_s(self) -> float:
        """Time it may take on this machine."""
        return self.simulated_s / (TIMES_REAL_TIME * self.cores)

    @property
    def how(self) -> str:
        """The assumptions, in one sentence."""
        cores = "1 core" if self.cores == 1 else f"{self.cores} cores"
        return (
            f"each run its path at {MEAN_SPEED_MPS:g} m/s, {self.timeout_s:g} s at most, {cores} of {TIMES_REAL_TIME:g} times "
            "real time each; without Prefect's start and compilation"
        )


def estimate_of(
    configurations: Iterable[Configuration], runs: Mapping[str, int], timeout_s: float, cores: int
) -> Estimate:
    """The estimate for so many runs of each configuration by name."""
    simulated_s = sum(
        runs[each.name] * min(timeout_s, route_m(each) / MEAN_SPEED_MPS) for each in configurations if runs[each.name]
    )
    return Estimate(simulated_s, timeout_s, cores)


def route_m(configuration: Configuration) -> float:
    """Length of a configuration's route: of its path, else straight from stop to stop; infinite where it has no mission."""
    try:
        script = script_of(configuration.scenario)
    except ValueError:
        return math.inf
    if script.start is None or not script.goals:
        return math.inf
    length_m = configuration.provenance.get(PATH_LENGTH_KEY)
    if isinstance(length_m, int | float):
        return script.rounds * length_m
    stops = (script.start, *script.goals)  # of every round
    return sum(math.hypot(b.x_m - a.x_m, b.y_m - a.y_m) for a, b in itertools.pairwise(stops))
