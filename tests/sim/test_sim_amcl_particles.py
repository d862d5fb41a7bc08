"""AMCL's particles: the gate, how they spread, how odometry moves them."""

import math

import numpy as np
import pytest
from table import each_row

from vastflow.sim.kernels.numeric import njit
from vastflow.sim.kernels.record import record_of
from vastflow.sim.kernels.streams import streams_of
from vastflow.sim.nav2.amcl.particles import gate, move, new_cloud, spread
from vastflow.sim.nav2.parameters.amcl import AmclParameters

N = 20_000
SIGMA = math.sqrt(0.2) * 0.25


@njit
def passes(dx, dy, dyaw, parameters):
    return gate(dx, dy, dyaw, parameters[0])


@njit
def moved(cloud, n, stream, dx, dy, old_yaw, dyaw, parameters):
    move(cloud, n, stream, dx, dy, old_yaw, dyaw, parameters[0])


@njit
def drawn(cloud, n, stream, x, y, yaw, covariance):
    spread(cloud, n, stream, x, y, yaw, covariance)


@each_row(
    ("motion", "updates"),
    [
        ((0.25, 0.25, 0.2), False),
        ((0.251, 0.0, 0.0), True),
        ((0.0, -0.251, 0.0), True),
        ((0.0, 0.0, -0.201), True),
        ((0.2, 0.2, 0.0), False),
    ],
)
def test_gate_tests_each_axis_of_the_odometry_frame_by_itself(motion, updates):
    assert passes(*motion, record_of(AmclParameters())) == updates


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


def test_quarter_meter_ahead_scatters_as_the_motion_model_says():
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


def test_turning_in_place_scatters_the_yaw_alone():
    """δtrans < 0.01 m: no first rotation; σ_rot2² = α1 δ², σ_trans² = α4 δ²."""
    x, y, yaw = cloud_after(0.0, 0.0, 0.0, 0.5)
    sigma = math.sqrt(0.2) * 0.5
    assert yaw.mean() == pytest.approx(0.5, abs=5 * sigma / math.sqrt(N))
    assert yaw.std() == pytest.approx(sigma, rel=0.03)
    assert np.hypot(x, y).max() > 0.1  # α4: turning also scatters the position, along the heading
    assert np.abs(y).max() < 1e-12


def wrapped(angle_rad):
    return (angle_rad + np.pi) % (2 * np.pi) - np.pi


def test_driving_backwards_scatters_no_more_than_driving_forwards():
    ahead, back = cloud_after(0.25, 0.0, 0.0, 0.0), cloud_after(-0.25, 0.0, 0.0, 0.0)
    assert back[0].mean() == pytest.approx(-0.25 * math.exp(-0.0125 / 2), abs=0.005)
    assert wrapped(back[2]).std() == pytest.approx(ahead[2].std(), rel=0.03)
    assert back[1].std() == pytest.approx(ahead[1].std(), rel=0.05)


def test_driving_backwards_moves_particles_by_whole_turns_against_each_other():
    """Each turn is ±π with noise, wrapped by itself: half of the particles turn the same way twice."""
    turns = np.rint(cloud_after(-0.25, 0.0, 0.0, 0.0)[2] / (2 * np.pi))
    shares = [np.mean(turns == whole) for whole in (-1, 0, 1)]
    assert shares == pytest.approx([0.25, 0.5, 0.25], abs=5 * 0.5 / math.sqrt(N))


def test_particles_spread_with_the_covariance_asked_for():
    covariance = [[0.09, 0.02, 0.0], [0.02, 0.04, 0.0], [0.0, 0.0, 0.01]]
    cloud = new_cloud(N)
    drawn(cloud, N, streams_of([5])[0], 3.0, -2.0, 0.5, np.array([0.09, 0.02, 0.04, 0.01]))
    np.testing.assert_allclose(cloud.particles.mean(axis=1), [3.0, -2.0, 0.5], atol=5 * 0.3 / math.sqrt(N))
    np.testing.assert_allclose(np.cov(cloud.particles), covariance, atol=0.003)
    np.testing.assert_allclose(cloud.weights, 1 / N)


def test_covariance_along_one_line_spreads_particles_on_it():
    cloud = new_cloud(1000)
    drawn(cloud, 1000, streams_of([5])[0], 0.0, 0.0, 0.0, np.array([0.04, 0.04, 0.04, 0.0]))
    x, y, _ = cloud.particles
    np.testing.assert_allclose(x, y, atol=1e-7)
    assert x.std() == pytest.approx(0.2, rel=0.15)
