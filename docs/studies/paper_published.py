"""Figures that the paper reports, and figures derived from them."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Literal, TypeAlias

Kind: TypeAlias = Literal["performance", "robustness", "safety"]


@dataclass(frozen=True, slots=True)
class Published:
    """One campaign of the paper.

    Attributes:
        configurations: Number of configurations; equal ones count separately.
        passed, failed: Runs that were judged; those that did not start up are in neither.
        total_failure_share: Share of the failures that comes from configurations all of whose runs fail.
    """

    configurations: int
    passed: int
    failed: int
    total_failure_share: float

    @property
    def rate(self) -> float:
        """Success rate of the judged runs."""
        return self.passed / (self.passed + self.failed)

    @property
    def runs(self) -> int:
        """Runs that were asked for."""
        return self.configurations * RUNS

    @property
    def not_started(self) -> int:
        """Runs that were not judged."""
        return self.runs - self.passed - self.failed


RUNS: Final = 20
"""Number of runs of each configuration."""
PUBLISHED: Final[Mapping[Kind, Published]] = {
    "performance": Published(1816, 31714, 609, 0.3514),
    "robustness": Published(1792, 26041, 5409, 0.3280),
    "safety": Published(1872, 15901, 10065, 0.9402),
}
ALL_RUNS: Final = RUNS * sum(each.configurations for each in PUBLISHED.values())
SIMULATED_H: Final = 1800.0
DISTANCE_KM: Final = 1873.0
STORED_GB: Final = 737.0
CLUSTER_CPUS: Final = 1920
CLUSTER_H: Final = 7.0
LOCAL_RADIUS_M: Final = 0.22
"""Radius of the robot in the local costmap, Nav2's default, which is not varied."""
LOCAL_PADDING_M: Final = 0.01
"""Padding that Nav2 adds to this radius by default."""
CPUS_OF_A_RUN: Final = 5
"""Two for the simulation, two for navigation, one for the scenario."""
