"""The benchmark: pinned, so that its figure means the same thing next year."""

import json
import math

import pytest
from bench_show import shown
from bench_simulator import LARGE, ROUTES, SMALL, bench, benchmark_map, benchmark_routes
from table import each_row

from vastflow.sim.model.rates import TICK_S
from vastflow.sim.world.octile import passable, shortest_path


def test_maps_are_pinned():
    large, small = benchmark_map(LARGE), benchmark_map(SMALL)
    assert large.digest == "4b81e330fcdd2310eae21c696bc16a8ff887bb27fe050f20540a942f46686ec1"
    assert small.digest == "bb0fe3f30afcb6791c224b22cdc6ca6e9e690a779577cf57375f49c9d01323da"


@pytest.mark.slow
@each_row("floor", [LARGE, SMALL])
def test_routes_have_the_length_of_their_floor(floor):
    occupancy = benchmark_map(floor)
    free = passable(occupancy, 0.4)
    routes = benchmark_routes(occupancy, floor.route_m)
    assert len(routes) == ROUTES
    for route in routes:
        stops = [(pose.x_m, pose.y_m) for pose in (route.start, *route.mission.goals)]
        way = shortest_path(occupancy, free, stops)
        assert way is not None
        assert math.isclose(way[1], floor.route_m, abs_tol=0.06)


def test_controller_that_does_not_exist_is_refused():
    with pytest.raises(ValueError, match="controller: expected one of dwb, mppi, rpp, got 'teb'"):
        bench("teb")


@pytest.fixture(scope="module")
def measured():
    return bench("rpp")


@pytest.mark.slow
@each_row("floor", ["large", "small"])
def test_routes_are_driven_to_their_ends(measured, floor):
    found = measured if floor == "large" else measured["small"]
    assert (found["runs"], found["reached"], found["contacts"]) == (ROUTES, ROUTES, 0)
    assert found["driven_m"] == pytest.approx(ROUTES * found["map"]["route_m"], rel=0.15)
    assert found["x_real_time"] == pytest.approx(found["simulated_s"] / found["cpu_s"], rel=0.02)


@pytest.mark.slow
def test_control_cycle_takes_part_of_a_tick(measured):
    cycle, tick_us = measured["control_cycle"], 1e3 * measured["ms_per_simulated_s"] * TICK_S
    assert 0.1 < cycle["us"] < tick_us
    assert cycle["us"] * cycle["per_s_and_core"] == pytest.approx(1e6, rel=0.01)
    lines = dict(line.split(maxsplit=1) for line in shown(measured, as_json=False).splitlines())
    assert float(lines["control_cycle.us"]) == pytest.approx(cycle["us"], rel=1e-3)
    assert json.loads(shown(measured, as_json=True))["control_cycle"] == cycle
