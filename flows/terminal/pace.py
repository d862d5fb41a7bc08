"""The speed of a campaign, measured while it runs."""

from collections import deque
from dataclasses import dataclass
from typing import Final

from vastflow.tasks.engine.progress import Progress

WINDOW_S: Final = 60.0
"""A campaign's later configurations may be slower than its first, so only the last minute counts."""


@dataclass(frozen=True, slots=True)
class Pace:
    """Times and speed of a campaign.

    Attributes:
        elapsed_s, phase_s: Time since the campaign and since the phase began.
        runs_per_s: Executed runs per second; None before the second report of executed runs.
        times_real_time: Simulated seconds per second; None if `runs_per_s` is None.
        left_s: Time until the last run is done; None if unknown.
    """

    elapsed_s: float
    phase_s: float
    runs_per_s: float | None = None
    times_real_time: float | None = None
    left_s: float | None = None


class Meter:
    """Measures the pace from reports of progress and their times."""

    def __init__(self, started_s: float) -> None:
        self._started_s = started_s
        self._phase = ""
        self._phase_began_s = started_s
        self._reports: deque[tuple[float, int, float]] = deque()

    def note(self, progress: Progress, now_s: float) -> None:
        """Add a report."""
        if progress.phase != self._phase:
            self._phase, self._phase_began_s = progress.phase, now_s
            self._reports.clear()
        if self._reports and progress.executed and not self._reports[-1][1]:
            self._reports.clear()  # the first run also compiled kernels: the pace counts from its end
        self._reports.append((now_s, progress.executed, progress.simulated_s))
        while len(self._reports) > 2 and now_s - self._reports[1][0] > WINDOW_S:
            self._reports.popleft()

    def pace(self, progress: Progress, now_s: float) -> Pace:
        """Return the pace at `now_s` after the last report `progress`."""
        elapsed_s, phase_s = now_s - self._started_s, now_s - self._phase_began_s
        if not self._reports:
            return Pace(elapsed_s, phase_s)
        began_s, executed, simulated_s = self._reports[0]
        done, time_s = progress.executed - executed, now_s - began_s
        if done <= 0 or time_s <= 0:
            return Pace(elapsed_s, phase_s)
        runs_per_s = done / time_s
        return Pace(
            elapsed_s,
            phase_s,
            runs_per_s,
            (progress.simulated_s - simulated_s) / time_s,
            (progress.runs_total - progress.runs_done) / runs_per_s,
        )
