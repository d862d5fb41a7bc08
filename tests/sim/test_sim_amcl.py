"""AMCL from Python: the weight of one pose, and a filter fed with odometry and scans."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from amcl_filter import Filter, weight
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage
from table import each_row

from vastflow.sim.world.lidar import scan
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
    scan(skips, RESOLUTION_M, *origin_xy_m, np.zeros((0, 6)), sensor, LIDAR.directions(), *limits, ranges_m)
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


def pz(distance_m, range_max_m=20.0):
    return 0.5 * math.exp(-(distance_m**2) / (2 * 0.2**2)) + 0.5 / range_max_m


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
        total += pz(min(distances[row, column], 2.0) if inside else 2.0, range_max_m) ** 3
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
def test_weight_is_the_likelihood_field_s_whatever_pose_scan_and_scanner(
    x, y, yaw, laser, beams, max_beams, range_max_m, seed
):
    rng = np.random.default_rng(seed)
    occupied = np.zeros((70, 90), dtype=np.bool_)
    occupied[20, 15:60] = True  # one straight wall, to which every way of measuring gives the same distance
    ranges_m = rng.uniform(-0.5, 8.0, beams)
    ranges_m[rng.random(beams) < 0.1] = np.inf
    ranges_m[rng.random(beams) < 0.1] = np.nan
    origin = (-1.3, 0.7)
    beam = {**BEAMS, "range_max_m": range_max_m}
    found = weight(
        pose_xyt=(x, y, yaw),
        ranges_m=ranges_m,
        laser_xyt=laser,
        max_beams=max_beams,
        **beam,
        **place(occupied, origin),
    )
    expected = weight_by_hand((x, y, yaw), ranges_m, laser, occupied, origin, max_beams, range_max_m)
    assert found == pytest.approx(expected, abs=1e-6)


@pytest.fixture(scope="module")
def one_wall_cell():
    """9 × 11 cells, a wall in column 8, row 4."""
    occupied = np.zeros((9, 11), dtype=np.bool_)
    occupied[4, 8] = True
    return occupied


def one_beam(pose_xyt, reading_m, occupied, **values):
    laser = {"laser_xyt": (0.0, 0.0, 0.0), **BEAMS, **values}
    return weight(pose_xyt=pose_xyt, ranges_m=[reading_m], **laser, **place(occupied))


@each_row(("reading_m", "cells_off"), [(0.276, 0), (0.324, 0), (0.274, 1), (0.326, 1), (0.2, 2)])
def test_cell_of_an_end_point_is_found_by_rounding_as_amcl_does(one_wall_cell, reading_m, cells_off):
    """Column 8 is x 0.40..0.45 m of the map; AMCL takes 0.375..0.425 for it."""
    found = one_beam((0.1, 0.2, 0.0), reading_m, one_wall_cell)
    assert found == pytest.approx(1 + pz(0.05 * cells_off) ** 3, abs=1e-9)


@each_row("occupied", [np.zeros((20, 20), dtype=np.bool_), np.ones((1, 1), dtype=np.bool_)])
def test_maps_without_walls_or_of_one_cell_have_weights_too(occupied):
    assert 1.0 < one_beam((0.0, 0.0, 0.0), 0.3, occupied) < 1.2


def corridor_weights():
    """Along a corridor of 12 m × 1 m between walls one cell thick."""
    occupied = frame_of(20, 240, margin=20)
    origin = (-1.0, -1.0)
    x, y, yaw = 5.0, 0.5, 0.05
    ranges_m = looked(occupied, (x, y, yaw), origin)
    arguments = {"ranges_m": ranges_m, "laser_xyt": LIDAR.mount_xyt, **BEAMS, **place(occupied, origin)}

    def at(dx, dy, dyaw):
        return weight(pose_xyt=(x + dx, y + dy, yaw + dyaw), **arguments)

    return at


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
def test_weights_in_a_corridor_are_those_measured_with_nav2(offset, upstream, tolerance):
    assert corridor_weights()(*offset) == pytest.approx(upstream, rel=tolerance)


START = (2.6, 2.1, 0.4)


@pytest.fixture
def filters(room) -> Callable[..., Filter]:
    def make(seed=3, **parameters):
        return Filter(laser_xyt=LIDAR.mount_xyt, seed=seed, **place(room), **parameters)

    return make


def updated(amcl, room, driven_m=0.0):
    """An update straight ahead of the start, its odometry beginning at 0."""
    x, y, yaw = START
    truth = (x + driven_m * math.cos(yaw), y + driven_m * math.sin(yaw), yaw)
    return amcl.update((driven_m, 0.0, 0.0), looked(room, truth), *BEAMS.values())


def test_first_update_resamples_where_the_pose_was_set(filters, room):
    amcl = filters()
    amcl.set_pose(START, np.zeros((3, 3)))
    pose, covariance = updated(amcl, room)
    np.testing.assert_allclose(pose, START, atol=1e-9)
    np.testing.assert_allclose(covariance, 0.0, atol=1e-9)
    assert amcl.particles.shape == (2000, 3)
    np.testing.assert_allclose(amcl.particles, np.tile(START, (2000, 1)))
    assert amcl.weights.sum() == pytest.approx(1.0)


def test_between_the_gates_there_is_no_update(filters, room):
    amcl = filters()
    amcl.set_pose(START, np.zeros(3))
    updated(amcl, room)
    before = amcl.particles
    assert updated(amcl, room, 0.25) is None
    np.testing.assert_array_equal(amcl.particles, before)
    assert updated(amcl, room, 0.26) is not None


def test_filter_follows_a_drive(filters, room):
    amcl = filters()
    amcl.set_pose(START, np.zeros(3))
    for step in range(6):
        pose, covariance = updated(amcl, room, 0.3 * step)
        off_m = np.hypot(
            pose[0] - START[0] - 0.3 * step * math.cos(0.4), pose[1] - START[1] - 0.3 * step * math.sin(0.4)
        )
        assert off_m < 0.25
        assert abs(pose[2] - 0.4) < 0.1
    assert 500 < len(amcl.weights) <= 2000
    assert (np.diag(covariance) > 0.0).all()
    np.testing.assert_array_equal(covariance, covariance.T)


def test_published_covariance_is_that_of_the_particles(filters, room):
    amcl = filters()
    amcl.set_pose(START, [0.2, 0.3, 0.1])
    _, covariance = updated(amcl, room)
    x, y, yaw = amcl.particles.T
    np.testing.assert_allclose(covariance[:2, :2], np.cov(x, y, bias=True), rtol=1e-6)
    assert covariance[2, 2] == pytest.approx(-2 * math.log(abs(np.exp(1j * yaw).mean())), rel=1e-6)
    assert covariance[0, 2] == covariance[1, 2] == 0.0


def test_uncertain_pose_is_drawn_to_where_the_scan_fits(filters, room):
    amcl = filters()
    amcl.set_pose((START[0] + 0.15, START[1] - 0.1, START[2] + 0.1), [0.04, 0.04, 0.04])
    for step in range(8):
        pose, _ = updated(amcl, room, 0.26 * step)
    end = np.array(START) + 0.26 * 7 * np.array([math.cos(0.4), math.sin(0.4), 0.0])
    np.testing.assert_allclose(pose, end, atol=0.15)


def test_full_covariance_and_its_diagonal_spread_alike(filters, room):
    clouds = []
    for covariance in (np.diag([0.1, 0.2, 0.05]), [0.1, 0.2, 0.05], [[0.1, 0, 0.9], [0, 0.2, 0], [0, 0, 0.05]]):
        amcl = filters()
        amcl.set_pose(START, covariance)
        updated(amcl, room)
        clouds.append(amcl.particles)
    np.testing.assert_array_equal(clouds[0], clouds[1])
    np.testing.assert_array_equal(clouds[0], clouds[2])


def test_same_seed_and_calls_give_the_same_particles_and_another_seed_others(filters, room):
    clouds = []
    for seed in (1, 1, 2):
        amcl = filters(seed=seed)
        amcl.set_pose(START, [0.1, 0.1, 0.05])
        updated(amcl, room)
        updated(amcl, room, 0.3)
        clouds.append(amcl.particles)
    np.testing.assert_array_equal(clouds[0], clouds[1])
    assert clouds[0].shape != clouds[2].shape or (clouds[0] != clouds[2]).any()


def test_setting_the_pose_again_begins_anew(filters, room):
    amcl = filters()
    amcl.set_pose(START, [0.1, 0.1, 0.05])
    updated(amcl, room)
    amcl.set_pose((1.0, 1.0, 0.0), np.zeros(3))
    pose, _ = updated(amcl, room)
    np.testing.assert_allclose(pose, (1.0, 1.0, 0.0), atol=1e-9)
    assert len(amcl.weights) == 2000


@each_row("beams", [1, 59, 361, 362, 363, 364, 1440])
def test_scans_may_change_their_number_of_beams(filters, room, beams):
    amcl = filters(max_beams=2000)
    amcl.set_pose(START, np.zeros(3))
    updated(amcl, room)
    ranges_m = np.resize(looked(room, START), beams)
    assert amcl.update((0.3, 0.0, 0.0), ranges_m, 0.0, LIDAR.angle_increment_rad, 0.164, 20.0) is not None


def test_second_updates_resample_with_an_interval_of_two(filters, room):
    amcl = filters(resample_interval=2)
    amcl.set_pose(START, [0.1, 0.1, 0.05])
    pose, covariance = updated(amcl, room)
    np.testing.assert_allclose(pose, START)
    np.testing.assert_allclose(np.diag(covariance), [0.1, 0.1, 0.05])
    assert amcl.weights.sum() == pytest.approx(1.0)
    assert np.ptp(amcl.weights) > 0.0
    assert updated(amcl, room, 0.3) is not None
    assert np.ptp(amcl.weights) == 0.0
    assert updated(amcl, room, 0.6) is None
    assert np.ptp(amcl.weights) > 0.0


def test_filter_weighs_its_particles_as_poses_are_weighed_alone(filters, room):
    """In four bytes a beam that ends on the very edge of a cell may fall into the next one."""
    amcl = filters(resample_interval=2)
    amcl.set_pose(START, [0.2, 0.2, 0.5])
    updated(amcl, room)
    arguments = {"ranges_m": looked(room, START), "laser_xyt": LIDAR.mount_xyt, **BEAMS, **place(room)}
    alone = np.array([weight(pose_xyt=pose, **arguments) for pose in amcl.particles[:60]])
    ratio = amcl.weights[:60] / alone
    assert np.mean(np.abs(ratio / np.median(ratio) - 1.0) < 1e-5) > 0.9
    assert np.ptp(alone) > 3.0
