"""AMCL from Python: weights of poses, a filter fed with odometry and scans, and its errors on drives."""

import math
from collections.abc import Callable
from itertools import pairwise
from types import SimpleNamespace

import amcl_accuracy as accuracy
import numpy as np
import pandas as pd
import pytest
from amcl_filter import Filter, weight
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage
from table import each_row

from vastflow.sim.nav2.amcl.sensor import _beam_points
from vastflow.sim.world.lidar import scan
from vastflow.sim.world.occupancy import OccupancyMap
from vastflow.sim.world.robot_model import Lidar
from vastflow.sim.world.skip_table import skip_table_of

LIDAR = Lidar()
BEAMS = {
    "angle_min_rad": LIDAR.angle_min_rad,
    "angle_increment_rad": LIDAR.angle_increment_rad,
    "range_min_m": LIDAR.range_min_m,
    "range_max_m": LIDAR.range_max_m,
}
RESOLUTION_M = 0.05


def place(occupied, origin_xy_m=(0.0, 0.0)):
    return {"occupied": occupied, "resolution_m": RESOLUTION_M, "origin_xy_m": origin_xy_m}


def looked(occupied, pose_xyt, origin_xy_m=(0.0, 0.0)):
    """The minimal TurtleBot 4's scan at a pose."""
    x, y, yaw = pose_xyt
    ranges_m = np.empty(LIDAR.beams)
    mount_m = LIDAR.mount_xyt[0]
    sensor = (x + mount_m * math.cos(yaw), y + mount_m * math.sin(yaw), yaw)
    limits = (LIDAR.range_min_m, LIDAR.range_max_m)
    skips = skip_table_of(np.ascontiguousarray(occupied))
    scan(skips, RESOLUTION_M, *origin_xy_m, np.zeros((0, 7)), sensor, LIDAR.directions(), *limits, ranges_m)
    return ranges_m


def frame_of(rows, columns, thick=1, margin=4):
    """A room of free cells with walls `thick` cells wide, and as unknown cells round it."""
    occupied = np.zeros((rows + 2 * margin, columns + 2 * margin), dtype=np.bool_)
    occupied[margin - thick : margin + rows + thick, margin - thick : margin + columns + thick] = True
    occupied[margin : margin + rows, margin : margin + columns] = False
    return occupied


@pytest.fixture(scope="module")
def room():
    """A room of 5 m × 4 m with two pillars; its free space begins at (0.2, 0.2)."""
    occupied = frame_of(80, 100)
    occupied[30:38, 30:36] = True
    occupied[60:64, 80:90] = True
    return occupied


def weight_by_hand(pose_xyt, ranges_m, laser_xyt, occupied, origin_xy_m, max_beams, range_max_m):
    """1 + Σ pz³ as the likelihood field model has it, beam by beam, with Euclidean distances."""
    distances = ndimage.distance_transform_edt(~occupied) * RESOLUTION_M
    x, y, yaw = pose_xyt
    laser_x = x + laser_xyt[0] * math.cos(yaw) - laser_xyt[1] * math.sin(yaw)
    laser_y = y + laser_xyt[0] * math.sin(yaw) + laser_xyt[1] * math.cos(yaw)
    total = 1.0
    for b in range(0, len(ranges_m), max(1, (len(ranges_m) - 1) // (max_beams - 1))):
        reading = range_max_m if ranges_m[b] <= 0.164 else ranges_m[b]
        if not reading < range_max_m:
            continue
        bearing = yaw + laser_xyt[2] + b * LIDAR.angle_increment_rad
        column = math.floor((laser_x + reading * math.cos(bearing) - origin_xy_m[0]) / RESOLUTION_M + 0.5)
        row = math.floor((laser_y + reading * math.sin(bearing) - origin_xy_m[1]) / RESOLUTION_M + 0.5)
        inside = 0 <= row < occupied.shape[0] and 0 <= column < occupied.shape[1]
        away_m = min(distances[row, column], 2.0) if inside else 2.0
        total += (0.5 * math.exp(-(away_m**2) / (2 * 0.2**2)) + 0.5 / range_max_m) ** 3
    return total


@given(
    x=st.floats(-1.0, 7.0),
    y=st.floats(-1.0, 6.0),
    yaw=st.floats(-7.0, 7.0),
    laser=st.tuples(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3), st.floats(-3.2, 3.2)),
    beams=st.integers(2, 400),
    max_beams=st.integers(2, 80),
    range_max_m=st.floats(1.0, 30.0),
    seed=st.integers(0, 2**32),
)
@settings(deadline=None, max_examples=60)
def test_weight_follows_likelihood_field_for_any_pose_scan_and_scanner(
    x, y, yaw, laser, beams, max_beams, range_max_m, seed
):
    rng = np.random.default_rng(seed)
    occupied = np.zeros((70, 90), dtype=np.bool_)
    occupied[20, 15:60] = True  # one straight wall, to which every way of measuring gives the same distance
    ranges_m = rng.uniform(-0.5, 8.0, beams)
    ranges_m[rng.random(beams) < 0.1] = np.inf
    ranges_m[rng.random(beams) < 0.1] = np.nan
    origin, seen = (-1.3, 0.7), {"pose_xyt": (x, y, yaw), "ranges_m": ranges_m, "laser_xyt": laser}
    beams = {**BEAMS, "range_max_m": range_max_m, "max_beams": max_beams}
    expected = weight_by_hand(*seen.values(), occupied, origin, max_beams, range_max_m)
    assert weight(**seen, **beams, **place(occupied, origin)) == pytest.approx(expected, abs=1e-6)


@each_row("occupied", [np.zeros((20, 20), dtype=np.bool_), np.ones((1, 1), dtype=np.bool_)])
def test_weight_is_finite_on_maps_without_walls_or_of_one_cell(occupied):
    origin = {"pose_xyt": (0.0, 0.0, 0.0), "laser_xyt": (0.0, 0.0, 0.0)}
    assert 1.0 < weight(ranges_m=[0.3], **origin, **BEAMS, **place(occupied)) < 1.2


@each_row(
    ("offset", "upstream", "tolerance"),
    [
        ((0.0, 0.0, 0.0), 9.31, 0.01),
        ((0.5, 0.0, 0.0), 8.80, 0.02),
        ((1.0, 0.0, 0.0), 8.76, 0.02),
        ((0.0, 0.1, 0.0), 6.15, 0.03),
        ((0.0, 0.2, 0.0), 2.89, 0.05),
        ((0.0, 0.0, 0.1), 7.72, 0.05),
    ],
)
def test_corridor_weights_match_nav2(offset, upstream, tolerance):
    """Along a corridor of 12 m × 1 m between walls one cell thick."""
    occupied, origin, pose = frame_of(20, 240, margin=20), (-1.0, -1.0), (5.0, 0.5, 0.05)
    arguments = {"ranges_m": looked(occupied, pose, origin), "laser_xyt": LIDAR.mount_xyt, **BEAMS}
    found = weight(pose_xyt=tuple(np.add(pose, offset)), **arguments, **place(occupied, origin))
    assert found == pytest.approx(upstream, rel=tolerance)


START = (2.6, 2.1, 0.4)


@pytest.fixture
def filters(room) -> Callable[..., Filter]:
    """A filter whose pose is set, with a covariance."""

    def make(covariance, pose=START, **parameters):
        amcl = Filter(laser_xyt=LIDAR.mount_xyt, seed=3, **place(room), **parameters)
        amcl.set_pose(pose, covariance)
        return amcl

    return make


def updated(amcl, room, driven_m=0.0):
    """An update straight ahead of the start, its odometry beginning at 0."""
    x, y, yaw = START
    truth = (x + driven_m * math.cos(yaw), y + driven_m * math.sin(yaw), yaw)
    return amcl.update((driven_m, 0.0, 0.0), looked(room, truth), *BEAMS.values())


def test_first_update_resamples_where_the_pose_was_set(filters, room):
    amcl = filters(np.zeros((3, 3)))
    pose, covariance = updated(amcl, room)
    np.testing.assert_allclose(pose, START, atol=1e-9)
    np.testing.assert_allclose(covariance, 0.0, atol=1e-9)
    assert amcl.particles.shape == (2000, 3)
    np.testing.assert_allclose(amcl.particles, np.tile(START, (2000, 1)))
    assert amcl.weights.sum() == pytest.approx(1.0)


def test_second_updates_resample_with_an_interval_of_two(filters, room):
    amcl = filters([0.1, 0.1, 0.05], resample_interval=2)
    pose, covariance = updated(amcl, room)
    np.testing.assert_allclose(pose, START)
    np.testing.assert_allclose(np.diag(covariance), [0.1, 0.1, 0.05])
    assert amcl.weights.sum() == pytest.approx(1.0)
    assert np.ptp(amcl.weights) > 0.0
    assert updated(amcl, room, 0.3) is not None
    assert np.ptp(amcl.weights) == 0.0
    assert updated(amcl, room, 0.6) is None
    assert np.ptp(amcl.weights) > 0.0


def test_filter_weights_match_single_pose_weights(filters, room):
    """In four bytes a beam that ends on the very edge of a cell may fall into the next one."""
    amcl = filters([0.2, 0.2, 0.5], resample_interval=2)
    updated(amcl, room)
    arguments = {"ranges_m": looked(room, START), "laser_xyt": LIDAR.mount_xyt, **BEAMS, **place(room)}
    alone = np.array([weight(pose_xyt=pose, **arguments) for pose in amcl.particles[:60]])
    ratio = amcl.weights[:60] / alone
    assert np.mean(np.abs(ratio / np.median(ratio) - 1.0) < 1e-5) > 0.9
    assert np.ptp(alone) > 3.0


SEEDS = 6


def walled(rows, columns):
    """Return a map of free cells from (0, 0) on with a wall of one cell round them."""
    cells = np.where(frame_of(rows, columns, margin=10), 100, -1).astype(np.int8)
    cells[10 : rows + 10, 10 : columns + 10] = 0
    return OccupancyMap(cells, RESOLUTION_M, (-10 * RESOLUTION_M, -10 * RESOLUTION_M))


def line(*corners):
    """A way through corners with a point each 0.05 m."""
    legs = [np.linspace(a, b, round(np.hypot(*(b - a)) / RESOLUTION_M) + 1) for a, b in pairwise(np.array(corners))]
    return np.concatenate([legs[0], *(leg[1:] for leg in legs[1:])])


@pytest.fixture(scope="module")
def corridor():
    """A corridor of 16 m × 1 m, and 13 m of driving along it."""
    occupancy = walled(20, 320)
    return occupancy, accuracy.drive(occupancy, line((1.5, 0.5), (14.5, 0.5)), Lidar())


@pytest.fixture(scope="module")
def shelved_room():
    """Drive 13 m round the pillar of a shelved_room of 6 m × 5 m that also has a shelf."""
    occupancy = walled(100, 120)
    occupancy.cells[60:68, 65:73] = 100
    occupancy.cells[60:90, 10:15] = 100
    way = line((1.2, 1.2), (4.8, 1.2), (4.8, 3.8), (1.2, 3.8), (1.2, 1.4), (2.2, 1.4))
    return occupancy, accuracy.drive(occupancy, way, Lidar())


@pytest.fixture(scope="module")
def errors():
    """Errors of `SEEDS` filters, measured once for each ground and condition."""
    known = {}

    def measure(ground, **condition):
        occupancy, driven = ground
        key = (id(occupancy), *sorted(condition.items()))
        if key not in known:
            what = accuracy.Condition("", **condition)
            runs = [accuracy.localize(occupancy, driven, Lidar(), what, seed) for seed in range(SEEDS)]
            found = pd.concat([run for run, _ in runs])
            known[key] = {**{name: found[name] for name in found}, "particles": np.concatenate([n for _, n in runs])}
        return known[key]

    return measure


def test_filter_errs_as_measured_with_nav2(shelved_room, corridor, errors):
    """On 17 m of corridors that was 0.20 m, 0.41 m at the 95th percentile, and 0.012 to 0.014 rad."""
    narrow, wide = errors(corridor), errors(shelved_room)
    assert narrow["position_m"].mean() == pytest.approx(0.20, rel=0.3)
    assert np.percentile(narrow["position_m"], 95) == pytest.approx(0.41, rel=0.35)
    assert np.abs(narrow["along_m"]).mean() > 2 * np.abs(narrow["across_m"]).mean()
    assert 0.03 < wide["position_m"].mean() < 0.5 * narrow["position_m"].mean()
    assert np.percentile(wide["position_m"], 95) < 0.21
    for found in (narrow, wide):
        assert found["yaw_rad"].mean() == pytest.approx(0.013, rel=0.3)


def test_noise_and_dropout_hurt_the_filter_as_much_as_they_should(shelved_room, corridor, errors):
    wide, narrow = errors(shelved_room), errors(corridor)
    for noise_m in (0.1, 0.2):  # up to the width of the likelihood
        for ground, exact in ((shelved_room, wide), (corridor, narrow)):
            noisy = errors(ground, noise_m=noise_m)["position_m"].mean()
            assert noisy < 1.3 * exact["position_m"].mean() + 0.02
    assert errors(shelved_room, odometry=0.1)["position_m"].mean() == pytest.approx(wide["position_m"].mean(), rel=0.3)
    assert errors(shelved_room, dropout=0.5)["position_m"].mean() < 1.5 * wide["position_m"].mean()
    assert errors(shelved_room, dropout=0.9)["position_m"].mean() > 2 * wide["position_m"].mean()
    few = errors(corridor, dropout=0.9)
    assert np.abs(few["across_m"]).mean() > 1.5 * np.abs(narrow["across_m"]).mean()


def test_particle_count_adapts_to_uncertainty(shelved_room, errors):
    """Nav2's filter has 500 to 1600 in rooms: all of them where no beam says anything."""
    exact, few = errors(shelved_room)["particles"], errors(shelved_room, dropout=0.9)["particles"]
    assert np.percentile(exact, 5) == 501
    assert 520 < exact.mean() < 1000
    assert few.mean() > 1600
    blind, particles = accuracy.localize(*shelved_room, Lidar(), accuracy.Condition("", dropout=1.0), 0)
    assert min(particles[-10:]) > 1500
    assert 0.1 < blind.position_m.iloc[-1] < 3.0


@each_row(("laser_max_range", "used"), [(-1.0, 2), (0.0, 2), (5.0, 1), (20.0, 2)])
def test_beams_beyond_own_maximum_are_skipped(laser_max_range, used):
    amcl = SimpleNamespace(laser_min_range=-1.0, laser_max_range=laser_max_range, max_beams=3)
    given = SimpleNamespace(amcl=amcl, range_min=0.1, range_max=8.0, mount_x=0.0, mount_y=0.0, resolution=0.05)
    ends = np.zeros((2, 3))
    ahead = np.tile([1.0, 0.0], (3, 1))
    assert _beam_points.py_func(given, np.array([2.0, 6.0, 9.0]), ahead, ends) == used
    assert ends[0, :used].tolist() == pytest.approx([40.0, 120.0][:used])
