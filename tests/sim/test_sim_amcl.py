"""AMCL: weights by hand, motion noise, resampling limits, the gate and clusters."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vastflow.sim.lidar import Lidar
from vastflow.sim.nav.amcl import (
    beam_points,
    gate,
    heaviest_cluster,
    kld_limit,
    likelihood_cubed,
    move,
    new_cloud,
    resample,
    weigh,
    weight_of,
)
from vastflow.sim.numeric import njit
from vastflow.sim.streams import streams_of

RANGE_MAX_M = 20.0
SIGMA_M = 0.2


@njit
def moved(particles, stream, dx, dy, old_yaw, dyaw, alpha):
    move(particles, particles.shape[1], stream, dx, dy, old_yaw, dyaw, alpha, alpha, alpha, alpha)


@njit
def weighed(cloud, n, points, n_points, cubed, resolution):
    weigh(cloud, n, points, n_points, cubed, resolution, 0.0, 0.0)


@njit
def resampled(cloud, n, stream, low, high):
    return resample(cloud, n, stream, low, high, 0.05, 0.99)


@njit
def clustered(cloud, bins):
    return heaviest_cluster(cloud, bins)


def field(occupied, resolution_m=0.05, max_dist_m=2.0):
    return likelihood_cubed(
        np.asarray(occupied, dtype=np.bool_),
        resolution_m,
        range_max_m=RANGE_MAX_M,
        z_hit=0.5,
        z_rand=0.5,
        sigma_hit_m=SIGMA_M,
        likelihood_max_dist_m=max_dist_m,
    )


def pz(distance_m):
    return 0.5 * math.exp(-(distance_m**2) / (2 * SIGMA_M**2)) + 0.5 / RANGE_MAX_M


def weight(pose, points, cubed, resolution_m=0.05, origin=(0.0, 0.0)):
    points = np.asarray(points, dtype=np.float64).reshape(-1, 2).T.copy()
    x, y, yaw = pose
    cells = np.zeros(points.shape[1], dtype=np.int32)
    return weight_of(x, y, math.cos(yaw), math.sin(yaw), points, points.shape[1], cubed, resolution_m, *origin, cells)


@pytest.fixture
def one_wall_cell():
    """9 × 11 cells, a wall in column 8, row 4."""
    occupied = np.zeros((9, 11), dtype=np.bool_)
    occupied[4, 8] = True
    return field(occupied)


@pytest.mark.parametrize("cells_off", [0, 1, 2, 3])
def test_a_beam_that_ends_some_cells_off_the_wall_weighs_by_the_likelihood_of_that_distance(one_wall_cell, cells_off):
    found = weight((0.1, 0.2, 0.0), [(0.3 - 0.05 * cells_off, 0.0)], one_wall_cell)
    assert found == pytest.approx(1 + pz(0.05 * cells_off) ** 3, rel=1e-6)


def test_beams_add_their_cubes_to_one(one_wall_cell):
    points = [(0.3, 0.0), (0.3, 0.05), (0.2, -0.1)]
    expected = 1 + pz(0.0) ** 3 + pz(0.05) ** 3 + pz(math.hypot(0.1, 0.1)) ** 3
    assert weight((0.1, 0.2, 0.0), points, one_wall_cell) == pytest.approx(expected, rel=1e-6)


def test_end_points_turn_with_the_pose(one_wall_cell):
    assert weight((0.4, 0.0, math.pi / 2), [(0.2, 0.0)], one_wall_cell) == pytest.approx(1 + pz(0.0) ** 3, rel=1e-6)


@pytest.mark.parametrize(("x", "cells_off"), [(0.376, 0), (0.424, 0), (0.374, 1), (0.426, 1)])
def test_the_cell_of_an_end_point_is_found_by_rounding_as_amcl_does(one_wall_cell, x, cells_off):
    """Column 8 is x 0.40..0.45 m of the map; AMCL takes 0.375..0.425 for it."""
    found = weight((0.0, 0.2, 0.0), [(x, 0.0)], one_wall_cell)
    assert found == pytest.approx(1 + pz(0.05 * cells_off) ** 3, rel=1e-6)


def test_the_origin_of_the_map_is_subtracted(one_wall_cell):
    found = weight((5.1, -6.8, 0.0), [(0.3, 0.0)], one_wall_cell, origin=(5.0, -7.0))
    assert found == pytest.approx(1 + pz(0.0) ** 3, rel=1e-6)


@pytest.mark.parametrize("point", [(-9.0, 0.0), (9.0, 0.0), (0.0, 9.0), (0.0, -9.0)])
def test_off_the_map_the_distance_is_the_cap(one_wall_cell, point):
    assert weight((0.1, 0.2, 0.0), [point], one_wall_cell) == pytest.approx(1 + pz(2.0) ** 3, rel=1e-6)


def test_distances_are_capped():
    occupied = np.zeros((1, 100), dtype=np.bool_)
    occupied[0, 0] = True
    table = field(occupied, max_dist_m=0.5)
    assert table[1, 1 + 10] == pytest.approx(pz(0.5) ** 3, rel=1e-6)
    assert table[1, 1 + 90] == table[1, 1 + 11]


def test_a_map_without_walls_weighs_every_pose_alike():
    table = field(np.zeros((20, 20)))
    assert len(np.unique(table)) == 1


def test_a_perfect_scan_of_sixty_beams_weighs_about_ten_to_one():
    assert 1 + 60 * pz(0.0) ** 3 == pytest.approx(9.68, abs=0.01)


def used(ranges, max_beams=60):
    out = np.zeros((2, 360))
    n = beam_points(
        np.asarray(ranges, dtype=np.float64), max_beams, Lidar().directions(), -0.04, 0.0, 0.164, RANGE_MAX_M, out
    )
    return out[:, :n]


def test_every_sixth_of_360_beams_is_used():
    ranges = 1.0 + np.arange(360) / 1000
    points = used(ranges)
    lengths = np.hypot(points[0] + 0.04, points[1])
    np.testing.assert_allclose(lengths, ranges[::6])


@pytest.mark.parametrize("reading", [math.inf, math.nan, 20.0, 25.0, 0.164, 0.1, -0.2])
def test_a_reading_beyond_the_limits_or_too_near_counts_as_none(reading):
    ranges = np.full(360, 2.0)
    ranges[12] = reading
    assert used(ranges).shape == (2, 59)


@pytest.mark.parametrize(
    ("motion", "updates"),
    [
        ((0.25, 0.25, 0.2), False),
        ((0.251, 0.0, 0.0), True),
        ((0.0, -0.251, 0.0), True),
        ((0.0, 0.0, -0.201), True),
        ((0.2, 0.2, 0.0), False),
    ],
)
def test_the_gate_tests_each_axis_of_the_odometry_frame_by_itself(motion, updates):
    assert gate(*motion, 0.25, 0.2) == updates


def cloud_after(dx, dy, old_yaw, dyaw, alpha=0.2, n=20_000, heading=0.0):
    particles = np.zeros((3, n))
    particles[2] = heading
    moved(particles, streams_of([11])[0], dx, dy, old_yaw, dyaw, alpha)
    return particles


def test_without_noise_particles_move_as_the_odometry_did():
    x, y, yaw = cloud_after(0.3, 0.1, 0.2, 0.4, alpha=0.0, n=4, heading=1.2)
    turn = 1.0  # the map's heading less the odometry's
    np.testing.assert_allclose(x, 0.3 * math.cos(turn) - 0.1 * math.sin(turn))
    np.testing.assert_allclose(y, 0.3 * math.sin(turn) + 0.1 * math.cos(turn))
    np.testing.assert_allclose(yaw, 1.6)


def test_a_quarter_metre_ahead_scatters_as_the_motion_model_says():
    """σ_trans² = α3 d², σ_rot1² = σ_rot2² = α2 d²: 0.11 m and 0.11 rad."""
    x, y, yaw = cloud_after(0.25, 0.0, 0.0, 0.0)
    sigma = math.sqrt(0.2) * 0.25
    assert sigma == pytest.approx(0.1118, abs=1e-4)
    forward, heading = np.hypot(x, y) * np.sign(x), np.arctan2(y * np.sign(x), x * np.sign(x))
    n = x.size
    near = np.abs(forward) > 0.02  # the heading of a particle that hardly moved says nothing
    assert forward.mean() == pytest.approx(0.25, abs=5 * sigma / math.sqrt(n))
    assert forward.std() == pytest.approx(sigma, rel=0.03)
    assert heading[near].std() == pytest.approx(sigma, rel=0.03)
    assert yaw.std() == pytest.approx(math.sqrt(2) * sigma, rel=0.03)
    assert yaw.mean() == pytest.approx(0.0, abs=5 * math.sqrt(2) * sigma / math.sqrt(n))


def test_turning_in_place_scatters_the_yaw_alone():
    """δtrans < 0.01 m: no first rotation; σ_rot2² = α1 δ², σ_trans² = α4 δ²."""
    x, y, yaw = cloud_after(0.0, 0.0, 0.0, 0.5)
    sigma = math.sqrt(0.2) * 0.5
    assert yaw.mean() == pytest.approx(0.5, abs=5 * sigma / math.sqrt(yaw.size))
    assert yaw.std() == pytest.approx(sigma, rel=0.03)
    assert np.hypot(x, y).max() > 0.1  # α4: turning also scatters the position, along the heading
    assert np.abs(y).max() < 1e-12


def test_driving_backwards_scatters_no_more_than_driving_forwards():
    ahead, back = cloud_after(0.25, 0.0, 0.0, 0.0), cloud_after(-0.25, 0.0, 0.0, 0.0)
    assert back[0].mean() == pytest.approx(-0.25 * math.exp(-0.0125 / 2), abs=0.005)
    assert back[2].std() == pytest.approx(ahead[2].std(), rel=0.03)
    assert back[1].std() == pytest.approx(ahead[1].std(), rel=0.05)


@pytest.mark.parametrize(("bins", "limit"), [(0, 2000), (1, 2000), (2, 500), (40, 500), (100, 1129), (200, 2000)])
def test_the_number_of_particles_for_some_bins(bins, limit):
    assert kld_limit(bins, 500, 2000, 0.05, 0.99) == limit


@given(st.integers(2, 4000))
@settings(deadline=None)
def test_the_limit_is_fox_s_formula_within_the_bounds(bins):
    k = bins - 1
    formula = math.ceil(k / 0.1 * (1 - 2 / (9 * k) + math.sqrt(2 / (9 * k)) * 0.99) ** 3)
    assert abs(kld_limit(bins, 1, 10**6, 0.05, 0.99) - formula) <= 1
    assert 500 <= kld_limit(bins, 500, 2000, 0.05, 0.99) <= 2000


def filled(groups):
    """A cloud of (count, x, y, yaw) groups, all of equal weight."""
    cloud = new_cloud(2000)
    poses = np.concatenate([np.tile(pose, (count, 1)) for count, *pose in groups]).T
    n = poses.shape[1]
    cloud.particles[:, :n] = poses
    weighed(cloud, n, np.zeros((2, 1)), 0, field(np.zeros((3, 3))), 0.05)
    return cloud, n


def test_a_cloud_in_one_bin_is_resampled_to_the_greatest_number():
    cloud, n = filled([(700, 0.1, 0.1, 0.01)])
    assert resampled(cloud, n, streams_of([1])[0], 500, 2000) == (2000, 1)


def test_a_cloud_in_two_bins_is_resampled_to_one_more_than_the_least_number():
    cloud, n = filled([(350, 0.1, 0.1, 0.01), (350, 0.6, 0.1, 0.01)])
    assert resampled(cloud, n, streams_of([1])[0], 500, 2000) == (501, 2)


@pytest.mark.parametrize("pose", [(0.6, 0.1, 0.01), (0.1, -0.1, 0.01), (0.1, 0.1, 0.2), (0.1, 0.1, 0.01 - 2 * math.pi)])
def test_bins_are_half_a_metre_and_ten_degrees_of_the_raw_yaw(pose):
    cloud, n = filled([(350, 0.1, 0.1, 0.01), (350, *pose)])
    assert resampled(cloud, n, streams_of([1])[0], 500, 2000)[1] == 2


def test_resampling_draws_particles_by_their_weight():
    cloud = new_cloud(2000)
    occupied = np.zeros((40, 200), dtype=np.bool_)
    occupied[20, 100] = True
    cubed = field(occupied)
    cloud.particles[:, 0], cloud.particles[:, 1] = (5.0, 1.0, 0.0), (1.0, 1.0, 0.0)
    points = np.zeros((2, 60))  # sixty beams that end at the robot: on the wall for the first particle
    weighed(cloud, 2, points, 60, cubed, 0.05)
    heavy, light = 1 + 60 * pz(0.0) ** 3, 1 + 60 * pz(2.0) ** 3
    share = heavy / (heavy + light)
    assert cloud.weights[:2] == pytest.approx([share, 1.0])
    counts = [0, 0]
    for entropy in range(20):
        cloud.particles[:, 0], cloud.particles[:, 1] = (5.0, 1.0, 0.0), (1.0, 1.0, 0.0)
        n, _ = resampled(cloud, 2, streams_of([entropy])[0], 500, 2000)
        counts[0] += int((cloud.particles[0, :n] == 5.0).sum())
        counts[1] += n
    found = counts[0] / counts[1]
    assert found == pytest.approx(share, abs=5 * math.sqrt(share * (1 - share) / counts[1]))


def test_the_pose_is_the_mean_of_the_heaviest_cluster_and_not_of_the_cloud():
    cloud, n = filled([(300, 0.1, 0.1, 0.1), (300, 0.6, 0.3, 0.2), (700, 5.2, 5.2, 1.0), (50, 9.0, 1.0, -1.0)])
    _, bins = resampled(cloud, n, streams_of([1])[0], 500, 2000)
    assert bins == 4
    assert clustered(cloud, bins) == pytest.approx((5.2, 5.2, 1.0))


def test_bins_that_touch_at_a_corner_are_one_cluster():
    """Apart, each half is lighter than the third group; together they are heavier."""
    cloud, n = filled([(450, 0.1, 0.1, 0.1), (450, 0.6, 0.6, 0.2), (600, 5.2, 5.2, 1.0)])
    count, bins = resampled(cloud, n, streams_of([1])[0], 500, 2000)
    x, y, yaw = clustered(cloud, bins)
    assert (x, y, yaw) == pytest.approx((0.35, 0.35, 0.15), abs=0.05)
    assert count == 501


def test_the_yaw_of_a_cluster_is_a_circular_mean():
    cloud, n = filled([(500, 0.1, 0.1, math.radians(178)), (500, 0.1, 0.1, math.radians(182))])
    _, bins = resampled(cloud, n, streams_of([1])[0], 500, 2000)
    assert math.cos(clustered(cloud, bins)[2] - math.pi) == pytest.approx(1.0, abs=1e-3)


def test_bins_do_not_wrap_at_half_a_turn():
    cloud, n = filled([(300, 0.1, 0.1, math.pi - 0.01), (500, 0.1, 0.1, 0.01 - math.pi)])
    _, bins = resampled(cloud, n, streams_of([1])[0], 500, 2000)
    assert bins == 2
    assert clustered(cloud, bins)[2] == pytest.approx(0.01 - math.pi)
