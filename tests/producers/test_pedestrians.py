"""Pedestrians on routes of their own."""

import numpy as np
import pytest
from shapely.geometry import LineString, Point

from vastflow.producers.catalog.crossing import CrossingVariation
from vastflow.producers.catalog.pedestrians import PedestrianVariation
from vastflow.producers.model.configuration import Fragment, Rejection
from vastflow.producers.model.conformance import check_producer
from vastflow.producers.model.producer import evaluate
from vastflow.producers.places.ground import ground_of
from vastflow.sim.reading.movers import movers_of
from vastflow.sim.world.pedestrian import Pedestrian

ROOMS = [
    "####################",
    "#.......#..........#",
    "#.......#..........#",
    "#..................#",
    "#.......#....##....#",
    "#.......#....##....#",
    "#.......#..........#",
    "####################",
]
START = {"start_pose": {"x": 2.0, "y": 1.0}}


@pytest.fixture(scope="module")
def inputs(drawn_map):
    return {"map_file": drawn_map(*ROOMS, cells=16), **START}


def pedestrians(**parameters):
    return PedestrianVariation(PedestrianVariation.Parameters.model_validate(parameters))


def test_pedestrian_variation_keeps_the_contract(inputs, drawn_map):
    closet = drawn_map("####", "#..#", "####", cells=16)
    check_producer(pedestrians(amount=[0, 3], avoids_robot=[True, False], count=2), [inputs, {"map_file": closet}])


def test_routes_are_on_free_ground_of_their_length_and_off_the_start(inputs):
    (item,) = evaluate(pedestrians(amount=12, route=5.0, keep_off=1.5, seed=3), inputs)
    ground = ground_of(inputs["map_file"], 0.5)
    bodies = movers_of(item.values)
    assert [body.name for body in bodies] == [f"person {k}" for k in range(1, 13)]
    for body in bodies:
        assert isinstance(body.rule, Pedestrian)
        route = LineString(body.rule.waypoints)
        assert 0.85 * 2.5 < route.length <= 7.5
        assert route.distance(Point(2.0, 1.0)) > 1.4
        for at in np.arange(0.0, route.length, 0.05):
            assert ground.stands(*route.interpolate(at).coords[0])


def test_more_people_are_the_fewer_and_further_ones_on_equal_routes(inputs):
    items = evaluate(pedestrians(amount=[2, 5], avoids_robot=[True, False], count=2), inputs)
    assert all(isinstance(item, Fragment) for item in items)
    routes = [[entry["waypoints"] for entry in item.values["movers"]] for item in items]
    assert routes[0] == routes[2] == routes[4][:2] == routes[6][:2]
    assert routes[0] != routes[1] and routes[4] == routes[6]
    assert [movers_of(item.values)[0].rule.avoids_robot for item in items] == [True, True, False, False] * 2
    asked = [item.values["_requested_movers.person"] for item in items]
    assert [(a["amount"], a["avoids_robot"], a["draw"]) for a in asked[:3]] == [
        (2, True, 1),
        (2, True, 2),
        (2, False, 1),
    ]


def test_pedestrians_come_after_other_movers(inputs):
    crossing = CrossingVariation.Parameters.model_validate({"encounter_s": 6.0, "run_up": 0.5})
    (first,) = evaluate(CrossingVariation(crossing), {**inputs, "goal_pose": {"x": 7.0, "y": 1.0}})
    (item,) = evaluate(pedestrians(amount=1), {**inputs, **first.values})
    assert [entry["name"] for entry in item.values["movers"]] == ["crossing", "person 1"]
    assert {key for key in item.values if key.startswith("_")} == {"_requested_movers.person"}


def test_rooms_without_a_route_are_a_rejection(inputs):
    (item,) = evaluate(pedestrians(amount=2, route=100.0), inputs)
    assert item == Rejection(
        "no route for person 1 was found in 50 draws", {"amount": 2, "avoids_robot": True, "draw": 1}
    )
