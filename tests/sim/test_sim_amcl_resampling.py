"""AMCL's resampling: KLD's limit, bins, clusters and the statistics of the samples."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from table import each_row

from vastflow.sim.kernels.numeric import njit
from vastflow.sim.kernels.record import record_of
from vastflow.sim.kernels.streams import streams_of
from vastflow.sim.nav2.amcl.particles import covariance, heaviest_cluster, kld_limit, new_cloud, resample
from vastflow.sim.nav2.parameters.amcl import AmclParameters

PARAMETERS = record_of(AmclParameters())


@njit
def limit(bins, parameters):
    return kld_limit(bins, parameters[0])


@njit
def resampled(cloud, n, stream, parameters):
    return resample(cloud, n, stream, parameters[0])


@njit
def clustered(cloud, bins):
    return heaviest_cluster(cloud, bins)


@njit
def scattered(cloud, bins):
    return covariance(cloud.sums, bins)


@each_row(("bins", "expected"), [(0, 2000), (1, 2000), (2, 500), (40, 500), (100, 1129), (200, 2000)])
def test_number_of_particles_for_some_bins(bins, expected):
    assert limit(bins, PARAMETERS) == expected


@given(st.integers(2, 4000))
@settings(deadline=None)
def test_limit_is_fox_s_formula_within_the_bounds(bins):
    k = bins - 1
    formula = math.ceil(k / 0.1 * (1 - 2 / (9 * k) + math.sqrt(2 / (9 * k)) * 0.99) ** 3)
    wide = record_of(AmclParameters(min_particles=1, max_particles=100_000))
    assert abs(limit(bins, wide) - formula) <= 1
    assert 500 <= limit(bins, PARAMETERS) <= 2000


def filled(groups, weights=None):
    """A cloud of (count, x, y, yaw) groups; each particle weighs the same, or as its group's entry in `weights`."""
    cloud = new_cloud(2000)
    n = 0
    for k, (count, *pose) in enumerate(groups):
        cloud.particles[:, n : n + count] = np.array(pose)[:, None]
        cloud.weights[n : n + count] = 1.0 if weights is None else weights[k]
        n += count
    cloud.headings[:] = np.cos(cloud.particles[2]), np.sin(cloud.particles[2])
    return cloud, n


def test_cloud_in_two_bins_is_resampled_to_one_more_than_the_least_number():
    cloud, n = filled([(350, 0.1, 0.1, 0.01), (350, 0.6, 0.1, 0.01)])
    assert resampled(cloud, n, streams_of([1])[0], PARAMETERS) == (501, 2)


@each_row("pose", [(0.6, 0.1, 0.01), (0.1, -0.1, 0.01), (0.1, 0.1, 0.2), (0.1, 0.1, 0.01 - 2 * math.pi)])
def test_bins_are_half_a_meter_and_ten_degrees_of_the_raw_yaw(pose):
    cloud, n = filled([(350, 0.1, 0.1, 0.01), (350, *pose)])
    assert resampled(cloud, n, streams_of([1])[0], PARAMETERS)[1] == 2


@each_row("pose", [(0.4, 0.1, 0.01), (0.1, 0.0, 0.01), (0.1, 0.1, 0.17)])
def test_poses_in_one_bin_count_once(pose):
    cloud, n = filled([(350, 0.1, 0.1, 0.01), (350, *pose)])
    assert resampled(cloud, n, streams_of([1])[0], PARAMETERS)[1] == 1


@given(st.lists(st.floats(1.0, 10.0), min_size=1, max_size=300), st.integers(0, 2**32))
@settings(deadline=None, max_examples=20)
def test_particles_are_drawn_by_their_weight(weights, seed):
    """Whatever the shape of the weights: particle k stands at k meters, and its share of draws is its weight's."""
    n, draws = len(weights), 20_000
    cloud = new_cloud(draws)
    cloud.particles[0, :n], cloud.weights[:n] = np.arange(n), weights
    everything = record_of(AmclParameters(min_particles=draws, max_particles=draws))
    count, _ = resampled(cloud, n, streams_of([seed])[0], everything)
    assert count == draws
    shares = np.array(weights) / sum(weights)
    found = np.bincount(cloud.particles[0].astype(int), minlength=n) / draws
    np.testing.assert_allclose(found, shares, atol=6 * math.sqrt(shares.max() / draws))


def test_pose_is_the_mean_of_the_heaviest_cluster_and_not_of_the_cloud():
    cloud, n = filled([(300, 0.1, 0.1, 0.1), (300, 0.6, 0.3, 0.2), (700, 5.2, 5.2, 1.0), (50, 9.0, 1.0, -1.0)])
    _, bins = resampled(cloud, n, streams_of([1])[0], PARAMETERS)
    assert bins == 4
    assert clustered(cloud, bins) == pytest.approx((5.2, 5.2, 1.0))


@each_row("seed", range(5))
def test_bins_that_touch_at_a_corner_are_one_cluster_whichever_is_found_first(seed):
    """Apart, each half is lighter than the third group; together they are heavier."""
    cloud, n = filled([(450, 0.1, 0.1, 0.1), (450, 0.6, 0.6, 0.2), (600, 5.2, 5.2, 1.0)])
    count, bins = resampled(cloud, n, streams_of([seed])[0], PARAMETERS)
    assert clustered(cloud, bins) == pytest.approx((0.35, 0.35, 0.15), abs=0.05)
    assert count == 501


def test_bins_with_an_empty_one_between_them_are_two_clusters():
    cloud, n = filled([(450, 0.1, 0.1, 0.1), (450, 1.1, 0.1, 0.1), (600, 5.2, 5.2, 1.0)])
    _, bins = resampled(cloud, n, streams_of([1])[0], PARAMETERS)
    assert clustered(cloud, bins) == pytest.approx((5.2, 5.2, 1.0))


def test_yaw_of_a_cluster_is_a_circular_mean():
    cloud, n = filled([(500, 0.1, 0.1, math.radians(178)), (500, 0.1, 0.1, math.radians(182))])
    _, bins = resampled(cloud, n, streams_of([1])[0], PARAMETERS)
    assert math.cos(clustered(cloud, bins)[2] - math.pi) == pytest.approx(1.0, abs=1e-3)


def test_bins_do_not_wrap_at_half_a_turn():
    cloud, n = filled([(300, 0.1, 0.1, math.pi - 0.01), (500, 0.1, 0.1, 0.01 - math.pi)])
    _, bins = resampled(cloud, n, streams_of([1])[0], PARAMETERS)
    assert bins == 2
    assert clustered(cloud, bins)[2] == pytest.approx(0.01 - math.pi)


def test_covariance_is_that_of_all_particles_whatever_their_cluster():
    rng = np.random.default_rng(2)
    cloud, n = new_cloud(2000), 2000
    cloud.particles[:] = rng.multivariate_normal(
        [40.0, -30.0, 2.0], [[0.2, 0.05, 0], [0.05, 0.1, 0], [0, 0, 0.04]], n
    ).T
    cloud.particles[0, :500] += 20.0
    cloud.headings[:] = np.cos(cloud.particles[2]), np.sin(cloud.particles[2])
    cloud.weights[:] = 1.0
    count, bins = resampled(cloud, n, streams_of([1])[0], PARAMETERS)
    x, y, yaw = cloud.particles[:, :count]
    length = abs(np.exp(1j * yaw).mean())
    expected = (x.var(), np.cov(x, y, bias=True)[0, 1], y.var(), -2 * math.log(length))
    assert scattered(cloud, bins) == pytest.approx(expected, rel=1e-6)
    assert expected[0] > 50.0
