"""AMCL's resampling: KLD sampling over bins of pose space, the clusters of bins and the statistics of the samples."""

import math
from typing import Any, Final

import numpy as np

from vastflow.sim.kernels.numeric import inner
from vastflow.sim.kernels.streams import uniform
from vastflow.sim.nav.particles import GUIDE, Cloud

BIN_M: Final = 0.5
BIN_RAD: Final = math.radians(10.0)

# A bin's key holds its three indices in 21 bits each, counted from half a range below zero.
_MIDDLE: Final = 1 << 20
_X: Final = np.uint64(1 << 42)
_Y: Final = np.uint64(1 << 21)
_YAW: Final = np.uint64(1)
_HASH: Final = np.uint64(0x9E3779B97F4A7C15)
_STEPS: Final = np.arange(3, dtype=np.uint64)


NEIGHBORS: Final = np.array([i * _X + j * _Y + k * _YAW for i in _STEPS for j in _STEPS for k in _STEPS])
"""What to add to the key of a bin's lowest neighbor for each of the 27."""


@inner
def kld_limit(bins: int, q: Any) -> int:
    """Particles needed for `bins` occupied bins (Fox 2001; `pf_z` is used as the normal quantile itself)."""
    if bins <= 1:
        return int(q.max_particles)
    b = 2.0 / (9.0 * (bins - 1))
    x = 1.0 - b + math.sqrt(b) * q.pf_z
    needed = math.ceil((bins - 1) / (2.0 * q.pf_err) * x * x * x)
    return int(min(max(needed, q.min_particles), q.max_particles))


@inner
def resample(cloud: Cloud, n: int, stream: Any, q: Any) -> Any:
    """Multinomial resampling until enough for the bins occupied so far: (particles, bins) now in the cloud."""
    particles, resampled, headings, weights = cloud.particles, cloud.resampled, cloud.headings, cloud.weights
    slots, entries, keys, labels, sums = cloud.slots, cloud.entries, cloud.bins, cloud.labels, cloud.sums
    guide, cumulative = cloud.guide, cloud.cumulative
    total = _accumulate(weights, n, cumulative, guide)
    for slot in range(slots.shape[0]):
        slots[slot] = np.uint64(0)
    bins, count, needed = 0, 0, q.max_particles
    while count < q.max_particles and count <= needed:
        k = _pick(guide, cumulative, uniform(stream), total)
        x, y, yaw = particles[0, k], particles[1, k], particles[2, k]
        resampled[0, count], resampled[1, count], resampled[2, count] = x, y, yaw
        count += 1
        key = _key(x, y, yaw)
        slot = _slot(slots, key)
        if slots[slot] != key:
            slots[slot], entries[slot] = key, bins
            keys[bins], labels[bins] = key, -1
            for j in range(8):
                sums[bins, j] = 0.0
            bins += 1
            needed = kld_limit(bins, q)
        entry = np.uint32(entries[slot])
        sums[entry, 0] += 1.0
        sums[entry, 1] += x
        sums[entry, 2] += y
        sums[entry, 3] += headings[0, k]
        sums[entry, 4] += headings[1, k]
        sums[entry, 5] += x * x
        sums[entry, 6] += x * y
        sums[entry, 7] += y * y
    for axis in range(3):
        for k in range(count):
            particles[axis, k] = resampled[axis, k]
    for k in range(count):
        weights[k] = 1.0 / count
    return count, bins


@inner
def _accumulate(weights: Any, n: int, cumulative: Any, guide: Any) -> float:
    """Running sum of `n` weights, and for each share of it how many particles end before; the whole sum."""
    total = 0.0
    for k in range(n):
        total += weights[k]
        cumulative[k] = total
    cumulative[n - 1] = np.inf  # beyond any draw, whatever the rounding
    for share in range(GUIDE + 1):
        guide[share] = 0
    per_weight = GUIDE / total
    for k in range(n - 1):
        guide[min(np.uint32(cumulative[k] * per_weight), np.uint32(GUIDE - 1)) + np.uint32(1)] = k + 1
    before = 0
    for share in range(GUIDE):
        before = max(before, guide[share])
        guide[share] = before
    return total


@inner
def _pick(guide: Any, cumulative: Any, draw: float, total: float) -> Any:
    """The particle in whose part of the running sum a number in [0, 1) falls."""
    k = np.uint32(guide[np.uint32(draw * GUIDE)])
    draw *= total
    # Two steps without a branch are nearly always enough; to guess wrongly at a branch costs more than both.
    k += np.uint32(cumulative[k] <= draw)
    k += np.uint32(cumulative[k] <= draw)
    while cumulative[k] <= draw:
        k += np.uint32(1)
    return k


@inner
def _key(x_m: float, y_m: float, yaw_rad: float) -> Any:
    """Key of the bin a pose lies in."""
    return (
        np.uint64(int(x_m * (1.0 / BIN_M) + _MIDDLE)) * _X
        + np.uint64(int(y_m * (1.0 / BIN_M) + _MIDDLE)) * _Y
        + np.uint64(int(yaw_rad * (1.0 / BIN_RAD) + _MIDDLE)) * _YAW
    )


@inner
def _slot(slots: Any, key: Any) -> Any:
    """Where a bin is, or would be put, in the hash table."""
    mask = np.uint64(slots.shape[0] - 1)
    slot = (key * _HASH) >> np.uint64(40) & mask
    while slots[slot] != 0 and slots[slot] != key:
        slot = (slot + np.uint64(1)) & mask
    return slot


@inner
def heaviest_cluster(cloud: Cloud, bins: int) -> Any:
    """Mean pose (x, y, yaw) of the heaviest 26-connected cluster of bins; yaw bins do not wrap, as in AMCL."""
    slots, entries, keys, labels = cloud.slots, cloud.entries, cloud.bins, cloud.labels
    sums, stack = cloud.sums, cloud.stack
    best_weight, best = -1.0, (0.0, 0.0, 0.0)
    label = 0
    for first in range(bins):
        if labels[first] >= 0:
            continue
        w, x, y, c, s = 0.0, 0.0, 0.0, 0.0, 0.0
        labels[first] = label
        stack[0] = first
        depth = 1
        while depth > 0:
            depth -= 1
            k = stack[depth]
            w += sums[k, 0]
            x += sums[k, 1]
            y += sums[k, 2]
            c += sums[k, 3]
            s += sums[k, 4]
            corner = keys[k] - _X - _Y - _YAW
            for step in range(27):
                slot = _slot(slots, corner + NEIGHBORS[step])
                entry = np.uint32(entries[slot])
                if slots[slot] != 0 and labels[entry] < 0:
                    labels[entry] = label
                    stack[depth] = entry
                    depth += 1
        label += 1
        if w > best_weight:
            best_weight, best = w, (x / w, y / w, math.atan2(s, c))
    return best


@inner
def covariance(sums: Any, bins: int) -> Any:
    """Covariance of all samples: xx, xy, yy (m²) and the circular variance of yaw, -2 ln R (rad²)."""
    w, x, y, c, s, xx, xy, yy = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(bins):
        w += sums[k, 0]
        x += sums[k, 1]
        y += sums[k, 2]
        c += sums[k, 3]
        s += sums[k, 4]
        xx += sums[k, 5]
        xy += sums[k, 6]
        yy += sums[k, 7]
    x, y, length = x / w, y / w, math.sqrt(c * c + s * s) / w
    # Rounding may take sums of equal numbers a little beyond what they can be.
    return max(xx / w - x * x, 0.0), xy / w - x * y, max(yy / w - y * y, 0.0), -2.0 * math.log(min(length, 1.0))
