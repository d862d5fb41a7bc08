"""Smoothness of a motion, as numbers that depend neither on its duration nor on its speed."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

MAX_FREQUENCY_HZ: Final = 10.0
AMPLITUDE: Final = 0.05
_PADDING: Final = 4
"""Powers of two by which the spectrum is finer than its samples."""


def spectral_arc_length(
    speed_mps: NDArray[np.float64],
    step_s: float,
    max_frequency_hz: float = MAX_FREQUENCY_HZ,
    amplitude: float = AMPLITUDE,
) -> float | None:
    """Arc length of a speed profile's normalized magnitude spectrum, negative: the nearer to 0, the smoother.

    SPARC of Balasubramanian, Melendez-Calderon, Roby-Brami and Burdet, "On the analysis of movement smoothness", Journal of
    NeuroEngineering and Rehabilitation 12:112, 2015: with V̂(f) = |V(f)| / |V(0)|,

        SPARC = -∫_0^{f_c} sqrt((1 / f_c)² + (dV̂/df)²) df

    f_c is the highest frequency up to `max_frequency_hz` (and half the rate of samples) at which V̂ is still `amplitude` or more. One bell
    shaped movement has about -1.4.

    Args:
        speed_mps: (N,) at equal steps.
        step_s: Between samples (s).

    Returns:
        None for fewer than two samples, and for a robot that never moved.
    """
    if len(speed_mps) < 2 or not np.any(speed_mps):
        return None
    n = 2 ** (int(np.ceil(np.log2(len(speed_mps)))) + _PADDING)
    magnitude = np.abs(np.fft.rfft(speed_mps, n))
    frequency_hz = np.fft.rfftfreq(n, step_s)
    magnitude = magnitude / magnitude.max()
    within = np.flatnonzero((frequency_hz <= max_frequency_hz) & (magnitude >= amplitude))
    if within.size < 2:
        return None
    band = slice(within[0], within[-1] + 1)
    frequency_hz, magnitude = frequency_hz[band], magnitude[band]
    steps = np.diff(frequency_hz) / (frequency_hz[-1] - frequency_hz[0])
    return -float(np.sum(np.hypot(steps, np.diff(magnitude))))
