"""AMCL's errors on drives along a corridor and through a room: the short form of tests/proofs/amcl_accuracy.py."""

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest
from table import each_row

from vastflow.sim.world.occupancy import OccupancyMap
from vastflow.sim.world.robot_model import Lidar

PROOF = Path(__file__).parents[1] / "proofs" / "amcl_accuracy.py"
RESOLUTION_M = 0.05
SEEDS = 6


@pytest.fixture(scope="module")
def accuracy():
    """The proof as a module."""
    spec = importlib.util.spec_from_file_location("amcl_accuracy", PROOF)
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def walled(rows, columns):
    """Return a map of free cells from (0, 0) on with a wall of one cell round them."""
    cells = np.full((rows + 20, columns + 20), -1, dtype=np.int8)
    cells[9 : rows + 11, 9 : columns + 11] = 100
    cells[10 : rows + 10, 10 : columns + 10] = 0
    return OccupancyMap(cells, RESOLUTION_M, (-10 * RESOLUTION_M, -10 * RESOLUTION_M))


def line(*corners):
    """A way through corners with a point each 0.05 m."""
    legs = [
        np.linspace(a, b, round(np.hypot(*(b - a)) / RESOLUTION_M) + 1)
        for a, b in zip(np.array(corners[:-1]), np.array(corners[1:]), strict=True)
    ]
    return np.concatenate([legs[0], *(leg[1:] for leg in legs[1:])])


@pytest.fixture(scope="module")
def corridor(accuracy):
    """A corridor of 16 m × 1 m, and 13 m of driving along it."""
    occupancy = walled(20, 320)
    return occupancy, accuracy.drive(occupancy, line((1.5, 0.5), (14.5, 0.5)), Lidar())


@pytest.fixture(scope="module")
def room(accuracy):
    """Drive 13 m round the pillar of a room of 6 m × 5 m that also has a shelf."""
    occupancy = walled(100, 120)
    occupancy.cells[60:68, 65:73] = 100
    occupancy.cells[60:90, 10:15] = 100
    way = line((1.2, 1.2), (4.8, 1.2), (4.8, 3.8), (1.2, 3.8), (1.2, 1.4), (2.2, 1.4))
    return occupancy, accuracy.drive(occupancy, way, Lidar())


@pytest.fixture(scope="module")
def errors(accuracy):
    """Errors of `SEEDS` filters, measured once for each place and condition."""
    known = {}

    def measure(place, **condition):
        occupancy, driven = place
        key = (id(occupancy), *sorted(condition.items()))
        if key not in known:
            what = accuracy.Condition("", **condition)
            runs = [accuracy.localize(occupancy, driven, Lidar(), what, seed) for seed in range(SEEDS)]
            names = ("along_m", "across_m", "yaw_rad", "particles", "position_m")
            known[key] = {name: np.concatenate([getattr(run, name) for run in runs]) for name in names}
        return known[key]

    return measure


def test_corridor_loses_the_place_along_it_and_not_that_across_it(corridor, errors):
    found = errors(corridor)
    assert np.abs(found["along_m"]).mean() > 2 * np.abs(found["across_m"]).mean()


def test_error_in_a_corridor_is_that_measured_with_nav2_s_filter(corridor, errors):
    """Nav2 measured 0.20 m in the mean and 0.41 m at the 95th percentile on 17 m of corridors."""
    found = errors(corridor)["position_m"]
    assert found.mean() == pytest.approx(0.20, rel=0.3)
    assert np.percentile(found, 95) == pytest.approx(0.41, rel=0.35)


def test_room_with_things_in_it_is_easier_than_a_corridor(room, corridor, errors):
    found = errors(room)["position_m"]
    assert 0.03 < found.mean() < 0.5 * errors(corridor)["position_m"].mean()
    assert np.percentile(found, 95) < 0.21


def test_yaw_is_kept_as_nav2_s_filter_keeps_it(room, corridor, errors):
    """0.012 to 0.014 rad in the mean."""
    for place in (room, corridor):
        assert errors(place)["yaw_rad"].mean() == pytest.approx(0.013, rel=0.3)


def test_number_of_particles_adapts_to_what_is_known(room, errors):
    """Nav2's filter has 500 to 1600 in rooms: all of them where no beam says anything."""
    exact, blind = errors(room)["particles"], errors(room, dropout=0.9)["particles"]
    assert np.percentile(exact, 5) == 501
    assert 520 < exact.mean() < 1000
    assert blind.mean() > 1600


@each_row("noise_m", [0.1, 0.2])
def test_noise_up_to_the_width_of_the_likelihood_hardly_hurts(room, corridor, errors, noise_m):
    for place in (room, corridor):
        assert errors(place, noise_m=noise_m)["position_m"].mean() < 1.3 * errors(place)["position_m"].mean() + 0.02


def test_half_of_the_beams_are_nearly_as_good_as_all(room, errors):
    assert errors(room, dropout=0.5)["position_m"].mean() < 1.5 * errors(room)["position_m"].mean()


def test_tenth_of_the_beams_is_too_few(room, corridor, errors):
    assert errors(room, dropout=0.9)["position_m"].mean() > 2 * errors(room)["position_m"].mean()
    assert np.abs(errors(corridor, dropout=0.9)["across_m"]).mean() > 1.5 * np.abs(errors(corridor)["across_m"]).mean()


def test_odometry_noise_of_a_tenth_makes_no_difference(room, errors):
    assert errors(room, odometry=0.1)["position_m"].mean() == pytest.approx(errors(room)["position_m"].mean(), rel=0.3)


def test_pose_is_odometry_and_particles_spread_without_a_single_beam(accuracy, room):
    occupancy, driven = room
    errors = accuracy.localize(occupancy, driven, Lidar(), accuracy.Condition("", dropout=1.0), 0)
    assert errors.particles[-10:].min() > 1500
    assert 0.1 < errors.position_m[-1] < 3.0
