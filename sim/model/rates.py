"""Rates of the stack's loops: whole numbers of ticks of its clock."""

from typing import Final

TICK_S: Final = 0.05
"""The stack runs at 20 Hz: the velocity smoother's rate, and the controller's unless a file has a lower one."""


def ticks_of(frequency_hz: float) -> int:
    """Ticks between two cycles of a loop, one at the least."""
    return max(1, round(1.0 / (frequency_hz * TICK_S)))


def held_hz(frequency_hz: float) -> float:
    """The rate at which a loop runs that is to run at `frequency_hz`."""
    return 1.0 / (ticks_of(frequency_hz) * TICK_S)
