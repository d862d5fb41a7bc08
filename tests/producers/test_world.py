"""Worlds that are not as the robot's map has them."""

import pytest

from vastflow.producers.catalog.world import WorldVariation
from vastflow.producers.model.configuration import Fragment, Rejection
from vastflow.producers.model.conformance import check_producer
from vastflow.producers.model.producer import evaluate
from vastflow.sim.world.difference import differing
from vastflow.sim.world.environment import difference_of
from vastflow.sim.world.map_file import load_map

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
STOPS = {"start_pose": {"x": 0.0, "y": 0.0}, "goal_poses": [{"x": 5.0, "y": 0.0}]}


def world_variation(**parameters):
    return WorldVariation(WorldVariation.Parameters.model_validate(parameters))


@pytest.fixture(scope="module")
def inputs(drawn_map):
    return {"map_file": drawn_map(*ROOMS, cells=8), **STOPS}


def test_world_variation_keeps_the_contract(inputs, drawn_map):
    check_producer(
        world_variation(wall_offset=[0.0, 0.05], missing_furniture=[0, 0.5], count=2),
        [inputs, {**inputs, "start_pose": {"x": -0.9, "y": -1.9}}],
    )


def test_world_is_drawn_for_each_combination_and_each_of_count(inputs):
    items = evaluate(world_variation(wall_offset=[0.02, 0.05], missing_furniture=[0.1, 0.9], count=3), inputs)
    worlds = [item.values["world"] for item in items]
    assert [(w["wall_offset"], w["missing_furniture"]) for w in worlds] == [
        pair for pair in [(0.02, 0.1), (0.02, 0.9), (0.05, 0.1), (0.05, 0.9)] for _ in range(3)
    ]
    assert len({w["seed"] for w in worlds}) == 12


def test_equal_world_writes_only_provenance(inputs):
    (item,) = evaluate(world_variation(count=5), inputs)
    assert item == Fragment({"_wall_offset_m": 0.0, "_missing_furniture": 0.0})


def test_robot_finds_a_path_in_each_world(inputs):
    """With offsets of 0.3 m doors of 0.4 m are often closed; such worlds are drawn again."""
    found = [i for i in evaluate(world_variation(wall_offset=0.3, count=20), inputs) if isinstance(i, Fragment)]
    assert found
    occupancy = load_map(inputs["map_file"].path)
    for item in found:
        world = differing(occupancy, difference_of(item.values["world"]))
        for x_m in (0.0, 5.0):
            assert world.free[world.cell_of(x_m, 0.0)]


def test_world_without_path_between_stops_is_rejected_with_reason(inputs, drawn_map):
    parted = drawn_map(*(row if row[8] == "#" else f"{row[:8]}#{row[9:]}" for row in ROOMS), cells=8)
    for changes, reason in (
        ({"start_pose": {"x": -0.9, "y": -1.9}}, "a wall stands at the start"),
        ({"map_file": parted}, "walls part the start from a goal"),
    ):
        (item,) = evaluate(world_variation(wall_offset=0.01), inputs | changes)
        assert isinstance(item, Rejection)
        why = "in none of 20 worlds that were drawn does the robot find a path. In the last one,"
        assert item.reason == f"{why} {reason}"
    (item,) = evaluate(world_variation(wall_offset=0.1), {"map_file": inputs["map_file"]})
    assert isinstance(item, Fragment)
