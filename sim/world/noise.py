"""The interface of lidar noise: parameters, and a kernel that changes the ranges of a scan."""

from collections.abc import Callable
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vastflow.sim.model.parameter import ParameterGroup


class Scan(NamedTuple):
    """A scan as the scanner measures it.

    Attributes:
        ranges_m: (B,) float64, `inf` where a beam meets nothing; noise changes them in place.
        directions: (B, 2) unit vectors of the beams in the robot's frame.
        range_min_m, range_max_m: Exact readings lie in [min, max).
    """

    ranges_m: Any
    directions: Any
    range_min_m: float
    range_max_m: float


class NoiseMemory(NamedTuple):
    """The memory of noise without one of its own.

    Attributes:
        stream: (1,) uint64, the run's random numbers for the lidar: `uniform`, `normal_pair`, and `integer_below` of
            `vastflow.sim.kernels.streams` draw from it.
    """

    stream: Any


class LidarNoise(ParameterGroup):
    """Base of all lidar noise: a subclass has its parameters as fields (see `parameter`), and its kernel as an attribute.

    Attributes:
        perturb: Kernel (parameters, memory, `Scan`): it returns nothing. `parameters.name` is a field's value: a flag is 0
            or 1, a tuple an array.
    """

    perturb: ClassVar[Callable[..., Any]]

    def memory(self, stream: NDArray[np.uint64], beams: int) -> Any:
        """Return state and working space of a run: a NamedTuple of arrays; kernels change them in place."""
        return NoiseMemory(stream)
