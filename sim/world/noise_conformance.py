"""Conformance checks of lidar noise, for authors' tests."""

import functools
import math
from collections.abc import Callable
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vastflow.sim.kernels.binding import Bound, Running
from vastflow.sim.kernels.conformance import SEED, allocations_of, guarded, least_us, must_at
from vastflow.sim.kernels.numeric import njit
from vastflow.sim.world.lidar import perturb, running_noise
from vastflow.sim.world.noise import LidarNoise, Scan
from vastflow.sim.world.robot_model import Lidar

MOST_US: Final = 500.0
"""CPU time of a scan; 10 scans a simulated second then take 5 ms."""


def check_lidar_noise(noise: LidarNoise) -> None:
    """Run all `CHECKS` on `noise`; raise an `AssertionError` with place, actual, and expected behavior."""
    for check in CHECKS:
        check(noise)


def check_ranges(noise: LidarNoise) -> None:
    """Check that it compiles, raises nothing, and gives ranges or `inf` for unchanged directions."""
    for name, given in _scans().items():
        directions = given.directions.copy()
        _perturb(_started(noise), given)
        _must(not np.isnan(given.ranges_m).any(), noise, f"must give ranges, or inf, found NaN in {name!r}")
        _must(np.array_equal(given.directions, directions), noise, f"must change ranges alone in {name!r}")


def check_determinism(noise: LidarNoise) -> None:
    """Check that equal random numbers give equal ranges, whatever other scanners see."""
    one, other = _started(noise), _started(noise, SEED + 1)
    alone = [_perturb(one, given).tobytes() for given in _scans().values()]
    again = _started(noise)
    together = []
    for given, foreign in zip(_scans().values(), _scans().values(), strict=True):
        _perturb(other, foreign)
        together.append(_perturb(again, given).tobytes())
    right = "must perturb the same again. It keeps something outside of its memory, or draws from elsewhere than its stream."
    _must(alone == together, noise, right)


def check_allocations(noise: LidarNoise) -> None:
    """Check that a call allocates nothing."""
    found = _started(noise)
    for name, given in _scans().items():
        each = allocations_of(lambda times, given=given: _perturb(found, given, times))  # type: ignore[misc]
        right = f"must allocate nothing in a call, got {each:g} allocations in {name!r}. Keep arrays in its memory."
        _must(each == 0, noise, right)


def check_time(noise: LidarNoise, most_us: float = MOST_US) -> None:
    """Check that the fastest of several scans takes at most `most_us` of CPU time."""
    found, given = _started(noise), _scans()["a room"]
    took_us = least_us(lambda: _perturb(found, given))
    _must(took_us <= most_us, noise, f"must take at most {most_us:g} µs a scan, took {took_us:.0f}")


CHECKS: Final[tuple[Callable[[LidarNoise], None], ...]] = (
    check_ranges,
    check_determinism,
    check_allocations,
    check_time,
)
"""All checks, for a parametrized test."""


def _scans() -> dict[str, Scan]:
    """Return scans of a room, of nothing, of a near wall, and of a single beam."""
    lidar = Lidar()
    directions = lidar.directions()
    limits = lidar.range_min_m, lidar.range_max_m
    room = 3.0 + np.abs(directions[:, 0])
    room[::7] = math.inf
    return {
        "a room": Scan(room, directions, *limits),
        "no return": Scan(np.full(lidar.beams, math.inf), directions, *limits),
        "the least range": Scan(np.full(lidar.beams, lidar.range_min_m), directions, *limits),
        "one beam": Scan(np.array([2.0]), directions[:1].copy(), *limits),
    }


@njit
def _repeated(bound: Bound, given: Scan, times: int) -> None:
    for _ in range(times):
        perturb(bound, given)


def _started(noise: LidarNoise, seed: int = SEED) -> Running[LidarNoise]:
    stream = np.array([seed], dtype=np.uint64)
    return guarded(noise, "perturb", lambda: running_noise(noise, stream, Lidar().beams))


def _perturb(found: Running[LidarNoise], given: Scan, times: int = 1) -> NDArray[np.float64]:
    guarded(found.plug_in, "perturb", lambda: _repeated(found.bound, given, times))
    ranges: Any = given.ranges_m
    return np.array(ranges)


_must = functools.partial(must_at, "perturb")
