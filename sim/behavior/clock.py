"""Simulated time in whole ticks, so that no sum of floats decides when a wait ends."""

import math


class TickClock:
    """Time as a number of ticks; moments are compared in whole microseconds.

    Attributes:
        number: The tick that is being made; 0 before the first.
        period_us: Between two ticks.
    """

    def __init__(self, period_s: float) -> None:
        """Raise ValueError for a period that is not a whole, positive number of microseconds."""
        self.number = 0
        self.period_us = round(period_s * 1e6) if math.isfinite(period_s) else 0
        if self.period_us < 1 or not math.isclose(self.period_us, period_s * 1e6, rel_tol=1e-9):
            raise ValueError(f"the period of a tick is a whole number of microseconds, at least 1; got {period_s!r} s")

    @property
    def now_us(self) -> int:
        """The present tick's time."""
        return self.number * self.period_us

    @property
    def now_s(self) -> float:
        """The present tick's time."""
        return self.now_us / 1e6

    def in_us(self, duration_s: float) -> float:
        """The moment so much after now; the infinite stays infinite."""
        return self.now_us + microseconds(duration_s)

    def first_at(self, moment_us: float) -> float:
        """Number of the first tick at a moment or after it."""
        return -(-moment_us // self.period_us)

    def first_after(self, moment_us: float) -> float:
        """Number of the first tick that is strictly after a moment."""
        return moment_us // self.period_us + 1 if math.isfinite(moment_us) else moment_us


def microseconds(duration_s: float) -> float:
    """A duration in whole microseconds; infinite where it is."""
    return round(duration_s * 1e6) if math.isfinite(duration_s) else duration_s
