"""Standard normal numbers in kernels by the ziggurat method (Marsaglia and Tsang 2000; Doornik 2005).

The density is covered by 256 layers of equal area. A number drawn in a layer's rectangle lies under the curve for
certain in 98.8 % of cases and then costs one number of the stream, one multiplication and one comparison.
"""

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vastflow.sim.kernels.numeric import inner
from vastflow.sim.kernels.streams import uniform

LAYERS: Final = 256
TAIL: Final = 3.6541528853610088
AREA: Final = 0.00492867323399
"""Where the tail begins for 256 layers, and each layer's area; the lowest layer is a rectangle and the tail."""


def _edges() -> NDArray[np.float64]:
    """Right edge of each layer's rectangle from the lowest up, then 0; the lowest is as wide as its area asks."""
    edges = np.zeros(LAYERS + 1)
    edges[0], edges[1] = AREA * math.exp(0.5 * TAIL * TAIL), TAIL
    for k in range(2, LAYERS):
        edges[k] = math.sqrt(-2.0 * math.log(AREA / edges[k - 1] + math.exp(-0.5 * edges[k - 1] ** 2)))
    return edges


EDGES: Final = _edges()


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
    """`x` where it lies under the curve all the same, a number of the tail for the lowest layer, NaN to draw again."""
    if layer == np.uint64(0):
        while True:
            beyond = -math.log(1.0 - uniform(stream)) / TAIL
            if -2.0 * math.log(1.0 - uniform(stream)) > beyond * beyond:
                return math.copysign(TAIL + beyond, x)
    low = math.exp(-0.5 * EDGES[layer] * EDGES[layer])
    high = math.exp(-0.5 * EDGES[layer + np.uint64(1)] * EDGES[layer + np.uint64(1)])
    return x if low + uniform(stream) * (high - low) < math.exp(-0.5 * x * x) else math.nan
