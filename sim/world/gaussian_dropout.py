"""Lidar noise of the paper's relay: beams lost, then Gaussian noise."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vastflow.sim.kernels.numeric import addressed, njit
from vastflow.sim.kernels.streams import integer_below, normal_pair
from vastflow.sim.world.noise import LidarNoise, Scan
from vastflow.sim.world.noise_registry import GaussianDropoutParameters


class RelayMemory(NamedTuple):
    """Random numbers and scratch (B,) int64."""

    stream: Any
    order: Any


@njit
def perturb(ranges_m: Any, stream: Any, dropout: float, noise_m: float, order: Any) -> None:
    """Apply dropout, then noise, in place, as the paper's relay between simulator and Nav2 does.

    Exactly `int(B * dropout)` beams, chosen anew each scan, become `inf`; then every beam gets independent Gaussian noise of standard
    deviation `noise_m`, not clipped to the sensor's limits. `order` is scratch.
    """
    beams = ranges_m.shape[0]
    dropped = int(beams * dropout)
    if dropped > 0:
        for b in range(beams):
            order[b] = b
        for k in range(dropped):
            other = k + integer_below(stream, beams - k)
            order[k], order[other] = order[other], order[k]
            ranges_m[order[k]] = np.inf
    if noise_m > 0.0:
        for b in range(0, beams, 2):
            first, second = normal_pair(stream)
            ranges_m[b] += noise_m * first
            if b + 1 < beams:
                ranges_m[b + 1] += noise_m * second


@addressed
def relay(q: Any, memory: RelayMemory, given: Scan) -> None:
    perturb(
        given.ranges_m,
        memory.stream,
        q.laserscan_random_drop_percentage,
        q.laserscan_gaussian_noise_std_deviation,
        memory.order,
    )


class GaussianDropout(GaussianDropoutParameters, LidarNoise):
    """Independent Gaussian noise of every beam, and a share of beams without a return."""

    perturb = relay

    def memory(self, stream: NDArray[np.uint64], beams: int) -> RelayMemory:
        return RelayMemory(stream, np.zeros(beams, dtype=np.int64))
