"""AMCL's particles: a cloud's memory, how it is spread round a pose, and how odometry moves it.

Kernels work on preallocated arrays. Each step is cut into loops without branches, which run on vector units, and
short ones with them.
"""

import math
from typing import Any, Final, NamedTuple

import numpy as np

from vastflow.sim.kernels.numeric import inner
from vastflow.sim.kernels.sincos import rounded, sincos
from vastflow.sim.kernels.ziggurat import normals
from vastflow.sim.world.robot import wrapped

GUIDE: Final = 2048
LANES: Final = 4
"""Beams that are looked up at a time."""


class Cloud(NamedTuple):
    """A particle filter's memory for at most N particles.

    Attributes:
        particles, resampled: (3, N) float64 of x, y, yaw; yaw is not wrapped.
        headings: (2, N) float64: cos and sin of each yaw, from weighting.
        weights: (N,) float64, normalized; `cumulative` their running sum.
        guide: (GUIDE + 1,) int32: for each of GUIDE equal shares of weight, a particle at or before the first in it.
        frames: (4, N) x, y in cells of the likelihood table, cos and sin of each particle; float32 in the loop.
        likelihoods: (N,) of the same type: 1 + Σ pz³.
        points: (2, B) of the same type: end points of beams in the robot's frame, in cells.
        indices, unsigned: (4, N) int32 scratch, and its bytes as uint32, which spare the test for negative indices.
        slots, entries: (S,) uint64 and int32: hash table from a bin's key (0 where empty) to its number.
        bins: (N,) uint64 keys in order of discovery; `labels` (N,) int32 their clusters, -1 while none.
        sums: (N, 8) float64: weight, x, y, cos, sin, xx, xy, yy of a bin's particles.
        stack: (N,) int32 scratch of the clustering.
    """

    particles: Any
    resampled: Any
    headings: Any
    weights: Any
    cumulative: Any
    guide: Any
    frames: Any
    likelihoods: Any
    points: Any
    indices: Any
    unsigned: Any
    slots: Any
    entries: Any
    bins: Any
    labels: Any
    sums: Any
    stack: Any


def new_cloud(
    max_particles: int,
    beams: int = 360,
    dtype: type[np.floating[Any]] = np.float32,
) -> Cloud:
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
    """Draw `n` particles of equal weight round a pose.

    Args:
        covariance: (4,) xx, xy, yy (m²) and yaw (rad²).
    """
    particles, draws, weights = cloud.particles, cloud.resampled, cloud.weights
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
    rot1 = 0.0 if trans < 0.01 else wrapped(math.atan2(dy_m, dx_m) - old_yaw_rad)
    rot2 = wrapped(dyaw_rad - rot1)
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
