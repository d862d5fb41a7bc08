"""Random streams inside kernels: one xorshift64* state per subsystem, seeded by the run alone.

A stream is a (1,) uint64 array. Subsystems have separate streams, so that a change of how much one of them
draws leaves the others' numbers alone.
"""

import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vastflow.sim.kernels.numeric import njit

LIDAR: Final = 0
AMCL: Final = 1
PHASES: Final = 2
CONTROLLER: Final = 3
ODOMETRY: Final = 4
LATENCY: Final = 5
SUBSYSTEMS: Final = 6


def run_entropy(seed: int, situation_digest: str, run_index: int) -> list[int]:
    """Entropy of a run: the campaign's seed, the digest of environment and task, the run's index (design §5)."""
    return [seed, int(situation_digest, 16), run_index]


def streams_of(entropy: Sequence[int]) -> NDArray[np.uint64]:
    """Independent states (SUBSYSTEMS, 1) uint64, none of them zero."""
    children = np.random.SeedSequence(entropy).spawn(SUBSYSTEMS)
    states = [child.generate_state(1, np.uint64)[0] for child in children]
    return np.array([[state or 1] for state in states], dtype=np.uint64)


@njit
def uniform(stream: Any) -> float:
    """The next number in [0, 1) of `stream` (1,) uint64, 53 bits."""
    x = stream[0]
    x ^= x >> np.uint64(12)
    x ^= x << np.uint64(25)
    x ^= x >> np.uint64(27)
    stream[0] = x
    return float((x * np.uint64(0x2545F4914F6CDD1D)) >> np.uint64(11)) * 1.1102230246251565e-16


@njit
def normal_pair(stream: Any) -> tuple[float, float]:
    """Two independent standard normal numbers (Marsaglia's polar method)."""
    while True:
        x, y = 2.0 * uniform(stream) - 1.0, 2.0 * uniform(stream) - 1.0
        square = x * x + y * y
        if 0.0 < square < 1.0:
            factor = math.sqrt(-2.0 * math.log(square) / square)
            return x * factor, y * factor


@njit
def integer_below(stream: Any, n: int) -> int:
    """A uniform integer in 0..n-1."""
    return int(uniform(stream) * n)
