"""Arrays: room for them, and elementary functions of them, since NumPy's last bits depend on the processor."""

import math
from mmap import mmap
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from vastflow.sim.kernels.numeric import njit


def zero_pages(shape: tuple[int, ...], dtype: DTypeLike) -> NDArray[Any]:
    """Return zeros that take memory where they are first written: most runs see a part of a large map."""
    # NumPy's come from a heap that clears them again once a run has freed some as large.
    nbytes = math.prod(shape) * np.dtype(dtype).itemsize
    return np.frombuffer(mmap(-1, max(nbytes, 1)), dtype, math.prod(shape)).reshape(shape)


@njit
def exps(x: Any) -> Any:
    """e to the power of each number of `x` (N,) float64."""
    found = np.empty(x.shape[0])
    for k in range(x.shape[0]):
        found[k] = math.exp(x[k])
    return found


@njit
def cos_sins(angles_rad: Any) -> Any:
    """Cosines and sines (2, N) of angles (N,) float64."""
    found = np.empty((2, angles_rad.shape[0]))
    for k in range(angles_rad.shape[0]):
        found[0, k], found[1, k] = math.cos(angles_rad[k]), math.sin(angles_rad[k])
    return found
