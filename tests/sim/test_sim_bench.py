"""The benchmark: pinned, so that its figure means the same thing next year."""

import math

import pytest

from vastflow.sim.bench import ROUTES, bench, benchmark_map, benchmark_missions
from vastflow.sim.octile import passable, shortest_path


@pytest.fixture(scope="module")
def occupancy():
    return benchmark_map()


def test_the_map_is_pinned(occupancy):
    assert occupancy.shape == (1400, 2000)
    assert occupancy.digest == "4b81e330fcdd2310eae21c696bc16a8ff887bb27fe050f20540a942f46686ec1"


def test_every_route_is_twenty_metres(occupancy):
    free = passable(occupancy, 0.4)
    missions = benchmark_missions(occupancy)
    assert len(missions) == ROUTES
    for mission in missions:
        stops = [(pose.x_m, pose.y_m) for pose in (mission.start, *mission.goals)]
        way = shortest_path(occupancy, free, stops)
        assert way is not None
        assert math.isclose(way[1], 20.0, abs_tol=0.06)


def test_a_controller_that_does_not_exist_is_refused():
    with pytest.raises(ValueError, match="controller: found 'mppi'; one of rpp"):
        bench("mppi")
