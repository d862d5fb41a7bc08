"""Bodies that follow waypoints, as a producer writes them."""

import pytest
from pydantic import ValidationError

from vastflow.producers.catalog.mover import MoverVariation
from vastflow.producers.catalog.pedestrians import PedestrianVariation
from vastflow.producers.model.configuration import Rejection
from vastflow.producers.model.conformance import check_producer
from vastflow.producers.model.producer import evaluate
from vastflow.sim.model.shape import Box
from vastflow.sim.reading.movers import movers_of

GO = {"waypoints": [[0.5, -0.4], [5.5, -0.4]]}


@pytest.fixture(scope="module")
def inputs(drawn_map):
    return {"map_file": drawn_map("##########", "#........#", "#........#", "##########", cells=16)}


def mover(**parameters):
    return MoverVariation(MoverVariation.Parameters.model_validate({**GO, **parameters}))


def test_mover_variation_keeps_the_contract(inputs):
    check_producer(mover(speed_m_s=[0.5, 1], pause_s=[0, 2]), [inputs])
    check_producer(mover(waypoints=[[0.5, -0.4], [-0.9, -0.4]]), [inputs])


def test_mover_follows_waypoints_as_asked(inputs):
    asked = {"shape": {"length_m": 0.6, "width_m": 0.4}, "loop": "around", "phase_s": 4.0, "name": "cart"}
    items = evaluate(mover(**asked, speed_m_s=[0.5, 2], pause_s=1, start_s=[0, 3]), inputs)
    bodies = [movers_of(item.values)[0] for item in items]
    assert {(body.name, body.shape) for body in bodies} == {("cart", Box(0.6, 0.4))}
    rules = [body.rule for body in bodies]
    assert [(rule.speed_m_s, rule.start_s) for rule in rules] == [(0.5, 0), (0.5, 3), (2, 0), (2, 3)]
    assert {(rule.waypoints, rule.loop, rule.pause_s, rule.phase_s) for rule in rules} == {
        (((0.5, -0.4), (5.5, -0.4)), "around", 1.0, 4.0)
    }
    assert items[1].values["_requested_movers.cart"] == {"speed_m_s": 0.5, "pause_s": 1.0, "start_s": 3.0}


def test_movers_of_several_producers_are_told_apart(inputs):
    people = PedestrianVariation.Parameters.model_validate({"amount": 0, "route": 2.0, "keep_off": 0})
    found = dict(inputs)
    for each in (PedestrianVariation(people), mover(), mover(name="other", speed_m_s=2)):
        (item,) = evaluate(each, found)
        found |= item.values
    assert [entry["name"] for entry in found["movers"]] == ["mover", "other"]
    assert found["_requested_movers.person"]["amount"] == 0
    assert [found[f"_requested_movers.{name}"]["speed_m_s"] for name in ("mover", "other")] == [1.0, 2.0]


@pytest.mark.parametrize("place", [[-0.9, -0.4], [-50.0, -0.4]])
def test_waypoint_in_a_wall_is_a_rejection(inputs, place):
    (item,) = evaluate(mover(waypoints=[[0.5, -0.4], place]), inputs)
    assert item == Rejection(
        f"mover would stand in a wall at {place}", {"speed_m_s": 1.0, "pause_s": 0.0, "start_s": 0.0}
    )


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"waypoints": [[1, 1]]}, r"waypoints: expected 2 items or more, got \[\[1.0, 1.0\]\]"),
        ({"waypoints": [[1, 1]] * 2}, "expected waypoints that differ from the one before"),
        ({"waypoints": [[1, 1, 1], [2, 2, 2]]}, "expected a list of 2 numbers"),
        ({"speed_m_s": [1, 101]}, r"expected a number in \[0.001, 100\], got 101"),
        ({"name": "wall"}, "expected a name that no wall or obstacle has"),
    ],
)
def test_wrong_mover_is_a_fault_of_its_file(wrong, says):
    with pytest.raises(ValidationError, match=says):
        mover(**wrong)
