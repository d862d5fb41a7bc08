"""AMCL's particles: the gate, their spread, their motion, and their resampling."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from table import each_row

from vastflow.sim.kernels.numeric import njit
from vastflow.sim.kernels.record import record_of
from vastflow.sim.kernels.streams import streams_of
from vastflow.sim.nav2.amcl import particles
from vastflow.sim.nav2.amcl.particles import new_cloud
from vastflow.sim.nav2.parameters.amcl import AmclParameters

N = 20_000
SIGMA = math.sqrt(0.2) * 0.25
PARAMETERS = record_of(AmclParameters())


@njit
def passes(dx, dy, dyaw, parameters):
    return particles.gate(dx, dy, dyaw, parameters[0])


@njit
def moved(cloud, n, stream, dx, dy, old_yaw, dyaw, parameters):
    particles.move(cloud, n, stream, dx, dy, old_yaw, dyaw, parameters[0])


@njit
def drawn(cloud, n, stream, x, y, yaw, covariance):
    particles.spread(cloud, n, stream, x, y, yaw, covariance)


def test_amcl_gate_tests_axes_separately():
    assert not passes(0.25, 0.25, 0.2, PARAMETERS)
    for motion in ((0.251, 0.0, 0.0), (0.0, -0.251, 0.0), (0.0, 0.0, -0.201)):
        assert passes(*motion, PARAMETERS)


def cloud_after(dx, dy, old_yaw, dyaw, alpha=0.2, n=N, heading=0.0):
    cloud = new_cloud(n)
    cloud.particles[2] = heading
    parameters = record_of(AmclParameters(alpha1=alpha, alpha2=alpha, alpha3=alpha, alpha4=alpha))
    moved(cloud, n, streams_of([11])[0], dx, dy, old_yaw, dyaw, parameters)
    return cloud.particles


def test_particles_move_as_the_odometry_did_without_noise():
    x, y, yaw = cloud_after(0.3, 0.1, 0.2, 0.4, alpha=0.0, n=4, heading=1.2)
    turn = 1.0  # the map's heading less the odometry's
    np.testing.assert_allclose(x, 0.3 * math.cos(turn) - 0.1 * math.sin(turn), rtol=1e-10)
    np.testing.assert_allclose(y, 0.3 * math.sin(turn) + 0.1 * math.cos(turn), rtol=1e-10)
    np.testing.assert_allclose(yaw, 1.6)


def test_motion_of_quarter_meter_scatters_like_model():
    """σ_trans² = α3 d², σ_rot1² = σ_rot2² = α2 d²: 0.11 m and 0.11 rad."""
    x, y, yaw = cloud_after(0.25, 0.0, 0.0, 0.0)
    assert pytest.approx(0.1118, abs=1e-4) == SIGMA
    forward, heading = np.hypot(x, y) * np.sign(x), np.arctan2(y * np.sign(x), x * np.sign(x))
    near = np.abs(forward) > 0.02  # the heading of a particle that hardly moved says nothing
    assert forward.mean() == pytest.approx(0.25, abs=5 * SIGMA / math.sqrt(N))
    assert forward.std() == pytest.approx(SIGMA, rel=0.03)
    assert heading[near].std() == pytest.approx(SIGMA, rel=0.03)
    assert yaw.std() == pytest.approx(math.sqrt(2) * SIGMA, rel=0.03)
    assert yaw.mean() == pytest.approx(0.0, abs=5 * math.sqrt(2) * SIGMA / math.sqrt(N))


def test_turning_in_place_scatters_only_yaw():
    """δtrans < 0.01 m: no first rotation; σ_rot2² = α1 δ², σ_trans² = α4 δ²."""
    x, y, yaw = cloud_after(0.0, 0.0, 0.0, 0.5)
    sigma = math.sqrt(0.2) * 0.5
    assert yaw.mean() == pytest.approx(0.5, abs=5 * sigma / math.sqrt(N))
    assert yaw.std() == pytest.approx(sigma, rel=0.03)
    assert np.hypot(x, y).max() > 0.1  # α4: turning also scatters the position, along the heading
    assert np.abs(y).max() < 1e-12


def test_driving_backwards_scatters_particles_and_turns_them_against_each_other():
    """Each turn is ±π with noise, wrapped by itself: half of the particles turn the same way twice."""
    ahead, back = cloud_after(0.25, 0.0, 0.0, 0.0), cloud_after(-0.25, 0.0, 0.0, 0.0)
    turns = np.rint(back[2] / (2 * np.pi))
    assert back[0].mean() == pytest.approx(-0.25 * math.exp(-0.0125 / 2), abs=0.005)
    assert (back[2] - 2 * np.pi * turns).std() == pytest.approx(ahead[2].std(), rel=0.03)
    assert back[1].std() == pytest.approx(ahead[1].std(), rel=0.05)
    shares = [np.mean(turns == whole) for whole in (-1, 0, 1)]
    assert shares == pytest.approx([0.25, 0.5, 0.25], abs=5 * 0.5 / math.sqrt(N))


def test_particles_spread_with_the_covariance_asked_for():
    covariance = [[0.09, 0.02, 0.0], [0.02, 0.04, 0.0], [0.0, 0.0, 0.01]]
    cloud = new_cloud(N)
    drawn(cloud, N, streams_of([5])[0], 3.0, -2.0, 0.5, np.array([0.09, 0.02, 0.04, 0.01]))
    np.testing.assert_allclose(cloud.particles.mean(axis=1), [3.0, -2.0, 0.5], atol=5 * 0.3 / math.sqrt(N))
    np.testing.assert_allclose(np.cov(cloud.particles), covariance, atol=0.003)
    np.testing.assert_allclose(cloud.weights, 1 / N)


@njit
def limit(bins, parameters):
    return particles.kld_limit(bins, parameters[0])


@njit
def resampled(cloud, n, stream, parameters):
    return particles.resample(cloud, n, stream, parameters[0])


@njit
def clustered(cloud, bins):
    return particles.heaviest_cluster(cloud, bins)


@njit
def scattered(cloud, bins):
    return particles.covariance(cloud.sums, bins)


@given(st.integers(2, 4000))
@settings(deadline=None)
def test_particle_limit_follows_formula_of_fox_within_bounds(bins):
    k = bins - 1
    formula = math.ceil(k / 0.1 * (1 - 2 / (9 * k) + math.sqrt(2 / (9 * k)) * 0.99) ** 3)
    wide = record_of(AmclParameters(min_particles=1, max_particles=100_000))
    assert abs(limit(bins, wide) - formula) <= 1
    assert limit(bins, PARAMETERS) == min(max(limit(bins, wide), 500), 2000)
    assert limit(0, PARAMETERS) == limit(1, PARAMETERS) == 2000


def filled(groups):
    """A cloud of (count, x, y, yaw) groups; each particle weighs the same."""
    poses = np.array([pose for count, *pose in groups for _ in range(count)])
    cloud, n = new_cloud(2000), len(poses)
    cloud.particles[:, :n], cloud.weights[:n] = poses.T, 1.0
    cloud.headings[:] = np.cos(cloud.particles[2]), np.sin(cloud.particles[2])
    return cloud, n


@each_row(
    ("pose", "bins"),
    [
        *((pose, 2) for pose in ((0.6, 0.1, 0.01), (0.1, -0.1, 0.01), (0.1, 0.1, 0.2), (0.1, 0.1, 0.01 - 2 * math.pi))),
        *((pose, 1) for pose in ((0.4, 0.1, 0.01), (0.1, 0.0, 0.01), (0.1, 0.1, 0.17))),
    ],
)
def test_bins_are_half_a_meter_and_ten_degrees_of_the_raw_yaw(pose, bins):
    """A cloud in two bins is resampled to one more than the least number of particles."""
    cloud, n = filled([(350, 0.1, 0.1, 0.01), (350, *pose)])
    assert resampled(cloud, n, streams_of([1])[0], PARAMETERS) == (501 if bins == 2 else 2000, bins)


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


@each_row("seed", range(5))
def test_bins_that_touch_at_a_corner_are_one_cluster_whichever_is_found_first(seed):
    """Apart, each half is lighter than the third group; together they are heavier."""
    cloud, n = filled([(450, 0.1, 0.1, 0.1), (450, 0.6, 0.6, 0.2), (600, 5.2, 5.2, 1.0)])
    count, bins = resampled(cloud, n, streams_of([seed])[0], PARAMETERS)
    assert clustered(cloud, bins) == pytest.approx((0.35, 0.35, 0.15), abs=0.05)
    assert count == 501


@each_row(
    ("groups", "bins", "pose"),
    [
        # The heaviest cluster, and not the cloud.
        ([(300, 0.1, 0.1, 0.1), (300, 0.6, 0.3, 0.2), (700, 5.2, 5.2, 1.0), (50, 9.0, 1.0, -1.0)], 4, (5.2, 5.2, 1.0)),
        # An empty bin between two parts them.
        ([(450, 0.1, 0.1, 0.1), (450, 1.1, 0.1, 0.1), (600, 5.2, 5.2, 1.0)], 3, (5.2, 5.2, 1.0)),
        # Bins do not wrap at half a turn.
        ([(300, 0.1, 0.1, math.pi - 0.01), (500, 0.1, 0.1, 0.01 - math.pi)], 2, (0.1, 0.1, 0.01 - math.pi)),
    ],
)
def test_pose_is_the_mean_of_the_heaviest_cluster(groups, bins, pose):
    cloud, n = filled(groups)
    assert resampled(cloud, n, streams_of([1])[0], PARAMETERS)[1] == bins
    assert clustered(cloud, bins) == pytest.approx(pose)


def test_yaw_of_a_cluster_is_a_circular_mean():
    cloud, n = filled([(500, 0.1, 0.1, math.radians(178)), (500, 0.1, 0.1, math.radians(182))])
    _, bins = resampled(cloud, n, streams_of([1])[0], PARAMETERS)
    assert abs(clustered(cloud, bins)[2]) == pytest.approx(math.pi, abs=0.05)


def test_published_covariance_is_over_all_particles():
    rng = np.random.default_rng(2)
    cloud, n = new_cloud(2000), 2000
    covariance = [[0.2, 0.05, 0], [0.05, 0.1, 0], [0, 0, 0.04]]
    cloud.particles[:] = rng.multivariate_normal([40.0, -30.0, 2.0], covariance, n).T
    cloud.particles[0, :500] += 20.0
    cloud.headings[:] = np.cos(cloud.particles[2]), np.sin(cloud.particles[2])
    cloud.weights[:] = 1.0
    count, bins = resampled(cloud, n, streams_of([1])[0], PARAMETERS)
    x, y, yaw = cloud.particles[:, :count]
    length = abs(np.exp(1j * yaw).mean())
    expected = (x.var(), np.cov(x, y, bias=True)[0, 1], y.var(), -2 * math.log(length))
    assert scattered(cloud, bins) == pytest.approx(expected, rel=1e-6)
    assert expected[0] > 50.0
