"""AMCL: particles over the map, weighted by the likelihood field, resampled by KLD (Nav2's nav2_amcl).

Kernels work on preallocated arrays; a cloud is (3, max_particles) float64 of x, y, yaw, all of equal weight
after each resampling.
"""

import math
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from vastflow.sim.numeric import inner, njit
from vastflow.sim.robot import wrapped
from vastflow.sim.streams import normal_pair, uniform

BIN_M: Final = 0.5
BIN_RAD: Final = math.radians(10.0)
MAX_BINS: Final = 4096
SLOTS: Final = 4 * MAX_BINS
GUIDE: Final = 2048
MAX_BEAMS: Final = 1024


class Cloud(NamedTuple):
    """A particle filter's memory.

    Attributes:
        particles, resampled: (3, max_particles) float64.
        headings: (2, max_particles) float64: cos and sin of each yaw, from weighting.
        weights: (max_particles,) float64, cumulative after weighting.
        guide: (GUIDE + 1,) int64: for each of GUIDE equal shares, the first particle whose weight ends in or behind it.
        bins: (MAX_BINS, 4) int64: x, y, yaw bin and cluster label (-1: none yet).
        bin_sums: (MAX_BINS, 5) float64: weight, x, y, cos, sin.
        slots: (SLOTS,) int64 hash table of bin index + 1, 0 where empty.
        stack: (MAX_BINS,) int64 scratch of the clustering.
        cells: (MAX_BEAMS,) int32 scratch of the weighting.
    """

    particles: Any
    resampled: Any
    headings: Any
    weights: Any
    guide: Any
    bins: Any
    bin_sums: Any
    slots: Any
    stack: Any
    cells: Any


def new_cloud(max_particles: int) -> Cloud:
    """An empty cloud."""
    return Cloud(
        np.zeros((3, max_particles)),
        np.zeros((3, max_particles)),
        np.zeros((2, max_particles)),
        np.zeros(max_particles),
        np.zeros(GUIDE + 1, dtype=np.int64),
        np.zeros((MAX_BINS, 4), dtype=np.int64),
        np.zeros((MAX_BINS, 5)),
        np.zeros(SLOTS, dtype=np.int64),
        np.zeros(MAX_BINS, dtype=np.int64),
        np.zeros(MAX_BEAMS, dtype=np.int32),
    )


def likelihood_cubed(
    occupied: NDArray[np.bool_],
    resolution_m: float,
    *,
    range_max_m: float,
    z_hit: float,
    z_rand: float,
    sigma_hit_m: float,
    likelihood_max_dist_m: float,
) -> NDArray[np.float32]:
    """pz³ of a beam that ends in each cell; (H + 2, W + 2) float32 with a frame for beams that end off the map.

    pz = z_hit exp(-d² / 2σ²) + z_rand / range_max, d the distance to the nearest occupied cell, capped.
    """
    if occupied.any():
        distance_m = np.minimum(ndimage.distance_transform_edt(~occupied) * resolution_m, likelihood_max_dist_m)
    else:
        distance_m = np.full(occupied.shape, likelihood_max_dist_m)

    def cubed(d_m: Any) -> Any:
        return (z_hit * np.exp(-(d_m**2) / (2 * sigma_hit_m**2)) + z_rand / range_max_m) ** 3

    framed = np.pad(distance_m, 1, constant_values=likelihood_max_dist_m)
    return np.asarray(cubed(framed), dtype=np.float32)


@njit
def gate(dx_m: float, dy_m: float, dyaw_rad: float, update_min_d: float, update_min_a: float) -> bool:
    """Whether the robot moved enough since the last update: tested per axis of the odometry frame, as AMCL does."""
    return abs(dx_m) > update_min_d or abs(dy_m) > update_min_d or abs(dyaw_rad) > update_min_a


@inner
def move(
    particles: Any,
    n: int,
    stream: Any,
    dx_m: float,
    dy_m: float,
    old_yaw_rad: float,
    dyaw_rad: float,
    alpha1: float,
    alpha2: float,
    alpha3: float,
    alpha4: float,
) -> None:
    """DifferentialMotionModel: move `n` particles by an odometry step with noise that grows with the step."""
    trans = math.sqrt(dx_m * dx_m + dy_m * dy_m)
    rot1 = 0.0 if trans < 0.01 else wrapped(math.atan2(dy_m, dx_m) - old_yaw_rad)
    rot2 = wrapped(dyaw_rad - rot1)
    n1 = min(abs(rot1), abs(wrapped(rot1 - math.pi)))
    n2 = min(abs(rot2), abs(wrapped(rot2 - math.pi)))
    s1 = math.sqrt(alpha1 * n1 * n1 + alpha2 * trans * trans)
    st = math.sqrt(alpha3 * trans * trans + alpha4 * n1 * n1 + alpha4 * n2 * n2)
    s2 = math.sqrt(alpha1 * n2 * n2 + alpha2 * trans * trans)
    spare = 0.0
    for k in range(n):
        a, b = normal_pair(stream)
        if k % 2 == 0:
            c, spare = normal_pair(stream)
        else:
            c = spare
        r1, t, r2 = rot1 - s1 * a, trans - st * b, rot2 - s2 * c
        heading = particles[2, k] + r1
        particles[0, k] += t * math.cos(heading)
        particles[1, k] += t * math.sin(heading)
        particles[2, k] += r1 + r2


@njit
def beam_points(
    ranges_m: Any,
    max_beams: int,
    directions: Any,
    sensor_x_m: float,
    sensor_y_m: float,
    range_min_m: float,
    range_max_m: float,
    out: Any,
) -> int:
    """End points (2, M) in the robot's frame of the beams that AMCL uses; their number.

    Every ((N - 1) div (max_beams - 1))-th beam; a reading at or below the minimum counts as the maximum, and one at
    or above the maximum (or NaN) is skipped.
    """
    beams = ranges_m.shape[0]
    step = max(1, (beams - 1) // (max_beams - 1))
    n = 0
    for b in range(0, beams, step):
        reading = ranges_m[b]
        if reading <= range_min_m:
            reading = range_max_m
        if not reading < range_max_m or n == out.shape[1]:
            continue
        out[0, n] = sensor_x_m + reading * directions[b, 0]
        out[1, n] = sensor_y_m + reading * directions[b, 1]
        n += 1
    return n


@njit
def weight_of(
    x_m: float,
    y_m: float,
    cos_yaw: float,
    sin_yaw: float,
    points: Any,
    n_points: int,
    cubed: Any,
    resolution_m: float,
    origin_x_m: float,
    origin_y_m: float,
    cells: Any,
) -> float:
    """Unnormalised weight 1 + Σ pz³ of one pose.

    The cell of an end point is found by rounding: AMCL takes the map's origin as the centre of cell 0.

    Args:
        points: (2, M) end points in the robot's frame; the first `n_points` count.
        cubed: Table with its frame, from `likelihood_cubed`.
        cells: (M,) int32 scratch.
    """
    columns = cubed.shape[1]
    last_x, last_y = columns - 1.0, cubed.shape[0] - 1.0
    c, s = cos_yaw / resolution_m, sin_yaw / resolution_m
    x0 = (x_m - origin_x_m) / resolution_m + 1.5
    y0 = (y_m - origin_y_m) / resolution_m + 1.5
    # Two loops: the first has no branch and no gather, so that it runs on vector units.
    for k in range(n_points):
        fx = min(max(x0 + c * points[0, k] - s * points[1, k], 0.0), last_x)
        fy = min(max(y0 + s * points[0, k] + c * points[1, k], 0.0), last_y)
        cells[k] = np.int32(fy) * np.int32(columns) + np.int32(fx)
    flat = cubed.ravel()
    total = 1.0
    for k in range(n_points):
        total += flat[cells[k]]
    return total


@inner
def weigh(
    cloud: Cloud,
    n: int,
    points: Any,
    n_points: int,
    cubed: Any,
    resolution_m: float,
    origin_x_m: float,
    origin_y_m: float,
) -> None:
    """Cumulative, normalised weights of `n` equally weighted particles."""
    total = 0.0
    for k in range(n):
        cloud.headings[0, k], cloud.headings[1, k] = math.cos(cloud.particles[2, k]), math.sin(cloud.particles[2, k])
        total += weight_of(
            cloud.particles[0, k],
            cloud.particles[1, k],
            cloud.headings[0, k],
            cloud.headings[1, k],
            points,
            n_points,
            cubed,
            resolution_m,
            origin_x_m,
            origin_y_m,
            cloud.cells,
        )
        cloud.weights[k] = total
    for k in range(n):
        cloud.weights[k] /= total
    k = 0
    for share in range(GUIDE):
        while k < n - 1 and cloud.weights[k] <= share / GUIDE:
            k += 1
        cloud.guide[share] = k


@njit
def kld_limit(bins: int, min_particles: int, max_particles: int, pf_err: float, pf_z: float) -> int:
    """Particles needed for `bins` occupied bins (Fox 2001; `pf_z` is used as the normal quantile itself)."""
    if bins <= 1:
        return max_particles
    b = 2.0 / (9.0 * (bins - 1))
    x = 1.0 - b + math.sqrt(b) * pf_z
    needed = math.ceil((bins - 1) / (2.0 * pf_err) * x * x * x)
    return min(max(needed, min_particles), max_particles)


@inner
def resample(
    cloud: Cloud, n: int, stream: Any, min_particles: int, max_particles: int, pf_err: float, pf_z: float
) -> Any:
    """Multinomial resampling until enough for the bins occupied so far: (particles, bins) now in the cloud."""
    for k in range(SLOTS):
        cloud.slots[k] = 0
    bins, count, needed = 0, 0, max_particles
    while count < max_particles:
        draw = uniform(stream)
        k = cloud.guide[int(draw * GUIDE)]
        while k < n - 1 and cloud.weights[k] <= draw:
            k += 1
        x, y, yaw = cloud.particles[0, k], cloud.particles[1, k], cloud.particles[2, k]
        cloud.resampled[0, count], cloud.resampled[1, count], cloud.resampled[2, count] = x, y, yaw
        count += 1
        bx, by, bt = math.floor(x / BIN_M), math.floor(y / BIN_M), math.floor(yaw / BIN_RAD)
        slot = _slot(cloud, bx, by, bt)
        if cloud.slots[slot] == 0:
            if bins < MAX_BINS:
                cloud.bins[bins, 0], cloud.bins[bins, 1], cloud.bins[bins, 2], cloud.bins[bins, 3] = bx, by, bt, -1
                for j in range(5):
                    cloud.bin_sums[bins, j] = 0.0
                bins += 1
                cloud.slots[slot] = bins
                needed = kld_limit(bins, min_particles, max_particles, pf_err, pf_z)
            else:
                continue
        entry = cloud.slots[slot] - 1
        cloud.bin_sums[entry, 0] += 1.0
        cloud.bin_sums[entry, 1] += x
        cloud.bin_sums[entry, 2] += y
        cloud.bin_sums[entry, 3] += cloud.headings[0, k]
        cloud.bin_sums[entry, 4] += cloud.headings[1, k]
        if count > needed:
            break
    for axis in range(3):
        for k in range(count):
            cloud.particles[axis, k] = cloud.resampled[axis, k]
    return count, bins


@inner
def _slot(cloud: Cloud, bx: int, by: int, bt: int) -> int:
    """Where a bin is, or would be put, in the hash table."""
    slot = (bx * 73856093 ^ by * 19349663 ^ bt * 83492791) & (SLOTS - 1)
    while cloud.slots[slot] != 0:
        entry = cloud.slots[slot] - 1
        if cloud.bins[entry, 0] == bx and cloud.bins[entry, 1] == by and cloud.bins[entry, 2] == bt:
            return slot
        slot = (slot + 1) & (SLOTS - 1)
    return slot


@inner
def heaviest_cluster(cloud: Cloud, bins: int) -> Any:
    """Mean pose (x, y, yaw) of the heaviest 26-connected cluster of bins; yaw bins do not wrap, as in AMCL."""
    stack = cloud.stack
    best_weight, best = -1.0, (0.0, 0.0, 0.0)
    label = 0
    for first in range(bins):
        if cloud.bins[first, 3] >= 0:
            continue
        w, x, y, c, s = 0.0, 0.0, 0.0, 0.0, 0.0
        cloud.bins[first, 3] = label
        stack[0] = first
        depth = 1
        while depth > 0:
            depth -= 1
            k = stack[depth]
            w += cloud.bin_sums[k, 0]
            x += cloud.bin_sums[k, 1]
            y += cloud.bin_sums[k, 2]
            c += cloud.bin_sums[k, 3]
            s += cloud.bin_sums[k, 4]
            for i in range(27):
                slot = _slot(
                    cloud,
                    cloud.bins[k, 0] + i % 3 - 1,
                    cloud.bins[k, 1] + i // 3 % 3 - 1,
                    cloud.bins[k, 2] + i // 9 - 1,
                )
                if cloud.slots[slot] != 0 and cloud.bins[cloud.slots[slot] - 1, 3] < 0:
                    cloud.bins[cloud.slots[slot] - 1, 3] = label
                    stack[depth] = cloud.slots[slot] - 1
                    depth += 1
        label += 1
        if w > best_weight:
            best_weight, best = w, (x / w, y / w, math.atan2(s, c))
    return best
