"""Latency of a robot's sensors and computers: how late what reaches the stack, and how late what the stack commands."""

from collections.abc import Mapping
from typing import Final

from vastflow.sim.nav.parameters.parameter import ParameterGroup, parameter

LATENCY_KEY: Final = "latency"
"""Name of the section below `robot`."""

PRESET_KEY: Final = "preset"
"""Of the section: the preset that gives what the section leaves out."""

OLDEST_S: Final = 0.5
"""What comes later than this is taken to come then: Nav2's message filters drop what is much older."""

PHYSICS_HZ: Final = 100.0
"""Odometry at this rate is as new as the stack's tick."""


class Latency(ParameterGroup):
    """Seconds and Hz. An age is the least; a jitter is the mean of what comes on top, drawn from an exponential distribution.

    Attributes:
        scan_age, scan_jitter: From the end of a scan to AMCL, costmaps, and collision monitor.
        odometry_rate: Of odometry's messages and its transform.
        tf_age, tf_jitter: From a sample of odometry to the stack.
        controller_time, controller_jitter: From the begin of a controller cycle to its command; while it computes, none begins.
        missed_cycles: Share of the controller's cycles that are left out; the last command stands.
        smoother_in_step: Whether the velocity smoother runs right after the controller's cycle begins; else at a phase drawn for the run.
    """

    scan_age: float = parameter(0.0, 0.0, OLDEST_S)
    scan_jitter: float = parameter(0.0, 0.0, OLDEST_S)
    odometry_rate: float = parameter(PHYSICS_HZ, 5.0, PHYSICS_HZ)
    tf_age: float = parameter(0.0, 0.0, OLDEST_S)
    tf_jitter: float = parameter(0.0, 0.0, OLDEST_S)
    controller_time: float = parameter(0.0, 0.0, OLDEST_S)
    controller_jitter: float = parameter(0.0, 0.0, OLDEST_S)
    missed_cycles: float = parameter(0.0, 0.0, 0.9)
    smoother_in_step: bool = parameter(True)


IDEAL: Final = Latency()

PRESETS: Final[Mapping[str, Latency]] = {
    "ideal": IDEAL,
    "gazebo": Latency(
        scan_age=0.02,
        scan_jitter=0.01,
        odometry_rate=30.0,
        tf_age=0.005,
        tf_jitter=0.005,
        controller_time=0.007,
        controller_jitter=0.006,
        missed_cycles=0.01,
        smoother_in_step=False,
    ),
    "loaded": Latency(
        scan_age=0.12,
        scan_jitter=0.05,
        odometry_rate=20.0,
        tf_age=0.022,
        tf_jitter=0.02,
        controller_time=0.055,
        controller_jitter=0.06,
        missed_cycles=0.05,
        smoother_in_step=False,
    ),
}
"""Where the numbers are from stands in `docs/the-simulator.md`."""
