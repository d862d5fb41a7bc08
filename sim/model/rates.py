"""Rates of the stack's loops in ticks of its clock."""

from typing import Final

TICK_S: Final = 0.05
"""The stack runs at 20 Hz: the velocity smoother's rate, and the controller's unless a file has a lower one."""


def ticks_of(frequency_hz: float) -> int:
    """Return the ticks between two cycles of a loop, at least one."""
    return max(1, round(1.0 / (frequency_hz * TICK_S)))


def held_hz(frequency_hz: float) -> float:
    """Return the actual rate of a loop that should run at `frequency_hz`."""
    return 1.0 / (ticks_of(frequency_hz) * TICK_S)
