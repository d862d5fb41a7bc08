"""Tests of AMCL in the closed loop on maps of the dataset."""

import functools

import numpy as np
from bench_simulator import benchmark_routes
from driving import drive
from table import each_row

from vastflow.sim.model.recording import si
from vastflow.sim.nav2.navigator.prepared import prepare
from vastflow.sim.nav2.parameters.servers import Perturbation
from vastflow.sim.nav2.parameters.stack import NavParameters
from vastflow.sim.world.map_file import load_map
from vastflow.sim.world.noise_registry import GaussianDropoutParameters
from vastflow.sim.world.robot_model import Lidar, Robot
from vastflow.sim.world.world import World

ROUTES = 3
ROUTE_M = 15.0


@functools.cache
def recordings(map_file, noise_m=0.0, **perturbation):
    """Routes on a map, as they were driven."""
    occupancy = load_map(map_file)
    noise = GaussianDropoutParameters(laserscan_gaussian_noise_std_deviation=noise_m)
    parameters = NavParameters(perturbation=Perturbation(**perturbation), lidar_noise=noise)
    prepared = prepare(World(occupancy), Lidar(), parameters)
    routes = benchmark_routes(occupancy, ROUTE_M)[:ROUTES]
    return [
        drive(prepared, parameters, Lidar(), Robot(), route.start, route.mission, (), [0, 7, index], 180.0)
        for index, route in enumerate(routes)
    ]


def poses(recording, prefix=""):
    """(R, 3) true or estimated poses."""
    return np.column_stack([si(recording.columns[prefix + name]) for name in ("x_mm", "y_mm", "yaw_mrad")])


def wrapped(angle_rad):
    return (angle_rad + np.pi) % (2 * np.pi) - np.pi


@each_row("name", ["rooms", "hallways"])
@each_row("noise_m", [0.0, 0.1])
def test_localization_errs_as_filter_of_nav2(shared_map, name, noise_m):
    """Upstream's filter, measured: position 0.09 to 0.21 m in the mean, 0.45 m at the 95th percentile, 0.015 rad.

    Exact odometry and a likelihood of 0.2 m leave that much, so a smaller error would be as wrong as a larger one.
    """
    off = np.concatenate([poses(r) - poses(r, "estimated_") for r in recordings(shared_map(name), noise_m)])
    away_m, turned_rad = np.hypot(off[:, 0], off[:, 1]), np.abs(wrapped(off[:, 2]))
    assert 0.03 < away_m.mean() < 0.25
    assert np.percentile(away_m, 95) < 0.55
    assert 0.003 < turned_rad.mean() < 0.04


def test_pose_is_published_at_the_first_scan_and_then_after_each_gate(shared_map):
    recording = recordings(shared_map("rooms"))[0]
    published = poses(recording)[recording.columns["localized"] == 1]
    np.testing.assert_allclose(published[0], poses(recording)[0], atol=0.01)
    steps = np.diff(published, axis=0)
    assert len(steps) > 20
    # The gate is tested on each axis of the odometry frame, which is turned like the start.
    yaw = poses(recording)[0, 2]
    along = np.cos(yaw) * steps[:, 0] + np.sin(yaw) * steps[:, 1]
    across = np.cos(yaw) * steps[:, 1] - np.sin(yaw) * steps[:, 0]
    assert (np.maximum(np.maximum(abs(along), abs(across)) / 0.25, abs(wrapped(steps[:, 2])) / 0.2) > 0.97).all()


def test_uncertain_initial_pose_is_published_and_recovered(shared_map):
    map_file = shared_map("rooms")
    spread = {f"initial_pose_covariance_{axis}": value for axis, value in (("xx", 0.1), ("yy", 0.1), ("yaw", 0.05))}
    sure, unsure = recordings(map_file)[0], recordings(map_file, **spread)[0]
    assert sure.columns["covariance_xx_mm2"][0] == 0
    assert 2e4 < unsure.columns["covariance_xx_mm2"][0] < 2e5
    off_m = np.hypot(*(poses(unsure) - poses(unsure, "estimated_"))[:, :2].T)
    assert np.median(off_m[len(off_m) // 2 :]) < 0.3
