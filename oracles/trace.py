"""Traces: a recording's observation, what oracles read."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from vastflow.sim.recording import Run


@dataclass(frozen=True)
class Trace:
    """One run as aligned signals in SI units.

    Attributes:
        run: How the run ended.
        columns: Name to (N,) float64. From the recording: `t_s x_m y_m yaw_rad estimated_x_m estimated_y_m
            estimated_yaw_rad speed_mps yaw_rate_radps command_speed_mps command_yaw_rate_radps localized`.
            Derived: `localization_error_m`, `wall_clearance_m` (robot centre to the nearest wall),
            `deviation_m` (to the reference path; absent without one) and
            `separation_m/<size class>` (robot centre to the nearest centre of obstacles of that class).
    """

    run: Run
    columns: Mapping[str, NDArray[np.float64]] = field(repr=False)

    def __getitem__(self, column: str) -> NDArray[np.float64]:
        """The signal called `column`."""
        return self.columns[column]
