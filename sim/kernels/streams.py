"""Random streams of kernels: an xorshift64* state per subsystem, seeded by the run, and normal numbers.

A stream is a (1,) uint64 array. Subsystems have separate streams, so that a change of how much one of them
draws leaves the others' numbers alone. Many normal numbers at once come by the ziggurat method (Marsaglia and Tsang 2000; Doornik 2005).
"""

import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vastflow.sim.kernels.numeric import inner, njit
from vastflow.sim.model.elementary import exp, log

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


LAYERS: Final = 256
TAIL: Final = 3.6541528853610088
AREA: Final = 0.00492867323399
"""Begin of the tail for 256 layers, and the area of a layer; the lowest layer is a rectangle and the tail."""


EDGES: Final = np.zeros(LAYERS + 1)
"""The right edge of each layer's rectangle from the lowest up, then 0."""
EDGES[0], EDGES[1] = AREA * exp(0.5 * TAIL * TAIL), TAIL
for _k in range(2, LAYERS):
    _edge = float(EDGES[_k - 1])
    EDGES[_k] = math.sqrt(-2.0 * log(AREA / _edge + exp(-0.5 * _edge * _edge)))


@inner
def normals(stream: Any, out: Any) -> None:
    """Fill `out` (N,) with standard normal numbers of `stream` (1,) uint64."""
    # The state stays in a register, which is twice as fast as `uniform` on the array.
    state = stream[0]
    for k in range(out.shape[0]):
        while True:
            state ^= state >> np.uint64(12)
            state ^= state << np.uint64(25)
            state ^= state >> np.uint64(27)
            bits = state * np.uint64(0x2545F4914F6CDD1D)
            # The upper 8 bits are the layer, the others a signed number in [-1, 1).
            layer = bits >> np.uint64(56)
            x = np.int64(bits << np.uint64(8)) * 2.0**-63 * EDGES[layer]
            if abs(x) < EDGES[layer + np.uint64(1)]:
                break
            stream[0] = state
            x = _outside(stream, x, layer)
            state = stream[0]
            if not math.isnan(x):
                break
        out[k] = x
    stream[0] = state


@inner
def _outside(stream: Any, x: float, layer: Any) -> float:
    """Return `x` if it is under the curve, a tail number for the lowest layer, else NaN."""
    if layer == np.uint64(0):
        while True:
            beyond = -math.log(1.0 - uniform(stream)) / TAIL
            if -2.0 * math.log(1.0 - uniform(stream)) > beyond * beyond:
                return math.copysign(TAIL + beyond, x)
    low = math.exp(-0.5 * EDGES[layer] * EDGES[layer])
    high = math.exp(-0.5 * EDGES[layer + np.uint64(1)] * EDGES[layer + np.uint64(1)])
    return x if low + uniform(stream) * (high - low) < math.exp(-0.5 * x * x) else math.nan
