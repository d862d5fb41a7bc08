"""AMCL's particles: a cloud's memory, its spread, its motion by odometry, and its resampling.

Kernels work on preallocated arrays. Each step is cut into loops without branches, which run on vector units, and
short ones with them.
"""

import math
from typing import Any, Final, NamedTuple

import numpy as np

from vastflow.sim.kernels.numeric import inner
from vastflow.sim.kernels.sincos import rounded, sincos
from vastflow.sim.kernels.streams import normals, uniform
from vastflow.sim.world.motion import wrapped

GUIDE: Final = 2048
LANES: Final = 4
"""Beams that are looked up at a time."""


class Cloud(NamedTuple):
    """A particle filter's memory for at most N particles."""

    particles: Any  # particles, resampled: (3, N) float64 of x, y, yaw; yaw is not wrapped.
    resampled: Any
    headings: Any  # (2, N) float64: cos and sin of each yaw, from weighting.
    weights: Any  # (N,) float64, normalized; `cumulative` their running sum.
    cumulative: Any
    guide: Any  # (GUIDE + 1,) int32: for each of GUIDE equal shares of weight, a particle at or before the first in it.
    frames: Any  # (4, N) x, y in cells of the likelihood table, cos and sin of each particle; float32 in the loop.
    likelihoods: Any  # (N,) of the same type: 1 + Σ pz³.
    points: Any  # (2, B) of the same type: end points of beams in the robot's frame, in cells.
    # indices, unsigned: (4, N) int32 scratch, and its bytes as uint32, which spare the test for negative
    # indices.
    indices: Any
    unsigned: Any
    slots: Any  # slots, entries: (S,) uint64 and int32: hash table from a bin's key (0 where empty) to its number.
    entries: Any
    bins: Any  # (N,) uint64 keys in order of discovery; `labels` (N,) int32 their clusters, -1 while none.
    labels: Any
    sums: Any  # (N, 8) float64: weight, x, y, cos, sin, xx, xy, yy of a bin's particles.
    stack: Any  # (N,) int32 scratch of the clustering.


def new_cloud(max_particles: int, beams: int = 360, dtype: type[np.floating[Any]] = np.float32) -> Cloud:
    """An empty cloud for scans of `beams` beams, which looks beams up with coordinates of `dtype`."""
    n, slots = max_particles, 1 << (2 * max_particles).bit_length()
    indices = np.zeros((4, max_particles), dtype=np.int32)
    return Cloud(
        particles=np.zeros((3, n)),
        resampled=np.zeros((3, n)),
        headings=np.zeros((2, n)),
        weights=np.zeros(n),
        cumulative=np.zeros(n),
        guide=np.zeros(GUIDE + 1, dtype=np.int32),
        frames=np.zeros((4, n), dtype=dtype),
        likelihoods=np.zeros(n, dtype=dtype),
        points=np.zeros((2, points_for(beams)), dtype=dtype),
        indices=indices,
        unsigned=indices.view(np.uint32),
        slots=np.zeros(slots, dtype=np.uint64),
        entries=np.zeros(slots, dtype=np.int32),
        bins=np.zeros(n, dtype=np.uint64),
        labels=np.zeros(n, dtype=np.int32),
        sums=np.zeros((n, 8)),
        stack=np.zeros(n, dtype=np.int32),
    )


def points_for(beams: int) -> int:
    """Room that the end points of a scan need, filled up to a whole number of `LANES`."""
    return beams + LANES - 1


@inner
def gate(dx_m: float, dy_m: float, dyaw_rad: float, q: Any) -> bool:
    """Whether the robot moved enough since the last update: tested per axis of the odometry frame, as AMCL does."""
    return bool(abs(dx_m) > q.update_min_d or abs(dy_m) > q.update_min_d or abs(dyaw_rad) > q.update_min_a)


@inner
def spread(cloud: Cloud, n: int, stream: Any, x_m: float, y_m: float, yaw_rad: float, covariance: Any) -> None:
    """Draw `n` particles of equal weight round a pose; `covariance` (4,) is of xx, xy, yy (m²) and yaw (rad²)."""
    particles, draws, weights = cloud.particles, cloud.resampled, cloud.weights
    # Cholesky's factor of the covariance; AMCL takes the eigenvectors, which spreads the same cloud by other numbers.
    xx = math.sqrt(covariance[0])
    xy = covariance[1] / xx if xx > 0.0 else 0.0
    yy = math.sqrt(max(covariance[2] - xy * xy, 0.0))
    turn = math.sqrt(covariance[3])
    for axis in range(3):
        normals(stream, draws[axis, :n])
    for k in range(n):
        particles[0, k] = x_m + xx * draws[0, k]
        particles[1, k] = y_m + xy * draws[0, k] + yy * draws[1, k]
        particles[2, k] = yaw_rad + turn * draws[2, k]
        weights[k] = 1.0 / n


@inner
def move(
    cloud: Cloud, n: int, stream: Any, dx_m: float, dy_m: float, old_yaw_rad: float, dyaw_rad: float, q: Any
) -> None:
    """DifferentialMotionModel: move `n` particles by an odometry step with noise that grows with the step.

    Both noisy turns are wrapped and the yaw is not. Driving backwards makes the turns ±π, so the noise moves
    particles by whole turns against each other, which puts them into different bins and clusters: AMCL's own quirk.
    """
    trans = math.sqrt(dx_m * dx_m + dy_m * dy_m)
    # Below a centimeter the direction of a step is noise, and the robot is taken to turn in place (AMCL).
    rot1 = 0.0 if trans < 0.01 else wrapped(math.atan2(dy_m, dx_m) - old_yaw_rad)
    rot2 = wrapped(dyaw_rad - rot1)
    # A turn of nearly π is driving backwards, not turning: its noise is that of the small turn that is left.
    n1 = min(abs(rot1), abs(wrapped(rot1 - math.pi)))
    n2 = min(abs(rot2), abs(wrapped(rot2 - math.pi)))
    s1 = math.sqrt(q.alpha1 * n1 * n1 + q.alpha2 * trans * trans)
    st = math.sqrt(q.alpha3 * trans * trans + q.alpha4 * n1 * n1 + q.alpha4 * n2 * n2)
    s2 = math.sqrt(q.alpha1 * n2 * n2 + q.alpha2 * trans * trans)
    for axis in range(3):
        normals(stream, cloud.resampled[axis, :n])
    _drive(cloud.particles, cloud.resampled, n, (rot1, trans, rot2), (s1, st, s2))


@inner
def move_omni(
    cloud: Cloud, n: int, stream: Any, dx_m: float, dy_m: float, old_yaw_rad: float, dyaw_rad: float, q: Any
) -> None:
    """OmniMotionModel: the step goes along its own bearing, with noise along it, across it and in the turn."""
    square = dx_m * dx_m + dy_m * dy_m
    bearing = wrapped(math.atan2(dy_m, dx_m) - old_yaw_rad)
    turned = dyaw_rad * dyaw_rad
    along = math.sqrt(q.alpha3 * square + q.alpha4 * turned)
    turn = math.sqrt(q.alpha1 * turned + q.alpha2 * square)
    across = math.sqrt(q.alpha4 * turned + q.alpha5 * square)
    for axis in range(3):
        normals(stream, cloud.resampled[axis, :n])
    _glide(cloud.particles, cloud.resampled, n, (bearing, math.sqrt(square), dyaw_rad), (along, turn, across))


@inner
def _glide(particles: Any, draws: Any, n: int, step: Any, sigma: Any) -> None:
    """Go along a bearing by `step` and `sigma` times the standard normal numbers (3, N) drawn for it, and turn."""
    for k in range(n):
        driven, aside = step[1] + sigma[0] * draws[0, k], sigma[2] * draws[2, k]
        sine, cosine = sincos(particles[2, k] + step[0])
        particles[0, k] += driven * cosine + aside * sine
        particles[1, k] += driven * sine - aside * cosine
        particles[2, k] += step[2] + sigma[1] * draws[1, k]


@inner
def _drive(particles: Any, draws: Any, n: int, step: Any, sigma: Any) -> None:
    """Turn, go and turn by `step` less `sigma` times the standard normal numbers (3, N) drawn for it."""
    for k in range(n):
        # Wrapped by rounding, where AMCL takes the arc tangent of sine and cosine, which costs more.
        turn = _whole_turns_off(step[0] - sigma[0] * draws[0, k])
        driven = step[1] - sigma[1] * draws[1, k]
        sine, cosine = sincos(particles[2, k] + turn)
        particles[0, k] += driven * cosine
        particles[1, k] += driven * sine
        particles[2, k] += turn + _whole_turns_off(step[2] - sigma[2] * draws[2, k])


@inner
def _whole_turns_off(angle_rad: float) -> float:
    """The angle in [-π, π], without a branch."""
    return angle_rad - 2.0 * math.pi * rounded(angle_rad * (0.5 / math.pi))


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
"""Offsets of a bin's 27 neighbors from the key of the lowest one."""


@inner
def kld_limit(bins: int, q: Any) -> int:
    """Particles needed for `bins` occupied bins (Fox 2001; `pf_z` is used as the normal quantile itself)."""
    if bins <= 1:
        return int(q.max_particles)
    # Wilson and Hilferty's approximation of the chi-square quantile, as in Fox 2001.
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
    # The limit grows with the bins that are met, so it is asked anew for each new bin alone.
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
        # What clusters and covariance need is summed here: the particles pass through the cache once.
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
    """Compute the cumulative sum of `n` weights with an index by shares of it; return the total."""
    total = 0.0
    for k in range(n):
        total += weights[k]
        cumulative[k] = total
    cumulative[n - 1] = np.inf  # beyond any draw, whatever the rounding
    for share in range(GUIDE + 1):
        guide[share] = 0
    # An index by equal shares replaces a binary search, whose branches are guessed wrongly half of the time.
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
    """Return the particle that a number in [0, 1) selects from the cumulative weights."""
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
    return (
        np.uint64(int(x_m * (1.0 / BIN_M) + _MIDDLE)) * _X
        + np.uint64(int(y_m * (1.0 / BIN_M) + _MIDDLE)) * _Y
        + np.uint64(int(yaw_rad * (1.0 / BIN_RAD) + _MIDDLE)) * _YAW
    )


@inner
def _slot(slots: Any, key: Any) -> Any:
    """Return the slot of a bin in the hash table, or the free slot for it."""
    mask = np.uint64(slots.shape[0] - 1)
    # Fibonacci hashing: the golden ratio's bits spread neighboring bins, and the upper bits are the ones that are
    # mixed.
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
            # Keys of neighbors are sums of keys, as the fields are wide enough that none runs over into the next.
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
            # AMCL reports the heaviest cluster's mean, so the estimate may jump between clusters; the mean of all would
            # lie between them.
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
