"""Elementary functions of arrays: NumPy's last bits depend on the processor."""

import math
from typing import Any

import numpy as np

from vastflow.sim.kernels.numeric import njit


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
